"""Floor and walls behind people who stay: the part of an empty room that can be told without seeing it."""

from __future__ import annotations

import numpy as np

from anchorpose.camera import Camera

PLANES = 6  # floor, ceiling and the walls in view
TRIALS = 200  # a plane with a fifth of the points is drawn once in 125
VOTERS = 5000
TOLERANCE_M = 0.02  # walls and floors are flat to that
NOISE_GATE = 3.0
LEAST_SHARE = 0.03  # of the picture: a smaller plane is furniture, or somebody's back
MOST_BEYOND = 0.02  # of the readings on the far side: nothing is behind a wall


def depth_of_room(room_m: np.ndarray, camera: Camera, noise_per_m: float, seed: int = 0) -> np.ndarray:
    """(height, width) float32 depth of the nearest wall, floor or ceiling along each ray; 0 where none is met.

    room_m (height, width) float32: what is known of the room, 0 = nothing. Walls are planes with many readings on them
    and none behind them. A room is convex, so that of several planes the nearest is the one that is seen.
    """
    points = camera.back_project(room_m).reshape(-1, 3).astype(np.float64)
    points = points[np.isfinite(points[:, 2])]
    rng = np.random.default_rng(seed)
    share = min(1.0, VOTERS / max(len(points), 1))
    points = points[rng.random(len(points)) < share]
    rays = np.concatenate([camera.pixel_rays(), np.ones((*room_m.shape, 1), np.float32)], axis=-1)
    nearest = np.full(room_m.shape, np.inf, np.float32)
    for plane in _planes(points, LEAST_SHARE * share * room_m.size, noise_per_m, rng):
        towards = rays @ plane[:3].astype(np.float32)
        depth = np.where(towards > 1e-3, plane[3] / np.maximum(towards, 1e-3), np.inf)
        nearest = np.minimum(nearest, depth.astype(np.float32))
    return np.where(np.isfinite(nearest), nearest, np.float32(0.0))


def _planes(points_m: np.ndarray, least: float, noise_per_m: float, rng: np.random.Generator) -> list[np.ndarray]:
    """(4,) each: normal away from the camera and offset, ``normal @ p = offset``; largest first."""
    found, left = list[np.ndarray](), points_m
    limit = TOLERANCE_M + NOISE_GATE * noise_per_m * points_m[:, 2] ** 2
    while len(found) < PLANES and len(left) > max(least, 3):
        plane = _best(left, points_m, least, limit, noise_per_m, rng)
        if plane is None:
            break
        found.append(plane)
        left = left[np.abs(left @ plane[:3] - plane[3]) > TOLERANCE_M + NOISE_GATE * noise_per_m * left[:, 2] ** 2]
    return found


def _best(
    left_m: np.ndarray,
    points_m: np.ndarray,
    least: float,
    limit_m: np.ndarray,
    noise_per_m: float,
    rng: np.random.Generator,
) -> np.ndarray | None:
    corners = left_m[rng.integers(0, len(left_m), (TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    offsets = np.einsum("ij,ij->i", normals, corners[length > 1e-6, 0])
    sign = np.where(offsets < 0, -1.0, 1.0)
    best, best_votes = None, least
    gate = TOLERANCE_M + NOISE_GATE * noise_per_m * left_m[:, 2] ** 2
    for normal, offset in zip(normals * sign[:, None], offsets * sign, strict=True):
        votes = int(np.count_nonzero(np.abs(left_m @ normal - offset) < gate))
        if votes <= best_votes or np.mean(points_m @ normal - offset > 2.0 * limit_m) > MOST_BEYOND:
            continue
        best, best_votes = np.append(normal, offset), votes
    return None if best is None else _refitted(best, left_m, gate)


def _refitted(plane: np.ndarray, points_m: np.ndarray, gate_m: np.ndarray) -> np.ndarray:
    """Least squares on the inliers."""
    own = points_m[np.abs(points_m @ plane[:3] - plane[3]) < gate_m]
    centre = own.mean(axis=0)
    normal = np.linalg.eigh(np.cov((own - centre).T))[1][:, 0]
    normal *= np.sign(normal @ plane[:3])
    return np.append(normal, normal @ centre)
