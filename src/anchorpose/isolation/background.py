"""The empty room and the equipment chi_0 as each camera sees them, and what stands in front (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np
from numba import njit

from anchorpose.calibration.equipment_model import EquipmentCaster
from anchorpose.camera import Camera, invert_rigid
from anchorpose.isolation.components import JUMP_GATE, without_flying_pixels
from anchorpose.isolation.depth_noise import Sensor
from anchorpose.recording.equipment import EquipmentModel

BACKGROUND_GATE: Final = 2.0  # sigmas of a pixel, for a 3x3 median, whose deviation is 0.4 of that: five of its own
EQUIPMENT_GATE: Final = 3.0  # sigmas of a single pixel, not of a median: thin bars are 3 pixels wide
EQUIPMENT_TOLERANCE_M: Final = 0.01  # the equipment was measured by hand, and its pose was estimated
_SQUARE: Final = np.ones((3, 3), np.uint8)


class BackgroundSource(StrEnum):
    """Where the background came from; the run's notes quote it."""

    PICTURE = "the given picture of the empty room"
    RECORDING = "what stays in place in the recording"
    REMOVED = "the recording holds people only"


@dataclass(frozen=True, slots=True, eq=False)
class RestingLayer:
    """An object before the room, at rest from from_s until until_s (reference clock): later or earlier it is elsewhere.

    depth_m (height, width) float32 metres, 0 = not here; sigma_m (height, width) float32: deviation of a reading of it.
    """

    depth_m: np.ndarray
    sigma_m: np.ndarray
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundModel:
    """One camera's empty room.

    depth_m (height, width) float32 metres, 0 = nothing known. sigma_m (height, width) float32: deviation of a live
    reading from depth_m where nobody stands.
    layers: objects that are moved, each while it rests. usual_share: of the known pixels that read the room in a usual
    frame (``other_place``); 0 where that is not known.
    """

    depth_m: np.ndarray
    sigma_m: np.ndarray
    sensor: Sensor
    source: BackgroundSource
    layers: tuple[RestingLayer, ...] = ()
    usual_share: float = 0.0


def room_at(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return (depth_m, sigma_m), (height, width) float32 each, of what each reading is compared with at a time.

    That is the room, or a layer that holds then where the reading is not behind it. time_s None: the room.
    """
    room, sigma = model.depth_m, model.sigma_m
    for layer in model.layers:
        if time_s is not None and layer.from_s <= time_s <= layer.until_s:
            here = (layer.depth_m > 0) & (depth_m < layer.depth_m + JUMP_GATE * layer.sigma_m)
            room, sigma = np.where(here, layer.depth_m, room), np.where(here, layer.sigma_m, sigma)
    return room, sigma


def foreground(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None = None) -> np.ndarray:
    """Return (height, width) bool: pixels nearer than the room by more than the noise explains, flying pixels left out.

    time_s: of the frame, reference clock; None: nothing rests before the room.

    The test is on the 3x3 median of the difference in sigmas, so it reaches down to a sole on the floor: the margin is
    two sigmas along the ray, at grazing incidence a centimetre of height. A pixel that is clearly nearer needs no
    median: fingers and corners of the outline are smaller than that. Where the background is unknown, a reading counts
    as foreground; what belongs to no person is removed later.
    """
    nearer = _sigmas_nearer(depth_m, *room_at(depth_m, model, time_s))
    mask = ((cv2.medianBlur(nearer, 3) > BACKGROUND_GATE) & (nearer > 0)) | (nearer > JUMP_GATE)
    return without_flying_pixels(depth_m, mask, model.sensor.jump_limit)


@njit(cache=True, nogil=True)
def _sigmas_nearer(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return how many sigmas each reading is before the room; 1e3 where the room is unknown, -1e3 without a reading."""
    nearer = np.empty_like(depth)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] <= 0:
                nearer[row, column] = -1e3
            elif room[row, column] <= 0:
                nearer[row, column] = 1e3
            else:
                nearer[row, column] = (room[row, column] - depth[row, column]) / sigma[row, column]
    return nearer


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedEquipment:
    """What one camera would see if nothing but the equipment were there.

    depth_m (height, width) float32 metres, 0 = no equipment on this ray. A reading between low_m and high_m, (height,
    width) float32, is the equipment; where there is none near, low_m is inf. measured (height, width) bool: pixels
    around which the background frame shows nothing but equipment, where it is drawn.
    """

    depth_m: np.ndarray
    measured: np.ndarray
    low_m: np.ndarray
    high_m: np.ndarray


def equipment_depth(camera: Camera, equipment: EquipmentModel) -> np.ndarray:
    """Return (height, width) float32 depth of the equipment alone, 0 = none; raises ValueError where the pose is
    unknown.
    """
    depth = np.zeros((camera.height, camera.width), np.float32)
    rendering = EquipmentCaster(equipment).render(camera, invert_rigid(camera.require_pose()))
    if rendering is not None:
        depth[rendering.window] = np.where(np.isfinite(rendering.depth_m), rendering.depth_m, 0.0)
    return depth


def expect_equipment(drawn_m: np.ndarray, background: BackgroundModel) -> ExpectedEquipment:
    """Return which readings are the equipment, once per camera, since it does not move.

    drawn_m: ``equipment_depth``. The silhouette is one pixel wider than drawn: a pixel that is half bar reads as bar.
    """
    sigma = background.sensor.noise.sigma_m(drawn_m)
    reach = EQUIPMENT_TOLERANCE_M + EQUIPMENT_GATE * np.maximum(background.sigma_m, sigma)
    measured = (drawn_m > 0) & (background.depth_m > 0) & (np.abs(background.depth_m - drawn_m) < reach)
    margin = EQUIPMENT_GATE * sigma + np.where(measured, 0.0, EQUIPMENT_TOLERANCE_M)
    depth = np.where(measured, background.depth_m, drawn_m)
    low = cv2.erode(np.where(drawn_m > 0, depth - margin, np.inf).astype(np.float32), _SQUARE)
    high = cv2.dilate(np.where(drawn_m > 0, depth + margin, 0.0).astype(np.float32), _SQUARE)
    return ExpectedEquipment(drawn_m, cv2.erode(measured.astype(np.uint8), _SQUARE).astype(bool), low, high)


def equipment_mask(depth_m: np.ndarray, nearer: np.ndarray, expected: ExpectedEquipment) -> np.ndarray:
    """Return (height, width) bool: pixels whose view ends at the equipment, so that the patient may be behind it.

    Those that read as the equipment, and those that read nothing where it is drawn; what is nearer is in front of it.
    nearer (height, width) bool: ``background.foreground``. Where the empty equipment was measured, that decides alone:
    fingers around a bar stand out from it by less than a model measured by hand may be off, and than one pixel's noise.
    """
    on_it = (depth_m >= expected.low_m) & (depth_m <= expected.high_m) & ~(expected.measured & nearer)
    mask: np.ndarray = on_it | ((depth_m <= 0) & (expected.depth_m > 0))
    return mask
