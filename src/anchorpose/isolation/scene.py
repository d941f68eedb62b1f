"""What isolation knows of one camera before the first frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.background import BackgroundModel, BackgroundSource, foreground
from anchorpose.isolation.components import jump_limit_m, label_components
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.equipment import EquipmentView, equipment_mask, view_equipment
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import EquipmentModel

FEET_M = 0.3  # an ankle's height, and what a removed floor takes with it


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One camera with a known pose, its empty room and the equipment in it; rays (height, width, 2) float32."""

    camera: Camera
    rays: np.ndarray
    background: BackgroundModel
    equipment: EquipmentView | None


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The people's pixels of one camera's frame, all people together.

    depth_m (height, width) float32; labels (height, width) uint8 of ``PixelLabel``, CLUTTER where someone may be;
    row, column, piece (n,) int32: the foreground pixels and the connected piece (from 1) each belongs to;
    points_m (n, 3) float32 world; area_m2 (n,) float32: surface a pixel covers if it faces the camera;
    jump_limit_m (height, width) float32: how far neighbours of one surface may differ in depth.
    """

    depth_m: np.ndarray
    labels: np.ndarray
    row: np.ndarray
    column: np.ndarray
    piece: np.ndarray
    piece_count: int
    points_m: np.ndarray
    area_m2: np.ndarray
    jump_limit_m: np.ndarray


def set_scene(camera: Camera, background: BackgroundModel, equipment: EquipmentModel | None) -> Scene:
    """Prepare one camera; raises ValueError where its pose is unknown."""
    camera.require_pose()
    rays = camera.pixel_rays()
    return Scene(camera, rays, background, None if equipment is None else view_equipment(camera, rays, equipment))


def find_pieces(depth_m: np.ndarray, scene: Scene, config: IsolationConfig) -> Pieces:
    """Take room and equipment away from one frame and cut the rest at its depth jumps."""
    model, camera = scene.background, scene.camera
    people = foreground(depth_m, model, config)
    labels = np.where(depth_m > 0, np.uint8(PixelLabel.BACKGROUND), np.uint8(PixelLabel.NO_READING))
    nearer = (depth_m > 0) & (depth_m < model.depth_m - config.jump_gate * model.sigma_m)
    labels[nearer] = PixelLabel.CLUTTER  # in front of the room, yet flying
    if scene.equipment is not None:
        equipment = equipment_mask(depth_m, scene.equipment, model.noise_per_m, config)
        labels[equipment] = PixelLabel.EQUIPMENT
        people &= ~equipment
    labels[people] = PixelLabel.CLUTTER
    if model.source is BackgroundSource.REMOVED and people.any():
        labels[_empty_around(depth_m, people, camera)] = PixelLabel.BACKGROUND
    limit = jump_limit_m(depth_m, model.noise_per_m, model.focal_px, config.jump_gate, config.steepest_slope_rad)
    pieces, _ = label_components(depth_m, people, limit)
    row, column = np.nonzero(people)
    area = depth_m[row, column] ** 2 / np.float32(camera.intrinsics.fx * camera.intrinsics.fy)
    piece = pieces[row, column]
    large = np.bincount(piece, weights=area) >= config.crumb_area_m2
    kept = large[piece]
    row, column, area = row[kept].astype(np.int32), column[kept].astype(np.int32), area[kept]
    renumbered = np.cumsum(large[1:]).astype(np.int32)
    piece = renumbered[piece[kept] - 1]
    points = _world_points(depth_m, scene, row, column)
    return Pieces(depth_m, labels, row, column, piece, int(large[1:].sum()), points, area, limit)


def _empty_around(depth_m: np.ndarray, people: np.ndarray, camera: Camera) -> np.ndarray:
    """(height, width) bool: pixels without reading that were certainly removed as room, so nobody is there.

    Recorders that remove the room remove feet with the floor: near the lowest pixel, nothing is certain.
    """
    rows = np.flatnonzero(people.any(axis=1))
    feet_px = int(FEET_M * camera.intrinsics.fy / float(np.median(depth_m[people])))
    empty = depth_m <= 0
    empty[max(0, int(rows[-1]) - feet_px) :] = False
    return empty


def _world_points(depth_m: np.ndarray, scene: Scene, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    T_world_camera = scene.camera.require_pose().astype(np.float32)
    depth = depth_m[row, column][:, None]
    points_camera = np.concatenate([scene.rays[row, column] * depth, depth], axis=1)
    points: np.ndarray = points_camera @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    return points
