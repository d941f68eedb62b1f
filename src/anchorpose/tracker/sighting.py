"""Everybody who is seen in a frame, each with a rough body, before anything is known of who they are.

Where people touch, their surfaces go on into one another. A body tells: none explains two people.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import seen_past_by_all
from anchorpose.body.pose import TRUNK
from anchorpose.body.skin_points import pose_points
from anchorpose.isolation.people import FAINT, PatientChoice, People, Person, find_people
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.isolation.separation import label_people
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import FrameSet
from anchorpose.rotations import UP, unit
from anchorpose.tracker.bystanders import MOST_TRUNK_PAST, person_evidence, rough_person
from anchorpose.tracker.config import TrackConfig

ONE_PERSON: Final = 0.75  # of a person's nodes explained by a rough body: 0.5 to 0.7 where two people are taken for one
IN_EACH_OTHER_M: Final = 0.25  # from pelvis to pelvis: a trunk's depth and a rough body's error
BORDER_PX: Final = 4  # rows: filters leave the first ones without a reading
LIMBS_M: Final = 0.8  # above the floor, where the legs of an adult end
_ACROSS: Final = (("HipLeft", "HipRight"), ("ShoulderLeft", "ShoulderRight"))


@dataclass(frozen=True, slots=True, eq=False)
class RoughBody:
    """place_xz_m (2,): the pelvis; facing_xz (2,): unit vector from the back to the front; explained: 0 to 1, share of
    the person's nodes that the body accounts for; past: 0 to 1, share of the trunk's skin that cameras see past."""

    place_xz_m: np.ndarray
    facing_xz: np.ndarray
    explained: float
    past: float

    @property
    def possible(self) -> bool:
        """Whether cameras do not see past the trunk; rough bodies are a few centimetres off."""
        return self.past <= MOST_TRUNK_PAST


@dataclass(frozen=True, slots=True, eq=False)
class SeenPerson:
    """A person and the body; None where too little is seen of the person, or nobody is there to be confused with."""

    person: Person
    body: RoughBody | None

    @property
    def place_xz_m(self) -> np.ndarray:
        """(2,) the pelvis, or without a body the axis of the surface, which lies 0.1 m before it."""
        return self.person.ground_xz_m if self.body is None else self.body.place_xz_m


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Who is seen in the frame with a number; group: the person of each column, faint ones too (``find_people``).

    depths_m: each camera's depth image, None without a frame.
    """

    frame: int
    people: tuple[SeenPerson, ...]
    group: tuple[int, ...]
    depths_m: tuple[np.ndarray | None, ...]


def sight_people(frame_set: FrameSet, scenes: Sequence[Scene], config: TrackConfig) -> Sighting:
    """The people of one moment, with bodies where there are several columns.

    A person who is mostly hidden needs a body that no camera sees past. A person whom one body explains badly is
    split where several columns were taken for one; two whose bodies are in the same place are joined where one body
    explains both.
    """
    pieces = find_all_pieces(frame_set, scenes)

    def sighting_of(people: People) -> Sighting:
        seen = _with_bodies(people, pieces, scenes)
        return Sighting(frame_set.frame, seen, people.group, tuple(frame_set.depths_m))

    def grouped(group: Sequence[int]) -> Sighting:
        return sighting_of(find_people(pieces, config.isolation, group, faint=True))

    people = find_people(pieces, config.isolation, faint=True)
    sighting = sighting_of(people)
    if nobody := [k for k in people.faint if not _is_sure(sighting.people[k])]:
        sighting = grouped(_without(sighting.group, nobody))
    for poor in [k for k, seen in enumerate(sighting.people) if _explained(seen) < ONE_PERSON]:
        split = grouped(_split(sighting.group, poor))
        if _least_explained(split) > _least_explained(sighting):
            sighting = split
            break  # the others have new numbers
    for pair in _in_one_place(sighting):
        joined = grouped(_joined(sighting.group, *pair))
        if _explained(joined.people[min(pair)]) >= ONE_PERSON:
            return joined
    return sighting


