"""Where the equipment may stand in one camera's depth image: a search over every place and direction on the floor."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.calibration.equipment_model import EquipmentSamples, rotation_about_y
from anchorpose.calibration.equipment_residuals import NOISE_GATE, StillView
from anchorpose.calibration.equipment_search_kernels import (
    Scoring,
    SearchImage,
    SearchPoints,
    SpaceGrid,
    climb,
    correlate,
    fill_space,
    weigh_broad,
)
from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera
from anchorpose.lens import lens_array

CELL_M: Final = 0.04  # of the first, coarse map: as wide as a bar
YAW_STEP_RAD: Final = 0.0873  # 5 degrees move a bar at 0.5 m by one cell
ABOVE_FLOOR_M: Final = 0.06  # below this the floor itself fills the map
FARTHEST_M: Final = 7.0  # no depth camera sees a bar beyond
THINNING: Final = 3  # every third point of the equipment is enough until the last and finest steps
STARTS: Final = 400  # places of the coarse map that are refined
KEPT: Final = 16  # distinct places in the result
DISTINCT_M, DISTINCT_RAD = 0.10, 0.14  # two poses nearer than this (0.14 is 8 degrees) are the same one
TOLERANCES_M: Final = (0.05, 0.03, 0.02)  # what counts as on the surface, from coarse to fine
THROUGH_WEIGHT: Final = 2.0  # a point that is seen through counts twice as much against a pose as one on it for it
BROAD_M: Final = 0.10  # a surface that continues flat this far to all four sides is a wall, a panel or a table:
BROAD_WEIGHT: Final = 0.25  # a bar may lie anywhere in it, so it is weaker evidence than what ends where a bar ends


def search_floor(view: StillView, samples: EquipmentSamples, lowest_m: float) -> list[np.ndarray]:
    """T_camera_model (4, 4) of distinct places, best first, with the height ``lowest_m`` of Gamma_0 on the floor and Y
    upright.

    First a map of the space above the floor, filled, free or unknown, and for each of 72 directions the sum over the
    equipment's points at every cell; then the best places are improved on the depth image itself.
    """
    image = _search_image(view)
    starts = _coarse(image, view.camera, samples, lowest_m)
    if not len(starts):
        return []
    starts[:, 2] += samples.centre_m[1]  # the height of the centre above the floor
    surface, outside = samples.surface_m - samples.centre_m, samples.outside_m - samples.centre_m
    for tolerance in TOLERANCES_M:
        last = tolerance == TOLERANCES_M[-1]
        thin = slice(None, None, 1 if last else THINNING)
        points = SearchPoints(surface[thin], samples.normal[thin], samples.two_sided[thin], outside[thin])
        scores = climb(starts, image, points, Scoring(tolerance, NOISE_GATE, THROUGH_WEIGHT))
        keep = _distinct(starts, scores, KEPT if last else STARTS // 4)
        starts = starts[keep]
    return [_placed(image.T_camera_ground, place, samples.centre_m) for place in starts]


def _search_image(view: StillView) -> SearchImage:
    still = np.ascontiguousarray(view.still_m, dtype=np.float32)
    margin, noise = 2.0 * TOLERANCES_M[-1], 2.0 * NOISE_GATE * view.noise_per_m
    weight = weigh_broad(still, view.camera.intrinsics.fx, BROAD_M, BROAD_WEIGHT, margin, noise)
    return SearchImage(still, weight, lens_array(view.camera.intrinsics), ground_frame(view.floor), view.noise_per_m)


def ground_frame(floor: FloorPlane) -> np.ndarray:
    """T_camera_ground (4, 4): Y along the floor's up, Z level and away from the camera, origin below it."""
    away = np.array([0.0, 0.0, 1.0])
    away = away - (away @ floor.up) * floor.up
    away /= np.linalg.norm(away)
    T_camera_ground = np.eye(4)
    T_camera_ground[:3, :3] = np.stack([np.cross(floor.up, away), floor.up, away], axis=1)
    T_camera_ground[:3, 3] = -floor.height_m * floor.up
    return T_camera_ground


