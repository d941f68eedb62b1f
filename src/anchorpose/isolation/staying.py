"""People who never leave their place, told from the room by floor, size and movement."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.components import jump_limit, label_components
from anchorpose.isolation.config import IsolationConfig

SOLE_M: Final = 0.05  # above the floor; what is lower is the floor's noise
TOP_M: Final = (0.9, 2.3)  # heads of people who sit and of people who raise an arm
WIDEST_M: Final = 1.3  # from hand to hand with bent arms; walls and tables are wider
LEAST_MOVED_SHARE: Final = 0.1  # of the pixels around a body that were covered in some frame: it sways, a cupboard not
RING_PX: Final = 11  # around a body, 3 cm at 2 m


def people_who_stay(
    room_m: np.ndarray,
    moved: np.ndarray | None,
    camera: Camera,
    floor_height_m: float | None,
    noise_per_m: float,
    config: IsolationConfig,
) -> np.ndarray:
    """(height, width) bool: connected pieces of ``room_m`` that stand on the floor, are as large as a person and move.

    room_m (height, width) float32: what was farthest over time, 0 = unknown; moved (height, width) bool: pixels where
    something nearer was seen in some frame, None where there are too few frames to ask for movement. Where no floor is
    seen (floor_height_m None) nobody is connected to it either, and the height above it is not asked for.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m))
    upright = room_m > 0
    if floor_height_m is not None:  # noise across the floor is a z h, the camera about a metre above it
        upright &= points[..., 1] - floor_height_m > SOLE_M + config.jump_gate * noise_per_m * room_m
    limit = jump_limit(noise_per_m, camera.intrinsics.fx, config.jump_gate, config.steepest_slope_rad)
    pieces, count = label_components(room_m, upright, limit)
    pixel_m2 = room_m.astype(np.float64) ** 2 / (camera.intrinsics.fx * camera.intrinsics.fy)
    area = np.bincount(pieces.ravel(), pixel_m2.ravel(), count + 1)
    mask = np.zeros(room_m.shape, dtype=bool)
    for piece in np.flatnonzero(area > config.person_area_m2):
        body = pieces == piece
        if piece > 0 and _has_a_body_size(points[body], floor_height_m, config) and _moves(body, moved):
            mask |= body
    return mask


def _has_a_body_size(points_m: np.ndarray, floor_height_m: float | None, config: IsolationConfig) -> bool:
    low, high = np.percentile(points_m, [1, 99], axis=0)
    top_fits = floor_height_m is None or TOP_M[0] < high[1] - floor_height_m < TOP_M[1]
    return bool(
        top_fits
        and config.person_height_m < high[1] - low[1] < TOP_M[1]
        and np.hypot(high[0] - low[0], high[2] - low[2]) < WIDEST_M
    )


def _moves(body: np.ndarray, moved: np.ndarray | None) -> bool:
    if moved is None:
        return True
    ring = cv2.dilate(body.astype(np.uint8), np.ones((RING_PX, RING_PX), np.uint8)).astype(bool)
    return bool(moved[ring].mean() > LEAST_MOVED_SHARE)
