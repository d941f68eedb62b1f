"""The patient is lost: where to look for him again, and who he is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.isolation.bystander_memory import SAMPLE_PX, update_memory
from anchorpose.isolation.people import PatientChoice, Person, find_people, ground_distance
from anchorpose.isolation.scene import Pieces, find_pieces
from anchorpose.isolation.separation import separate
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.room import Room

NEAR_M = 0.5  # from where he was seen last: he stood there, and what is left of him to see is off his axis
WALK_M_S = 1.5  # as fast as people walk
BYSTANDER = 0.5  # of what is seen of somebody: so much belongs to one who was there beside the patient


class Search:
    """Everybody else is followed on while the patient is lost, so that nobody of them is taken for him.

    now: the last frame looked at; last_found: the last in which he was seen; place_m (3,): where he should be now.
    """

    def __init__(self, now: Observation, last_found: Observation, place_m: np.ndarray) -> None:
        self._memory, self._time_s = now.memory.without_patient, now.frame_set.time_s
        self._place_xz_m, self._lost_s = place_m[[0, 2]], last_found.frame_set.time_s
        self._newcomer = last_found.memory.next_label  # labels from this on are of people who came since

    def look(self, frame_set: FrameSet, room: Room, config: TrackConfig) -> PatientChoice | None:
        """Who may be the patient in this frame, None where nobody may; frames come in their order, none is left out."""
        pieces = [
            None if depth is None else find_pieces(depth, scene, config.isolation)
            for depth, scene in zip(frame_set.depths_m, room.scenes, strict=True)
        ]
        elapsed_s = frame_set.time_s - self._time_s
        views = separate(pieces, self._memory, None, elapsed_s, config.isolation)
        self._memory = update_memory(self._memory, pieces, views, room.cameras, elapsed_s, config.isolation)
        self._time_s = frame_set.time_s
        reach_m = NEAR_M + WALK_M_S * abs(frame_set.time_s - self._lost_s)
        people = find_people(pieces, config.isolation).people
        axes = [
            person.ground_xz_m for person in people if self._may_be_him(person, pieces, views, reach_m, config)
        ]  # fmt: skip
        if not axes:
            return None
        nearest = min(axes, key=lambda axis: float(np.linalg.norm(axis - self._place_xz_m)))
        return PatientChoice(nearest, "nearest to where he was lost of those who were not beside him", sure=False)

    def _may_be_him(
        self, person: Person, pieces: Sequence[Pieces | None], views: Sequence[View | None], reach_m: float,
        config: TrackConfig,
    ) -> bool:  # fmt: skip
        """Whether somebody is near enough to have come from there, and is nobody who was followed all the while."""
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
            near = np.flatnonzero(ground_distance(piece.points_m, axis_xz_m) < config.isolation.person_radius_m)
            near = near[::SAMPLE_PX]
            found.append(view.labels[piece.row[near], piece.column[near]])
    return np.concatenate(found)
