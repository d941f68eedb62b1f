"""The equipment chi_0 as each camera must see it, and the readings that are it (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.config import IsolationConfig
from anchorpose.recording.equipment import EquipmentModel

_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedEquipment:
    """What one camera would see if nothing but the equipment were there.

    depth_m (height, width) float32 metres, 0 = no equipment on this ray. A reading between low_m and high_m, (height,
    width) float32, is the equipment; where there is none near, low_m is inf. measured (height, width) bool: pixels
    around which the empty room's picture shows nothing but equipment, where it is drawn.
    """

    depth_m: np.ndarray
    measured: np.ndarray
    low_m: np.ndarray
    high_m: np.ndarray


def equipment_depth(camera: Camera, rays: np.ndarray, equipment: EquipmentModel) -> np.ndarray:
    """(height, width) float32 depth of the equipment alone, 0 = none: every pixel's ray cast at its triangles.

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
    depth: np.ndarray = np.where(distance < 1e6, distance, 0.0).astype(np.float32)  # a miss is reported as 1e37
    return depth


def expect_equipment(drawn_m: np.ndarray, background: BackgroundModel, config: IsolationConfig) -> ExpectedEquipment:
    """Which readings are the equipment, once a camera, for it does not move.

    drawn_m: ``equipment_depth``. The silhouette is one pixel wider than drawn: a pixel that is half bar reads as bar.
    """
    sigma = background.noise_per_m * drawn_m**2
    reach = config.equipment_tolerance_m + config.equipment_gate * np.maximum(background.sigma_m, sigma)
    measured = (drawn_m > 0) & (background.depth_m > 0) & (np.abs(background.depth_m - drawn_m) < reach)
    margin = config.equipment_gate * sigma + np.where(measured, 0.0, config.equipment_tolerance_m)
    depth = np.where(measured, background.depth_m, drawn_m)
    low = cv2.erode(np.where(drawn_m > 0, depth - margin, np.inf).astype(np.float32), _SQUARE)
    high = cv2.dilate(np.where(drawn_m > 0, depth + margin, 0.0).astype(np.float32), _SQUARE)
    return ExpectedEquipment(drawn_m, cv2.erode(measured.astype(np.uint8), _SQUARE).astype(bool), low, high)


def equipment_mask(depth_m: np.ndarray, nearer: np.ndarray, expected: ExpectedEquipment) -> np.ndarray:
    """(height, width) bool: pixels whose view ends at the equipment, so that the patient may be behind it.

    Those that read as the equipment, and those that read nothing where it is drawn; what is nearer is in front of it.
    nearer (height, width) bool: ``background.foreground``. Where the empty equipment was measured, that decides alone:
    fingers around a bar stand out from it by less than a model measured by hand may be off, and than one pixel's noise.
    """
    on_it = (depth_m >= expected.low_m) & (depth_m <= expected.high_m) & ~(expected.measured & nearer)
    mask: np.ndarray = on_it | ((depth_m <= 0) & (expected.depth_m > 0))
    return mask
