"""The equipment chi_0 as each camera must see it, and the pixels it hides (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.config import IsolationConfig
from anchorpose.recording.equipment import EquipmentModel


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentView:
    """What one camera would see if nothing but the equipment were there.

    depth_m (height, width) float32 metres, 0 = no equipment on this ray.
    """

    depth_m: np.ndarray


def view_equipment(camera: Camera, rays: np.ndarray, equipment: EquipmentModel) -> EquipmentView:
    """Cast every pixel's ray at the equipment's triangles; once a camera, for it does not move.

    rays (height, width, 2) float32: ``camera.pixel_rays()``. Raises ValueError where the camera's pose is unknown.
    """
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    T_world_camera = camera.require_pose()
    scene = EmbreeScene()
    vertices, faces = equipment.triangles()
    TriangleMesh(scene, vertices[faces].astype(np.float32))
    ahead = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1).reshape(-1, 3)
    directions = (ahead @ T_world_camera[:3, :3].T).astype(np.float32)  # one metre of depth long: distance = depth
    origins = np.broadcast_to(T_world_camera[:3, 3].astype(np.float32), directions.shape).copy()
    distance = scene.run(origins, directions, query="DISTANCE").reshape(rays.shape[:2])
    return EquipmentView(np.where(distance < 1e6, distance, 0.0).astype(np.float32))  # a miss is reported as 1e37


def equipment_mask(depth_m: np.ndarray, view: EquipmentView, noise_per_m: float, config: IsolationConfig) -> np.ndarray:
    """(height, width) bool: pixels that show the equipment, or nothing where the equipment should be.

    Whatever is nearer than the equipment by more than noise and tolerance is in front of it and stays. The expected
    silhouette is one pixel wider than drawn: a pixel that is half bar reads as bar.
    """
    expected = np.where(view.depth_m > 0, view.depth_m, np.inf).astype(np.float32)
    nearest = cv2.erode(expected, np.ones((3, 3), np.uint8))
    farthest = cv2.dilate(view.depth_m, np.ones((3, 3), np.uint8))
    margin = config.equipment_tolerance_m + config.equipment_gate * noise_per_m * farthest**2
    on_it = (depth_m >= nearest - margin) & (depth_m <= farthest + margin) & (farthest > 0)
    unread = (depth_m <= 0) & (view.depth_m > 0)
    return on_it | unread


def hidden_by_equipment(
    depth_m: np.ndarray, view: EquipmentView, noise_per_m: float, config: IsolationConfig
) -> np.ndarray:
    """(height, width) bool: pixels whose view ends at the equipment, so that the patient may be behind it."""
    margin = config.equipment_tolerance_m + config.equipment_gate * noise_per_m * view.depth_m**2
    in_front = (depth_m > 0) & (depth_m < view.depth_m - margin)
    return (view.depth_m > 0) & ~in_front
