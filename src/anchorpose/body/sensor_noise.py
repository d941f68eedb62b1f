"""What the noise of the cameras, as measured on their background, does to a pose that was fitted to their readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.sparse import csr_array

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import rows_of_nodes
from anchorpose.body.evidence import Evidence
from anchorpose.body.poor_depth import distance_of
from anchorpose.body.pose_accumulation import accumulate_pose
from anchorpose.body.skin_points import Body, PosedPoints, pose_jacobian, pose_points
from anchorpose.isolation.depth_noise import DepthNoise

NODES: Final = 1200  # each stands for two of the fit: sigma is the same to a tenth, in half of the time


def noise_covariance(
    body: Body,
    belief: PoseBelief,
    evidence: Evidence,
    noises: Sequence[DepthNoise | None],
    config: RegistrationConfig,
) -> np.ndarray:
    """(POSE_SIZE, POSE_SIZE) covariance of the pose by the noise of this frame's readings alone.

    noises: of each camera, None where it has no depth image. The fit weighs all rows alike; a change n of the readings
    changes the pose by ``C J^T W n`` (C the belief's covariance), so that noise of covariance N gives
    ``C J^T W N W J C``. In N, nodes of one patch of ``shared_px`` pixels have one error in common, others none.
    """
    posed = pose_points(body, belief.pose)
    few = replace(config, node_count=min(config.node_count, NODES))
    rows, node = rows_of_nodes(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], few)
    if not len(rows):
        return np.zeros_like(belief.covariance)
    used, count = min(few.node_count, len(evidence.surface)), min(config.node_count, len(evidence.surface))
    noise_m, patch = node_noise(evidence, noises, used / len(evidence.surface))
    weight = count / used * rows.weights(rows.residuals(posed)) / config.rows_per_observation
    felt = _felt(body, posed, rows.point, rows.direction, weight * noise_m[node], patch[node] - len(evidence.surface))
    return np.asarray(belief.covariance @ felt @ belief.covariance)


def _felt(
    body: Body, posed: PosedPoints, point: np.ndarray, direction: np.ndarray, strength: np.ndarray, patch: np.ndarray
) -> np.ndarray:
    """``J^T S N S J`` (POSE_SIZE, POSE_SIZE), S the strength of each row; rows of negative patches share no error."""
    alone, shared = patch < 0, patch >= 0
    none = np.zeros(int(alone.sum()))
    felt, _ = accumulate_pose(body, posed, point[alone], direction[alone], none, strength[alone] ** 2)
    if not shared.any():
        return felt
    rows = pose_jacobian(body, posed, point[shared], direction[shared]) * strength[shared, None]
    number = np.unique(patch[shared], return_inverse=True)[1]
    together = csr_array((np.ones(len(rows)), (number, np.arange(len(rows))))) @ rows
    return np.asarray(felt + together.T @ together)


def node_noise(
    evidence: Evidence, noises: Sequence[DepthNoise | None], thinned: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) one sigma of each node along its normal, metres, and (n,) the patch whose error it has in common.

    thinned: share of the nodes that are used. Where a used node stands for more pixels than have an error in common,
    denoising averages them: it is then a patch by itself, with less noise. 0 where the camera's noise is unknown.
    """
    surface, noise_m = evidence.surface, np.zeros(len(evidence.surface))
    patch = np.arange(len(surface))
    for number, (view, camera, noise) in enumerate(zip(evidence.views, evidence.cameras, noises, strict=True)):
        mine = np.flatnonzero(surface.camera == number)
        if view is None or noise is None or not len(mine):
            continue
        ray = surface.points_m[mine] - camera.position_m
        depth_m = ray @ camera.require_pose()[:3, 2]
        cosine = np.abs((ray * surface.normals[mine]).sum(axis=1)) / np.linalg.norm(ray, axis=1)
        cosine = np.minimum(cosine, 1.0)
        sharing = noise.shared_px * thinned * len(mine) / max(int(view.patient.sum()), 1)
        along_m = cosine * noise.sigma_m(depth_m, np.degrees(np.arccos(cosine)))
        noise_m[mine] = along_m * min(1.0, np.sqrt(sharing))
        if sharing > 1.0:
            row, column = (surface.pixel[mine] / np.sqrt(noise.shared_px)).astype(np.int64).T
            patch[mine] = len(surface) + (row * camera.width + column) * len(noises) + number
    return noise_m, patch


def finest_patch_m(evidence: Evidence, noises: Sequence[DepthNoise | None]) -> float:
    """Side of the patch of pixels with one error in common at the patient, metres, in the camera where it is smallest.

    0 where no camera shows the patient. Matching windows and smoothing move the edges of a limb by a part of it.
    """
    found = [
        np.sqrt(noise.shared_px) * distance_m / camera.intrinsics.fx
        for view, camera, noise in zip(evidence.views, evidence.cameras, noises, strict=True)
        if view is not None and noise is not None and (distance_m := distance_of(view)) is not None
    ]
    return float(min(found, default=0.0))
