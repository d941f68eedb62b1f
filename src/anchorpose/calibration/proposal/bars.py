"""Long thin things and flat broad things among points: where a bar or a plate may be, before it is fitted."""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionConfig:
    """What passes for a bar or a plate."""

    bar_radius_m: float = 0.055  # from a bar's middle line to its surface: tubes of 3 cm to pads of 9 cm
    surroundings_m: float = 0.10  # a bar has nothing beside it up to here, a strip of a plate has
    most_beside: float = 0.5  # of a bar's own pixels: other bars that start from it
    least_length_m: float = 0.15  # shorter pieces are handles, screws and corners
    slenderness: float = 2.5  # length over breadth, below which nothing is a bar
    gap_m: float = 0.06  # without readings along a bar: what another bar hides
    seeds: int = 120  # places from which a bar is looked for, anew for each bar
    near_m: float = 0.12  # points around a seed that tell a direction: twice a thick bar's breadth
    least_pixels: int = 40  # of a bar or plate: fewer do not tell a direction
    plate_radius_m: float = 0.09  # a disc of this size is filled on a plate and never on a bar
    plate_filled: float = 0.85  # of the disc's cells
    plate_flatness_m: float = 0.02  # noise and upholstery
    plate_edge_m: float = 0.05  # a seat's edge, which is no bar of its own
    cell_m: float = 0.02  # three pixels at 2.4 m
    most: int = 40  # parts of one piece of equipment

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A part as first seen: rotation (3, 3), columns its axes, a bar's longest or a plate's normal last.

    low, high (3,): extent of its visible points along the axes, from ``center_m``; members: their indices.
    """

    plate: bool
    center_m: np.ndarray
    rotation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    members: np.ndarray


def find_parts(points_m: np.ndarray, config: DetectionConfig, seed: int = 0) -> list[Found]:
    """Plates first, then bars, the one with most pixels first; each takes its points away from the later ones."""
    rng = np.random.default_rng(seed)
    left = np.arange(len(points_m))
    parts: list[Found] = []
    for find in (_best_plate, _best_bar):
        while len(left) >= config.least_pixels and len(parts) < config.most:
            found = find(points_m, left, config, rng)
            if found is None:
                break
            parts.append(found)
            left = left[~_inside(points_m[left], found, 0.01, config.plate_edge_m if found.plate else 0.01)]
    return parts


def _inside(points_m: np.ndarray, part: Found, margin_m: float, margin_last_m: float) -> np.ndarray:
    """(n,) bool: within the part's extent and a margin, another one along its last axis."""
    local = (points_m - part.center_m) @ part.rotation
    margin = np.array([margin_m, margin_m, margin_last_m])
    return np.asarray(((local > part.low - margin) & (local < part.high + margin)).all(axis=1))


def _best_bar(
    points_m: np.ndarray, left: np.ndarray, config: DetectionConfig, rng: np.random.Generator
) -> Found | None:
    points = points_m[left]
    tree = cKDTree(points)
    best: tuple[int, np.ndarray, np.ndarray] | None = None
    for place in points[rng.choice(len(points), min(config.seeds, len(points)), replace=False)]:
        near = points[tree.query_ball_point(place, config.near_m)]
        if len(near) < config.least_pixels // 2:
            continue
        line = _grow_line(points, place, _main_direction(near), config)
        if line is not None and (best is None or line[0].sum() > best[0]):
            best = int(line[0].sum()), *line
    if best is None:
        return None
    _, chosen, axis = best
    return _bar(points_m, left[chosen], axis)


def _grow_line(
    points: np.ndarray, place: np.ndarray, axis: np.ndarray, config: DetectionConfig
) -> tuple[np.ndarray, np.ndarray] | None:
    """Points (n,) bool on the bar through a place, and its direction; None where it is no bar."""
    middle = place
    radius = 1.5 * config.bar_radius_m
    for _ in range(6):
        along, across = _cylindrical(points, middle, axis)
        on_line = across < radius
        reach = _unbroken(along, on_line, config)
        if reach is None:
            return None
        chosen = on_line & (along >= reach[0]) & (along <= reach[1])
        if chosen.sum() < config.least_pixels:
            return None
        middle, axis = points[chosen].mean(axis=0), _main_direction(points[chosen])
        # a thin tube is told by its own breadth, so that the bars it meets do not turn it
        radius = float(np.clip(2.5 * np.median(across[chosen]), 0.4 * config.bar_radius_m, config.bar_radius_m))
    along, across = _cylindrical(points, middle, axis)
    chosen = (across < radius) & (along >= along[chosen].min()) & (along <= along[chosen].max())
    length = float(np.ptp(along[chosen]))
    beside = (across >= 1.2 * config.bar_radius_m) & (across < config.surroundings_m)
    beside &= (along >= along[chosen].min()) & (along <= along[chosen].max())
    breadth = 2.0 * float(np.percentile(across[chosen], 90))
    if length < max(config.least_length_m, config.slenderness * breadth):
        return None
    return (chosen, axis) if beside.sum() < config.most_beside * chosen.sum() else None


