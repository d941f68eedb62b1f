"""Describe the empty room and the equipment (an object with a known 3D model, the paper's chi_0) as each camera sees
them, and find the foreground: pixels with a reading in front of the room (paper, Section III).
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

# sigmas (standard deviations) of a single reading. A pixel is foreground if the median over its 3x3 neighbourhood lies
# in front of the room by more than ``BACKGROUND_GATE`` sigmas. The median of nine readings has 0.4 times the sigma of a
# single reading, so this gate of two sigmas of a reading is five sigmas of the median.
BACKGROUND_GATE: Final = 2.0
# sigmas of a single reading, maximum difference between the depth of the equipment and a reading that shows it. For
# equipment, the median of 3x3 pixels is not used: thin bars are at most three pixels wide, so the 3x3 pixels would
# include pixels beside the bar
EQUIPMENT_GATE: Final = 3.0
# m, assumed error of the equipment's predicted surface: the model was measured by hand, and the pose was estimated
EQUIPMENT_TOLERANCE_M: Final = 0.01
_SQUARE: Final = np.ones((3, 3), np.uint8)


class BackgroundSource(StrEnum):
    """The source of a camera's background (its empty room); the texts appear in the run's notes."""

    PICTURE = "the given picture of the empty room"
    RECORDING = "what stays in place in the recording"
    REMOVED = "the recording holds people only"


@dataclass(frozen=True, slots=True, eq=False)
class RestingLayer:
    """An object in front of the room that rests in one place for some time."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 at pixels without the object
    sigma_m: np.ndarray  # (height, width) float32 m, standard deviation of the readings on the object
    from_s: float  # s on the reference clock (the first camera's clock), time at which the object comes to rest
    until_s: float  # s on the reference clock, time at which the object is moved away


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundModel:
    """One camera's empty room (the background): its depth, the noise of its readings, and movable objects that rest in
    it.
    """

    depth_m: np.ndarray  # (height, width) float32 m, 0 where unknown
    sigma_m: np.ndarray  # (height, width) float32 m, standard deviation of the empty room's readings about ``depth_m``
    sensor: Sensor
    source: BackgroundSource
    # movable objects that rest in the room, each with the time during which it rests
    layers: tuple[RestingLayer, ...] = ()
    # share of pixels that show the room, among the pixels at which the room's depth is known: the median over frames; 0
    # = unknown
    usual_share: float = 0.0
    moved: bool = False  # whether the camera or much of the room moved during the recording


def room_at(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the background's depth at each pixel of a frame, and the standard deviation of readings of the background,
    (height, width) float32 metres each.

    depth_m: the frame's readings. If an object rests at a pixel at the time ``time_s``, the object (its layer) is the
    background of this pixel. If no object rests there, or if the reading lies behind the object, the background is the
    room. time_s: time of the frame on the reference clock; if it is None, resting objects are ignored.
    """
    room, sigma = model.depth_m, model.sigma_m
    for layer in model.layers:
        if time_s is not None and layer.from_s <= time_s <= layer.until_s:
            here = (layer.depth_m > 0) & (depth_m < layer.depth_m + JUMP_GATE * layer.sigma_m)
            room, sigma = np.where(here, layer.depth_m, room), np.where(here, layer.sigma_m, sigma)
    return room, sigma


def foreground(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None = None) -> np.ndarray:
    """Return (height, width) bool: pixels whose readings are nearer than the room by more than noise causes, without
    flying pixels (readings between two surfaces, at an outline).

    time_s: time of the frame on the reference clock; None: objects that rest in the room only for some time are
    ignored.

    The test of a pixel computes the difference between the room's depth and the reading, in sigmas (standard
    deviations), and takes the median over 3x3 pixels. The pixel is foreground if this median exceeds two sigmas,
    measured along the ray (``BACKGROUND_GATE``), and the pixel itself is nearer than the room. Where rays meet the
    floor at a small angle, two sigmas along the ray are a centimetre of height, so even the sole of a shoe on the floor
    is found. A pixel that is nearer than the room by more than ``JUMP_GATE`` sigmas is foreground, whatever the median
    is: fingers and corners of the outline fill less than half of the 3x3 pixels, so the median there may show the room.
    Where the background is unknown, every reading counts as foreground; pixels that show no person are removed later.
    """
    nearer = _sigmas_nearer(depth_m, *room_at(depth_m, model, time_s))
    mask = ((cv2.medianBlur(nearer, 3) > BACKGROUND_GATE) & (nearer > 0)) | (nearer > JUMP_GATE)
    return without_flying_pixels(depth_m, mask, model.sensor.jump_limit)


@njit(cache=True, nogil=True)
def _sigmas_nearer(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return, for each pixel, how many sigmas the reading lies in front of the room: 1e3 if the room is unknown, -1e3
    without a reading.
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
    """One camera's predicted view of the equipment alone."""

    depth_m: np.ndarray  # (height, width) float32 m, 0 without equipment on this ray
    # (height, width) bool, whether the background has the equipment's depth at a pixel and at all its eight neighbours
    measured: np.ndarray
    # (height, width) float32 m; a reading from low_m to high_m shows the equipment; inf at pixels without equipment
    low_m: np.ndarray
    high_m: np.ndarray  # (height, width) float32 m; 0 without equipment


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
    """Compute, for each pixel, the range of depths in which a reading shows the equipment. These ranges are computed
    only once per camera, since the equipment does not move.

    drawn_m: from ``equipment_depth``. The equipment's silhouette is made one pixel wider than it is drawn, since a
    pixel that lies half on a bar reads the bar.
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
    """Return (height, width) bool: pixels that show the equipment; the patient may be hidden behind it.

    The equipment's mask has the pixels with a reading between ``low_m`` and ``high_m``, and the pixels without a
    reading at which the equipment is expected. nearer (height, width) bool: the foreground, from ``foreground``. Where
    the background itself shows the equipment (``measured``), a pixel of the foreground is never equipment. The reason
    is that fingers around a bar stand out from the bar by less than the sum of the equipment model's error and one
    pixel's noise. So the readings of the fingers may lie between ``low_m`` and ``high_m``, too.
    """
    on_it = (depth_m >= expected.low_m) & (depth_m <= expected.high_m) & ~(expected.measured & nearer)
    mask: np.ndarray = on_it | ((depth_m <= 0) & (expected.depth_m > 0))
    return mask
