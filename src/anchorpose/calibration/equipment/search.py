"""Where the equipment may stand in one camera's picture: a search over every place and direction on the floor."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from anchorpose.calibration.equipment.kernels import climb, correlate, fill_space, weigh_broad
from anchorpose.calibration.equipment.samples import EquipmentSamples
from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """How finely and how far the equipment is looked for."""

    cell_m: float = 0.04  # of the first, coarse map: as wide as a bar
    yaw_step_rad: float = 0.0873  # 5 degrees move a bar at 0.5 m by one cell
    above_floor_m: float = 0.06  # below this the floor itself fills the map
    farthest_m: float = 7.0  # no depth camera sees a bar beyond
    thinning: int = 3  # every third point of the equipment is enough until the last and finest steps
    starts: int = 400  # places of the coarse map that are looked at closely
    kept: int = 16  # distinct places that are handed on
    distinct_m: float = 0.10  # two poses nearer than this and
    distinct_rad: float = 0.14  # this, 8 degrees, are the same one
    tolerances_m: tuple[float, ...] = (0.05, 0.03, 0.02)  # what counts as on the surface, from coarse to fine
    noise_gate: float = 3.0  # sigmas of the sensor's noise on top
    through_weight: float = 2.0  # a point that is seen through speaks against a pose twice as loud as one for it
    broad_m: float = 0.10  # a surface that goes on flat so far to all four sides is a wall, a panel or a table:
    broad_weight: float = 0.25  # a bar may lie anywhere in it, so it says less than what ends where a bar ends
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
    """T_camera_ground (4, 4): Y along the floor's up, Z level and away from the camera, origin below it."""
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
    still = np.ascontiguousarray(still_m, dtype=np.float32)
    weight = weigh_broad(
        still, camera.intrinsics.fx, config.broad_m, config.broad_weight, config.tolerances_m[-1], noise_per_m,
        config.noise_gate,
    )  # fmt: skip
    starts = _coarse(still, weight, camera, T_camera_ground, samples, lowest_m, noise_per_m, config)
    if not len(starts):
        return ()
    surface, outside = samples.surface_m - samples.centre_m, samples.outside_m - samples.centre_m
    seen = np.stack([still, weight])
    starts[:, 2] += samples.centre_m[1]  # the height of the centre above the floor
    for tolerance in config.tolerances_m:
        last = tolerance == config.tolerances_m[-1]
        thin = slice(None, None, 1 if last else config.thinning)
        limits = np.array([tolerance, noise_per_m, config.noise_gate, config.through_weight, config.outside_weight])
        scores = climb(
            starts, seen, lens, T_camera_ground, surface[thin], samples.normal[thin], samples.two_sided[thin],
            outside[thin], limits,
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
    weight: np.ndarray,
    camera: Camera,
    T_camera_ground: np.ndarray,
    samples: EquipmentSamples,
    lowest_m: float,
    noise_per_m: float,
    config: SearchConfig,
) -> np.ndarray:
    """(n, 4) yaw, x, y, z of the best cells of all directions; y is of Gamma_0's origin less the centre's height."""
    cell, reach = config.cell_m, samples.radius_m
    surface = samples.surface_m[:: config.thinning]
    heights = surface[:, 1] - lowest_m
    seen = still_m[still_m > 0]
    if not seen.size:
        return np.zeros((0, 4))
    farthest = min(config.farthest_m, float(np.percentile(seen, 99)) + reach)
    wide = farthest * max(camera.width / 2 / camera.intrinsics.fx, 0.3) + reach
    counts = (int(heights.max() / cell) + 2, int(2 * wide / cell) + 1, int(farthest / cell) + 1)
    space = fill_space(
        still_m, weight, lens_array(camera), T_camera_ground, counts, wide, cell,
        config.above_floor_m, noise_per_m, config.noise_gate,
    )  # fmt: skip
    value = np.array([0, 1, -config.through_weight, config.broad_weight], np.float32)[space]
    yaws = np.arange(0.0, 2 * np.pi - 1e-9, config.yaw_step_rad)
    sums = np.empty((len(yaws), counts[1], counts[2]), np.float32)
    level = surface[:, [0, 2]] - samples.centre_m[[0, 2]]
    for number, yaw in enumerate(yaws):
        turned = level @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        cells = np.rint(np.stack([heights - cell / 2, turned[:, 0], turned[:, 1]], axis=1) / cell).astype(np.int64)
        unique, weight = np.unique(np.maximum(cells, [0, -(10**6), -(10**6)]), axis=0, return_counts=True)
        sums[number] = correlate(value, unique, weight.astype(np.float32))
    most = min(20 * config.starts, sums.size) - 1
    best = np.flatnonzero(sums.ravel() >= np.partition(sums.ravel(), -most - 1)[-most - 1])
    best = best[np.argsort(-sums.ravel()[best], kind="stable")]
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
