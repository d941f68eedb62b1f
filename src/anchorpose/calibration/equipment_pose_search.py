"""Where the equipment may stand in one camera's picture: a search over every place and direction on the floor."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numba as nb
import numpy as np

from anchorpose.calibration.equipment_pose_samples import EquipmentSamples
from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera

UNKNOWN, OCCUPIED, FREE = 0, 1, 2
LEAST_Z_M = 0.3  # nearer than any depth camera measures


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """How finely and how far the equipment is looked for."""

    cell_m: float = 0.04  # of the first, coarse map: as wide as a bar
    yaw_step_rad: float = 0.0873  # 5 degrees move a bar at 0.5 m by one cell
    above_floor_m: float = 0.06  # below this the floor itself fills the map
    farthest_m: float = 7.0  # no depth camera sees a bar beyond
    starts: int = 400  # places of the coarse map that are looked at closely
    kept: int = 16  # distinct places that are handed on
    distinct_m: float = 0.10  # two poses nearer than this and
    distinct_rad: float = 0.14  # this, 8 degrees, are the same one
    tolerances_m: tuple[float, ...] = (0.05, 0.03, 0.02)  # what counts as on the surface, from coarse to fine
    noise_gate: float = 3.0  # sigmas of the sensor's noise on top
    through_weight: float = 2.0  # a point that is seen through speaks against a pose twice as loud as one for it
    outside_weight: float = 1.0  # of points beside the equipment that are filled: within a wall they cancel the rest

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not min(value if isinstance(value, tuple) else (value,), default=0) > 0:
                raise ValueError(f"{entry.name} must be positive, got {value}")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A place the equipment may stand at: T_camera_model (4, 4) and how well it fits, 1 = every point that faces the
    camera lies on what is seen."""

    T_camera_model: np.ndarray
    score: float


def ground_frame(floor: FloorPlane) -> np.ndarray:
    """T_camera_ground (4, 4): Y along the floor's up, Z level and away from the camera, origin on the floor below it."""
    away = np.array([0.0, 0.0, 1.0])
    away = away - (away @ floor.up) * floor.up
    away /= np.linalg.norm(away)
    T_camera_ground = np.eye(4)
    T_camera_ground[:3, :3] = np.stack([np.cross(floor.up, away), floor.up, away], axis=1)
    T_camera_ground[:3, 3] = -floor.height_m * floor.up
    return T_camera_ground


