"""Find the people in the foreground of all cameras by the learnt descriptor, a network that finds people in depth
images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import described, nearest_rays
from anchorpose.descriptor.people import LEAST_AREA_M2, LEAST_CERTAINTY, FoundPerson, find_people
from anchorpose.isolation.scene import Pieces
from anchorpose.threads import each

PERSON_AREA_M2: Final = 0.12  # m2, minimum seen surface of a person, a fifth of an adult's frontal area
FOREGROUND: Final = 0.33
"""Minimum ratio of the area of a found person's foreground pixels to the area that the descriptor states for this
person. The ratio is tested only if the area of the foreground pixels is smaller than ``LEAST_AREA_M2``. For people, it
is 0.5 to 0.9 and not 1, since the descriptor's rays (points of its coarse grid) at a person's outline have no
foreground pixel at their depth; for parts of the room that were mistaken for people, it was 0.1 and 0.16.
"""

# m, maximum difference between the depths of a pixel and of the descriptor's nearest ray (a point of its coarse grid);
# if the difference is larger, the outline of a surface lies between both
EDGE_M: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """One person as seen by all cameras at one moment."""

    ground_xz_m: np.ndarray  # (2,) float64, X and Z of the pelvis in the world, metres
    bottom_m: float  # height of the lowest point of the seen surface
    top_m: float  # height of the highest point of the seen surface
    area_m2: float  # area of the seen surface


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """The people at one moment."""

    people: tuple[Person, ...]
    of: tuple[np.ndarray | None, ...]  # per camera, (n,) int32, number of each foreground pixel's person, -1 = nobody

    def points_m(self, pieces: Sequence[Pieces | None], number: int) -> np.ndarray:
        """Return the points (n, 3) in the world at a person's pixels in all cameras. number: the person's number."""
        shown = [(pixels, own) for pixels, own in zip(pieces, self.of, strict=True) if pixels is not None]
        return np.concatenate([pixels.points_m[own == number] for pixels, own in shown])

    def joined(self, owner: np.ndarray) -> People:
        """Merge people. owner (k,): for each person, the number of the person with whom they are merged, or their own
        number.
        """
        kept = np.flatnonzero(owner == np.arange(len(owner)))
        members = [[self.people[k] for k in np.flatnonzero(owner == number)] for number in kept]
        number = np.append(np.searchsorted(kept, owner), -1)  # the last entry means nobody
        people = [
            Person(
                self.people[k].ground_xz_m,
                min(one.bottom_m for one in parts),
                max(one.top_m for one in parts),
                sum(one.area_m2 for one in parts),
            )
            for k, parts in zip(kept, members, strict=True)
        ]
        return People(tuple(people), tuple(None if of is None else number[of].astype(np.int32) for of in self.of))


@dataclass(frozen=True, slots=True, eq=False)
class PatientChoice:
    """The place of the patient in a frame, and why this person was chosen."""

    ground_xz_m: np.ndarray  # (2,) float64, X and Z
    reason: str  # text for users after "who", such as "stands within the equipment"
    # whether the choice is certain: the user named the patient, or the patient is in the equipment and nobody else is
    # nearly as likely to be the patient
    sure: bool
    frame: int | None = None  # number of the frame in which the patient is there; None if the frame does not matter
    rival_xz_m: np.ndarray | None = None  # (2,) place of another person who may be the patient; None if there is none


def see_people(pieces: Sequence[Pieces | None], cameras: Sequence[Camera]) -> People:
    """Find the people in the foreground of all cameras at one moment by the learnt descriptor, a network that finds
    people in depth images.

    A pixel gets the number of the person whom the descriptor finds at its nearest ray (a point of the descriptor's
    coarse grid), or -1 if this ray shows no person.
    """
    depths = [None if pixels is None else pixels.depth_m for pixels in pieces]
    said = each(lambda depth, camera: None if depth is None else described(depth, camera), depths, cameras)
    found = find_people(said, depths, [camera.require_pose() for camera in cameras])
    found = tuple(one for one in found if one.certainty >= LEAST_CERTAINTY)
    of = [
        None if pixels is None else _person_of_pixels(pixels, camera, [one.rays[number] for one in found])
        for number, (pixels, camera) in enumerate(zip(pieces, cameras, strict=True))
    ]
    shown = [(pixels, own) for pixels, own in zip(pieces, of, strict=True) if pixels is not None and own is not None]
    seen = [_person_seen(number, one, shown) for number, one in enumerate(found)]
    kept = [number for number, person in enumerate(seen) if person is not None]
    renumbered = np.full(len(seen) + 1, -1, np.int32)
    renumbered[kept] = np.arange(len(kept))
    people = tuple(person for person in seen if person is not None)
    return People(people, tuple(None if own is None else renumbered[own] for own in of))


def _person_of_pixels(pixels: Pieces, camera: Camera, rays: Sequence[np.ndarray | None]) -> np.ndarray:
    """Return the person (n,) int32 of each foreground pixel, -1 if the descriptor's nearest ray (a point of its coarse
    grid) shows no person or has a different depth. rays: for each person (h, w) bool, the rays that show this person in
    this camera.
    """
    said = described(pixels.depth_m, camera)
    owner = np.full(said.person.shape, -1, np.int32)
    for number, own in enumerate(rays):
        if own is not None:
            owner[own] = number
    row, column, inside = (axis[pixels.row, pixels.column] for axis in nearest_rays(camera))
    at_ray_m = pixels.depth_m[said.row[row, column], said.column[row, column]]
    same = inside & (np.abs(at_ray_m - pixels.depth_m[pixels.row, pixels.column]) < EDGE_M)
    return np.where(same, owner[row, column], np.int32(-1))


def _person_seen(number: int, found: FoundPerson, shown: Sequence[tuple[Pieces, np.ndarray]]) -> Person | None:
    """Return the found person with this number, measured on the person's foreground pixels. Return None if these pixels
    are too few: the descriptor then mistook a part of the room for a person.
    """
    heights = np.concatenate([pixels.points_m[own == number, 1] for pixels, own in shown])
    area_m2 = sum(float(pixels.area_m2[own == number].sum()) for pixels, own in shown)
    if area_m2 < min(LEAST_AREA_M2, FOREGROUND * found.area_m2):
        return None
    bottom, top = np.percentile(heights, [1, 99])
    return Person(found.pelvis_m[[0, 2]], float(bottom), float(top), area_m2)
