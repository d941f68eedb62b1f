"""Search every place and direction on the floor where the equipment may stand in one camera's depth image."""

from __future__ import annotations

from typing import Final, NamedTuple

import numba as nb
import numpy as np
from scipy.ndimage import binary_dilation

from anchorpose.calibration.equipment_model import EquipmentSamples
from anchorpose.calibration.equipment_refine import StillView
from anchorpose.calibration.first_frames import NOISE_GATE, FloorPlane
from anchorpose.camera import Camera
from anchorpose.lens import lens_array, pixel_of_ray
from anchorpose.rotations import rigid, rotation_about_y

UNKNOWN, OCCUPIED, FREE, BROAD = 0, 1, 2, 3  # states of a map cell; BROAD: only broad flat surfaces fill the cell
# m, minimum depth of cells and points that are compared; no depth camera measures nearer than this
LEAST_Z_M: Final = 0.3
# m; at this distance from the equipment's centre, a step of rotation moves a point as far as a step of shift
RADIUS_M: Final = 0.5
CELL_M: Final = 0.04  # m, side of a cell of the first, coarse map; as wide as a bar
YAW_STEP_RAD: Final = 0.0873  # rad (5 degrees), step between tried yaws; it moves a bar 0.5 m from the centre by a cell
ABOVE_FLOOR_M: Final = 0.06  # m above the floor; lower cells of the map are left out, since the floor fills them
# m, maximum extent of the coarse map away from the camera; no depth camera sees a bar from farther away
FARTHEST_M: Final = 7.0
THINNING: Final = 3  # every third point of the equipment is used, except in the last and finest step of the refinement
STARTS: Final = 400  # number of places of the coarse map that are refined
KEPT: Final = 16  # number of distinct places in the result
DISTINCT_M, DISTINCT_RAD = 0.10, 0.14  # m and rad (8 degrees); poses that differ by less than both are the same pose
# m, maximum difference between a point's depth and the reading at its pixel for the point to count as seen, in addition
# to the noise; one value per step from coarse to fine
TOLERANCES_M: Final = (0.05, 0.03, 0.02)
THROUGH_WEIGHT: Final = 2.0  # weight of a point that is seen through, relative to a point on the surface
# m; a surface that continues flat this far to all four sides is part of a wall, a panel or a table
BROAD_M: Final = 0.10
# weight of readings on a broad surface, relative to other readings, since a bar would fit anywhere in this surface
BROAD_WEIGHT: Final = 0.25


class SearchImage(NamedTuple):
    """The image in which the equipment is searched: depth_m (height, width) float32 of still surfaces, 0 = no reading;
    weight (height, width) float32 of each reading as evidence; lens: parameters of the lens, as ``lens_array`` returns
    them; T_camera_ground (4, 4): pose, in the camera frame, of the ground frame, which has Y up, Z level in the
    camera's viewing direction, and the origin on the floor below the camera; noise_per_m: factor a (1/m) of the
    sensor's noise, which has sigma a z^2 at depth z.
    """

    depth_m: np.ndarray
    weight: np.ndarray
    lens: np.ndarray
    T_camera_ground: np.ndarray
    noise_per_m: float


class SearchPoints(NamedTuple):
    """Points relative to the equipment's centre: surface (n, 3), normal (n, 3), two_sided (n,) bool, outside (m, 3)."""

    surface: np.ndarray
    normal: np.ndarray
    two_sided: np.ndarray
    outside: np.ndarray


