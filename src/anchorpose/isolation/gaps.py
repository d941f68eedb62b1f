"""Gaps in the walls of a room through which a camera sees farther: doorways and windows, or mirrors.

A depth camera measures along the light's way: it shows a mirrored room, and people, beyond the mirror's plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.room_planes import depth_of_plane, find_planes, off_plane_m
from anchorpose.isolation.scene import Scene
from anchorpose.rotations import UP

UPRIGHT: Final = 0.2  # cosine to the vertical: a mirror that leans by 11 degrees
FRAMED: Final = 0.6  # of a gap's border: a doorway has no frame at the floor


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """An upright plane of one camera's empty room, which is on its near side.

    normal (3,): unit, world, away from the camera, with ``normal @ p = offset_m``; depth_m (height, width) float32: of
    the plane along each ray, inf where it is not met; on_it, gap (height, width) bool: pixels of the empty room that
    show the plane, and those between them that show something beyond it or nothing.
    """

    camera: Camera
    normal: np.ndarray
    offset_m: float
    depth_m: np.ndarray
    on_it: np.ndarray
    gap: np.ndarray

    def beyond_m(self, points_m: np.ndarray) -> np.ndarray:
        """(...) how far points (..., 3) are beyond the plane, negative on the camera's side."""
        return np.asarray(points_m @ self.normal - self.offset_m)

    def reflected(self, points_m: np.ndarray) -> np.ndarray:
        """(..., 3) where a mirror in this plane shows points (..., 3)."""
        return np.asarray(points_m - 2.0 * self.beyond_m(points_m)[..., None] * self.normal)

    def gap_before(self, point_m: np.ndarray) -> np.ndarray | None:
        """(height, width) bool: the connected gap through which a point (3,) is seen, None where it is in none."""
        place = transform_points(invert_rigid(self.camera.require_pose()), point_m[None])
        column, row, inside = self.camera.pixel_of(place)
        if not inside[0] or not self.gap[row[0], column[0]]:
            return None
        _, piece = cv2.connectedComponents(self.gap.astype(np.uint8), connectivity=4)
        return np.asarray(piece == piece[row[0], column[0]])

    def frames(self, gap: np.ndarray) -> bool:
        """Whether the plane is around a gap (height, width), not only beside it."""
        border = cv2.dilate(gap.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ~gap
        return bool(border.any() and self.on_it[border].mean() > FRAMED)


def find_walls(scene: Scene) -> list[Wall]:
    """The upright planes of a camera's empty room, largest first; also fronts of furniture."""
    camera, room_m, noise = scene.camera, scene.background.depth_m, scene.background.noise_per_m
    T_world_camera, found = camera.require_pose(), list[Wall]()
    for plane in find_planes(room_m, camera, noise, most_beyond=1.0):
        normal = T_world_camera[:3, :3] @ plane[:3]
        if abs(normal @ UP) > UPRIGHT:
            continue
        beyond = np.nan_to_num(camera.back_project(room_m) @ plane[:3].astype(np.float32) - plane[3], nan=np.inf)
        limit_m = off_plane_m(room_m, noise)
        on_it = (room_m > 0) & (np.abs(beyond) < limit_m)
        gap = _within(on_it) & ~on_it & (beyond > limit_m)
        offset_m = float(plane[3] + normal @ camera.position_m)
        found.append(Wall(camera, normal, offset_m, depth_of_plane(plane, camera), on_it, gap))
    return found


def _within(mask: np.ndarray) -> np.ndarray:
    """(height, width) bool: the convex hull of the pixels of a mask."""
    filled = np.zeros(mask.shape, np.uint8)
    hull = cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32))
    return cv2.fillConvexPoly(filled, hull, 1).astype(bool)


def with_wall(scene: Scene, wall: Wall, gap: np.ndarray) -> Scene:
    """The scene with the wall where the gap (height, width) is: nobody is seen beyond it."""
    model = scene.background
    depth_m = np.where(gap, wall.depth_m, model.depth_m)
    sigma_m = np.where(gap, model.noise.sigma_m(wall.depth_m).astype(np.float32), model.sigma_m)
    return replace(scene, background=replace(model, depth_m=depth_m, sigma_m=sigma_m))
