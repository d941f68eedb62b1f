"""The planes of a room: floor, ceiling and walls, from what is known of the empty room."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.camera import Camera

PLANES: Final = 6  # floor, ceiling and the walls in view
TRIALS: Final = 200  # a plane with a fifth of the points is drawn once in 125
VOTERS: Final = 5000  # points that vote on a plane
TOLERANCE_M: Final = 0.02  # walls and floors are flat to that
NOISE_GATE: Final = 3.0  # sigmas
LEAST_SHARE: Final = 0.03  # of the image: a smaller plane is furniture, or a person's back
MOST_BEYOND: Final = 0.02  # of the readings on the far side: nothing is behind a wall


def depth_of_room(room_m: np.ndarray, camera: Camera, noise_per_m: float, seed: int = 0) -> np.ndarray:
    """(height, width) float32 depth of the nearest wall, floor or ceiling along each ray; 0 where none is met.

    room_m (height, width) float32: what is known of the room, 0 = nothing. Walls are planes with many readings on them
    and none behind them. A room is convex, so that of several planes the nearest is the one that is seen.
    """
    nearest = np.full(room_m.shape, np.inf, np.float32)
    for plane in find_planes(room_m, camera, noise_per_m, seed=seed):
        nearest = np.minimum(nearest, depth_of_plane(plane, camera))
    return np.where(np.isfinite(nearest), nearest, np.float32(0.0))


def depth_of_plane(plane: np.ndarray, camera: Camera) -> np.ndarray:
    """(height, width) float32 depth of a plane (4,) of ``find_planes`` along each ray; inf where it is not met."""
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1), np.float32)], axis=-1)
    towards = rays @ plane[:3].astype(np.float32)
    depth = np.where(towards > 1e-3, plane[3] / np.maximum(towards, 1e-3), np.inf)
    return np.asarray(depth, dtype=np.float32)


def find_planes(
    room_m: np.ndarray, camera: Camera, noise_per_m: float, most_beyond: float = MOST_BEYOND, seed: int = 0
) -> list[np.ndarray]:
    """(4,) each, camera frame: unit normal away from the camera and offset, ``normal @ p = offset``; largest first.

    room_m: as in ``depth_of_room``; most_beyond: share of the readings that may be on the far side of a plane.
    """
    points = camera.back_project(room_m).reshape(-1, 3).astype(np.float64)
    points = points[np.isfinite(points[:, 2])]
    rng = np.random.default_rng(seed)
    share = min(1.0, VOTERS / max(len(points), 1))
    points = points[rng.random(len(points)) < share]
    return _planes(points, LEAST_SHARE * share * room_m.size, noise_per_m, most_beyond, rng)


def _planes(
    points_m: np.ndarray, least: float, noise_per_m: float, most_beyond: float, rng: np.random.Generator
) -> list[np.ndarray]:
    """The planes with more than ``least`` of the points (n, 3)."""
    found, left = list[np.ndarray](), points_m
    while len(found) < PLANES and len(left) > max(least, 3):
        plane = _best(left, points_m, least, noise_per_m, most_beyond, rng)
        if plane is None:
            break
        found.append(plane)
        left = left[np.abs(left @ plane[:3] - plane[3]) > off_plane_m(left[:, 2], noise_per_m)]
    return found


def _best(
    left_m: np.ndarray,
    points_m: np.ndarray,
    least: float,
    noise_per_m: float,
    most_beyond: float,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """The plane through three of the points ``left_m`` with most of them on it and few beyond, None if too few."""
    corners = left_m[rng.integers(0, len(left_m), (TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    offsets = np.einsum("ij,ij->i", normals, corners[length > 1e-6, 0])
    sign = np.where(offsets < 0, -1.0, 1.0)
    best, best_votes = None, least
    gate, limit = off_plane_m(left_m[:, 2], noise_per_m), off_plane_m(points_m[:, 2], noise_per_m)
    for normal, offset in zip(normals * sign[:, None], offsets * sign, strict=True):
        votes = int(np.count_nonzero(np.abs(left_m @ normal - offset) < gate))
        if votes <= best_votes or np.mean(points_m @ normal - offset > 2.0 * limit) > most_beyond:
            continue
        best, best_votes = np.append(normal, offset), votes
    return None if best is None else _refitted(best, left_m, gate)


def off_plane_m(depth_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """How far readings at a depth may be from the plane that they show."""
    return np.asarray(TOLERANCE_M + NOISE_GATE * noise_per_m * depth_m**2)


def _refitted(plane: np.ndarray, points_m: np.ndarray, gate_m: np.ndarray) -> np.ndarray:
    """Least squares on the inliers."""
    own = points_m[np.abs(points_m @ plane[:3] - plane[3]) < gate_m]
    centre = own.mean(axis=0)
    normal = np.linalg.eigh(np.cov((own - centre).T))[1][:, 0]
    normal *= np.sign(normal @ plane[:3])
    return np.append(normal, normal @ centre)
