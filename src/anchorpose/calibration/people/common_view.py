"""What several cameras without poses see at the same moments, each in a frame of its own that stands on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera

NEARER_M: Final = 0.12  # people stand off the room by more than this
SURFACE_STEP_M: Final = 0.07  # neighbours farther apart in depth are not on one surface
NORMAL_PX: Final = 2
RIM_PX: Final = 7  # 2 cm at 2 m to either side: what a limb moves in the 30 ms between two pictures
LEAST_FACING: Final = 0.25  # cosine between normal and ray; flatter surfaces are too noisy


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Surface points of one picture: points, normals (n, 3) float64 camera frame; person (n,) bool: not the room's."""

    points_m: np.ndarray
    normals: np.ndarray
    person: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class LevelView:
    """One camera's part. T_level_camera (4, 4): Y up, origin on the floor below the camera, Z level along its axis
    turned left; depths_m: its pictures (height, width), at the moments that all cameras share; smooth_m: ``smoothed``;
    people (height, width) bool: where people are, with a rim; seen: one a picture; room_m: the empty room or
    what stays.
    """

    camera: Camera
    T_level_camera: np.ndarray
    room_m: np.ndarray
    depths_m: tuple[np.ndarray, ...]
    smooth_m: tuple[np.ndarray, ...]
    people: tuple[np.ndarray, ...]
    seen: tuple[Seen, ...]


def level_view(
    camera: Camera, floor: FloorPlane, background_m: np.ndarray | None, depths_m: Sequence[np.ndarray], step_px: int
) -> LevelView:
    """The view of one camera; depths_m (height, width) float32, 0 = no reading, at least one."""
    stack = np.stack(depths_m)
    room = background_m if background_m is not None else np.quantile(stack, 0.9, axis=0).astype(np.float32)
    smooth = tuple(smoothed(depth) for depth in depths_m)
    seen = tuple(surface_points(camera, depth, room, step_px) for depth in smooth)
    people = tuple(_people(depth, room) for depth in depths_m)
    return LevelView(camera, level_frame(floor), room, tuple(depths_m), smooth, people, seen)


def _people(depth_m: np.ndarray, room_m: np.ndarray) -> np.ndarray:
    """(height, width) bool: nearer than the room, and what is next to it."""
    nearer = (depth_m > 0) & ((room_m <= 0) | (depth_m < room_m - NEARER_M))
    return np.asarray(cv2.dilate(nearer.astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8)) > 0)


def level_frame(floor: FloorPlane) -> np.ndarray:
    """T_level_camera (4, 4): Y along the floor's normal, origin below the camera, X level along the optical axis."""
    ahead = np.array([0.0, 0.0, 1.0])
    forward = ahead - (floor.up @ ahead) * floor.up
    forward /= np.linalg.norm(forward)
    T_level_camera = np.eye(4)
    T_level_camera[:3, :3] = np.stack([forward, floor.up, np.cross(forward, floor.up)])
    T_level_camera[1, 3] = floor.height_m
    return T_level_camera


def smoothed(depth_m: np.ndarray) -> np.ndarray:
    """(height, width) the mean of each 3x3 neighbourhood where it is one surface, elsewhere 0."""
    window = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(depth_m, window)
    one = (nearest > 0) & (cv2.dilate(depth_m, window) - nearest < SURFACE_STEP_M)
    return np.where(one, cv2.blur(depth_m, (3, 3)), np.float32(0.0)).astype(np.float32)


def surface_points(camera: Camera, smooth_m: np.ndarray, room_m: np.ndarray, step_px: int) -> Seen:
    """Points with normals on a grid of every ``step_px``-th pixel, where the surface is smooth and faces the camera."""
    rows, columns = (
        grid.ravel()
        for grid in np.mgrid[
            NORMAL_PX : camera.height - NORMAL_PX : step_px, NORMAL_PX : camera.width - NORMAL_PX : step_px
        ]
    )
    points, normals, good = points_with_normals(camera, smooth_m, rows, columns)
    room = room_m[rows, columns]
    person = (room <= 0) | (smooth_m[rows, columns] < room - NEARER_M)  # where the room is out of reach, people are not
    return Seen(points[good], normals[good], person[good])


def points_with_normals(
    camera: Camera, smooth_m: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and unit normals (n, 3) at pixels ``NORMAL_PX`` or more inside the picture; whether both can be used."""
    rays = camera.pixel_rays()
    aside = ((0, 0), (0, -NORMAL_PX), (0, NORMAL_PX), (-NORMAL_PX, 0), (NORMAL_PX, 0))
    places = [(rows + r, columns + c) for r, c in aside]
    point, left, right, above, below = (
        np.column_stack([rays[at] * smooth_m[at][:, None], smooth_m[at]]).astype(np.float64) for at in places
    )
    normal = np.cross(right - left, below - above)
    length = np.linalg.norm(normal, axis=1)
    seen = np.logical_and.reduce([smooth_m[at] > 0 for at in places])
    flat = np.maximum(np.abs(right - left)[:, 2], np.abs(below - above)[:, 2]) < 2.0 * SURFACE_STEP_M
    normal /= np.maximum(length, 1e-12)[:, None]
    towards = -np.einsum("ij,ij->i", normal, point)
    normal *= np.sign(towards)[:, None]
    facing = np.abs(towards) > LEAST_FACING * np.linalg.norm(point, axis=1)
    return point, normal, seen & flat & facing & (length > 0)
