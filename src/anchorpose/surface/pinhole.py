"""World points into a camera's depth image, inside compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid
from anchorpose.lens import lens_array, pixel_of_ray


class Pinhole(NamedTuple):
    """A camera as compiled kernels take it: T_camera_world (4, 4) float32; lens: ``lens_array``."""

    T_camera_world: np.ndarray
    lens: np.ndarray


def pinhole(camera: Camera) -> Pinhole:
    """The camera's pose and intrinsics; raises ValueError for a camera without pose."""
    T_camera_world = np.ascontiguousarray(invert_rigid(camera.require_pose()), dtype=np.float32)
    return Pinhole(T_camera_world, lens_array(camera.intrinsics))


@njit(cache=True, nogil=True)
def into_camera(camera: Pinhole, points: np.ndarray, k: int) -> tuple[np.float32, np.float32, np.float32]:
    """Row and column in pixels of one point, and its depth; NaN behind the camera and beyond the lens."""
    T_camera_world, lens = camera.T_camera_world, camera.lens
    x, y, z = T_camera_world[0, 3], T_camera_world[1, 3], T_camera_world[2, 3]
    for axis in range(3):
        x += T_camera_world[0, axis] * points[k, axis]
        y += T_camera_world[1, axis] * points[k, axis]
        z += T_camera_world[2, axis] * points[k, axis]
    if z <= 0.0:
        return np.float32(np.nan), np.float32(np.nan), z
    column, row = pixel_of_ray(x / z, y / z, lens)
    return np.float32(row), np.float32(column), z
