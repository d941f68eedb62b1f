"""Represent a depth camera: intrinsics, pose, and the conversion between pixels and metres."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from anchorpose.lens import Intrinsics, lens_array, project, rays_of_pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """One camera of a recording. In the camera's coordinate frame, x points right, y down and z away from the camera,
    as in OpenCV; the unit is the metre.
    """

    name: str
    width: int
    height: int
    depth_scale: float  # metres per grey value
    intrinsics: Intrinsics
    T_world_camera: np.ndarray | None = field(default=None)  # (4, 4); None if the pose is unknown

    @property
    def position_m(self) -> np.ndarray:
        """Return the centre of projection (3,) in the world frame; raises ValueError if the pose is unknown."""
        return self.require_pose()[:3, 3]

    def require_pose(self) -> np.ndarray:
        """Return T_world_camera, the camera's pose. Raises ValueError if the pose is unknown, since no stage of the
        pipeline may assume a pose.
        """
        if self.T_world_camera is None:
            raise ValueError(f"the pose of camera {self.name} is unknown")
        return self.T_world_camera

    def share_in_image(self, places_m: np.ndarray) -> float:
        """Return the share (0 to 1) of the world points (n, 3) that lies inside this camera's image; raises ValueError
        if the pose is unknown.
        """
        return float(self.pixel_of(transform_points(invert_rigid(self.require_pose()), places_m))[2].mean())

    def pixel_rays(self) -> np.ndarray:
        """Return the ray (line of sight) of each pixel (height, width, 2) float32, as x/z and y/z in the camera frame;
        NaN beyond the lens's valid radius. The array is read only.
        """
        return _pixel_rays(self.intrinsics, self.width, self.height)

    def valid_pixels(self) -> np.ndarray:
        """Return (height, width) bool, read only: whether a pixel lies within the lens's valid radius, so that it has a
        ray.
        """
        return _valid_pixels(self.intrinsics, self.width, self.height)

    def back_project(self, depth_m: np.ndarray) -> np.ndarray:
        """Convert a depth image (height, width) in metres to points (height, width, 3) float32 in the camera frame; NaN
        where the depth is 0 (no reading).
        """
        depth = np.where(depth_m > 0, depth_m, np.nan).astype(np.float32)
        return np.concatenate([self.pixel_rays() * depth[..., None], depth[..., None]], axis=-1)

    def project(self, points_camera_m: np.ndarray) -> np.ndarray:
        """Project points (n, 3) in the camera frame to pixels (n, 2), column and row, including the lens's distortion;
        NaN behind the camera and beyond the lens's valid radius.
        """
        points = np.asarray(points_camera_m, dtype=np.float64).reshape(-1, 3)
        return project(points, lens_array(self.intrinsics))

    def pixel_of(self, points_camera_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the column and row (n,) int64 of each point's pixel, and (n,) bool: whether the point is in the image.
        Column and row of a point outside the image are 0.
        """
        place = self.project(points_camera_m)
        place = np.where(np.isfinite(place), np.clip(place, -1e6, 1e6), -1.0)
        column, row = np.rint(place).astype(np.int64).T
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return np.where(inside, column, 0), np.where(inside, row, 0), inside

    def look(self, points_m: np.ndarray, depth_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compare points (n, 3) in the world with this camera's depth image (height, width).

        Return three arrays (n,): the depth of each point in this camera in metres, the depth image's reading at the
        point's pixel, and whether the point is in the image. For a point outside the image, the reading is the reading
        at pixel (0, 0), which has no meaning. Raises ValueError if the camera's pose is unknown.
        """
        in_camera = transform_points(invert_rigid(self.require_pose()), points_m)
        column, row, inside = self.pixel_of(in_camera)
        return in_camera[:, 2], depth_m[row, column], inside


def places_of(cameras: Iterable[Camera], among: Sequence[Camera]) -> tuple[int, ...]:
    """Return the index of each camera in ``among``, by its name; raises ValueError if ``among`` lacks a camera."""
    names = [camera.name for camera in among]
    return tuple(names.index(camera.name) for camera in cameras)


@lru_cache(maxsize=16)
def _pixel_rays(intrinsics: Intrinsics, width: int, height: int) -> np.ndarray:
    rays = rays_of_pixels(intrinsics, width, height).astype(np.float32)
    rays.setflags(write=False)
    return rays


@lru_cache(maxsize=16)
def _valid_pixels(intrinsics: Intrinsics, width: int, height: int) -> np.ndarray:
    valid = np.isfinite(_pixel_rays(intrinsics, width, height)[..., 0])
    valid.setflags(write=False)
    return valid


def transform_points(T_target_source: np.ndarray, points_source: np.ndarray) -> np.ndarray:
    """Return ``p_target = T_target_source @ p_source`` for points of shape (..., 3)."""
    return points_source @ T_target_source[:3, :3].T + T_target_source[:3, 3]


def invert_rigid(T_target_source: np.ndarray) -> np.ndarray:
    """Return the inverse, T_source_target, of a rigid transform (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = T_target_source[:3, :3].T
    inverse[:3, 3] = -T_target_source[:3, :3].T @ T_target_source[:3, 3]
    return inverse
