"""Long thin and broad flat objects among points: where a bar or a plate may be, before it is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

BAR_RADIUS_M: Final = 0.055  # from a bar's middle line to its surface: tubes of 3 cm to pads of 9 cm
SURROUNDINGS_M: Final = 0.10  # a bar has nothing beside it up to here, a strip of a plate has
MOST_BESIDE: Final = 0.5  # of a bar's own pixels: other bars that start from it
LEAST_LENGTH_M: Final = 0.15  # shorter pieces are handles, screws and corners
SLENDERNESS: Final = 2.5  # length over breadth, below which nothing is a bar
GAP_M: Final = 0.06  # without readings along a bar: what another bar hides
SEEDS: Final = 120  # places from which a bar is sought, drawn again for each bar
NEAR_M: Final = 0.12  # points around a seed that give a direction: twice a thick bar's breadth
LEAST_PIXELS: Final = 40  # of a bar or plate: fewer give no direction
PLATE_RADIUS_M: Final = 0.09  # a disc of this size is filled on a plate and never on a bar
PLATE_FILLED: Final = 0.85  # of the disc's cells
PLATE_FLATNESS_M: Final = 0.02  # noise and upholstery
PLATE_EDGE_M: Final = 0.05  # a seat's edge, which is not a bar of its own
CELL_M: Final = 0.02  # three pixels at 2.4 m
MOST_PARTS: Final = 40  # of one piece of equipment


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A part as detected: rotation (3, 3), columns its axes, a bar's longest or a plate's normal last.

    low, high (3,): extent of its visible points along the axes, from ``center_m``; members: their indices.
    """

    plate: bool
    center_m: np.ndarray
    rotation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    members: np.ndarray


def find_parts(points_m: np.ndarray) -> list[Found]:
    """Plates first, then bars, the one with most pixels first; its points are removed before the next is sought."""
    rng = np.random.default_rng(0)
    left = np.arange(len(points_m))
    parts: list[Found] = []
    for find in (_best_plate, _best_bar):
        while len(left) >= LEAST_PIXELS and len(parts) < MOST_PARTS:
            found = find(points_m, left, rng)
            if found is None:
                break
            parts.append(found)
            left = left[~_inside(points_m[left], found, 0.01, PLATE_EDGE_M if found.plate else 0.01)]
    return parts


def _inside(points_m: np.ndarray, part: Found, margin_m: float, margin_last_m: float) -> np.ndarray:
    """(n,) bool: within the part's extent and a margin, another one along its last axis."""
    local = (points_m - part.center_m) @ part.rotation
    margin = np.array([margin_m, margin_m, margin_last_m])
    return np.asarray(((local > part.low - margin) & (local < part.high + margin)).all(axis=1))


def _best_bar(points_m: np.ndarray, left: np.ndarray, rng: np.random.Generator) -> Found | None:
    points = points_m[left]
    tree = cKDTree(points)
    best: tuple[int, np.ndarray, np.ndarray] | None = None
    for place in points[rng.choice(len(points), min(SEEDS, len(points)), replace=False)]:
        near = points[tree.query_ball_point(place, NEAR_M)]
        if len(near) < LEAST_PIXELS // 2:
            continue
        line = _grow_line(points, place, _main_direction(near))
        if line is not None and (best is None or line[0].sum() > best[0]):
            best = int(line[0].sum()), *line
    if best is None:
        return None
    _, chosen, axis = best
    return _bar(points_m, left[chosen], axis)


