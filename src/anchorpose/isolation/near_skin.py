"""Distance of many points to a few: a voxel field, filled once a frame, read for every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

VOXEL_M = 0.02  # half of it, 1 cm, is the error of a distance: small beside a margin of clothes


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Axis-aligned voxels: origin_m (3,) float32 lowest corner; distance_m (a, b, c) float32, inf beyond margin_m."""

    origin_m: np.ndarray
    distance_m: np.ndarray
    margin_m: float

    def at(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) float32 metres from points (n, 3) to the nearest source, to within a voxel; inf beyond the margin."""
        return _read(self.distance_m, self.origin_m, points_m.astype(np.float32, copy=False))


@njit(cache=True)
def _stamp(field: np.ndarray, place: np.ndarray, reach: int) -> None:
    """Lower ``field`` (squared voxels) around each place (n, 3 float32, voxels)."""
    n_x, n_y, n_z = field.shape
    for i in range(len(place)):
        x, y, z = place[i, 0], place[i, 1], place[i, 2]
        for a in range(max(int(x) - reach, 0), min(int(x) + reach + 1, n_x)):
            d_x = (a + np.float32(0.5) - x) ** 2
            for b in range(max(int(y) - reach, 0), min(int(y) + reach + 1, n_y)):
                d_xy = d_x + (b + np.float32(0.5) - y) ** 2
                for c in range(max(int(z) - reach, 0), min(int(z) + reach + 1, n_z)):
                    squared = d_xy + (c + np.float32(0.5) - z) ** 2
                    if squared < field[a, b, c]:
                        field[a, b, c] = squared


@njit(cache=True)
def _read(field: np.ndarray, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
    distance = np.full(len(points), np.inf, dtype=np.float32)
    for i in range(len(points)):
        x, y, z = (points[i] - origin) / np.float32(VOXEL_M)
        if 0 <= x < field.shape[0] and 0 <= y < field.shape[1] and 0 <= z < field.shape[2]:
            distance[i] = field[int(x), int(y), int(z)]
    return distance


def distance_field(sources_m: np.ndarray, margin_m: float) -> DistanceField:
    """The distance to sources (k, 3) everywhere within ``margin_m`` of them; k is at least one."""
    pad = margin_m + VOXEL_M
    origin = (sources_m.min(axis=0) - pad).astype(np.float32)
    shape = np.ceil((sources_m.max(axis=0) + pad - origin) / VOXEL_M).astype(int) + 1
    return _filled(sources_m, origin, (int(shape[0]), int(shape[1]), int(shape[2])), margin_m)


def thinned(points_m: np.ndarray, spacing_m: float) -> np.ndarray:
    """One point (m, 3) of each cube of edge ``spacing_m`` that holds any of points (n, 3), in their order."""
    if not len(points_m):
        return points_m
    cube = np.floor((points_m - points_m.min(axis=0)) / spacing_m).astype(np.int64)
    size = cube.max(axis=0) + 1
    _, first = np.unique((cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2], return_index=True)
    return points_m[np.sort(first)]


def _filled(sources_m: np.ndarray, origin_m: np.ndarray, shape: tuple[int, int, int], margin_m: float) -> DistanceField:
    reach = int(np.ceil(margin_m / VOXEL_M))
    place = ((sources_m - origin_m) / VOXEL_M).astype(np.float32).reshape(-1, 3)
    place = place[((place > -reach) & (place < np.array(shape) + reach)).all(axis=1)]
    squared = np.full(shape, np.inf, dtype=np.float32)
    _stamp(squared, place, reach)
    distance = np.sqrt(squared) * np.float32(VOXEL_M)
    distance[distance > margin_m] = np.inf
    return DistanceField(origin_m, distance, margin_m)