@nb.njit(cache=True)
def _transform(T: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Transform a point by a rigid motion (4, 4)."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@nb.njit(cache=True)
def fill_space(image: SearchImage, counts: tuple[int, int, int], wide_m: float) -> np.ndarray:
    """Return a map of the space above the floor, (y, x, z) int8. The state of each cell follows from the pixels around
    the cell's projection into the depth image.

    counts: numbers of cells along y, x, z; x starts at -wide_m.
    """
    space = np.zeros(counts, np.int8)
    for iy in range(counts[0]):
        y = (iy + 0.5) * CELL_M
        if y < ABOVE_FLOOR_M:
            continue
        for ix in range(counts[1]):
            for iz in range(counts[2]):
                space[iy, ix, iz] = _state_of_cell(image, ix * CELL_M - wide_m, y, iz * CELL_M)
    return space


@nb.njit(cache=True)
def _state_of_cell(image: SearchImage, x: float, y: float, z: float) -> int:
    """Return the state of the map cell at a point of the ground frame: OCCUPIED by a surface, BROAD if only broad flat
    surfaces fill it, FREE if the camera sees through it, or UNKNOWN if the image shows none of these.
    """
    still, weight, lens = image.depth_m, image.weight, image.lens
    height, width = still.shape
    cx, cy, cz = _transform(image.T_camera_ground, x, y, z)
    if cz < LEAST_Z_M:
        return UNKNOWN
    column, row = pixel_of_ray(cx / cz, cy / cz, lens)
    reach = int(min(max(0.5 * CELL_M * lens[0] / cz, 1.0), 6.0))
    c0, r0 = round(column), round(row)
    if c0 < reach or r0 < reach or c0 >= width - reach or r0 >= height - reach:
        return UNKNOWN
    margin = CELL_M + NOISE_GATE * image.noise_per_m * cz * cz
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
        return OCCUPIED if narrow else BROAD
    return FREE if behind > 0 and still[r0, c0] > cz else UNKNOWN


@nb.njit(cache=True, fastmath=True)
def correlate(value: np.ndarray, cells: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Place a pattern of ``cells`` (n, 3), each (y, x, z), at every position (x, z) of the map ``value``. Return, for
    each position, the weighted sum of the map's values at the cells of the pattern.
    """
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
def climb(places: np.ndarray, image: SearchImage, points: SearchPoints, tolerance_m: float) -> np.ndarray:
    """Improve the places (n, 4) (yaw, x, y, z), in place, by steps along yaw, x and z. The steps are first half of the
    tolerance, then a quarter of it. Return the scores (n,) of the improved places.
    """
    scores = np.empty(len(places))
    trial = np.empty(4)
    for k in range(len(places)):
        best = _score(places[k], image, points, tolerance_m)
        step = tolerance_m / 2.0
        for _ in range(8):
            improved = False
            for axis in (0, 1, 3):
                for sign in (-1.0, 1.0):
                    trial[:] = places[k]
                    trial[axis] += sign * (step / RADIUS_M if axis == 0 else step)
                    value = _score(trial, image, points, tolerance_m)
                    if value > best + 1e-9:
                        best = value
                        places[k] = trial
                        improved = True
            if not improved:
                if step < tolerance_m / 3.0:
                    break
                step /= 2.0
        scores[k] = best
    return scores


@nb.njit(cache=True)
def _score(place: np.ndarray, image: SearchImage, points: SearchPoints, tolerance_m: float) -> float:
    """Return a score of how well equipment at ``place`` (yaw, x, y, z) agrees with the image, divided by the number of
    surface points that face the camera.
    """
    surface, outside, T = points.surface, points.outside, image.T_camera_ground
    cos, sin = np.cos(place[0]), np.sin(place[0])
    total, facing = 0.0, 0
    for k in range(len(surface) + len(outside)):
        on_surface = k < len(surface)
        p = surface[k] if on_surface else outside[k - len(surface)]
        x = cos * p[0] + sin * p[2] + place[1]
        y = p[1] + place[2]
        z = -sin * p[0] + cos * p[2] + place[3]
        cx, cy, cz = _transform(T, x, y, z)
        if on_surface:
            n = points.normal[k]
            gx, gy, gz = cos * n[0] + sin * n[2], n[1], -sin * n[0] + cos * n[2]
            nx = T[0, 0] * gx + T[0, 1] * gy + T[0, 2] * gz
            ny = T[1, 0] * gx + T[1, 1] * gy + T[1, 2] * gz
            nz = T[2, 0] * gx + T[2, 1] * gy + T[2, 2] * gz
            if not points.two_sided[k] and nx * cx + ny * cy + nz * cz > 0.0:
                continue
            facing += 1
        elif y < 0.1:
            continue  # a point beside the equipment that is so near to the floor may show the floor
        d, w = _reading(image, cx, cy, cz)
        if d <= 0.0:
            continue
        margin = tolerance_m + NOISE_GATE * image.noise_per_m * cz * cz
        if on_surface:
            if abs(d - cz) < margin or (d > cz and _at_edge(image, cx, cy, cz, margin)):
                total += w
            elif d > cz:
                total -= THROUGH_WEIGHT
        elif abs(d - cz) < margin:
            total -= len(surface) / len(outside) * 0.5
    return total / max(facing, 1)


@nb.njit(cache=True)
def _at_edge(image: SearchImage, x: float, y: float, z: float, margin_m: float) -> bool:
    """Return whether one of the four pixels around a point in the camera frame reads the point's depth. If so, the
    point may lie on a thin bar although the point's own pixel reads the background: the point is then less than a pixel
    inside the bar's edge.
    """
    column, row = pixel_of_ray(x / z, y / z, image.lens)
    c, r = int(np.floor(column)), int(np.floor(row))
    height, width = image.depth_m.shape
    for i in range(max(r, 0), min(r + 2, height)):
        for j in range(max(c, 0), min(c + 2, width)):
            if abs(image.depth_m[i, j] - z) < margin_m:
                return True
    return False


@nb.njit(cache=True)
def _reading(image: SearchImage, x: float, y: float, z: float) -> tuple[float, float]:
    """Return depth and weight at the pixel of a point in the camera frame; both are 0 where there is no reading."""
    if z < LEAST_Z_M:
        return 0.0, 0.0
    column, row = pixel_of_ray(x / z, y / z, image.lens)
    c, r = round(column), round(row)
    height, width = image.depth_m.shape
    if c < 0 or r < 0 or c >= width or r >= height:
        return 0.0, 0.0
    return float(image.depth_m[r, c]), float(image.weight[r, c])


def weigh_broad(depth_m: np.ndarray, focal: float, noise_per_m: float) -> np.ndarray:
    """Return the weights of readings (height, width): ``BROAD_WEIGHT`` where a surface continues flat for ``BROAD_M``
    to all sides, else 1.
    """
    margin_m, noise = 2.0 * TOLERANCES_M[-1], 2.0 * NOISE_GATE * noise_per_m
    height, width = depth_m.shape
    row, column = np.nonzero(depth_m > 0.0)
    k = np.maximum((BROAD_M * focal / depth_m[row, column].astype(np.float64)).astype(np.int64), 1)
    inside = (row >= k) & (column >= k) & (row < height - k) & (column < width - k)
    row, column, k = row[inside], column[inside], k[inside]
    z = depth_m[row, column].astype(np.float64)
    flat = np.ones(len(row), dtype=bool)
    for down, right in ((0, 1), (1, 0)):
        one, other = depth_m[row - down * k, column - right * k], depth_m[row + down * k, column + right * k]
        with np.errstate(divide="ignore", invalid="ignore"):
            # in the image of a plane, 1/z (z: depth) is a linear function of row and column, while z is not
            between = (one * other / (one + other)).astype(np.float64) * 2.0 - z
        flat &= (one > 0.0) & (other > 0.0) & (np.abs(between) < margin_m + noise * z * z)
    weight = np.ones((height, width), np.float32)
    weight[row[flat], column[flat]] = BROAD_WEIGHT
    return weight


def search_floor(view: StillView, samples: EquipmentSamples, lowest_m: float) -> list[np.ndarray]:
    """Return T_camera_model (4, 4) of distinct places of the model, best first. At each place, the equipment is
    upright, and Y = ``lowest_m`` of its frame lies on the floor.

    The space above the floor is mapped as filled, free or unknown. The equipment is tried in 72 directions at every
    cell of the floor: the score is the sum of the map's values at the equipment's points. Then the best places are
    improved on the depth image itself.
    """
    image = _search_image(view)
    starts = _coarse(image, view.camera, samples, lowest_m)
    if not len(starts):
        return []
    starts[:, 2] += samples.centre_m[1]  # this column is now the height of the equipment's centre above the floor
    surface, outside = samples.surface_m - samples.centre_m, samples.outside_m - samples.centre_m
    for tolerance in TOLERANCES_M:
        last = tolerance == TOLERANCES_M[-1]
        thin = slice(None, None, 1 if last else THINNING)
        points = SearchPoints(surface[thin], samples.normal[thin], samples.two_sided[thin], outside[thin])
        scores = climb(starts, image, points, tolerance)
        keep = _distinct(starts, scores, KEPT if last else STARTS // 4)
        starts = starts[keep]
    return [_placed(image.T_camera_ground, place, samples.centre_m) for place in starts]


def _search_image(view: StillView) -> SearchImage:
    still = np.ascontiguousarray(view.still_m, dtype=np.float32)
    weight = weigh_broad(still, view.camera.intrinsics.fx, view.noise_per_m)
    return SearchImage(still, weight, lens_array(view.camera.intrinsics), ground_frame(view.floor), view.noise_per_m)


def ground_frame(floor: FloorPlane) -> np.ndarray:
    """Return T_camera_ground (4, 4): Y along the floor's upward normal, Z level in the camera's viewing direction,
    origin on the floor below the camera.
    """
    away = np.array([0.0, 0.0, 1.0])
    away = away - (away @ floor.up) * floor.up
    away /= np.linalg.norm(away)
    return rigid(np.stack([np.cross(floor.up, away), floor.up, away], axis=1), -floor.height_m * floor.up)


def _placed(T_camera_ground: np.ndarray, place: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    """Return T_camera_model for ``place`` (yaw, x, y, z): direction, and position of the equipment's centre in the
    ground frame.
    """
    turn = rotation_about_y(place[0])
    return np.asarray(T_camera_ground @ rigid(turn, place[1:] - turn @ centre_m))


def _distinct(places: np.ndarray, scores: np.ndarray, most: int) -> np.ndarray:
    """Return the indices of the best places, at most ``most``, without any place within ``DISTINCT_M`` and
    ``DISTINCT_RAD`` of a better place.
    """
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
    """Return the best places on the coarse map, (n, 4) yaw, x, y, z, best first; y is the height above the floor of the
    origin of the equipment's frame, not yet of the equipment's centre.
    """
    surface = samples.surface_m[::THINNING]
    heights = surface[:, 1] - lowest_m
    seen = image.depth_m[image.depth_m > 0]
    if not seen.size:
        return np.zeros((0, 4))
    farthest = min(FARTHEST_M, float(np.percentile(seen, 99)) + samples.radius_m)
    wide = farthest * max(camera.width / 2 / camera.intrinsics.fx, 0.3) + samples.radius_m
    counts = (int(heights.max() / CELL_M) + 2, int(2 * wide / CELL_M) + 1, int(farthest / CELL_M) + 1)
    space = fill_space(image, counts, wide)
    # from one tried direction to the next, a bar's ends move by a cell, so a correctly placed bar may lie in a free
    # cell beside the bar's readings; such cells count as unknown
    beside = binary_dilation(space == OCCUPIED, np.ones((1, 3, 3), bool)) & (space == FREE)
    space[beside] = UNKNOWN
    value = np.array([0, 1, -THROUGH_WEIGHT, BROAD_WEIGHT], np.float32)[space]
    yaws = np.arange(0.0, 2 * np.pi - 1e-9, YAW_STEP_RAD)
    sums = np.empty((len(yaws), counts[1], counts[2]), np.float32)
    level = surface[:, [0, 2]] - samples.centre_m[[0, 2]]
    for number, yaw in enumerate(yaws):
        turned = level @ rotation_about_y(-yaw)[np.ix_([0, 2], [0, 2])]
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
    """Return the index of the first (best) place of each group of neighbouring places; at most ``STARTS`` indices."""
    size = np.array([DISTINCT_RAD, DISTINCT_M, 1e9, DISTINCT_M])
    groups = np.floor(places / size + 0.25).astype(np.int64)
    _, first = np.unique(groups, axis=0, return_index=True)
    return np.sort(first)[:STARTS]
