"""Who is in a depth image: pixels that vote for one pelvis are one person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.descriptor.learnt import FOCAL_PX, STEP, Described

APART_M: Final = 0.35
"""Pelvises of people side by side are farther apart. Of the votes in 24 new scenes of the training's generator 96 % are
nearer to their own pelvis."""

NEAR_M: Final = 0.2  # around the middle of the votes of one person: twice their median error
STRAY_M: Final = 0.7  # from every pelvis: a vote for nobody

LEAST_AREA_M2: Final = 0.06
"""Of the surface that a camera sees of a person: a head with its neck. Clutter that is taken for people can be larger;
its certainty is lower."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundPerson:
    """pelvis_m (3,) in the camera's frame; rays (h, w) bool: those of ``Described`` that show this person; area_m2: of
    the surface that is seen, across the line of sight; certainty: mean probability of the pixels, 0.5 to 1."""

    pelvis_m: np.ndarray
    rays: np.ndarray
    area_m2: float
    certainty: float


def find_people(said: Described, depth_m: np.ndarray) -> tuple[FoundPerson, ...]:
    """Return the people of a described image (height, width), the one that shows most first.

    The pelvises are where the votes are densest, weighted by the area that a pixel shows, each found among the votes
    that are ``APART_M`` from those before. A pixel belongs to the pelvis nearest to its vote.
    """
    found = said.person >= 0.5
    votes, certainty = said.pelvis_m[found], said.person[found]
    area_m2 = (depth_m[said.row[found], said.column[found]] * STEP / FOCAL_PX) ** 2
    pelvises = _pelvises(votes, area_m2)
    if not len(pelvises):
        return ()
    distance, owner = cKDTree(pelvises).query(votes)
    owner[distance > STRAY_M] = -1
    people, places = list[FoundPerson](), np.nonzero(found)
    for number, pelvis_m in enumerate(pelvises):
        mine = owner == number
        area = float(area_m2[mine].sum())
        if area >= LEAST_AREA_M2:
            rays = np.zeros_like(found)
            rays[tuple(axis[mine] for axis in places)] = True
            people.append(FoundPerson(pelvis_m, rays, area, float(certainty[mine].mean())))
    return tuple(sorted(people, key=lambda person: -person.area_m2))


def _pelvises(votes_m: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(p, 3) the places that votes (n, 3) gather at, the heaviest first."""
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
    """(3,) the place with most weight about it: the best of some votes, moved to the mean around it until it stays."""
    some = votes_m[:: max(1, len(votes_m) // 200)]
    near = cKDTree(votes_m).query_ball_point(some, NEAR_M)
    centre = some[int(np.argmax([weight[rows].sum() for rows in near]))]
    for _ in range(10):
        inside = np.linalg.norm(votes_m - centre, axis=1) < NEAR_M
        moved = np.average(votes_m[inside], axis=0, weights=weight[inside])
        if np.linalg.norm(moved - centre) < 0.005:
            break
        centre = moved
    return np.asarray(centre)
