"""The lens of an Azure Kinect's depth camera, from the calibration that the device carries.

The facts are from the published Azure Kinect Sensor SDK (github.com/microsoft/Azure-Kinect-Sensor-SDK, MIT):
``src/calibration/calibration.c`` (the document), ``src/transformation/mode_specific_calibration.c`` (crops, binning and
the half pixel) and ``src/transformation/intrinsic_transformation.c`` (the order and the meaning of the parameters).
Orbbec's wrapper for Femto (github.com/orbbec/OrbbecSDK-K4A-Wrapper) has the same three, unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.lens import Intrinsics, LensModel
from anchorpose.recording.document import parse_json

DEPTH_CAMERA: Final = "CALIBRATION_CameraLocationD0"
MODEL: Final = "CALIBRATION_LensDistortionModelBrownConrady"
"""By its name; by its formula it is OpenCV's rational model. The SDK's other models were on early internal devices."""
SENSOR_PX: Final = 1024
"""The sensor is a square; the SDK refuses a calibration of another."""
FOCAL: Final = (0.25, 1.0)
"""Of the sensor's width, beyond which a focal length is damaged: 127 and 53 degrees of view without distortion, where
the maker states 120 with it; a real file has 0.493."""


@dataclass(frozen=True, slots=True)
class DepthMode:
    """A part of the sensor: binning, sensor pixels per image pixel; left and top, image pixels that are cropped."""

    name: str
    width: int
    height: int
    binning: int
    left: int
    top: int


MODES: Final = (
    DepthMode("NFOV_2X2BINNED", 320, 288, 2, 96, 90),
    DepthMode("NFOV_UNBINNED", 640, 576, 1, 192, 180),
    DepthMode("WFOV_2X2BINNED", 512, 512, 2, 0, 0),
    DepthMode("WFOV_UNBINNED", 1024, 1024, 1, 0, 0),
)
"""All modes with a depth image; no two have the same size."""


def depth_mode(width: int, height: int) -> DepthMode | None:
    """Return the mode whose images have this size; None where there is none."""
    return next((mode for mode in MODES if (mode.width, mode.height) == (width, height)), None)


def lens_of(calibration: bytes, mode: DepthMode) -> Intrinsics:
    """Return the depth camera's lens in the pixels of a mode.

    calibration: the text of ``calibration.json``. Raises ValueError with what is wrong with it, to follow "which".
    """
    camera = _depth_camera(calibration)
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, centre_x, centre_y, p2, p1 = _parameters(camera)
    if centre_x or centre_y:
        raise ValueError("has a centre of distortion, which this lens model lacks")
    size_px = SENSOR_PX / mode.binning
    # the document's (0, 0) is the corner of the sensor's first pixel, ours is the centre of the image's first pixel
    return Intrinsics(
        fx=fx * size_px,
        fy=fy * size_px,
        cx=cx * size_px - mode.left - 0.5,
        cy=cy * size_px - mode.top - 0.5,
        distortion=(k1, k2, p1, p2, k3, k4, k5, k6),
        model=LensModel.RATIONAL,
        valid_radius=_radius(camera),
    )


def _depth_camera(calibration: bytes) -> dict:
    """Return the entry of the depth camera."""
    try:
        document = parse_json(calibration.rstrip(b"\0"))
        cameras = document["CalibrationInformation"]["Cameras"]
        camera = next(entry for entry in cameras if entry["Location"] == DEPTH_CAMERA)
        size = (camera["SensorWidth"], camera["SensorHeight"])
    except (ValueError, LookupError, TypeError, StopIteration):
        raise ValueError("is damaged or has no depth camera") from None
    if size != (SENSOR_PX, SENSOR_PX):
        raise ValueError(f"is not of a sensor of {SENSOR_PX} x {SENSOR_PX} pixels")
    return dict(camera)


def _parameters(camera: dict) -> tuple[float, ...]:
    """Return the fourteen numbers of the depth camera, checked."""
    try:
        model = camera["Intrinsics"]["ModelType"]
        numbers = np.array(camera["Intrinsics"]["ModelParameters"], dtype=np.float64)
    except (ValueError, LookupError, TypeError, OverflowError):
        raise ValueError("is damaged: it has no numbers for the lens") from None
    if model != MODEL:
        raise ValueError("is of a lens model that no Azure Kinect was sold with")
    if numbers.shape != (14,) or not np.isfinite(numbers).all():
        raise ValueError("is damaged: it does not have fourteen numbers for the lens")
    if not ((numbers[:2] > 0) & (numbers[:2] < 1) & (numbers[2:4] > FOCAL[0]) & (numbers[2:4] < FOCAL[1])).all():
        raise ValueError("is damaged: its focal length or image centre cannot be this sensor's")
    return tuple(numbers.tolist())


def _radius(camera: dict) -> float | None:
    """Return how far from the axis the lens was calibrated, in units of z; None where the maker did not find it (0)."""
    radius = camera.get("MetricRadius")
    if not isinstance(radius, int | float) or not np.isfinite(radius) or radius <= 1e-4:
        return None
    return float(radius)
