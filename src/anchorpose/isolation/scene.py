"""Describe one camera's scene (its empty room and the equipment) before the first frame, and cut the people's pixels
out of each frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.isolation.background import (
    BackgroundModel,
    BackgroundSource,
    ExpectedEquipment,
    equipment_depth,
    equipment_mask,
    expect_equipment,
    foreground,
    room_at,
)
from anchorpose.isolation.components import JUMP_GATE, label_components
from anchorpose.isolation.depth_noise import Sensor
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.threads import each

# m2, minimum area of a piece of the people's pixels, the area of a fingertip; smaller pieces are left out
SMALLEST_PIECE_M2: Final = 0.0005
# m above the lowest pixel of people, maximum height at which readings of feet may be missing: the height of an ankle,
# plus the part of a foot that a recorder removes with the floor
FEET_M: Final = 0.3
# m2, minimum area of a board (a flat rectangular object), since a smaller flat piece may be a part of a body that is
# seen between bars
LEAST_M2: Final = 0.15
FLATTEST: Final = 0.025  # maximum deviation of a board from a plane, as a share of its width; trunks bulge by 5 %
# minimum share of its enclosing rectangle that a board fills; a trunk with thighs fills less
LEAST_FILLED: Final = 0.85
SAMPLE: Final = 500  # number of points of a piece that are tested for flatness


def flat_pieces(
    points_m: np.ndarray, depth_m: np.ndarray, piece: np.ndarray, area_m2: np.ndarray, noise_per_m: float
) -> np.ndarray:
    """Return (n,) bool: pixels of boards, that is, of large pieces that are flat and rectangular. A piece is flat if
    its points deviate from a plane by no more than the noise plus ``FLATTEST`` times the width of the piece.

    points_m (n, 3), depth_m (n,), piece (n,) numbered from 1, area_m2 (n,): one camera's foreground pixels.
    """
    area = np.bincount(piece, area_m2, minlength=1)
    flat = np.zeros(len(area), dtype=bool)
    for large in np.flatnonzero(area > LEAST_M2):
        mine = np.flatnonzero(piece == large)
        mine = mine[:: max(1, len(mine) // SAMPLE)]
        own = points_m[mine].astype(np.float64)
        own -= own.mean(axis=0)
        spread, axes = np.linalg.eigh(own.T @ own / len(own))
        across = np.abs(own @ axes[:, 0])
        thickness = 1.483 * _median(across)  # a median, since a hand at the board's edge may stick out
        noise = noise_per_m * _median(depth_m[mine]) ** 2
        if thickness - noise > FLATTEST * np.sqrt(12.0 * spread[1]):  # points over a width w have variance w^2 / 12
            continue
        _, sides, _ = cv2.minAreaRect((own @ axes[:, 1:]).astype(np.float32))
        # this is the area that the piece would have if it faced the camera; it is less than the true area, so a
        # slanting board may be missed
        facing = area[large]
        flat[large] = facing > LEAST_FILLED * sides[0] * sides[1]
    return flat[piece]


def _median(values: np.ndarray) -> float:
    """Return the same median as ``np.median``, which takes ten times as long for a few hundred values."""
    ordered = np.sort(values)
    half = len(values) // 2
    return float(ordered[half]) if len(values) % 2 else float(ordered[half - 1] + ordered[half]) / 2


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One camera with a known pose, its empty room and equipment; rays (height, width, 2): x and y at depth 1."""

    camera: Camera
    rays: np.ndarray
    background: BackgroundModel
    equipment: ExpectedEquipment | None


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The people's pixels of one camera's frame, in connected pieces. A piece may show several people who touch, since
    people are not separated yet.
    """

    depth_m: np.ndarray  # (height, width) float32, the depth frame without readings on false ramps, metres
    # (height, width) uint8 of ``PixelLabel``; before people are separated, pixels that may show a person have CLUTTER
    labels: np.ndarray
    index: np.ndarray  # (height, width) int32, number of each foreground pixel, -1 = not foreground
    row: np.ndarray  # (n,) int32, row of each foreground pixel
    column: np.ndarray  # (n,) int32, column of each foreground pixel
    piece: np.ndarray  # (n,) int32, number of each pixel's connected piece, from 1
    piece_count: int
    points_m: np.ndarray  # (n, 3) float32, the point that each foreground pixel shows, metres in the world frame
    area_m2: np.ndarray  # (n,) float32, area that the pixel covers on a surface that faces the camera
    sensor: Sensor

    def only(self, kept: np.ndarray) -> Pieces:
        """Return the pieces with only the foreground pixels at which ``kept`` (n,) bool is True."""
        index = np.full_like(self.index, -1)
        row, column = self.row[kept], self.column[kept]
        index[row, column] = np.arange(len(row), dtype=np.int32)
        return replace(
            self,
            index=index,
            row=row,
            column=column,
            piece=self.piece[kept],
            points_m=self.points_m[kept],
            area_m2=self.area_m2[kept],
        )


def set_scene(camera: Camera, background: BackgroundModel, equipment: EquipmentModel | None) -> Scene:
    """Return the scene of one camera; raises ValueError if the camera's pose is unknown."""
    camera.require_pose()
    rays = camera.pixel_rays()
    if equipment is None:
        return Scene(camera, rays, background, None)
    return Scene(camera, rays, background, expect_equipment(equipment_depth(camera, equipment), background))


