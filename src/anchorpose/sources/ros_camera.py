"""Lens and place of a camera: ROS's ``CameraInfo`` (docs.ros.org, sensor_msgs/CameraInfo), transforms (REP 103, 105).

Only ``/tf_static`` places a camera: poses in ``/tf`` may change, and a robot's frame is not a world.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.lens import COEFFICIENTS, Intrinsics, LensModel
from anchorpose.sources.bag_file import BagFile, DamagedBag
from anchorpose.sources.ros_messages import CameraInfo, read_transforms

_MODELS: Final = {
    "plumb_bob": LensModel.BROWN_CONRADY,
    "rational_polynomial": LensModel.RATIONAL,
    "equidistant": LensModel.KANNALA_BRANDT,
    "fisheye": LensModel.KANNALA_BRANDT,
}
_LARGEST: Final = 1e6  # of any number of a lens
_SHORTEST_PX: Final = 1.0
_TOPIC: Final = "/tf_static"
_WORLDS: Final = frozenset({"world", "map", "odom"})
_FARTHEST_M: Final = 1e6
_LONGEST: Final = 100  # transforms in a row, so that a damaged file with a ring of frames ends

T_WORLD_ROS: Final = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""REP 103's world has x forward and z up; this project's has x forward and y up."""


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
    if not may_be_a_lens(focal_centre, info.D):
        return Lens(None, "the camera was not calibrated")
    fx, fy, cx, cy = _of_part(info, *focal_centre)
    return lens_with((fx, fy, cx, cy), () if rectified else info.D, info.model)


def may_be_a_lens(focal_centre: tuple[float, ...], D: tuple[float, ...]) -> bool:
    """Whether focal lengths, centre and coefficients are numbers that a lens can have, and not damage or zeros."""
    return all(abs(value) < _LARGEST for value in (*focal_centre, *D)) and min(focal_centre[:2]) >= _SHORTEST_PX


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


class StaticTransforms:
    """The transforms of a bag that never change."""

    def __init__(self, bag: BagFile) -> None:
        self._parents: dict[str, tuple[str, np.ndarray]] = {}
        for message in bag.messages((_TOPIC,)):
            try:
                for parent, child, values in read_transforms(message):
                    self._parents[child] = parent, values
            except DamagedBag:
                continue  # a chain without it ends in no world

    def place(self, frame: str) -> tuple[np.ndarray | None, str]:
        """T_world_camera (4, 4) of an optical frame, None without a fixed world; and the last frame of its chain."""
        T_frame_camera, found = np.eye(4), None
        frame = frame.lstrip("/")
        for _ in range(_LONGEST):
            if frame in _WORLDS:
                found = T_frame_camera
            if frame not in self._parents:
                break
            frame, values = self._parents[frame]
            T_parent_frame = _matrix(values)
            if T_parent_frame is None:
                return None, frame
            T_frame_camera = T_parent_frame @ T_frame_camera
        return (None if found is None else T_WORLD_ROS @ found), frame


def _matrix(values: np.ndarray) -> np.ndarray | None:
    """(4, 4) of translation in metres and quaternion x, y, z, w; None where they are none."""
    if not (np.abs(values) < _FARTHEST_M).all():  # nor are those that are no numbers
        return None
    length = np.linalg.norm(values[3:])
    if not 0.99 < length < 1.01:  # ROS's own tolerance for a unit quaternion
        return None
    x, y, z, w = values[3:] / length
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = values[:3]
    return matrix
