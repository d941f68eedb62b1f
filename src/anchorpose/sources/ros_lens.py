"""The lens that a ``CameraInfo`` describes (docs.ros.org, sensor_msgs/CameraInfo)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from anchorpose.lens import COEFFICIENTS, Intrinsics, LensModel
from anchorpose.sources.ros_messages import CameraInfo

_MODELS: Final = {
    "plumb_bob": LensModel.BROWN_CONRADY,
    "rational_polynomial": LensModel.RATIONAL,
    "equidistant": LensModel.KANNALA_BRANDT,
    "fisheye": LensModel.KANNALA_BRANDT,
}


@dataclass(frozen=True, slots=True)
class Lens:
    """The intrinsics, or why there are none; notes: what the user should know of them."""

    intrinsics: Intrinsics | None
    problem: str = ""


def image_size(info: CameraInfo) -> tuple[int, int]:
    """Width and height of the images that belong to an info, after its region and binning."""
    _, _, height, width = info.roi
    across, down = _binning(info)
    return (width or info.width) // across, (height or info.height) // down


def lens_of(info: CameraInfo, rectified: bool) -> Lens:
    """The lens of an image; rectified: the image has been freed of distortion, so that P holds and not K."""
    if rectified and info.P[0] > 0.0:
        focal_centre = info.P[0], info.P[5], info.P[2], info.P[6]
    elif rectified and any(info.D):
        return Lens(None, "its images are rectified, but their projection P is missing")
    else:
        focal_centre = info.K[0], info.K[4], info.K[2], info.K[5]
    if not all(map(math.isfinite, (*focal_centre, *info.D))) or min(focal_centre[:2]) <= 0.0:
        return Lens(None, "the camera was not calibrated")
    fx, fy, cx, cy = _of_part(info, *focal_centre)
    return lens_with((fx, fy, cx, cy), () if rectified else info.D, info.model)


def lens_with(focal_centre: tuple[float, float, float, float], D: tuple[float, ...], model: str) -> Lens:
    """From focal lengths, centre, and coefficients of a model by ROS's name."""
    fx, fy, cx, cy = focal_centre
    if not any(D):
        return Lens(Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy))
    known = _MODELS.get(model)
    if known is LensModel.BROWN_CONRADY and len(D) == 4:
        D = (*D, 0.0)
    if known is LensModel.BROWN_CONRADY and len(D) in COEFFICIENTS[LensModel.RATIONAL]:
        known = LensModel.RATIONAL  # some drivers name the shorter model for OpenCV's eight coefficients
    if known is None or len(D) not in COEFFICIENTS[known]:
        return Lens(None, f"its lens model {model!r} with {len(D)} coefficients is not known")
    return Lens(Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, distortion=D, model=known))


def _of_part(info: CameraInfo, fx: float, fy: float, cx: float, cy: float) -> tuple[float, float, float, float]:
    """Of the full image's lens, that of a region of it whose pixels are joined.

    A joined pixel's centre lies between those of its parts, hence the halves.
    """
    column, row, _, _ = info.roi
    across, down = _binning(info)
    centre_x, centre_y = (cx - column + 0.5) / across - 0.5, (cy - row + 0.5) / down - 0.5
    return fx / across, fy / down, centre_x, centre_y


def _binning(info: CameraInfo) -> tuple[int, int]:
    """Pixels joined across and down; ROS writes 0 for 1."""
    return max(info.binning[0], 1), max(info.binning[1], 1)
