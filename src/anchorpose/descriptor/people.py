"""Find the people in depth images. For each pixel, the descriptor predicts the place of the person's pelvis (a vote);
pixels that vote for the same pelvis belong to the same person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from anchorpose.camera import Camera, transform_points
from anchorpose.descriptor.learnt import FOCAL_PX, STEP, Described, described, nearest_rays

APART_M: Final = 0.35
"""Minimum distance in metres between the pelvises of two people. In 24 simulated scenes that the network was not
trained on, 96 % of the votes are nearer than this to the pelvis of their person.
"""

# m, radius around a pelvis within which votes count for this pelvis; twice the median error of a vote
NEAR_M: Final = 0.2
STRAY_M: Final = 0.7  # m; a vote farther than this from every pelvis belongs to no person

MOST_VOTES: Final = 4000  # maximum number of votes that are counted; three cameras give 20,000

LEAST_AREA_M2: Final = 0.06
"""Minimum seen surface (m2) of a person: the area of a head with its neck. Objects can be larger, but have a lower
certainty."""


LEAST_CERTAINTY: Final = 0.7
"""Minimum of ``FoundPerson.certainty``. On labelled images of real rooms (``docs/descriptor.md``), all people in plain
view have a higher certainty. Some objects (0.2 to 3 per image) also have a certainty above this minimum. These objects
are rejected later, since the body model does not fit them (``tracker.patient_choice.HUMAN``).
"""


@dataclass(frozen=True, slots=True, eq=False)
class FoundPerson:
    """A person found by the descriptor."""

    pelvis_m: np.ndarray  # (3,) in the common frame of the cameras
    rays: tuple[np.ndarray | None, ...]  # per camera, (h, w) bool, rays that show the person; None without an image
    area_m2: float  # area of the seen surface, projected perpendicular to the lines of sight, summed over the cameras
    certainty: float  # mean probability that these pixels show a person, 0.5 to 1


def find_people(
    said: Sequence[Described | None], depths_m: Sequence[np.ndarray | None], poses: Sequence[np.ndarray]
) -> tuple[FoundPerson, ...]:
    """Return the people in described images (height, width) of one moment; the person with the largest seen area comes
    first.

    said, depths_m: one per camera, None without an image; poses: T_common_camera (4, 4) of each camera. A pelvis is
    where the votes of all cameras are densest, weighted by the area that each pixel shows. The next pelvis is searched
    among the votes at least ``APART_M`` from all pelvises found before. A pixel belongs to the pelvis nearest to its
    vote, if this pelvis is within ``STRAY_M`` of the vote. People with a seen area below ``LEAST_AREA_M2`` are left
    out.
    """
    votes = [_votes(one, depth, pose) for one, depth, pose in zip(said, depths_m, poses, strict=True)]
    shown = [one for one in votes if one is not None]
    if not shown:
        return ()
    every, area_m2 = np.concatenate([one.pelvis_m for one in shown]), np.concatenate([one.area_m2 for one in shown])
    pelvises = _pelvises(every, area_m2)
    if not len(pelvises):
        return ()
    distance, owner = cKDTree(pelvises).query(every)
    owner[distance > STRAY_M] = -1
    certainty = np.concatenate([one.certainty for one in shown])
    people = []
    for number, pelvis_m in enumerate(pelvises):
        mine = owner == number
        area = float(area_m2[mine].sum())
        if area >= LEAST_AREA_M2:
            people.append(FoundPerson(pelvis_m, _rays(mine, votes), area, float(certainty[mine].mean())))
    return tuple(sorted(people, key=lambda person: -person.area_m2))


# number of rays added around a person as a rim (6 cm at two metres), since the network leaves out fingers and shoes
RIM_RAYS: Final = 3
RIM_M: Final = 0.1  # m, maximum depth difference between the person and pixels of the rim


def people_mask(depth_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the pixels (height, width) bool of people that the descriptor is certain of, with a rim around them."""
    import cv2

    said = described(depth_m, camera)
    own = np.zeros(said.person.shape, dtype=bool)
    for one in find_people([said], [depth_m], [np.eye(4)]):
        if one.certainty >= LEAST_CERTAINTY and one.rays[0] is not None:
            own |= one.rays[0]
    rays_m, around = depth_m[said.row, said.column], np.ones((2 * RIM_RAYS + 1,) * 2, np.uint8)
    far = cv2.dilate(np.where(own, rays_m, np.float32(0.0)), around)
    near = -cv2.dilate(np.where(own, -rays_m, np.float32(-np.inf)), around)
    row, column, inside = nearest_rays(camera)
    return np.asarray(
        inside & (depth_m > near[row, column] - RIM_M) & (depth_m < far[row, column] + RIM_M) & (depth_m > 0)
    )


