"""The floor behind people who stay: the one part of an empty room that can be told without seeing it."""

from __future__ import annotations

import numpy as np

from anchorpose.camera import Camera

SAME_M = 0.06  # along the ray, floor that is read is off the plane by no more
LEAST_SHARE = 0.05  # of a row's readings: then the row shows floor, and no wall stands before it


def floor_behind(room_m: np.ndarray, camera: Camera, floor_height_m: float | None) -> np.ndarray:
    """(height, width) float32 depth of the floor plane in the rows of the picture in which floor is seen; 0 elsewhere.

    room_m (height, width) float32, 0 = unknown; floor_height_m: world Y of the floor, None where no camera sees it.
    """
    if floor_height_m is None:
        return np.zeros_like(room_m)
    rays = np.concatenate([camera.pixel_rays(), np.ones((*room_m.shape, 1), np.float32)], axis=-1)
    falling = -(rays @ camera.require_pose()[1, :3])
    floor = np.where(falling > 1e-3, (camera.position_m[1] - floor_height_m) / np.maximum(falling, 1e-3), 0.0)
    seen = (room_m > 0) & (floor > 0) & (np.abs(room_m - floor) < SAME_M)
    share = seen.sum(axis=1) / np.maximum((room_m > 0).sum(axis=1), 1)
    return np.where(share[:, None] > LEAST_SHARE, floor, 0.0).astype(np.float32)
