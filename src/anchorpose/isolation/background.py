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

# sigmas of a pixel, as a limit for a 3x3 median; a median has 0.4 of a pixel's deviation, so these are five of its own
# sigmas
BACKGROUND_GATE: Final = 2.0
EQUIPMENT_GATE: Final = 3.0  # sigmas of a single pixel, not of a median, since thin bars are 3 pixels wide
# m, error of the equipment, which was measured by hand and whose pose was estimated
EQUIPMENT_TOLERANCE_M: Final = 0.01
_SQUARE: Final = np.ones((3, 3), np.uint8)


class BackgroundSource(StrEnum):
    """The source of the background, which the run's notes state."""

    PICTURE = "the given picture of the empty room"
    RECORDING = "what stays in place in the recording"
    REMOVED = "the recording holds people only"


@dataclass(frozen=True, slots=True, eq=False)
class RestingLayer:
    """An object in front of the room, which rests here from from_s until until_s (reference clock) and is elsewhere at
    other times.

    depth_m (height, width) float32 metres, 0 = not here; sigma_m (height, width) float32: deviation of its readings.
    """

    depth_m: np.ndarray
    sigma_m: np.ndarray
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundModel:
    """One camera's empty room.

    depth_m (height, width) float32 metres, 0 = nothing known. sigma_m (height, width) float32: standard deviation of a
    live reading from depth_m where nobody stands. layers: movable objects, each for the time for which it rests.
    usual_share: share of the known pixels that read the room in a usual frame (``other_place``); 0 where unknown.
    """

    depth_m: np.ndarray
    sigma_m: np.ndarray
    sensor: Sensor
    source: BackgroundSource
    layers: tuple[RestingLayer, ...] = ()
    usual_share: float = 0.0


def room_at(depth_m: np.ndarray, model: BackgroundModel, time_s: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return (depth_m, sigma_m), (height, width) float32 each, with which readings at a time are compared.

    They describe the room or, where the reading is not behind it, a layer that is present at the time. time_s None:
    only the room.
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

    time_s: time of the frame, reference clock; None: no layers.

    The test uses the 3x3 median of the difference in sigmas, so it finds even a sole on the floor: the margin is two
    sigmas along the ray, at grazing incidence a centimetre of height. A pixel that is clearly nearer is tested without
    a median, since fingers and corners of the outline are smaller than its window. Where the background is unknown, a
    reading counts as foreground; pixels that do not belong to a person are removed later.
    """
    nearer = _sigmas_nearer(depth_m, *room_at(depth_m, model, time_s))
    mask = ((cv2.medianBlur(nearer, 3) > BACKGROUND_GATE) & (nearer > 0)) | (nearer > JUMP_GATE)
    return without_flying_pixels(depth_m, mask, model.sensor.jump_limit)


@njit(cache=True, nogil=True)
def _sigmas_nearer(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return how many sigmas each reading lies in front of the room; 1e3 where the room is unknown, -1e3 without a
    reading.
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
    """One camera's view, if only the equipment were there.

    depth_m (height, width) float32 metres, 0 = no equipment on this ray. A reading between low_m and high_m, (height,
    width) float32, is the equipment; away from equipment low_m is inf. measured (height, width) bool: pixels of the
    drawn equipment around which the background frame shows only equipment.
    """

    depth_m: np.ndarray
    measured: np.ndarray
    low_m: np.ndarray
    high_m: np.ndarray


def equipment_depth(camera: Camera, equipment: EquipmentModel) -> np.ndarray:
    """Return the depth (height, width) float32 of the equipment alone, 0 = none; raises ValueError where the pose is
    unknown.
    """
    depth = np.zeros((camera.height, camera.width), np.float32)
    rendering = EquipmentCaster(equipment).render(camera, invert_rigid(camera.require_pose()))
    if rendering is not None:
        depth[rendering.window] = np.where(np.isfinite(rendering.depth_m), rendering.depth_m, 0.0)
    return depth


def expect_equipment(drawn_m: np.ndarray, background: BackgroundModel) -> ExpectedEquipment:
    """Compute which readings show the equipment; once per camera is enough, since it does not move.

    drawn_m: ``equipment_depth``. The silhouette is made one pixel wider than drawn, since a pixel that is half on a bar
    reads the bar.
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

    These are pixels that read the equipment, and pixels without a reading where it is drawn; nearer readings are in
    front of it. nearer (height, width) bool: ``background.foreground``. Where the background frame shows the empty
    equipment, only ``nearer`` decides, since fingers around a bar stand out from the bar by less than the error of a
    model measured by hand, and by less than one pixel's noise.
    """
    on_it = (depth_m >= expected.low_m) & (depth_m <= expected.high_m) & ~(expected.measured & nearer)
    mask: np.ndarray = on_it | ((depth_m <= 0) & (expected.depth_m > 0))
    return mask