class _Votes(NamedTuple):
    """The votes of one camera: for each ray that shows a person, the predicted place of the person's pelvis, and the
    ray's area and certainty.
    """

    found: np.ndarray  # (h, w) bool, rays that show a person
    pelvis_m: np.ndarray  # (n, 3) votes of these rays for a pelvis, in the common frame
    area_m2: np.ndarray  # (n,) m2, area of the seen surface that each of these rays stands for
    certainty: np.ndarray  # (n,) probability that each of these rays shows a person


def _votes(said: Described | None, depth_m: np.ndarray | None, pose: np.ndarray) -> _Votes | None:
    if said is None or depth_m is None:
        return None
    found = said.person >= 0.5
    area_m2 = (depth_m[said.row[found], said.column[found]] * STEP / FOCAL_PX) ** 2
    return _Votes(found, transform_points(pose, said.pelvis_m[found]), area_m2, said.person[found])


def _rays(mine: np.ndarray, votes: Sequence[_Votes | None]) -> tuple[np.ndarray | None, ...]:
    """Return, per camera, (h, w) bool: the rays whose votes are True in ``mine`` (n,), a mask over the votes of all
    cameras.
    """
    rays, first = list[np.ndarray | None](), 0
    for one in votes:
        if one is None:
            rays.append(None)
            continue
        last, own = first + len(one.pelvis_m), np.zeros_like(one.found)
        own[one.found] = mine[first:last]
        rays.append(own)
        first = last
    return tuple(rays)


def _pelvises(votes_m: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the places (p, 3) around which votes (n, 3) are densest, in the order in which they are found: first the
    densest place of all votes, then the densest place of the votes that are more than ``APART_M`` from all earlier
    places.
    """
    step = 1 + len(votes_m) // MOST_VOTES
    votes_m, weight = votes_m[::step], weight[::step] * step
    left, found = np.ones(len(votes_m), dtype=bool), list[np.ndarray]()
    while weight[left].sum() >= LEAST_AREA_M2:
        centre = _densest(votes_m[left], weight[left])
        found.append(centre)
        apart = np.linalg.norm(votes_m - centre, axis=1) > APART_M
        if apart[left].all():
            break
        left &= apart
    return np.array(found).reshape(-1, 3)


def _densest(votes_m: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the place (3,) with most weight of votes around it. The search compares about 200 votes and starts at the
    vote with most weight around it. The search then moves from place to place: the next place is the weighted mean of
    the votes around the present place. The search ends when the place hardly changes.
    """
    some = votes_m[:: max(1, len(votes_m) // 200)]
    centre = some[int(np.argmax(_weight_near(some, votes_m, weight, NEAR_M)))]
    for _ in range(10):
        inside = np.linalg.norm(votes_m - centre, axis=1) < NEAR_M
        moved = np.average(votes_m[inside], axis=0, weights=weight[inside])
        if np.linalg.norm(moved - centre) < 0.005:
            break
        centre = moved
    return np.asarray(centre)


@njit(cache=True, nogil=True)
def _weight_near(places_m: np.ndarray, votes_m: np.ndarray, weight: np.ndarray, reach_m: float) -> np.ndarray:
    """Return the total weight (k,) of the votes (n, 3) within reach_m of each place (k, 3)."""
    found = np.zeros(len(places_m))
    for k in range(len(places_m)):
        x, y, z = places_m[k]
        for n in range(len(votes_m)):
            away2 = (votes_m[n, 0] - x) ** 2 + (votes_m[n, 1] - y) ** 2 + (votes_m[n, 2] - z) ** 2
            if away2 <= reach_m * reach_m:
                found[k] += weight[n]
    return found
