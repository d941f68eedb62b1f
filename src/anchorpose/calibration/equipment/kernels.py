"""Compiled kernels of the search for the equipment: a map of the space, its correlation, the climb in the picture."""

from __future__ import annotations

import numba as nb
import numpy as np

UNKNOWN, OCCUPIED, FREE, BROAD = 0, 1, 2, 3
LEAST_Z_M = 0.3  # nearer than any depth camera measures


@nb.njit(cache=True)
def pixel_of(x: float, y: float, z: float, lens: np.ndarray) -> tuple[float, float]:
    """Column and row of a camera point ahead, OpenCV's distortion."""
    u, v = x / z, y / z
    r2 = u * u + v * v
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    du = 2.0 * lens[6] * u * v + lens[7] * (r2 + 2.0 * u * u)
    dv = lens[6] * (r2 + 2.0 * v * v) + 2.0 * lens[7] * u * v
    return (u * radial + du) * lens[0] + lens[2], (v * radial + dv) * lens[1] + lens[3]


@nb.njit(cache=True)
def fill_space(
    still: np.ndarray,
    weight: np.ndarray, lens: np.ndarray, T: np.ndarray, counts: tuple[int, int, int], wide: float, cell: float,
    above: float, noise: float, gate: float,
) -> np.ndarray:  # fmt: skip
    """(y, x, z) int8 map of the ground frame: what each cell's own window of pixels says of it."""
    height, width = still.shape
    space = np.zeros(counts, np.int8)
    for iy in range(counts[0]):
        y = (iy + 0.5) * cell
        if y < above:
            continue
        for ix in range(counts[1]):
            x = ix * cell - wide
            for iz in range(counts[2]):
                z = iz * cell
                cz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
                if cz < LEAST_Z_M:
                    continue
                cx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
                cy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
                column, row = pixel_of(cx, cy, cz, lens)
                reach = int(min(max(0.5 * cell * lens[0] / cz, 1.0), 6.0))
                c0, r0 = round(column), round(row)
                if c0 < reach or r0 < reach or c0 >= width - reach or r0 >= height - reach:
                    continue
                margin = cell + gate * noise * cz * cz
                filled, narrow, behind, step = False, False, 0, max(1, reach // 2)
                for r in range(r0 - reach, r0 + reach + 1, step):
                    for c in range(c0 - reach, c0 + reach + 1, step):
                        d = still[r, c]
                        if d > 0.0 and abs(d - cz) < margin:
                            filled = True
                            narrow = narrow or weight[r, c] == 1.0
                        if d > cz:
                            behind += 1
                if filled:
                    space[iy, ix, iz] = OCCUPIED if narrow else BROAD
                elif behind > 0 and still[r0, c0] > cz:
                    space[iy, ix, iz] = FREE
    return space


@nb.njit(cache=True, fastmath=True)
def correlate(value: np.ndarray, cells: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(x, z) sum of the map's values over the cells (n, 3) of y, x, z, moved to every place."""
    _, nx, nz = value.shape
    total = np.zeros((nx, nz), np.float32)
    for k in range(len(cells)):
        iy, dx, dz = cells[k]
        if iy >= value.shape[0]:
            continue
        w = weight[k]
        low, high = max(0, -dz), min(nz, nz - dz)
        for ix in range(max(0, -dx), min(nx, nx - dx)):
            source = value[iy, ix + dx]
            target = total[ix]
            for iz in range(low, high):
                target[iz] += w * source[iz + dz]
    return total


@nb.njit(cache=True)
def _fit(
    place: np.ndarray, seen: np.ndarray, lens: np.ndarray, T: np.ndarray, surface: np.ndarray, normal: np.ndarray,
    two_sided: np.ndarray, outside: np.ndarray, limits: np.ndarray,
) -> float:  # fmt: skip
    """How well (yaw, x, y, z) explains the picture, per point of the surface that faces the camera.

    seen (2, height, width): depth, and how much a reading says; limits: tolerance, noise, gate, and the weights of
    points seen through and of filled points beside the equipment.
    """
    still, weight = seen[0], seen[1]
    tolerance, noise, gate, through, beside = limits
    height, width = still.shape
    cos, sin = np.cos(place[0]), np.sin(place[0])
    total, facing = 0.0, 0
    for k in range(len(surface) + len(outside)):
        on_surface = k < len(surface)
        p = surface[k] if on_surface else outside[k - len(surface)]
        x = cos * p[0] + sin * p[2] + place[1]
        y = p[1] + place[2]
        z = -sin * p[0] + cos * p[2] + place[3]
        cx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        cy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        cz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if on_surface:
            n = normal[k]
            gx, gy, gz = cos * n[0] + sin * n[2], n[1], -sin * n[0] + cos * n[2]
            nx = T[0, 0] * gx + T[0, 1] * gy + T[0, 2] * gz
            ny = T[1, 0] * gx + T[1, 1] * gy + T[1, 2] * gz
            nz = T[2, 0] * gx + T[2, 1] * gy + T[2, 2] * gz
            if not two_sided[k] and nx * cx + ny * cy + nz * cz > 0.0:
                continue
            facing += 1
        elif y < 0.1:
            continue  # the floor is allowed beside the equipment
        if cz < LEAST_Z_M:
            continue
        column, row = pixel_of(cx, cy, cz, lens)
        c, r = round(column), round(row)
        if c < 0 or r < 0 or c >= width or r >= height:
            continue
        d = still[r, c]
        if d <= 0.0:
            continue
        margin = tolerance + gate * noise * cz * cz
        if on_surface:
            if abs(d - cz) < margin:
                total += weight[r, c]
            elif d > cz:
                total -= through
        elif abs(d - cz) < margin:
            total -= beside * len(surface) / len(outside) * 0.5
    return total / max(facing, 1)


@nb.njit(cache=True)
def climb(
    places: np.ndarray, seen: np.ndarray, lens: np.ndarray, T: np.ndarray, surface: np.ndarray, normal: np.ndarray,
    two_sided: np.ndarray, outside: np.ndarray, limits: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Improves each place in turn along yaw, x and z, with steps of half and a quarter of the tolerance."""
    scores = np.empty(len(places))
    trial = np.empty(4)
    radius = 0.5
    for k in range(len(places)):
        best = _fit(places[k], seen, lens, T, surface, normal, two_sided, outside, limits)
        step = limits[0] / 2.0
        for _ in range(8):
            improved = False
            for axis in (0, 1, 3):
                for sign in (-1.0, 1.0):
                    trial[:] = places[k]
                    trial[axis] += sign * (step / radius if axis == 0 else step)
                    value = _fit(trial, seen, lens, T, surface, normal, two_sided, outside, limits)
                    if value > best + 1e-9:
                        best = value
                        places[k] = trial
                        improved = True
            if not improved:
                if step < limits[0] / 3.0:
                    break
                step /= 2.0
        scores[k] = best
    return scores


@nb.njit(cache=True)
def weigh_broad(
    still: np.ndarray, focal: float, reach_m: float, low: float, tolerance: float, noise: float, gate: float
) -> np.ndarray:
    """(height, width) float32: ``low`` where the picture goes on flat for ``reach_m`` to all four sides, else 1."""
    height, width = still.shape
    weight = np.ones((height, width), np.float32)
    for row in range(height):
        for column in range(width):
            z = still[row, column]
            if z <= 0.0:
                continue
            k = max(int(reach_m * focal / z), 1)
            if row < k or column < k or row >= height - k or column >= width - k:
                continue
            left, right = still[row, column - k], still[row, column + k]
            above, below = still[row - k, column], still[row + k, column]
            if left <= 0.0 or right <= 0.0 or above <= 0.0 or below <= 0.0:
                continue
            limit = 2.0 * tolerance + 2.0 * gate * noise * z * z
            across = left * right / (left + right) * 2.0 - z  # 1/z, not z, is linear along a plane
            along = above * below / (above + below) * 2.0 - z
            if abs(across) < limit and abs(along) < limit:
                weight[row, column] = low
    return weight