def _placed(T_camera_ground: np.ndarray, place: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    """T_camera_model of (yaw, x, y, z): the centre's place in the ground frame."""
    T_ground_model = np.eye(4)
    T_ground_model[:3, :3] = rotation_about_y(place[0])
    T_ground_model[:3, 3] = place[1:] - T_ground_model[:3, :3] @ centre_m
    return np.asarray(T_camera_ground @ T_ground_model)


def _distinct(places: np.ndarray, scores: np.ndarray, most: int) -> np.ndarray:
    """Indices of the best places, none within ``DISTINCT_M`` and ``DISTINCT_RAD`` of a better one."""
    kept: list[int] = []
    for index in np.argsort(-scores, kind="stable"):
        turn = np.abs((places[kept, 0] - places[index, 0] + np.pi) % (2 * np.pi) - np.pi)
        apart = np.linalg.norm(places[kept, 1:] - places[index, 1:], axis=1)
        if not np.any((turn < DISTINCT_RAD) & (apart < DISTINCT_M)):
            kept.append(int(index))
            if len(kept) == most:
                break
    return np.array(kept, dtype=np.int64)


def _coarse(image: SearchImage, camera: Camera, samples: EquipmentSamples, lowest_m: float) -> np.ndarray:
    """(n, 4) yaw, x, y, z of the best cells of all directions; y is of Gamma_0's origin less the centre's height."""
    surface = samples.surface_m[::THINNING]
    heights = surface[:, 1] - lowest_m
    seen = image.depth_m[image.depth_m > 0]
    if not seen.size:
        return np.zeros((0, 4))
    farthest = min(FARTHEST_M, float(np.percentile(seen, 99)) + samples.radius_m)
    wide = farthest * max(camera.width / 2 / camera.intrinsics.fx, 0.3) + samples.radius_m
    counts = (int(heights.max() / CELL_M) + 2, int(2 * wide / CELL_M) + 1, int(farthest / CELL_M) + 1)
    space = fill_space(image, SpaceGrid(counts, wide, CELL_M, ABOVE_FLOOR_M), NOISE_GATE)
    value = np.array([0, 1, -THROUGH_WEIGHT, BROAD_WEIGHT], np.float32)[space]
    yaws = np.arange(0.0, 2 * np.pi - 1e-9, YAW_STEP_RAD)
    sums = np.empty((len(yaws), counts[1], counts[2]), np.float32)
    level = surface[:, [0, 2]] - samples.centre_m[[0, 2]]
    for number, yaw in enumerate(yaws):
        turned = level @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        cells = np.rint(np.stack([heights - CELL_M / 2, turned[:, 0], turned[:, 1]], axis=1) / CELL_M).astype(np.int64)
        unique, weight = np.unique(np.maximum(cells, [0, -(10**6), -(10**6)]), axis=0, return_counts=True)
        sums[number] = correlate(value, unique, weight.astype(np.float32))
    most = min(20 * STARTS, sums.size) - 1
    best = np.flatnonzero(sums.ravel() >= np.partition(sums.ravel(), -most - 1)[-most - 1])
    best = best[np.argsort(-sums.ravel()[best], kind="stable")]
    turn, x, z = np.unravel_index(best, sums.shape)
    places = np.stack([yaws[turn], x * CELL_M - wide, np.full(len(best), -lowest_m), z * CELL_M], axis=1)
    return places[_first_of_neighbours(places)]


def _first_of_neighbours(places: np.ndarray) -> np.ndarray:
    """Indices of the first of each group of neighbouring cells and directions, best first."""
    size = np.array([DISTINCT_RAD, DISTINCT_M, 1e9, DISTINCT_M])
    groups = np.floor(places / size + 0.25).astype(np.int64)
    _, first = np.unique(groups, axis=0, return_index=True)
    return np.sort(first)[:STARTS]
