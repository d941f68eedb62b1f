"""The equipment chi_0 as each camera must see it, and the readings that are it (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from anchorpose.calibration.equipment.render import EquipmentCaster
from anchorpose.camera import Camera, invert_rigid
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


def equipment_depth(camera: Camera, equipment: EquipmentModel) -> np.ndarray:
    """(height, width) float32 depth of the equipment alone, 0 = none; raises ValueError where the pose is unknown."""
    depth = np.zeros((camera.height, camera.width), np.float32)
    rendering = EquipmentCaster(equipment).render(camera, invert_rigid(camera.require_pose()))
    if rendering is not None:
        depth[rendering.window] = np.where(np.isfinite(rendering.depth_m), rendering.depth_m, 0.0)
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