def _cylindrical(points: np.ndarray, middle: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offset = points - middle
    along = offset @ axis
    return along, np.linalg.norm(offset - along[:, None] * axis, axis=1)


def _unbroken(along: np.ndarray, on_line: np.ndarray, config: DetectionConfig) -> tuple[float, float] | None:
    """The stretch around 0 that has no gap longer than ``gap_m``."""
    places = np.sort(along[on_line])
    if not len(places):
        return None
    breaks = np.flatnonzero(np.diff(places) > config.gap_m)
    starts, ends = places[np.concatenate([[0], breaks + 1])], places[np.concatenate([breaks, [len(places) - 1]])]
    middle = int(np.argmin(np.maximum(starts, 0.0) - np.minimum(ends, 0.0)))
    return float(starts[middle]), float(ends[middle])


def _main_direction(points: np.ndarray) -> np.ndarray:
    offset = points - points.mean(axis=0)
    direction: np.ndarray = np.linalg.eigh(offset.T @ offset)[1][:, -1]
    return direction


def _bar(points_m: np.ndarray, members: np.ndarray, axis: np.ndarray) -> Found:
    """Cross-section along the vertical where the bar has one, so that its sides are upright and level."""
    upward = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(upward, axis)
    side /= np.linalg.norm(side)
    return _found(False, points_m, members, np.stack([side, np.cross(axis, side), axis], axis=1))


def _found(plate: bool, points_m: np.ndarray, members: np.ndarray, rotation: np.ndarray) -> Found:
    center = points_m[members].mean(axis=0)
    low, high = np.percentile((points_m[members] - center) @ rotation, [1, 99], axis=0)
    return Found(plate, center, rotation, low, high, members)


def _best_plate(
    points_m: np.ndarray, left: np.ndarray, config: DetectionConfig, rng: np.random.Generator
) -> Found | None:
    points = points_m[left]
    tree = cKDTree(points)
    best: Found | None = None
    for place in points[rng.choice(len(points), min(config.seeds, len(points)), replace=False)]:
        near = points[tree.query_ball_point(place, config.plate_radius_m)]
        if len(near) < config.least_pixels:
            continue
        spread, axes = np.linalg.eigh(np.cov((near - place).T))
        if np.sqrt(spread[0]) > config.plate_flatness_m or _filled(near - place, axes, config) < config.plate_filled:
            continue
        found = _grow_plate(points_m, left, place, axes, config)
        if found is not None and (best is None or len(found.members) > len(best.members)):
            best = found
    return best


def _filled(offset: np.ndarray, axes: np.ndarray, config: DetectionConfig) -> float:
    """Share of a disc's cells that hold a point."""
    reach = int(config.plate_radius_m / config.cell_m)
    cell = np.rint(offset @ axes[:, 1:] / config.cell_m).astype(int)
    cell = cell[(np.abs(cell) <= reach).all(axis=1)] + reach
    grid = np.zeros((2 * reach + 1,) * 2, dtype=bool)
    grid[tuple(cell.T)] = True
    row, column = np.indices(grid.shape) - reach
    disc = row**2 + column**2 <= reach**2
    return float(grid[disc].mean())


def _grow_plate(
    points_m: np.ndarray, left: np.ndarray, place: np.ndarray, axes: np.ndarray, config: DetectionConfig
) -> Found | None:
    """The connected part of the plane around a place, in its smallest rectangle; None where that is a bar's."""
    offset = points_m[left] - place
    on_plane = np.abs(offset @ axes[:, 0]) < config.plate_flatness_m
    flat = offset[on_plane] @ axes[:, 1:]
    cell = np.floor(flat / config.cell_m).astype(int)
    first = cell.min(axis=0) - 1
    grid = np.zeros(cell.max(axis=0) - first + 2, dtype=bool)
    grid[tuple((cell - first).T)] = True
    grid = ndimage.binary_opening(grid, np.ones((5, 5), bool))  # bars that lie in the same plane fall off
    label, _ = ndimage.label(grid)
    here = label[tuple(-first)]
    if here == 0:
        return None
    chosen = left[on_plane][label[tuple((cell - first).T)] == here]
    if len(chosen) < config.least_pixels:
        return None
    (_, size, degrees) = cv2.minAreaRect((points_m[chosen] - place).astype(np.float32) @ axes[:, 1:].astype(np.float32))
    if min(size) < 2.0 * config.bar_radius_m:
        return None
    turn = np.radians(degrees)
    one = axes[:, 1:] @ [np.cos(turn), np.sin(turn)]
    return _found(True, points_m, chosen, np.stack([one, np.cross(axes[:, 0], one), axes[:, 0]], axis=1))