def find_all_pieces(frame_set: FrameSet, scenes: Sequence[Scene]) -> list[Pieces | None]:
    """Return the people's pixels (``Pieces``) of all cameras at one moment; None for a camera without a frame."""

    def pieces_of(depth_m: np.ndarray | None, scene: Scene) -> Pieces | None:
        return None if depth_m is None else find_pieces(depth_m, scene, frame_set.time_s)

    return each(pieces_of, frame_set.depths_m, scenes)


def find_pieces(depth_m: np.ndarray, scene: Scene, time_s: float | None = None) -> Pieces:
    """Remove room and equipment from one frame, and cut the other pixels into pieces where the depth jumps. Readings on
    false ramps (drawn between two surfaces by the camera's filters) and boards (flat rectangular pieces) are removed,
    too.

    time_s: time of the frame on the reference clock (the first camera's clock); None: objects at rest do not count as
    room.
    """
    model, camera, sensor = scene.background, scene.camera, scene.background.sensor
    depth_m = sensor.without_ramps(depth_m)
    people = foreground(depth_m, model, time_s)
    equipment = None if scene.equipment is None else equipment_mask(depth_m, people, scene.equipment)
    if equipment is not None:
        people &= ~equipment
    labels = _first_labels(depth_m, time_s, people, scene, equipment)
    piece_of, count = label_components(depth_m, people, sensor.jump_limit)
    focal = camera.intrinsics.fx * camera.intrinsics.fy
    large = _areas(depth_m, piece_of, count, focal) >= SMALLEST_PIECE_M2
    large[0] = False
    renumbered = np.where(large, np.cumsum(large), 0).astype(np.int32)
    T_world_camera = camera.require_pose().astype(np.float32)
    index, row, column, piece, points, area = _listed(depth_m, piece_of, renumbered, scene.rays, T_world_camera, focal)
    found = Pieces(depth_m, labels, index, row, column, piece, int(large.sum()), points, area, sensor)
    flat = flat_pieces(points, depth_m[row, column], piece, area, sensor.noise_per_m)
    return found.only(~flat) if flat.any() else found


def _first_labels(
    depth_m: np.ndarray, time_s: float | None, people: np.ndarray, scene: Scene, equipment: np.ndarray | None
) -> np.ndarray:
    """Return each pixel's ``PixelLabel`` (height, width) uint8 as it is before people are separated."""
    model = scene.background
    labels = _nearness(depth_m, *room_at(depth_m, model, time_s), JUMP_GATE)
    if equipment is not None:
        labels[equipment] = PixelLabel.EQUIPMENT
    labels[people] = PixelLabel.CLUTTER
    if model.source is BackgroundSource.REMOVED and people.any():
        labels[_empty_around(depth_m, people, scene.camera)] = PixelLabel.BACKGROUND
    return labels


@njit(cache=True, nogil=True)
def _nearness(depth: np.ndarray, room: np.ndarray, sigma: np.ndarray, gate: float) -> np.ndarray:
    """Return each pixel's label: NO_READING, BACKGROUND, or CLUTTER for a reading more than ``gate`` standard
    deviations (``sigma``) in front of the room.
    """
    labels = np.zeros(depth.shape, np.uint8)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z > 0:
                near = z < room[row, column] - gate * sigma[row, column]
                labels[row, column] = PixelLabel.CLUTTER if near else PixelLabel.BACKGROUND
    return labels


def _empty_around(depth_m: np.ndarray, people: np.ndarray, camera: Camera) -> np.ndarray:
    """Return (height, width) bool: pixels that have no reading because the recorder removed them as part of the room.

    Recorders that remove the room also remove feet, together with the floor. So the result leaves out the pixels up to
    ``FEET_M`` above the lowest foreground pixel, and all pixels below.
    """
    rows = np.flatnonzero(people.any(axis=1))
    feet_px = int(FEET_M * camera.intrinsics.fy / float(np.median(depth_m[people])))
    empty = depth_m <= 0
    empty[max(0, int(rows[-1]) - feet_px) :] = False
    return empty


@njit(cache=True, nogil=True)
def _areas(depth: np.ndarray, piece: np.ndarray, count: int, focal: float) -> np.ndarray:
    """Return the area (count + 1,), m2, that each piece would have if it faced the camera."""
    area = np.zeros(count + 1)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if piece[row, column] > 0:
                area[piece[row, column]] += depth[row, column] * depth[row, column] / focal
    return area


@njit(cache=True, nogil=True)
def _listed(
    depth: np.ndarray, piece_of: np.ndarray, renumbered: np.ndarray, rays: np.ndarray, T: np.ndarray, focal: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the pixels of the pieces that are kept (``renumbered`` > 0), as the fields index, row, column, piece,
    points_m and area_m2 of ``Pieces``.
    """
    height, width = depth.shape
    index = np.full((height, width), -1, np.int32)
    count = 0
    for row in range(height):
        for column in range(width):
            if renumbered[piece_of[row, column]] > 0:
                index[row, column] = count
                count += 1
    rows, columns, pieces = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.int32)
    points, area = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    for row in range(height):
        for column in range(width):
            k = index[row, column]
            if k < 0:
                continue
            z = depth[row, column]
            x, y = rays[row, column, 0] * z, rays[row, column, 1] * z
            rows[k], columns[k], pieces[k] = row, column, renumbered[piece_of[row, column]]
            for axis in range(3):
                points[k, axis] = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2] * z + T[axis, 3]
            area[k] = z * z / focal
    return index, rows, columns, pieces, points, area
