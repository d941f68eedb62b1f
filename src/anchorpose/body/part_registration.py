"""Part registration as the paper has it: every body part on its own, by ICP from the predicted pose (Section IV)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import BodyMesh
from anchorpose.body.nearest_skin import Oriented
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry
from anchorpose.surface.surface import Surface

COLLINEAR_RATIO: Final = 1e-3
LEAST_PAIRS: Final = 6  # below that a rigid motion follows the noise of single nodes
PAIR_ROUNDS: Final = 8  # of reweighting the pairs; their fit settles in five
LEAST_SCALE_M: Final = 0.01  # pairs within a node's spacing of their fit are as good as each other
ITERATIONS: Final = 5  # of ICP after the pairs
REACH_M: Final = 0.06  # a limb's radius: farther nodes belong to the next limb
SURFACE_SIGMA_M: Final = 0.02  # of a node off the skin of its part: clothes, sensor, and neighbours that share both
TURN_SIGMA: Final = 0.15  # radians, and
SHIFT_SIGMA_M: Final = 0.02  # metres, that a step may leave the pairs: what planes do not constrain must not slide


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
    if spread[1] <= COLLINEAR_RATIO * spread[0]:
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
    tree = cKDTree(surface.points_m)
    transforms, registered = T_predicted.copy(), np.zeros(len(T_predicted), dtype=bool)
    for bone in np.unique(part):
        own = part == bone
        paired = own & np.isfinite(matched_m).all(axis=1)
        T = _fit_pairs(skin.places_m[paired], matched_m[paired], T_predicted[bone], robust)
        registered[bone] = T is not None
        transforms[bone] = T_predicted[bone] if T is None else T
        for _ in range(iterations):
            step = _icp_step(Oriented(skin.places_m[own], skin.normals[own]), surface, tree, transforms[bone])
            if step is None:
                break
            transforms[bone], registered[bone] = step @ transforms[bone], True
    return PartRegistration(transforms, registered)


def _fit_pairs(skin_m: np.ndarray, matched_m: np.ndarray, T_predicted: np.ndarray, robust: bool) -> np.ndarray | None:
    """The motion that the pairs agree on, starting from the prediction; None where they do not determine one.

    robust: reweighted by Cauchy's function of the residual over its median: mismatches have no influence.
    """
    if len(skin_m) < LEAST_PAIRS:
        return None
    T = T_predicted
    try:
        if not robust:
            return fit_rigid_transform(skin_m, matched_m)
        for _ in range(PAIR_ROUNDS):
            residual = np.linalg.norm(transform_points(T, skin_m) - matched_m, axis=1)
            scale = max(float(np.median(residual)), LEAST_SCALE_M)
            T = fit_rigid_transform(skin_m, matched_m, 1.0 / (1.0 + (residual / scale) ** 2))
    except DegenerateGeometry:
        return None
    return T


def _icp_step(skin: Oriented, surface: Surface, tree: cKDTree, T: np.ndarray) -> np.ndarray | None:
    """One step of point-to-plane ICP of a part at T, (4, 4) after it; None where too few nodes are near.

    The plane's normal is the mean of both, as in ``surface_constraints``; what the planes leave open does not move.
    """
    moved, facing = transform_points(T, skin.places_m), skin.normals @ T[:3, :3].T
    distance, nearest = tree.query(moved, distance_upper_bound=REACH_M)
    near = np.flatnonzero(np.isfinite(distance))
    node_normals = surface.normals[nearest[near]].astype(np.float64)
    alike = (node_normals * facing[near]).sum(axis=1) > 0.5  # 60 degrees: not the other side of a limb
    near, node_normals = near[alike], node_normals[alike]
    if len(near) < LEAST_PAIRS:
        return None
    direction = node_normals + facing[near]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    residual = ((moved[near] - surface.points_m[nearest[near]]) * direction).sum(axis=1)
    centre = moved[near].mean(axis=0)
    rows = np.hstack([np.cross(moved[near] - centre, direction), direction])
    weight = 1.0 / (SURFACE_SIGMA_M * (1.0 + (residual / SURFACE_SIGMA_M) ** 2)) ** 2
    keep = np.repeat([1.0 / TURN_SIGMA**2, 1.0 / SHIFT_SIGMA_M**2], 3)
    change = -np.linalg.solve((rows * weight[:, None]).T @ rows + np.diag(keep), rows.T @ (weight * residual))
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix()
    step[:3, 3] = centre - step[:3, :3] @ centre + change[3:]
    return step


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