def _grow_line(points: np.ndarray, place: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Points (n,) bool on the bar through a place, and its direction; None where it is not a bar."""
    middle = place
    radius = 1.5 * BAR_RADIUS_M
    for _ in range(6):
        along, across = _cylindrical(points, middle, axis)
        on_line = across < radius
        reach = _unbroken(along, on_line)
        if reach is None:
            return None
        chosen = on_line & (along >= reach[0]) & (along <= reach[1])
        if chosen.sum() < LEAST_PIXELS:
            return None
        middle, axis = points[chosen].mean(axis=0), _main_direction(points[chosen])
        # a thin tube is limited to its own breadth, so that the bars it meets do not turn it
        radius = float(np.clip(2.5 * np.median(across[chosen]), 0.4 * BAR_RADIUS_M, BAR_RADIUS_M))
    along, across = _cylindrical(points, middle, axis)
    chosen = (across < radius) & (along >= along[chosen].min()) & (along <= along[chosen].max())
    length = float(np.ptp(along[chosen]))
    beside = (across >= 1.2 * BAR_RADIUS_M) & (across < SURROUNDINGS_M)
    beside &= (along >= along[chosen].min()) & (along <= along[chosen].max())
    breadth = 2.0 * float(np.percentile(across[chosen], 90))
    if length < max(LEAST_LENGTH_M, SLENDERNESS * breadth):
        return None
    return (chosen, axis) if beside.sum() < MOST_BESIDE * chosen.sum() else None


def _cylindrical(points: np.ndarray, middle: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offset = points - middle
    along = offset @ axis
    return along, np.linalg.norm(offset - along[:, None] * axis, axis=1)


def _unbroken(along: np.ndarray, on_line: np.ndarray) -> tuple[float, float] | None:
    """The stretch around 0 that has no gap longer than ``GAP_M``."""
    places = np.sort(along[on_line])
    if not len(places):
        return None
    breaks = np.flatnonzero(np.diff(places) > GAP_M)
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


def _best_plate(points_m: np.ndarray, left: np.ndarray, rng: np.random.Generator) -> Found | None:
    points = points_m[left]
    tree = cKDTree(points)
    best: Found | None = None
    for place in points[rng.choice(len(points), min(SEEDS, len(points)), replace=False)]:
        near = points[tree.query_ball_point(place, PLATE_RADIUS_M)]
        if len(near) < LEAST_PIXELS:
            continue
        spread, axes = np.linalg.eigh(np.cov((near - place).T))
        if np.sqrt(spread[0]) > PLATE_FLATNESS_M or _filled(near - place, axes) < PLATE_FILLED:
            continue
        found = _grow_plate(points_m, left, place, axes)
        if found is not None and (best is None or len(found.members) > len(best.members)):
            best = found
    return best


def _filled(offset: np.ndarray, axes: np.ndarray) -> float:
    """Share of a disc's cells that hold a point."""
    reach = int(PLATE_RADIUS_M / CELL_M)
    cell = np.rint(offset @ axes[:, 1:] / CELL_M).astype(int)
    cell = cell[(np.abs(cell) <= reach).all(axis=1)] + reach
    grid = np.zeros((2 * reach + 1,) * 2, dtype=bool)
    grid[tuple(cell.T)] = True
    row, column = np.indices(grid.shape) - reach
    disc = row**2 + column**2 <= reach**2
    return float(grid[disc].mean())


def _grow_plate(points_m: np.ndarray, left: np.ndarray, place: np.ndarray, axes: np.ndarray) -> Found | None:
    """The connected part of the plane around a place, in its smallest rectangle; None where that is a bar's."""
    offset = points_m[left] - place
    on_plane = np.abs(offset @ axes[:, 0]) < PLATE_FLATNESS_M
    flat = offset[on_plane] @ axes[:, 1:]
    cell = np.floor(flat / CELL_M).astype(int)
    first = cell.min(axis=0) - 1
    grid = np.zeros(cell.max(axis=0) - first + 2, dtype=bool)
    grid[tuple((cell - first).T)] = True
    grid = ndimage.binary_opening(grid, np.ones((5, 5), bool))  # removes bars that lie in the same plane
    label, _ = ndimage.label(grid)
    here = label[tuple(-first)]
    if here == 0:
        return None
    chosen = left[on_plane][label[tuple((cell - first).T)] == here]
    if len(chosen) < LEAST_PIXELS:
        return None
    (_, size, degrees) = cv2.minAreaRect((points_m[chosen] - place).astype(np.float32) @ axes[:, 1:].astype(np.float32))
    if min(size) < 2.0 * BAR_RADIUS_M:
        return None
    turn = np.radians(degrees)
    one = axes[:, 1:] @ [np.cos(turn), np.sin(turn)]
    return _found(True, points_m, chosen, np.stack([one, np.cross(axes[:, 0], one), axes[:, 0]], axis=1))