def body_of_chosen(
    frame_set: FrameSet, choice: PatientChoice, scenes: Sequence[Scene], config: TrackConfig
) -> RoughBody | None:
    """The rough body of the person who was chosen in a frame, also of one who is alone; None as in SeenPerson."""
    pieces = find_all_pieces(frame_set, scenes)
    people = find_people(pieces, config.isolation, choice.group, faint=True)
    away_m = [float(np.linalg.norm(one.ground_xz_m - choice.ground_xz_m)) for one in people.people]
    views = label_people(pieces, people, np.arange(len(people.people)))
    label = PixelLabel.PATIENT + int(np.argmin(away_m))
    evidence = person_evidence(views, [scene.camera for scene in scenes], label)
    return _rough_body(evidence)


def shows_limbs_alone(frame_set: FrameSet, scenes: Sequence[Scene]) -> bool:
    """Whether the upper border of an image cuts a person off below where trunks begin."""
    for pixels in find_all_pieces(frame_set, scenes):
        if pixels is None:
            continue
        for piece in np.unique(pixels.piece[pixels.row < BORDER_PX]):
            own = pixels.piece == piece
            large = pixels.area_m2[own].sum() > FAINT.area_m2
            if large and np.percentile(pixels.points_m[own, 1], 99) < LIMBS_M:
                return True
    return False


def _is_sure(seen: SeenPerson) -> bool:
    """Whether a body explains a person who is mostly hidden; a camera would see past an arm's body."""
    return seen.body is not None and seen.body.possible and seen.body.explained >= ONE_PERSON


def _without(group: Sequence[int], people: Sequence[int]) -> tuple[int, ...]:
    """The columns of some people become nobody's."""
    left = sorted(set(group) - {-1, *people})
    return tuple(left.index(k) if k in left else -1 for k in group)


def _split(group: Sequence[int], person: int) -> tuple[int, ...]:
    """Each column of a person becomes a person of their own."""
    people = [(k, column) if k == person else (k, -1) for column, k in enumerate(group)]
    numbers = {one: number for number, one in enumerate(sorted({one for one in people if one[0] >= 0}))}
    return tuple(numbers.get(one, -1) for one in people)


def _joined(group: Sequence[int], first: int, second: int) -> tuple[int, ...]:
    """Two people become one, with the lower of their numbers."""
    low, high = sorted((first, second))
    return tuple(low if k == high else k - (k > high) for k in group)


def _in_one_place(sighting: Sighting) -> list[tuple[int, int]]:
    """Pairs of people whose bodies would stand in each other."""
    places = [None if seen.body is None else seen.body.place_xz_m for seen in sighting.people]
    return [
        (i, j)
        for (i, one), (j, other) in combinations(enumerate(places), 2)
        if one is not None and other is not None and np.linalg.norm(one - other) < IN_EACH_OTHER_M
    ]


def _explained(seen: SeenPerson) -> float:
    return 1.0 if seen.body is None else seen.body.explained


def _least_explained(sighting: Sighting) -> float:
    return min((_explained(seen) for seen in sighting.people), default=1.0)


def _with_bodies(people: People, pieces: Sequence[Pieces | None], scenes: Sequence[Scene]) -> tuple[SeenPerson, ...]:
    """Everybody with a body, from the pixels that are theirs when trunks grow up to the creases between people."""
    if len(set(people.group) - {-1}) < 2 and people.group.count(0) < 2:
        return tuple(SeenPerson(person, None) for person in people.people)
    views = label_people(pieces, people, np.arange(len(people.people)))
    cameras = [scene.camera for scene in scenes]
    return tuple(
        SeenPerson(person, _rough_body(person_evidence(views, cameras, PixelLabel.PATIENT + number)))
        for number, person in enumerate(people.people)
    )


def _rough_body(evidence: Evidence) -> RoughBody | None:
    person = rough_person(evidence)
    if person is None:
        return None
    body, found = person
    joints = body.joints(found.belief.pose)
    across = sum(unit(joints[JOINT_INDEX[right]] - joints[JOINT_INDEX[left]]) for left, right in _ACROSS)
    posed = pose_points(body, found.belief.pose)
    past = float(np.nan_to_num(seen_past_by_all(body.points, posed, evidence.views, evidence.cameras)[TRUNK]))
    return RoughBody(joints[0, [0, 2]], unit(np.cross(UP, across)[[0, 2]]), found.explained, past)
