"""Describe the empty room and the equipment chi_0 as each camera sees them, and find the foreground (paper, Section
III).
"""

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

# limit for a 3x3 median, in sigmas of a single pixel; the median's sigma is 0.4 of that, so the limit is five of its
# sigmas
BACKGROUND_GATE: Final = 2.0
EQUIPMENT_GATE: Final = 3.0  # limit in sigmas of a single pixel; no median is used, since thin bars are 3 pixels wide
# m, error of the equipment model, which was measured by hand and whose pose was estimated
EQUIPMENT_TOLERANCE_M: Final = 0.01
_SQUARE: Final = np.ones((3, 3), np.uint8)


class BackgroundSource(StrEnum):
    """The source of the background; the texts appear in the run's notes."""

    PICTURE = "the given picture of the empty room"
    RECORDING = "what stays in place in the recording"
    REMOVED = "the recording holds people only"


@dataclass(frozen=True, slots=True, eq=False)
class RestingLayer:
    """An object in front of the room that rests in one place for some time."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 at pixels without the object
    sigma_m: np.ndarray  # (height, width) float32, standard deviation of its readings
    from_s: float  # s on the reference clock, time at which the object comes to rest
    until_s: float  # s on the reference clock, time at which the object is moved away


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundModel:
    """One camera's empty room."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 where unknown
    sigma_m: np.ndarray  # (height, width) float32, standard deviation of readings from ``depth_m`` without people
    sensor: Sensor
    source: BackgroundSource
    layers: tuple[RestingLayer, ...] = ()  # movable objects, each for the time that it rests
    usual_share: float = 0.0  # share of the known pixels that show the room in a usual frame (``other_place``)


def room_at(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return (depth_m, sigma_m), (height, width) float32 each, with which the readings of a frame are compared.

    They describe the room or, unless the reading lies behind it, a layer that rests there at this time. With None as
    time_s, they describe only the room.
    """
    room, sigma = model.depth_m, model.sigma_m
    for layer in model.layers:
        if time_s is not None and layer.from_s <= time_s <= layer.until_s:
            here = (layer.depth_m > 0) & (depth_m < layer.depth_m + JUMP_GATE * layer.sigma_m)
            room, sigma = np.where(here, layer.depth_m, room), np.where(here, layer.sigma_m, sigma)
    return room, sigma


def foreground(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None = None) -> np.ndarray:
    """Return (height, width) bool: pixels nearer than the room by more than the noise explains, without flying
    pixels.

    time_s: time of the frame on the reference clock; None: without layers.

    The test uses the 3x3 median of the difference in sigmas, so it finds even a sole on the floor: the margin is two
    sigmas along the ray, which is a centimetre of height at grazing incidence. A pixel that is clearly nearer is tested
    without a median, since fingers and corners of the outline are smaller than the median's window. Where the
    background is unknown, every reading counts as foreground; pixels that do not belong to a person are removed later.
    """
    nearer = _sigmas_nearer(depth_m, *room_at(depth_m, model, time_s))
    mask = ((cv2.medianBlur(nearer, 3) > BACKGROUND_GATE) & (nearer > 0)) | (nearer > JUMP_GATE)
    return without_flying_pixels(depth_m, mask, model.sensor.jump_limit)


@njit(cache=True, nogil=True)
def _sigmas_nearer(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return by how many sigmas each reading lies in front of the room; 1e3 if the room is unknown there, -1e3 without
    a reading.
    """
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
    """One camera's view of the equipment alone."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 without equipment on this ray
    measured: np.ndarray  # (height, width) bool, equipment pixels around which the background shows only equipment
    low_m: np.ndarray  # (height, width) float32; a reading from low_m to high_m is the equipment; inf without equipment
    high_m: np.ndarray  # (height, width) float32


def equipment_depth(camera: Camera, equipment: EquipmentModel) -> np.ndarray:
    """Return the depth (height, width) float32 of the equipment alone, 0 without equipment; raises ValueError if the
    camera's pose is unknown.
    """
    depth = np.zeros((camera.height, camera.width), np.float32)
    rendering = EquipmentCaster(equipment).render(camera, invert_rigid(camera.require_pose()))
    if rendering is not None:
        depth[rendering.window] = np.where(np.isfinite(rendering.depth_m), rendering.depth_m, 0.0)
    return depth


def expect_equipment(drawn_m: np.ndarray, background: BackgroundModel) -> ExpectedEquipment:
    """Compute which readings show the equipment; once per camera is enough, since it does not move.

    drawn_m: from ``equipment_depth``. The silhouette is made one pixel wider than drawn, since a pixel that lies half
    on a bar reads the bar.
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
    """Return (height, width) bool: pixels that show the equipment, so that the patient may be behind it.

    These are pixels that read the equipment, and pixels without a reading where the equipment is drawn; nearer readings
    are in front of it. nearer (height, width) bool: from ``foreground``. Where the background frame shows the equipment
    without people, only ``nearer`` decides: fingers around a bar stand out by less than the error of the equipment
    model, and by less than one pixel's noise.
    """
    on_it = (depth_m >= expected.low_m) & (depth_m <= expected.high_m) & ~(expected.measured & nearer)
    mask: np.ndarray = on_it | ((depth_m <= 0) & (expected.depth_m > 0))
    return mask
