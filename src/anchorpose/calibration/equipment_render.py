"""The equipment as a camera would see it at a given pose, and its outline to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.recording.equipment import EquipmentModel

MARGIN_PX: Final = 6  # around the equipment: the profiles across the outline reach this far
SUBPIXEL: Final = 8  # rays between two pixels: the outline is known to a sixteenth of a pixel
JUMP_M: Final = 0.08  # between neighbouring pixels of the equipment: one part ends before another


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """A window of one camera's depth image, (h, w) from row ``top`` and column ``left``; camera frame.

    depth_m float32, inf = no equipment; normal (h, w, 3) towards the camera; part int, -1 = none.
    """

    top: int
    left: int
    depth_m: np.ndarray
    normal: np.ndarray
    part: np.ndarray

    @property
    def window(self) -> tuple[slice, slice]:
        """Where it lies in the whole image."""
        height, width = self.depth_m.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points of the equipment's silhouette, one per row of the arrays, found along rows or columns of the window.

    row, column (n,) int: the last pixel on the equipment, in the whole image; step (n, 2) int: the direction outward
    (rows, columns); beyond_px (n,) float: how far beyond that pixel's centre the outline is; across (n, 2): unit normal
    of the outline in the image (rows, columns), outward; part (n,).
    """

    row: np.ndarray
    column: np.ndarray
    step: np.ndarray
    beyond_px: np.ndarray
    across: np.ndarray
    depth_m: np.ndarray
    part: np.ndarray


class EquipmentCaster:
    """Casts rays at chi_0; the tree over its triangles is built once."""

    def __init__(self, model: EquipmentModel) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        corners = [vertices[faces] for vertices, faces in (part.triangles() for part in model.parts)]
        triangles = np.concatenate(corners)
        self._scene: Any = EmbreeScene()
        TriangleMesh(self._scene, triangles.astype(np.float32))
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        self._part = np.repeat(np.arange(len(corners)), [len(part) for part in corners])
        self.vertices_m = triangles.reshape(-1, 3)
        self.part_count = len(corners)

    def render(self, camera: Camera, T_camera_model: np.ndarray) -> Rendering | None:
        """What the camera would see; None where no corner of the equipment falls into the image."""
        points = transform_points(T_camera_model, self.vertices_m)
        window = _window(camera, points)
        if window is None:
            return None
        top, bottom, left, right = window
        rays = camera.pixel_rays()[top:bottom, left:right]
        hit, depth = self._cast(rays.reshape(-1, 2), T_camera_model)
        found = hit >= 0
        normal = np.where(found[:, None], self._normal[hit] @ T_camera_model[:3, :3].T, 0.0)
        ahead = np.concatenate([rays.reshape(-1, 2), np.ones((len(hit), 1))], axis=1)
        normal *= -np.sign(np.sum(normal * ahead, axis=1, keepdims=True))
        shape = rays.shape[:2]
        part = np.where(found, self._part[hit], -1).reshape(shape)
        return Rendering(top, left, depth.reshape(shape), normal.reshape(*shape, 3), part)

    def outline(self, camera: Camera, T_camera_model: np.ndarray, rendering: Rendering) -> Outline:
        """The silhouette, subpixel: rays between each pixel on the equipment and its neighbour that is not."""
        depth = rendering.depth_m
        smooth = cv2.GaussianBlur(np.isfinite(depth).astype(np.float32), (0, 0), 1.5)
        slope = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 0, 1), cv2.Sobel(smooth, cv2.CV_32F, 1, 0)], axis=-1)
        inner = np.isfinite(depth)
        inner[:3], inner[-3:], inner[:, :3], inner[:, -3:] = False, False, False, False
        found = []
        for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            beyond = np.roll(depth, (-step[0], -step[1]), (0, 1))
            edge = inner & ~(beyond < depth + JUMP_M)
            across = slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)
            edge &= -(across @ np.array(step)) > 0.65  # the outline runs across this direction, not along it
            row, column = np.nonzero(edge)
            found.append((row, column, np.broadcast_to(step, (len(row), 2))))
        row, column, step_of = (np.concatenate(part) for part in zip(*found, strict=True))
        normal = -slope[row, column]
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        at, part = depth[row, column], rendering.part[row, column]
        row, column = row + rendering.top, column + rendering.left
        rays = camera.pixel_rays()
        here, there = rays[row, column], rays[row + step_of[:, 0], column + step_of[:, 1]]
        beyond_px = self._share_on_equipment(here, there, at, T_camera_model)
        return Outline(row, column, step_of, beyond_px, normal, at, part)

    def _share_on_equipment(
        self, here: np.ndarray, there: np.ndarray, depth_m: np.ndarray, T_camera_model: np.ndarray
    ) -> np.ndarray:
        """(n,) share of the way between two rays (n, 2) that meets the equipment at about the depth of the first."""
        share = (np.arange(SUBPIXEL) + 0.5) / SUBPIXEL
        between = here[:, None] + (there - here)[:, None] * share[:, None]
        hit, distance = self._cast(between.reshape(-1, 2).astype(np.float32), T_camera_model)
        on = (hit >= 0).reshape(-1, SUBPIXEL) & (distance.reshape(-1, SUBPIXEL) < depth_m[:, None] + JUMP_M)
        return np.asarray(on.mean(axis=1))

    def _cast(self, rays: np.ndarray, T_camera_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangle hit by each ray (n, 2), -1 none, and its depth, inf where none."""
        T_model_camera = invert_rigid(T_camera_model)
        ahead = np.concatenate([rays, np.ones((len(rays), 1), rays.dtype)], axis=1)
        directions = (ahead @ T_model_camera[:3, :3].T).astype(np.float32)
        origins = np.broadcast_to(T_model_camera[:3, 3].astype(np.float32), directions.shape).copy()
        found = self._scene.run(origins, directions, query="INTERSECT", output=True)
        hit = found["primID"].astype(np.int64)
        return hit, np.where(hit >= 0, found["tfar"], np.inf).astype(np.float32)


def _window(camera: Camera, points_m: np.ndarray) -> tuple[int, int, int, int] | None:
    """Rows and columns that hold the equipment, with a margin; all where some is behind the lens."""
    if points_m[:, 2].max() < 0.1:
        return None
    if points_m[:, 2].min() < 0.1:
        return 0, camera.height, 0, camera.width
    pixels = camera.project(points_m)
    left, top = np.floor(pixels.min(axis=0)).astype(int) - MARGIN_PX
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + MARGIN_PX + 1
    top, bottom = max(top, 0), min(bottom, camera.height)
    left, right = max(left, 0), min(right, camera.width)
    return (top, bottom, left, right) if bottom - top > 8 and right - left > 8 else None
