"""Where a camera is in the room, of the transforms that ROS records (REP 103 and 105).

Only ``/tf_static`` is used: what ``/tf`` tells may move, and a frame of a robot is no world.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.sources.bag_file import BagFile, DamagedBag
from anchorpose.sources.ros_messages import read_transforms

_TOPIC: Final = "/tf_static"
_WORLDS: Final = frozenset({"world", "map", "odom"})
_FARTHEST_M: Final = 1e6
_LONGEST: Final = 100  # transforms in a row, so that a damaged file with a ring of frames ends

T_WORLD_ROS: Final = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""REP 103's world has x forward and z up; this project's has x forward and y up."""


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
