"""Search for a lost patient. A person who was seen together with the patient earlier is not taken for the patient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.body.belief import PoseBelief
from anchorpose.camera import Camera
from anchorpose.isolation.bystander_memory import CELL_M, BystanderMemory, update_memory
from anchorpose.isolation.people import PatientChoice, People, see_people
from anchorpose.isolation.scene import Pieces, find_all_pieces
from anchorpose.isolation.separation import separate
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.patient_choice import outside_m
from anchorpose.tracker.room import Room, Run
from anchorpose.tracker.sighting import see_people_apart
from anchorpose.tracker.start import NoStart

# m; a person this close to the patient's last place counts as standing there, as a partly seen person's place is
# inexact
NEAR_M: Final = 0.5
WALK_M_S: Final = 1.5  # m/s, speed at which people walk
# s, time for which the hidden skin of bystanders is remembered while the patient is lost; short, since the patient may
# reappear at the place of this skin
FORGET_S: Final = 1.0
RETURN_S: Final = 1.0  # s, minimum time in which a person can walk out of the image, turn round and come back
# m, width of half a trunk or a head; if the visible strip of a patient at the image border is narrower, the patient is
# leaving
STRIP_M: Final = 0.15
BORDER: Final = 0.1  # share of the image's width or height; stereo cameras may read nothing in a border this wide
# an image border cuts a person off if it touches at least this share of the person's pixel rows (or columns)
CUT: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class LastSeen:
    """The frame that showed the patient last, and the other people seen with the patient."""

    seen: Observation  # the last frame that shows the patient
    belief: PoseBelief  # the patient's pose in that frame
    met: frozenset[int] = frozenset()  # labels of all people who were followed together with the patient
    # (2,) m, place where each person's pelvis was last seen, by the person's label
    places: dict[int, np.ndarray] = field(default_factory=dict)
    gone_s: float = 0.0  # s, time since the frame ``seen``

    def after(self, following: Observation, belief: PoseBelief | None, elapsed_s: float) -> LastSeen:
        """Return this record after one more frame. belief: the pose in the new frame; None if that frame does not show
        the patient.
        """
        others = [one for one in following.bystanders.followed if one.hidden_s == 0.0]
        met = self.met | {one.label for one in others}
        places = self.places | {one.label: one.belief.pose.root_m[[0, 2]] for one in others}
        if belief is not None:
            return LastSeen(following, belief, met, places)
        return replace(self, met=met, places=places, gone_s=self.gone_s + elapsed_s)


class Search:
    """The search for a lost patient. Bystanders are still followed, so that none of them is taken for the patient.

    now: the frame in which the patient was lost; last: the frame that showed the patient last; left: whether the
    patient has walked out of the image.
    """

    memory: BystanderMemory  # the remembered skin of all people after the last frame searched
    _belief: PoseBelief
    _time_s: float
    _place_xz_m: np.ndarray
    _lost_s: float
    _newcomer: int
    _met: frozenset[int]
    _places: dict[int, np.ndarray]
    _left: bool
    _skin_m: np.ndarray  # (n, 3) m, the patient's skin as last seen
    _moved: bool  # whether a camera has seen past most of this skin since then, so that the patient is somewhere else

    def __init__(self, now: Observation, last: LastSeen, left: bool = False) -> None:
        self.memory, self._time_s = now.memory.without_patient.since(FORGET_S), now.frame_set.time_s
        self._belief, self._lost_s = last.belief, last.seen.frame_set.time_s
        self._place_xz_m = last.belief.pose.root_m[[0, 2]]
        # people who came after the patient was last seen have this label, or a label that was given later
        self._newcomer = last.seen.memory.next_label
        self._met, self._places, self._left = last.met, last.places, left
        self._skin_m = last.seen.memory.seen_last.get(PixelLabel.PATIENT, np.zeros((0, 3), np.float32))
        self._moved = False

    def look(self, frame_set: FrameSet, run: Run) -> PatientChoice | NoStart:
        """Return the person who may be the patient in this frame, or the reason why no person may be. Call this method
        for all frames in order.

        A new person may be a known bystander with a new label, if the person appears in another place, if the patient
        has left the image, or if a camera has seen since then that nobody is where the patient was lost. Such a person
        counts as the patient only if standing in the equipment, or while all bystanders are in view. A person who
        enters too soon after the patient has left is not the patient.
        """
        pieces, cameras = find_all_pieces(frame_set, run.room.scenes), run.room.cameras
        elapsed_s = frame_set.time_s - self._time_s
        views = separate(pieces, self.memory, None, elapsed_s, cameras)
        self.memory = update_memory(self.memory, pieces, views, cameras, elapsed_s).since(FORGET_S)
        self._time_s = frame_set.time_s
        self._moved |= _is_seen_past(self._skin_m, pieces, cameras)
        if self._left and abs(frame_set.time_s - self._lost_s) < RETURN_S:
            self._met |= _people_in(views)
            self._newcomer = self.memory.next_label
        reach_m = NEAR_M + WALK_M_S * abs(frame_set.time_s - self._lost_s)
        people = see_people(pieces, cameras)
        axes, in_view = self._candidates(people, pieces, views, reach_m)
        if axes:  # the descriptor may take a piece of a bystander for a new person; bodies show this, but take longer
            people = see_people_apart(pieces, cameras).people
            axes, in_view = self._candidates(people, pieces, views, reach_m)
        if not axes:
            return NoStart.NOBODY_NEW if people.people else NoStart.NOBODY_THERE
        nearest = min(axes, key=self._away_m)
        elsewhere = self._left or self._moved or self._away_m(nearest) > NEAR_M
        if elsewhere and not self._met <= in_view and not _in_equipment(nearest, run.room):
            return NoStart.WHO_IS_IT
        return PatientChoice(
            nearest, "is nearest to where the patient was lost, among people who were not there before", sure=False
        )

    def _away_m(self, axis_xz_m: np.ndarray) -> float:
        """Return how far a place (2,) is from the place where the patient was last seen."""
        return float(np.linalg.norm(axis_xz_m - self._place_xz_m))

    def _is_someone_hidden(self, axis_xz_m: np.ndarray, in_view: frozenset[int]) -> bool:
        """Return whether a person at a place (2,) may be a bystander who is out of view. This is possible if the
        bystander's last place is nearer to this place than the patient's last place is. Such a bystander may reappear
        before the patient, under a new label.
        """
        hidden = [place for label, place in self._places.items() if label not in in_view]
        return any(np.linalg.norm(axis_xz_m - place) < self._away_m(axis_xz_m) for place in hidden)

    def expected(self, time_s: float) -> PoseBelief | None:
        """Return the pose in which a lost patient is expected: the last pose, which becomes less certain with time.
        This pose helps to recognise the patient: patients who are hidden behind a therapist do not turn round within a
        second. The result is None if the patient has walked out of the image.
        """
        return None if self._left else self._belief.later(self._belief.pose, abs(time_s - self._lost_s))

    def _candidates(
        self, people: People, pieces: Sequence[Pieces | None], views: Sequence[View | None], reach_m: float
    ) -> tuple[list[np.ndarray], frozenset[int]]:
        """Return the places (2,) of the people who may be the patient, since they are no bystanders seen before and
        stand within ``reach_m`` of the patient's last place; and the labels of the bystanders who are in view.

        Each bystander is matched with at most one of the people: the person with most pixels of the bystander's label.
        Labels may spread from one person to another who touches them, but the learnt descriptor still finds two people.
        A bystander is in view if the bystander's label is the most frequent label of a person's pixels: a few pixels
        with this label may be left on another person.
        """
        known = sorted(self._met - self.memory.given_since(self._newcomer))
        shared = np.zeros((len(people.people), 256), np.int64)
        for piece, own, view in zip(pieces, people.of, views, strict=True):
            if piece is not None and own is not None and view is not None:
                labels = view.labels[piece.row, piece.column]
                np.add.at(shared, (own[own >= 0], labels[own >= 0]), 1)
        who, label = linear_sum_assignment(-shared[:, known])
        taken = {int(k) for k, n in zip(who, label, strict=True) if shared[k, known[n]] > 0}
        in_view = frozenset(shared.argmax(axis=1).tolist())
        axes = [person.ground_xz_m for k, person in enumerate(people.people) if k not in taken]
        near = [axis for axis in axes if self._away_m(axis) <= reach_m]
        return [axis for axis in near if not self._is_someone_hidden(axis, in_view)], in_view


def _is_seen_past(skin_m: np.ndarray, pieces: Sequence[Pieces | None], cameras: Sequence[Camera]) -> bool:
    """Return whether a camera sees past most of these points on a person's skin (n, 3): its readings there lie farther
    away. The result is False without points.
    """
    for pixels, camera in zip(pieces, cameras, strict=True):
        if pixels is not None and len(skin_m):
            own, read, inside = camera.look(skin_m, pixels.depth_m)
            if np.median(np.where(inside, read - own, 0.0)) > CELL_M:
                return True
    return False


def _people_in(views: Sequence[View | None]) -> frozenset[int]:
    """Return the labels, in all views, of the people other than the patient."""
    seen = np.zeros(256, dtype=bool)
    for view in views:
        if view is not None:
            seen |= np.bincount(view.labels.ravel(), minlength=256) > 0
    return frozenset((np.flatnonzero(seen[PixelLabel.OTHER_PERSON :]) + int(PixelLabel.OTHER_PERSON)).tolist())


def seen_as_strip(views: Sequence[View | None], cameras: Sequence[Camera]) -> bool:
    """Return whether every camera that sees the patient shows only a narrow strip at the border of its image.

    The result is False if no camera sees the patient, since the patient may then be hidden.
    """
    seen = [(view, camera) for view, camera in zip(views, cameras, strict=True) if view is not None]
    shown = [(view, camera) for view, camera in seen if view.patient.any()]
    return bool(shown) and all(_is_strip(view, camera) for view, camera in shown)


def _is_strip(view: View, camera: Camera) -> bool:
    """Return whether the patient's pixels extend less than ``STRIP_M`` from an image border. If pixels at the border
    have no readings, the extent is measured from the readings nearest to the border.
    """
    lens = camera.intrinsics
    sides = (
        (view.patient, view.depth_m, lens.fx),
        (view.patient[:, ::-1], view.depth_m[:, ::-1], lens.fx),
        (view.patient.T, view.depth_m.T, lens.fy),
        (view.patient[::-1].T, view.depth_m[::-1].T, lens.fy),
    )
    return any(_reach_m(patient, depth_m, focal_px) < STRIP_M for patient, depth_m, focal_px in sides)


def _reach_m(patient: np.ndarray, depth_m: np.ndarray, focal_px: float) -> float:
    """Return how far the patient's pixels extend from column 0 (a border of the image), in metres; infinite if this
    border does not cut the patient off.
    """
    if not patient[:, : int(np.ceil(BORDER * patient.shape[1]))].any():
        return float("inf")
    rows = np.flatnonzero(patient.any(axis=1))
    first_px = (depth_m[rows] > 0).argmax(axis=1)
    at_border = (patient[rows].argmax(axis=1) == first_px) & (first_px < BORDER * patient.shape[1])
    if at_border.mean() < CUT:
        return float("inf")
    row, column = np.nonzero(patient)
    first_px = np.zeros(len(patient), np.int64)
    first_px[rows] = patient[rows].argmax(axis=1)
    return float(np.percentile((column - first_px[row]) * depth_m[row, column] / focal_px, 95))


def _in_equipment(place_xz_m: np.ndarray, room: Room) -> bool:
    equipment = room.recording.equipment
    return equipment is not None and outside_m(place_xz_m, equipment) == 0.0