def search_floor(
    still_m: np.ndarray,
    camera: Camera,
    floor: FloorPlane,
    samples: EquipmentSamples,
    lowest_m: float,
    noise_per_m: float,
    config: SearchConfig,
) -> tuple[Candidate, ...]:
    """Distinct candidates, best first, with the height ``lowest_m`` of Gamma_0 on the floor and Y upright.

    still_m (height, width) float32: what stays in place, 0 = no reading. First a map of the space above the floor,
    filled, free or unknown, and for each of 72 directions the sum over the equipment's points at every cell; then the
    best places are improved on the picture itself.
    """
    lens, T_camera_ground = lens_array(camera), ground_frame(floor)
    starts = _coarse(still_m, camera, T_camera_ground, samples, lowest_m, noise_per_m, config)
    if not len(starts):
        return ()
    surface, outside = samples.surface_m - samples.centre_m, samples.outside_m - samples.centre_m
    still = np.ascontiguousarray(still_m, dtype=np.float32)
    starts[:, 2] += samples.centre_m[1]  # the height of the centre above the floor
    for tolerance in config.tolerances_m:
        last = tolerance == config.tolerances_m[-1]
        scores = _climb(
            starts, still, lens, T_camera_ground, surface, samples.normal, samples.two_sided, outside,
            tolerance, noise_per_m, config.noise_gate, config.through_weight, config.outside_weight,
        )  # fmt: skip
        keep = _distinct(starts, scores, config, config.kept if last else config.starts // 4)
        starts, scores = starts[keep], scores[keep]
    return tuple(
        Candidate(_placed(T_camera_ground, place, samples.centre_m), float(score))
        for place, score in zip(starts, scores, strict=True)
    )


def lens_array(camera: Camera) -> np.ndarray:
    """(9,) fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    lens = camera.intrinsics
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion])


def _placed(T_camera_ground: np.ndarray, place: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    """T_camera_model of (yaw, x, y, z): the centre's place in the ground frame."""
    yaw, position = place[0], place[1:]
    T_ground_model = np.eye(4)
    T_ground_model[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    T_ground_model[:3, 3] = position - T_ground_model[:3, :3] @ centre_m
    placed: np.ndarray = T_camera_ground @ T_ground_model
    return placed


def _distinct(places: np.ndarray, scores: np.ndarray, config: SearchConfig, most: int) -> np.ndarray:
    """Indices of the best places, none within ``distinct`` of a better one."""
    kept: list[int] = []
    for index in np.argsort(-scores, kind="stable"):
        turn = np.abs((places[kept, 0] - places[index, 0] + np.pi) % (2 * np.pi) - np.pi)
        apart = np.linalg.norm(places[kept, 1:] - places[index, 1:], axis=1)
        if not np.any((turn < config.distinct_rad) & (apart < config.distinct_m)):
            kept.append(int(index))
            if len(kept) == most:
                break
    return np.array(kept, dtype=np.int64)


def _coarse(
    still_m: np.ndarray,
    camera: Camera,
    T_camera_ground: np.ndarray,
    samples: EquipmentSamples,
    lowest_m: float,
    noise_per_m: float,
    config: SearchConfig,
) -> np.ndarray:
    """(n, 4) yaw, x, y, z of the best cells of all directions; y is of Gamma_0's origin less the centre's height."""
    cell, reach = config.cell_m, samples.radius_m
    heights = samples.surface_m[:, 1] - lowest_m
    seen = still_m[still_m > 0]
    if not seen.size:
        return np.zeros((0, 4))
    farthest = min(config.farthest_m, float(np.percentile(seen, 99)) + reach)
    wide = farthest * max(camera.width / 2 / camera.intrinsics.fx, 0.3) + reach
    counts = (int(heights.max() / cell) + 2, int(2 * wide / cell) + 1, int(farthest / cell) + 1)
    space = _fill(
        np.ascontiguousarray(still_m, dtype=np.float32), lens_array(camera), T_camera_ground, counts, wide, cell,
        config.above_floor_m, noise_per_m, config.noise_gate,
    )  # fmt: skip
    value = np.array([0, 1, -config.through_weight])[space].astype(np.float32)
    yaws = np.arange(0.0, 2 * np.pi - 1e-9, config.yaw_step_rad)
    sums = np.empty((len(yaws), counts[1], counts[2]), np.float32)
    level = samples.surface_m[:, [0, 2]] - samples.centre_m[[0, 2]]
    for number, yaw in enumerate(yaws):
        turned = level @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        cells = np.rint(np.stack([heights - cell / 2, turned[:, 0], turned[:, 1]], axis=1) / cell).astype(np.int64)
        unique, weight = np.unique(np.maximum(cells, [0, -(10**6), -(10**6)]), axis=0, return_counts=True)
        sums[number] = _correlate(value, unique, weight.astype(np.float32))
    best = np.argsort(-sums, axis=None, kind="stable")[: 20 * config.starts]
    turn, x, z = np.unravel_index(best, sums.shape)
    rest = np.full(len(best), -lowest_m)
    places = np.stack([yaws[turn], x * cell - wide, rest, z * cell], axis=1)
    return places[_distinct_cells(places, config)]


def _distinct_cells(places: np.ndarray, config: SearchConfig) -> np.ndarray:
    """The first of each group of neighbouring cells and directions, best first."""
    size = np.array([config.distinct_rad, config.distinct_m, 1e9, config.distinct_m])
    groups = np.floor(places / size + 0.25).astype(np.int64)
    _, first = np.unique(groups, axis=0, return_index=True)
    return np.sort(first)[: config.starts]


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
def _fill(
    still: np.ndarray, lens: np.ndarray, T: np.ndarray, counts: tuple[int, int, int], wide: float, cell: float,
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
                c0, r0 = int(round(column)), int(round(row))
                if c0 < reach or r0 < reach or c0 >= width - reach or r0 >= height - reach:
                    continue
                margin = cell + gate * noise * cz * cz
                filled, behind, step = False, 0, max(1, reach // 2)
                for r in range(r0 - reach, r0 + reach + 1, step):
                    for c in range(c0 - reach, c0 + reach + 1, step):
                        d = still[r, c]
                        if d > 0.0 and abs(d - cz) < margin:
                            filled = True
                        if d > cz:
                            behind += 1
                if filled:
                    space[iy, ix, iz] = OCCUPIED
                elif behind > 0 and still[r0, c0] > cz:
                    space[iy, ix, iz] = FREE
    return space


@nb.njit(cache=True, fastmath=True)
def _correlate(value: np.ndarray, cells: np.ndarray, weight: np.ndarray) -> np.ndarray:
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
    place: np.ndarray, still: np.ndarray, lens: np.ndarray, T: np.ndarray, surface: np.ndarray, normal: np.ndarray,
    two_sided: np.ndarray, outside: np.ndarray, tolerance: float, noise: float, gate: float, through: float,
    beside: float,
) -> float:  # fmt: skip
    """How well (yaw, x, y, z) explains the picture, per point of the surface that faces the camera."""
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
        c, r = int(round(column)), int(round(row))
        if c < 0 or r < 0 or c >= width or r >= height:
            continue
        d = still[r, c]
        if d <= 0.0:
            continue
        margin = tolerance + gate * noise * cz * cz
        if on_surface:
            if abs(d - cz) < margin:
                total += 1.0
            elif d > cz:
                total -= through
        elif abs(d - cz) < margin:
            total -= beside * len(surface) / len(outside) * 0.5
    return total / max(facing, 1)


@nb.njit(cache=True)
def _climb(
    places: np.ndarray, still: np.ndarray, lens: np.ndarray, T: np.ndarray, surface: np.ndarray, normal: np.ndarray,
    two_sided: np.ndarray, outside: np.ndarray, tolerance: float, noise: float, gate: float, through: float,
    beside: float,
) -> np.ndarray:  # fmt: skip
    """Improves each place in turn along yaw, x and z, with steps of half and a quarter of the tolerance."""
    scores = np.empty(len(places))
    trial = np.empty(4)
    radius = 0.5
    for k in range(len(places)):
        best = _fit(
            places[k], still, lens, T, surface, normal, two_sided, outside, tolerance, noise, gate, through, beside
        )
        step = tolerance / 2.0
        for _ in range(8):
            improved = False
            for axis in (0, 1, 3):
                for sign in (-1.0, 1.0):
                    trial[:] = places[k]
                    trial[axis] += sign * (step / radius if axis == 0 else step)
                    value = _fit(
                        trial, still, lens, T, surface, normal, two_sided, outside, tolerance, noise, gate, through,
                        beside,
                    )  # fmt: skip
                    if value > best + 1e-9:
                        best = value
                        places[k] = trial
                        improved = True
            if not improved:
                if step < tolerance / 3.0:
                    break
                step /= 2.0
        scores[k] = best
    return scores
