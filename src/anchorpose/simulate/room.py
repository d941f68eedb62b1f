"""The room, and where the cameras stand in it."""

from __future__ import annotations

import numpy as np

from anchorpose.camera import Camera, Intrinsics
from anchorpose.simulate.sensor import SENSORS

CAMERA_NAMES = ("front", "left", "right", "behind")
AZIMUTH_RAD = (0.0, np.radians(57.0), np.radians(-57.0), np.pi)  # left of the patient is positive
AZIMUTH_SPREAD_RAD = (0.08, 0.2, 0.2, 0.3)
WALL_M = 2.7


def place_cameras(rng: np.random.Generator, sensor: str, count: int) -> tuple[Camera, ...]:
    """Cameras on tripods around the patient, who stands at the origin and faces +X."""
    spec = SENSORS[sensor]
    cameras = []
    for index in range(count):
        azimuth = AZIMUTH_RAD[index] + rng.uniform(-1.0, 1.0) * AZIMUTH_SPREAD_RAD[index]
        distance_m = rng.uniform(2.25, 2.85)
        position = np.array([distance_m * np.cos(azimuth), rng.uniform(1.1, 1.5), -distance_m * np.sin(azimuth)])
        target = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.82, 0.95), rng.uniform(-0.08, 0.08)])
        intrinsics = Intrinsics(fx=spec.focal_px, fy=spec.focal_px, cx=spec.width / 2.0, cy=spec.height / 2.0)
        cameras.append(
            Camera(
                name=CAMERA_NAMES[index],
                width=spec.width,
                height=spec.height,
                depth_scale=0.001,
                intrinsics=intrinsics,
                T_world_camera=look_at(position, target),
            )
        )
    return tuple(cameras)


def look_at(position_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """T_world_camera (4, 4) of a level camera at ``position_m`` that looks at ``target_m``."""
    away = (target_m - position_m) / np.linalg.norm(target_m - position_m)
    right = np.cross(away, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    T_world_camera[:3, 3] = position_m
    return T_world_camera


def room_triangles(rng: np.random.Generator, camera_behind: bool) -> np.ndarray:
    """(n, 3, 3) floor, back wall and side walls; the ceiling is out of every camera's picture."""
    back = -rng.uniform(3.1, 3.5) if camera_behind else -rng.uniform(1.7, 2.4)
    left, right, front = -rng.uniform(2.6, 3.2), rng.uniform(2.6, 3.2), rng.uniform(3.2, 3.8)
    quads = [
        [[back, 0, left], [front, 0, left], [front, 0, right], [back, 0, right]],
        [[back, 0, left], [back, 0, right], [back, WALL_M, right], [back, WALL_M, left]],
        [[back, 0, left], [back, WALL_M, left], [front, WALL_M, left], [front, 0, left]],
        [[back, 0, right], [front, 0, right], [front, WALL_M, right], [back, WALL_M, right]],
        [[front, 0, left], [front, WALL_M, left], [front, WALL_M, right], [front, 0, right]],
    ]
    return np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
