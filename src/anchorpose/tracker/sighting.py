"""Find all people in a frame, each with a rough body (a body of average shape), before the patient is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.explanation import seen_past_by_all
from anchorpose.body.pose import TRUNK
from anchorpose.body.skin_points import pose_points
from anchorpose.camera import Camera
from anchorpose.isolation.people import People, Person, see_people
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.isolation.separation import by_distance, label_people
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import FrameSet
from anchorpose.rotations import UP, unit
from anchorpose.tracker.bystanders import RoughPerson, rough_person

# m; a rough body covers all points that are closer than this to its skin, which allows for clothes and for errors of
# the fitted body
COVERED_M: Final = 0.10
# m, the depth of a trunk (front to back) plus an error; two bodies whose pelvises are closer than this are one person
IN_EACH_OTHER_M: Final = 0.25
TWO_PEOPLE_M: Final = 0.35  # m, breadth of a chest; the trunks of two people cannot be nearer to each other
_ACROSS: Final = (("HipLeft", "HipRight"), ("ShoulderLeft", "ShoulderRight"))


@dataclass(frozen=True, slots=True, eq=False)
class Crowd:
    """The people at one moment."""

    pieces: tuple[Pieces | None, ...]  # foreground of each camera; None if the camera has no frame
    people: People  # the people found in the foreground by the learnt descriptor
    bodies: tuple[RoughPerson | None, ...]  # one per person; None if too little of the person is seen

    def body_at(self, ground_xz_m: np.ndarray) -> RoughPerson | None:
        """Return the rough body of the person nearest to a place (2,); None without a person or a body."""
        order = by_distance(self.people, ground_xz_m)
        return self.bodies[order[0]] if len(order) else None


@dataclass(frozen=True, slots=True, eq=False)
class RoughBody:
    """The place, heading and fit of a rough body (a body of average shape that was fitted to a person)."""

    place_xz_m: np.ndarray  # (2,) m, place of the pelvis over the floor
    facing_xz: np.ndarray  # (2,) unit vector from the back to the front
    explained: float  # 0 to 1, share of the person's nodes that lie near the body
    # 0 to 1, share of the trunk's skin that cameras see past (they read something farther away there); NaN if unknown
    past: float


@dataclass(frozen=True, slots=True, eq=False)
class SeenPerson:
    """A person and their rough body, which is None if too little of the person is seen."""

    person: Person
    body: RoughBody | None

    @property
    def place_xz_m(self) -> np.ndarray:
        """Return the place (2,) of the fitted body's pelvis; without a body, the person's place on the ground."""
        return self.person.ground_xz_m if self.body is None else self.body.place_xz_m


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """The people seen in one frame."""

    frame: int  # number of the frame
    people: tuple[SeenPerson, ...]
    depths_m: tuple[np.ndarray | None, ...]  # each camera's depth image; None if the camera has no frame
    crowd: Crowd | None = None  # the pixels and rough body of each person, in the order of ``people``


def sight_people(frame_set: FrameSet, scenes: Sequence[Scene]) -> Sighting:
    """Return the people at one moment, each with a rough body (a body of average shape, fitted to the person)."""
    pieces, cameras = find_all_pieces(frame_set, scenes), [scene.camera for scene in scenes]
    crowd = see_people_apart(pieces, cameras)
    people = crowd.people
    views = label_people(pieces, people, np.arange(len(people.people)))
    seen = tuple(
        SeenPerson(person, None if body is None else _rough_body(body, views, cameras))
        for person, body in zip(people.people, crowd.bodies, strict=True)
    )
    return Sighting(frame_set.frame, seen, tuple(frame_set.depths_m), crowd)


def see_people_apart(pieces: Sequence[Pieces | None], cameras: Sequence[Camera]) -> Crowd:
    """Return the people at one moment with their rough bodies. A person whose points are covered by another person's
    body is merged into that person.

    The learnt descriptor estimates where a person's pelvis is. The estimate for a hidden pelvis may be half a metre
    off, so a person who is seen by two cameras may be taken for two people.
    """
    people = see_people(pieces, cameras)
    bodies = _bodies(pieces, people, cameras, np.arange(len(people.people)))
    owner = _owners(pieces, people, bodies)
    kept = np.flatnonzero(owner == np.arange(len(owner)))
    if len(kept) < len(owner):
        people = people.joined(owner)
        # bodies are fitted again only to people into whom another person was merged
        grown = np.flatnonzero(np.bincount(owner)[kept] > 1)
        fitted = dict(zip(grown.tolist(), _bodies(pieces, people, cameras, grown), strict=True))
        bodies = tuple(fitted.get(number, bodies[k]) for number, k in enumerate(kept.tolist()))
    return Crowd(tuple(pieces), people, bodies)


def _bodies(
    pieces: Sequence[Pieces | None], people: People, cameras: Sequence[Camera], numbers: np.ndarray
) -> tuple[RoughPerson | None, ...]:
    """Fit a rough body to each person whose index is in ``numbers``."""
    views = label_people(pieces, people, np.arange(len(people.people)))
    return tuple(rough_person(views, cameras, PixelLabel.PATIENT + number) for number in numbers.tolist())


def _owners(pieces: Sequence[Pieces | None], people: People, bodies: Sequence[RoughPerson | None]) -> np.ndarray:
    """Return, for each person (k,), the number of a larger person whose body covers most of this person. The result is
    the person's own number if no such larger person exists.
    """
    owner, skins = np.arange(len(people.people)), dict[int, cKDTree]()
    for number in np.argsort([-person.area_m2 for person in people.people], kind="stable").tolist():
        own_m = people.points_m(pieces, number)
        for other, skin in skins.items():
            if np.mean(np.isfinite(skin.query(own_m, distance_upper_bound=COVERED_M)[0])) > 0.5:
                owner[number] = other
                break
        body = bodies[number]
        if owner[number] == number and body is not None:
            skins[number] = cKDTree(pose_points(body.body, body.found.belief.pose).points_m)
    return owner


def rough_body_of(views: Sequence[View | None], cameras: Sequence[Camera], label: int) -> RoughBody | None:
    """Fit a rough body (average shape) to the person with this label, and return it; None if too little of the person
    is seen.
    """
    person = rough_person(views, cameras, label)
    return None if person is None else _rough_body(person, views, cameras)


def _rough_body(person: RoughPerson, views: Sequence[View | None], cameras: Sequence[Camera]) -> RoughBody:
    body, found = person
    joints = body.joints(found.belief.pose)
    across = sum(unit(joints[JOINT_INDEX[right]] - joints[JOINT_INDEX[left]]) for left, right in _ACROSS)
    posed = pose_points(body, found.belief.pose)
    past = float(seen_past_by_all(body.points, posed, views, cameras)[TRUNK])
    return RoughBody(joints[0, [0, 2]], unit(np.cross(UP, across)[[0, 2]]), found.explained, past)
