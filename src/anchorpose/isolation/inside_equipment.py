"""The room within the equipment: whatever stands there for a whole recording is the patient, and no furniture."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.config import IsolationConfig
from anchorpose.recording.equipment import EquipmentModel

LEAN_M = 0.25  # beyond the outline on the ground: arms over the rails, and the back
HEAD_M = 2.3  # above the floor: a raised arm
SOLE_M = 0.015  # above the floor: what the plane may be off, and a third of a foot's height


def clear_equipment(
    room_m: np.ndarray, sigma_m: np.ndarray, camera: Camera, equipment: EquipmentModel, drawn_m: np.ndarray,
    walls_m: np.ndarray, floor_height_m: float | None, noise_per_m: float, config: IsolationConfig,
) -> np.ndarray:  # fmt: skip
    """``room_m`` as it would be if nobody stood in the equipment, (height, width) float32.

    room_m, sigma_m (height, width): what stays in place, 0 = unknown; drawn_m: ``equipment_depth``; walls_m:
    ``depth_of_room``. What is above the floor, within the equipment's outline and not the equipment itself is taken
    away. What is behind it is the equipment as drawn or else floor or wall; where neither is known, 0.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m))
    lowest = float(equipment.triangles()[0][:, 1].min()) if floor_height_m is None else floor_height_m
    above = points[..., 1] - lowest
    inside = _outside_m(points, equipment) < LEAN_M
    standing = inside & (above > SOLE_M + config.jump_gate * noise_per_m * room_m) & (above < HEAD_M)
    margin = config.equipment_tolerance_m + config.equipment_gate * np.maximum(sigma_m, noise_per_m * drawn_m**2)
    standing &= ~((drawn_m > 0) & (room_m > drawn_m - margin))
    cleared = room_m.copy()
    cleared[standing] = np.where(drawn_m > 0, drawn_m, walls_m)[standing]
    return cleared


def _outside_m(points_m: np.ndarray, equipment: EquipmentModel) -> np.ndarray:
    """(height, width): how far points (height, width, 3) are outside the outline on the ground; negative inside."""
    hull = ConvexHull(equipment.triangles()[0][:, [0, 2]])
    sides = points_m[..., [0, 2]] @ hull.equations[:, :2].T + hull.equations[:, 2]
    distance: np.ndarray = np.where(np.isfinite(points_m[..., 0]), sides.max(axis=-1), np.inf)
    return distance
