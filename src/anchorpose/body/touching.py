"""How near other people's skin is to the patient's, in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.skin_points import PosedPoints
from anchorpose.body.visibility import VisibilityConfig, seen_skin
from anchorpose.camera import Camera
from anchorpose.isolation.crowd import Crowd
from anchorpose.isolation.view import View

HAND_M = 0.2  # from the finger tips of a hidden hand to the wrist that is seen


@dataclass(frozen=True, slots=True, eq=False)
class Nearness:
    """Pairs of a skin point of the patient's and somebody else within ``HAND_M`` of it, sorted by person, then point.

    person (n,) uint8: pixel label; point (n,) int32: skin point; distance_m (n,) float32: to that person's nearest
    skin; remembered (n,) bool: that skin is hidden now and was seen shortly before. shown (p,) bool: whether some
    camera sees the patient's skin, for each of his skin points.
    """

    person: np.ndarray
    point: np.ndarray
    distance_m: np.ndarray
    remembered: np.ndarray
    shown: np.ndarray


def find_nearness(
    posed: PosedPoints, crowd: Crowd, views: Sequence[View | None], cameras: Sequence[Camera], config: VisibilityConfig
) -> Nearness:
    """Distances from the posed skin to what is seen of all others, and to theirs that is remembered."""
    others, shown = crowd.others, seen_skin(posed, views, cameras, config)
    person, point, distance, remembered = [], [], [], []
    for label in np.flatnonzero(np.bincount(others.owner)).tolist():
        own = np.flatnonzero(_within(others.points_m, posed.points_m) & (others.owner == label))
        skin = np.flatnonzero(_within(posed.points_m, others.points_m[own]))
        found, nearest = cKDTree(others.points_m[own]).query(posed.points_m[skin], distance_upper_bound=HAND_M)
        near = np.isfinite(found)
        person.append(np.full(near.sum(), label, np.uint8))
        point.append(skin[near].astype(np.int32))
        distance.append(found[near].astype(np.float32))
        remembered.append(others.age_s[own[nearest[near]]] > 0.0)
    return Nearness(
        np.concatenate([np.zeros(0, np.uint8), *person]),
        np.concatenate([np.zeros(0, np.int32), *point]),
        np.concatenate([np.zeros(0, np.float32), *distance]),
        np.concatenate([np.zeros(0, bool), *remembered]),
        shown,
    )


def _within(points_m: np.ndarray, box_m: np.ndarray) -> np.ndarray:
    """(n,) bool: points no farther than ``HAND_M`` from the box around others."""
    if not len(box_m):
        return np.zeros(len(points_m), dtype=bool)
    low, high = box_m.min(axis=0) - HAND_M, box_m.max(axis=0) + HAND_M
    return np.asarray(((points_m > low) & (points_m < high)).all(axis=1))
