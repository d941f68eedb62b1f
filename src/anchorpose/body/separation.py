"""Limbs do not enter the trunk: rows that push a forearm or a hand out of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from anchorpose.body.constraints import Constraints
from anchorpose.body.skin_points import PosedPoints, SkinPoints

_TRUNK = ("Hips", "LowerBack", "Spine", "Spine1", "LHipJoint", "RHipJoint")
_LIMBS = ("ForeArm", "Hand", "FingerBase", "HandFinger1", "Thumb")
_DEEPEST_M = 0.15  # half a trunk: farther in, the nearest skin is no longer the way out
_ALLOWED_M = 0.01  # soft tissue gives
_SIGMA_M = 0.01


@cache
def trunk_and_arms(points: SkinPoints) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the skin points on the trunk, and of those on forearms and hands."""
    names = np.array(points.asset.bone_names)[points.part]
    trunk = np.flatnonzero(np.isin(names, _TRUNK))
    arms = np.flatnonzero([str(name).endswith(_LIMBS) for name in names])
    return trunk, arms


def separation_rows(points: SkinPoints, posed: PosedPoints) -> Constraints:
    """One row for each point of a forearm or hand that lies inside the trunk, towards the nearest skin of the trunk."""
    trunk, arms = trunk_and_arms(points)
    near, nearest = _nearest(posed.points_m, arms, trunk)
    limb, skin = arms[near], trunk[nearest]
    depth = ((posed.points_m[skin] - posed.points_m[limb]) * posed.normals[skin]).sum(axis=1)
    inside = depth > _ALLOWED_M
    limb, skin = limb[inside], skin[inside]
    return Constraints(
        limb,
        posed.points_m[skin],
        posed.normals[skin],
        np.full(len(limb), _SIGMA_M),
        np.full(len(limb), 2.0 * _DEEPEST_M),
    )


@njit(cache=True)
def _nearest(points: np.ndarray, arms: np.ndarray, trunk: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which arm points have trunk skin nearer than the deepest a limb may be, and the nearest of it; places in both."""
    near, nearest, count = np.empty(len(arms), np.int64), np.empty(len(arms), np.int64), 0
    for a in range(len(arms)):
        x, y, z = points[arms[a], 0], points[arms[a], 1], points[arms[a], 2]
        best, found = _DEEPEST_M * _DEEPEST_M, -1
        for t in range(len(trunk)):
            up = points[trunk[t], 1] - y
            if up * up >= best:
                continue
            away = up * up + (points[trunk[t], 0] - x) ** 2 + (points[trunk[t], 2] - z) ** 2
            if away < best:
                best, found = away, t
        if found >= 0:
            near[count], nearest[count] = a, found
            count += 1
    return near[:count], nearest[:count]
