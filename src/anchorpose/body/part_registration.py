"""Part registration as the paper has it: every body part on its own, by ICP from the predicted pose (Section IV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.shaped import ShapedBody
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry

COLLINEAR_RATIO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRegistrationConfig:
    """When a part is believed to have been seen, and how ICP runs."""

    least_pairs: int = 12  # below that a rigid motion follows the noise of single nodes
    reach_m: float = 0.06  # a limb's radius: farther nodes belong to the next limb
    iterations: int = 5

    def __post_init__(self) -> None:
        if self.least_pairs < 3 or self.iterations < 0 or not self.reach_m > 0:
            raise ValueError("least_pairs must be at least 3, iterations not negative, reach_m positive")


@dataclass(frozen=True, slots=True, eq=False)
class PartRegistration:
    """T_next_now (b, 4, 4) of every bone's part; registered (b,) bool: False where the prediction was kept."""

    T_next_now: np.ndarray
    registered: np.ndarray


def fit_rigid_transform(source_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """Rigid motion that best maps source_m onto target_m, least squares.

    source_m, target_m : (n, 3) float64, metres. Row i of one matches row i of the other.
    Returns T_target_source : (4, 4). Raises DegenerateGeometry when the points are collinear or fewer than three.
    Source: Arun et al. 1987 (doi:10.1109/TPAMI.1987.4767965), reflections excluded.
    """
    if len(source_m) < 3:
        raise DegenerateGeometry(f"{len(source_m)} points do not determine a rigid motion")
    source_mean, target_mean = source_m.mean(axis=0), target_m.mean(axis=0)
    u, spread, vt = np.linalg.svd((target_m - target_mean).T @ (source_m - source_mean))
    if spread[1] <= COLLINEAR_RATIO * spread[0]:
        raise DegenerateGeometry(f"{len(source_m)} points are collinear; rotation undefined")
    handedness = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = u @ handedness @ vt
    T_target_source[:3, 3] = target_mean - T_target_source[:3, :3] @ source_mean
    return T_target_source


def register_parts(
    nodes_m: np.ndarray, part: np.ndarray, matched_m: np.ndarray, surface_m: np.ndarray, T_predicted: np.ndarray,
    config: PartRegistrationConfig,
) -> PartRegistration:  # fmt: skip
    """tau-hat = ICP(tau, phi): pairs of the global hypothesis start each part, nearest nodes refine it.

    nodes_m (n, 3) nodes of frame t and their part (n,) bone index; matched_m (n, 3) where the tree puts them in t+1,
    NaN where it found nothing; surface_m (k, 3) nodes of t+1; T_predicted (b, 4, 4) predicted motion of each part. A
    part with too few pairs, or pairs on a line, keeps its prediction and says so.
    """
    tree = cKDTree(surface_m)
    transforms, registered = T_predicted.copy(), np.zeros(len(T_predicted), dtype=bool)
    for bone in np.unique(part):
        own = nodes_m[part == bone]
        pairs = matched_m[part == bone]
        predicted = transform_points(T_predicted[bone], own)
        believed = np.linalg.norm(pairs - predicted, axis=1) < 2.0 * config.reach_m  # NaN compares as False
        if believed.sum() < config.least_pairs:
            continue
        try:
            T = fit_rigid_transform(own[believed], pairs[believed])
            for _ in range(config.iterations):
                moved = transform_points(T, own)
                distance, nearest = tree.query(moved, distance_upper_bound=config.reach_m)
                near = np.isfinite(distance)
                T = fit_rigid_transform(own[near], surface_m[nearest[near]])
        except DegenerateGeometry:
            continue
        transforms[bone], registered[bone] = T, True
    return PartRegistration(transforms, registered)


def joints_of_parts(asset: BodyAsset, body: ShapedBody, T_world_rest: np.ndarray) -> np.ndarray:
    """The rule J: each joint is the node between two adjacent parts, the mean of where both put it. (21, 3) metres."""
    bones = joint_bones(asset)
    rest = body.rest_joints()
    places = []
    for joint, bone in enumerate(bones):
        parent = asset.bone_parents[bone]
        adjacent = [bone] if parent < 0 or asset.bone_names[bone] == "Head" else [bone, parent]
        places.append(np.mean([transform_points(T_world_rest[b], rest[joint]) for b in adjacent], axis=0))
    return np.array(places)
