"""Part registration as the paper has it: every body part on its own, by ICP from the predicted pose (Section IV)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import BodyMesh
from anchorpose.body.nearest_skin import Oriented
from anchorpose.body.part_kernels import COLLINEAR_RATIO, ONE_PLACE_M2, carry, fit_pairs, plane_steps
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry
from anchorpose.rotations import rotate, rotation_matrices
from anchorpose.surface.surface import Surface

ITERATIONS: Final = 5  # of ICP after the pairs
REACH_M: Final = 0.06  # a limb's radius: farther nodes belong to the next limb


@dataclass(frozen=True, slots=True, eq=False)
class PartRegistration:
    """T_next_now (b, 4, 4) of every bone's part; registered (b,) bool: False where the prediction was kept."""

    T_next_now: np.ndarray
    registered: np.ndarray


def fit_rigid_transform(source_m: np.ndarray, target_m: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Rigid motion that best maps source_m onto target_m, least squares.

    source_m, target_m : (n, 3) float64, metres. Row i of one matches row i of the other. weight (n,) not negative, of
    each row; None = all equal.
    Returns T_target_source : (4, 4). Raises DegenerateGeometry when the points are collinear or fewer than three.
    Source: Arun et al. 1987 (doi:10.1109/TPAMI.1987.4767965), reflections excluded.
    """
    if len(source_m) < 3:
        raise DegenerateGeometry(f"{len(source_m)} points do not determine a rigid motion")
    share = np.full(len(source_m), 1.0 / len(source_m)) if weight is None else weight / weight.sum()
    source_mean, target_mean = share @ source_m, share @ target_m
    u, spread, vt = np.linalg.svd((share[:, None] * (target_m - target_mean)).T @ (source_m - source_mean))
    if spread[1] <= max(COLLINEAR_RATIO * spread[0], ONE_PLACE_M2):
        raise DegenerateGeometry(f"{len(source_m)} points are collinear; rotation undefined")
    handedness = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = u @ handedness @ vt
    T_target_source[:3, 3] = target_mean - T_target_source[:3, :3] @ source_mean
    return T_target_source


def register_parts(
    skin: Oriented,
    part: np.ndarray,
    matched_m: np.ndarray,
    surface: Surface,
    T_predicted: np.ndarray,
    iterations: int = ITERATIONS,
    robust: bool = True,
) -> PartRegistration:
    """tau-hat = ICP(tau, phi): pairs of the global hypothesis start each part, the nearest nodes end it.

    skin: points of the body's skin in frame t; part (n,): their bone index; matched_m (n, 3): where the tree puts them
    in t+1, NaN where it found nothing; surface: that of t+1; T_predicted (b, 4, 4): predicted motion of each part;
    iterations: of ICP after the pairs; robust: whether pairs that do not fit lose their influence.
    The skin is registered, not the last frame's nodes, whose error would add up.
    A part of which too little is seen keeps its prediction and reports it.
    """
    order = np.argsort(part, kind="stable")
    bones, first = np.unique(part[order], return_index=True)
    start, matched_m = np.append(first, len(part)), matched_m[order]
    own_skin = Oriented(*(np.ascontiguousarray(one[order], np.float64) for one in skin))
    paired = np.flatnonzero(np.isfinite(matched_m).all(axis=1))
    transforms, registered = T_predicted.copy(), np.zeros(len(T_predicted), dtype=bool)
    own = transforms[bones]
    registered[bones] = fit_pairs(
        own_skin.places_m[paired], matched_m[paired], np.searchsorted(paired, start), own, robust
    )
    registered[bones] |= _refine(own_skin, start, surface, own, iterations)
    transforms[bones] = own
    return PartRegistration(transforms, registered)


def _refine(skin: Oriented, start: np.ndarray, surface: Surface, transforms: np.ndarray, iterations: int) -> np.ndarray:
    """(k,) bool: the parts, whose rows begin at start (k + 1,), that ICP moved from where transforms (k, 4, 4) have
    them, which it changes.

    A part stays where it is from the first step on that has too few nodes near it.
    """
    tree, nodes = cKDTree(surface.points_m), Oriented(surface.points_m, surface.normals)
    refined, active = np.zeros(len(transforms), bool), np.ones(len(transforms), bool)
    for _ in range(iterations):
        moved = carry(skin, start, transforms)
        distance, nearest = tree.query(moved.places_m, distance_upper_bound=REACH_M)
        change, centre = plane_steps(moved, start, nodes, nearest, np.isfinite(distance))
        active &= np.isfinite(change).all(axis=1)
        step = np.tile(np.eye(4), (active.sum(), 1, 1))
        step[:, :3, :3] = rotation_matrices(change[active, :3])
        step[:, :3, 3] = centre[active] - rotate(step[:, :3, :3], centre[active]) + change[active, 3:]
        transforms[active] = step @ transforms[active]
        refined |= active
    return refined


def joints_of_parts(asset: BodyAsset, body: BodyMesh, T_world_rest: np.ndarray) -> np.ndarray:
    """The rule J: each joint is the node between two adjacent parts, the mean of where both put it. (21, 3) metres."""
    bones = joint_bones(asset)
    rest = body.rest_joints()
    places = []
    for joint, bone in enumerate(bones):
        parent = asset.bone_parents[bone]
        adjacent = [bone] if parent < 0 or asset.bone_names[bone] == "Head" else [bone, parent]
        places.append(np.mean([transform_points(T_world_rest[b], rest[joint]) for b in adjacent], axis=0))
    return np.array(places)
