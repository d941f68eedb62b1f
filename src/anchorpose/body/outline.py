"""Skin that should be seen but is not is pulled to the patient's outline: model to data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.body.constraints import ConstraintConfig, Constraints
from anchorpose.body.pixels import lens_of, pixels_of
from anchorpose.body.skin_points import PosedPoints
from anchorpose.camera import Camera, invert_rigid
from anchorpose.isolation.view import PixelLabel, View

THICK_PX = 5  # what hides a limb is wider; a silhouette's rim of lost readings is thinner


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """possible (height, width) bool: pixels where the patient is seen or may be unseen, at least one of them."""

    possible: np.ndarray


def find_outline(view: View) -> Outline | None:
    """Where the patient is in a view, or may be unseen; None where he is not in the picture.

    He may be where he is seen, behind equipment, where nothing was read, and behind another person before him. Only
    background, and another person behind him, say that he is not there; and the thin rim of lost and flying readings
    along every silhouette says nothing else than the background beside it.
    """
    import cv2

    patient = view.patient
    if not patient.any():
        return None
    other = view.labels >= PixelLabel.OTHER_PERSON
    behind = other & (view.depth_m > np.median(view.depth_m[patient]))
    unseen = (view.labels != PixelLabel.BACKGROUND) & ~behind & ~patient
    thick = cv2.morphologyEx(unseen.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK_PX, THICK_PX), np.uint8))
    return Outline(patient | (thick > 0))


def outline_constraints(
    posed: PosedPoints, view: View, outline: Outline, camera: Camera, reach_m: float, config: ConstraintConfig
) -> Constraints:
    """Skin that should be seen but is not is pulled to the patient's outline: model to data.

    A skin point before background (without a reading where the room was removed) or before another person cannot be
    there; it is moved across the ray to the nearest pixel where the patient is or may be. Pixels without reading, and
    what equipment hides, say nothing.
    """
    T_world_camera = camera.require_pose()
    lens, distortion = lens_of(camera)
    point, target, direction = _stray_rows(
        posed.points_m,
        T_world_camera,
        invert_rigid(T_world_camera),
        lens,
        distortion,
        view.labels,
        view.depth_m,
        outline.possible,
        camera.pixel_rays(),
        reach_m,
    )
    count = len(point)
    return Constraints(point, target, direction, np.full(count, config.outline_sigma_m), np.full(count, reach_m))


@njit(cache=True)
def _stray_rows(
    points: np.ndarray, T_world_camera: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray,
    distortion: np.ndarray, labels: np.ndarray, depth: np.ndarray, possible: np.ndarray, rays: np.ndarray,
    reach: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Point, target and unit direction of the row of each stray point within three reaches of where it may be."""
    column, row, distance = pixels_of(points, T_camera_world, lens, distortion, labels.shape[0], labels.shape[1])
    kept, count = np.empty(len(points), np.int64), 0
    target, direction = np.empty((len(points), 3)), np.empty((len(points), 3))
    for p in range(len(points)):
        if column[p] < 0 or not _stray(labels[row[p], column[p]], depth[row[p], column[p]], distance[p] + reach):
            continue
        reach_px = 3.0 * reach / distance[p] * max(lens[0], lens[1])
        goal_row, goal_column = nearest_possible(possible, row[p], column[p], int(reach_px) + 2)
        if goal_row < 0:
            continue
        x, y = rays[goal_row, goal_column, 0] * distance[p], rays[goal_row, goal_column, 1] * distance[p]
        squared = 0.0
        for i in range(3):
            target[count, i] = T_world_camera[i, 3] + T_world_camera[i, 0] * x + T_world_camera[i, 1] * y
            target[count, i] += T_world_camera[i, 2] * distance[p]
            direction[count, i] = points[p, i] - target[count, i]
            squared += direction[count, i] ** 2
        length = np.sqrt(squared)
        if not 1e-4 < length < 3.0 * reach:
            continue
        for i in range(3):
            direction[count, i] /= length
        kept[count] = p
        count += 1
    return kept[:count].copy(), target[:count].copy(), direction[:count].copy()


@njit(cache=True)
def _stray(label: int, depth: float, farthest: float) -> bool:
    """Whether a pixel shows the room, or another person, beyond the farthest depth that the skin may have."""
    if label != PixelLabel.BACKGROUND and label < PixelLabel.OTHER_PERSON:
        return False
    return depth <= 0.0 or depth > farthest


@njit(cache=True)
def nearest_possible(possible: np.ndarray, row: int, column: int, reach_px: int) -> tuple[int, int]:
    """Row and column of the nearest True pixel no more than reach_px rows and columns off; -1, -1 without one."""
    height, width = possible.shape
    best, best_row, best_column = np.inf, -1, -1
    for ring in range(reach_px + 1):
        if ring * ring >= best:
            break
        for r in range(max(0, row - ring), min(height - 1, row + ring) + 1):
            step = 1 if abs(r - row) == ring else max(1, 2 * ring)  # the ring's sides have two pixels a row
            for c in range(column - ring, column + ring + 1, step):
                if c < 0 or c >= width or not possible[r, c]:
                    continue
                away = (r - row) ** 2 + (c - column) ** 2
                if away < best:
                    best, best_row, best_column = away, r, c
    return best_row, best_column
