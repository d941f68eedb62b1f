"""A patient through all frames: found, followed, lost, searched for and found again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from anchorpose.body.skin_points import FittedShape
from anchorpose.isolation.bystander_memory import SAMPLE_PX, update_memory
from anchorpose.isolation.people import PERSON_RADIUS_M, PatientChoice, Person, find_people, ground_distance
from anchorpose.isolation.scene import Pieces, find_all_pieces
from anchorpose.isolation.separation import separate
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate, nobody_found
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.patient_choice import outside_m
from anchorpose.tracker.room import Room
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import NoStart, Start, find_start

FIRST_PAUSE, LONGEST_PAUSE = 5, 15  # frames between searches that fail, doubled each time: one costs thirty frames
NEAR_M = 0.5  # from where the patient was last seen: what remains visible is off the body's axis
WALK_M_S = 1.5  # as fast as people walk
UNSEEN = "the patient was not seen any more"
BYSTANDER = 0.5  # share of a person's visible pixels that belong to a known bystander


def follow_patient(
    run: Run, frames: Iterable[FrameSet], known: FittedShape | None, begin: Start | None = None
) -> Iterator[Estimate]:
    """An estimate for every frame, in order: lost until the patient is found, followed, and searched for when lost.

    frames: in the order of time, or against it; the first one should be the room's initial frame. known: the learnt
    shape; None where it is still to be learnt. begin: the patient as already found in the first frame.
    """
    choice = run.room.initial_frame.choice if run.room.initial_frame else None
    for estimate, _ in follow_openly(run, frames, choice, known, begin):
        yield estimate


def follow_openly(
    run: Run,
    frames: Iterable[FrameSet],
    choice: PatientChoice | None,
    known: FittedShape | None,
    begin: Start | None = None,
) -> Iterator[tuple[Estimate, PatientTracker | None]]:
    """As ``follow_patient``, from any frame, and with the tracker as it stands after each estimate, if any.

    choice: where the patient stands in the first frame, None where nobody is to be looked for.
    """
    tracker: PatientTracker | None = None
    search: Search | None = None  # once the patient was followed and lost
    wait, pause, found = 0, FIRST_PAUSE, NoStart.NOBODY_THERE
    for frame_set in frames:
        if tracker is not None:
            if (estimate := tracker.step(frame_set)) is not None:
                yield estimate, tracker
            if tracker.unseen_s > run.config.follow.lost_after_s:
                search, known = Search.after(tracker, run), tracker.shape
                yield from ((nobody_found(seen.frame_set, UNSEEN, seen), None) for seen in list(tracker.window)[1:])
                tracker = None
            continue
        wait -= 1
        if search is not None:
            with run.stage("isolation"):
                looked = search.look(frame_set, run)
            choice, found = (None, looked) if isinstance(looked, NoStart) else (looked, found)
        if choice is not None and wait < 0:
            start, begin = begin or find_start(frame_set, run, choice, known), None
            if isinstance(start, Start):
                tracker, search = PatientTracker(run, start), None
                wait, pause = 0, FIRST_PAUSE
                yield tracker.first, tracker
                continue
            found = start
            if start is NoStart.NO_BODY_FITS:
                wait, pause = pause, min(2 * pause, LONGEST_PAUSE)
        yield nobody_found(frame_set, found.value), None
    if tracker is not None:
        for estimate in tracker.finish():
            yield estimate, tracker


class Search:
    """Bystanders are still followed while the patient is lost, so that none of them is taken for the patient.

    now: the last frame looked at; last_found: the last in which the patient was seen; place_m (3,): where the patient
    should be now; met: labels of the people who were followed beside the patient; left: the patient was last seen
    leaving the picture.
    """

    def __init__(
        self,
        now: Observation,
        last_found: Observation,
        place_m: np.ndarray,
        met: frozenset[int] = frozenset(),
        left: bool = False,
    ) -> None:
        self._memory, self._time_s = now.memory.without_patient, now.frame_set.time_s
        self._place_xz_m, self._lost_s = place_m[[0, 2]], last_found.frame_set.time_s
        self._newcomer = last_found.memory.next_label  # labels from this on are of people who came since
        self._met, self._left = met, left

    @classmethod
    def after(cls, tracker: PatientTracker, run: Run) -> Search:
        """The search that begins where a tracker lost the patient."""
        place_m = tracker.belief.pose.root_m
        left = not any(camera.shows(place_m) for camera in run.room.cameras)
        return cls(tracker.window[-1], tracker.last_found, place_m, frozenset(tracker.met), left)

    def look(self, frame_set: FrameSet, run: Run) -> PatientChoice | NoStart:
        """Who may be the patient in this frame, or why nobody may be; frames come in order, without gaps.

        Whoever comes in after the patient has left the picture may be another person who was there before: only where
        everybody else who was met is in view, or in the equipment, it is the patient.
        """
        pieces, config = find_all_pieces(frame_set.depths_m, run.room.scenes), run.config
        elapsed_s = frame_set.time_s - self._time_s
        views = separate(pieces, self._memory, None, elapsed_s, config.isolation)
        self._memory = update_memory(self._memory, pieces, views, run.room.cameras, elapsed_s)
        self._time_s = frame_set.time_s
        reach_m = NEAR_M + WALK_M_S * abs(frame_set.time_s - self._lost_s)
        people = find_people(pieces, config.isolation).people
        axes = [one.ground_xz_m for one in people if self._may_be_patient(one, pieces, views, reach_m, config)]
        if not axes:
            return NoStart.NOBODY_NEW if people else NoStart.NOBODY_THERE
        nearest = min(axes, key=lambda axis: float(np.linalg.norm(axis - self._place_xz_m)))
        if self._left and self._somebody_is_away(views) and not _in_equipment(nearest, run.room):
            return NoStart.WHO_IS_IT
        return PatientChoice(
            nearest, "is nearest to where the patient was lost, of those who were not there before", sure=False
        )

    def _somebody_is_away(self, views: Sequence[View | None]) -> bool:
        """Whether a person who was met beside the patient is not in view."""
        seen = np.zeros(256, dtype=bool)
        for view in views:
            if view is not None:
                seen |= np.bincount(view.labels.ravel(), minlength=256) > 0
        return not all(seen[label] for label in self._met)

    def _may_be_patient(
        self,
        person: Person,
        pieces: Sequence[Pieces | None],
        views: Sequence[View | None],
        reach_m: float,
        config: TrackConfig,
    ) -> bool:
        """Whether a person is near enough to have come from there and is not a bystander who was followed meanwhile."""
        if np.linalg.norm(person.ground_xz_m - self._place_xz_m) > reach_m:
            return False
        labels = _labels_about(person.ground_xz_m, pieces, views, config)
        known = (labels >= PixelLabel.OTHER_PERSON) & (labels < self._newcomer)
        return float(np.mean(known)) < BYSTANDER


def _labels_about(
    axis_xz_m: np.ndarray, pieces: Sequence[Pieces | None], views: Sequence[View | None], config: TrackConfig
) -> np.ndarray:
    """(n,) uint8 labels of every third pixel of the people that stands about an axis."""
    found = [np.zeros(0, np.uint8)]
    for piece, view in zip(pieces, views, strict=True):
        if piece is not None and view is not None:
            near = np.flatnonzero(ground_distance(piece.points_m, axis_xz_m) < PERSON_RADIUS_M)
            near = near[::SAMPLE_PX]
            found.append(view.labels[piece.row[near], piece.column[near]])
    return np.concatenate(found)


def _in_equipment(place_xz_m: np.ndarray, room: Room) -> bool:
    equipment = room.recording.equipment
    return equipment is not None and outside_m(place_xz_m, equipment) == 0.0
