"""The parts of the body that clinicians name as sets of skin points, and how near other people's skin is to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.config import VisibilityConfig
from anchorpose.body.regions import REGION_BONES, REGIONS
from anchorpose.body.skin_points import PosedPoints, SkinPoints
from anchorpose.body.visibility import seen_skin
from anchorpose.camera import Camera
from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.view import View

KNEE_RADIUS_M: Final = 0.10  # from the joint's centre: the kneecap and a hand's breadth around the leg


@cache
def region_of_points(points: SkinPoints) -> np.ndarray:
    """(p,) index into ``REGIONS`` of every skin point; the knee is the skin of thigh and shank around its joint."""
    asset = points.asset
    whole = {bone: k for k, (name, bones) in enumerate(REGION_BONES.items()) if not _is_knee(name) for bone in bones}
    of_bone = np.array([whole[name] for name in asset.bone_names])
    region = of_bone[points.part]
    place = asset.vertices[points.vertex]
    for side in ("Left", "Right"):
        leg = np.isin(points.part, [asset.bone(f"{side}UpLeg"), asset.bone(f"{side}Leg")])
        near = np.linalg.norm(place - asset.bone_heads[asset.bone(f"{side}Leg")], axis=1) < KNEE_RADIUS_M
        region[leg & near] = REGIONS.index(f"knee_{side.lower()}")
    return region


def _is_knee(region: str) -> bool:
    return region.startswith("knee")


@cache
def area_of_point(points: SkinPoints) -> float:
    """Square metres of skin that each of the evenly spread points stands for, on the mean adult."""
    asset = points.asset
    a, b, c = (asset.vertices[asset.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 / len(points.vertex))


HAND_M: Final = 0.2  # from the finger tips of a hidden hand to the wrist that is seen


@dataclass(frozen=True, slots=True, eq=False)
class Nearness:
    """Pairs of a skin point of the patient and another person within ``HAND_M`` of it, sorted by person, then point.

    person (n,) uint8: pixel label; point (n,) int32: skin point; distance_m (n,) float32: to that person's nearest
    skin; remembered (n,) bool: that skin is hidden now and was seen shortly before. shown (p,) bool: skin points of the
    patient that some camera sees.
    """

    person: np.ndarray
    point: np.ndarray
    distance_m: np.ndarray
    remembered: np.ndarray
    shown: np.ndarray


def find_nearness(
    posed: PosedPoints,
    memory: BystanderMemory,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    config: VisibilityConfig,
) -> Nearness:
    """Distances from the posed skin to what is seen of all others, and to theirs that is remembered."""
    others, shown = memory.without_patient, seen_skin(posed, views, cameras, config)
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
