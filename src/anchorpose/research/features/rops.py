"""Rotational projection statistics: the neighbourhood turned nine ways, each laid on three planes and summed up.

Source: Guo, Sohel, Bennamoun, Lu, Wan 2013 (doi:10.1007/s11263-013-0627-y), Section 4, as PCL 1.13 reads it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.research.features.circle import ONE, ZERO
from anchorpose.research.features.neighbours import Neighbours, as_points, require_radius, shared_or_found
from anchorpose.research.features.triangle_frame import prepare_triangles, triangle_frames

STATISTICS = 5  # central moments 11, 21, 12 and 22, and the entropy


@dataclass(frozen=True, slots=True, kw_only=True)
class RopsConfig:
    """135 numbers with three turns about each axis; ``columns`` tells how many."""

    radius_m: float = 0.20  # the 15 mesh resolutions of its authors, here 13 mm
    turns: int = 3  # about each axis, within a right angle: the authors' choice
    bins: int = 5  # along each side of a plane: theirs, too

    def __post_init__(self) -> None:
        require_radius(self.radius_m)
        for name in ("turns", "bins"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")

    @property
    def columns(self) -> int:
        return 3 * self.turns * 3 * STATISTICS


def rops(
    points_m: np.ndarray,
    triangles: np.ndarray,
    config: RopsConfig | None = None,
    chosen: np.ndarray | None = None,
    neighbours: Neighbours | None = None,
) -> np.ndarray:
    """(k, 135) float32 for the chosen nodes (k,) int, or for all (None); absolute values sum to 1.

    points_m (n, 3), NaN where not known; triangles (f, 3) int, of ``surface.mesh.faces``. neighbours: those of the
    chosen nodes within ``radius_m``, where a caller has them. Columns: axis x, y, z; turn; plane xy, xz, yz; moments
    11, 21, 12, 22 and entropy. NaN row: a node without position, or with nobody or no triangle within the radius.
    """
    config = config or RopsConfig()
    points = as_points(points_m, "points_m")
    near = shared_or_found(neighbours, points, config.radius_m, chosen)
    frames = triangle_frames(points, prepare_triangles(points, triangles), near)
    angle = np.radians(90.0 / (config.turns + 1) * np.arange(1, config.turns + 1))
    turns = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    return _statistics(points, near.centre, near.start, near.node, frames, turns, config.bins)


@njit(cache=True, error_model="numpy")
def _statistics(
    points: np.ndarray, centre: np.ndarray, start: np.ndarray, node: np.ndarray, frames: np.ndarray,
    turns: np.ndarray, bins: int,
) -> np.ndarray:  # fmt: skip
    result = np.full((len(centre), 9 * len(turns) * STATISTICS), np.nan, np.float32)
    most = 1
    for c in range(len(centre)):
        most = max(most, start[c + 1] - start[c] + 1)
    local, turned, cell = (
        np.empty((3, most), np.float32),
        np.empty((2, most), np.float32),
        np.empty((3, most), np.int32),
    )
    share = np.empty((3, bins * bins), np.float32)
    for c in range(len(centre)):
        if not np.isfinite(frames[c, 0, 0]):
            continue
        count = _lay_down(points, centre[c], node[start[c] : start[c + 1]], frames[c], local)
        column = 0
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3  # the turn takes the first of them to the second
            _into_bins(local[axis], count, bins, cell[axis])
            for turn in range(len(turns)):
                cosine, sine = turns[turn, 0], turns[turn, 1]
                for m in range(count):
                    turned[0, m] = cosine * local[one, m] - sine * local[two, m]
                    turned[1, m] = sine * local[one, m] + cosine * local[two, m]
                _into_bins(turned[0], count, bins, cell[one])
                _into_bins(turned[1], count, bins, cell[two])
                _lay_on_planes(cell, count, bins, share)
                for plane in range(3):
                    _sum_up(share[plane], bins, result[c, column : column + STATISTICS])
                    column += STATISTICS
        _normalize(result[c])
    return result


@njit(cache=True)
def _lay_down(points: np.ndarray, own: int, near: np.ndarray, frame: np.ndarray, local: np.ndarray) -> int:
    """The node itself and its neighbours in its frame; how many."""
    local[0, 0] = local[1, 0] = local[2, 0] = ZERO
    px, py, pz = points[own, 0], points[own, 1], points[own, 2]
    for axis in range(3):
        fx, fy, fz = frame[axis, 0], frame[axis, 1], frame[axis, 2]
        for m in range(len(near)):
            q = np.uint32(near[m])
            local[axis, m + 1] = fx * (points[q, 0] - px) + fy * (points[q, 1] - py) + fz * (points[q, 2] - pz)
    return len(near) + 1


@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})  # all are known; the ends are found abreast
def _into_bins(values: np.ndarray, count: int, bins: int, cell: np.ndarray) -> None:
    """Which of the equal parts between the least and the greatest each value is in; one part if they are one."""
    low, high = values[0], values[0]
    for m in range(count):
        low = values[m] if values[m] < low else low
        high = values[m] if values[m] > high else high
    width = (high - low) / np.float32(bins)
    width = width if width > ZERO else ONE
    for m in range(count):
        cell[m] = min(np.int32((values[m] - low) / width), np.int32(bins - 1))


@njit(cache=True, error_model="numpy")
def _lay_on_planes(cell: np.ndarray, count: int, bins: int, share: np.ndarray) -> None:
    """Fills share (3, bins * bins): the part of the points in each cell of the planes xy, xz and yz."""
    share[:] = ZERO
    for m in range(count):
        share[0, cell[0, m] * bins + cell[1, m]] += ONE
        share[1, cell[0, m] * bins + cell[2, m]] += ONE
        share[2, cell[1, m] * bins + cell[2, m]] += ONE
    share /= np.float32(count)


@njit(cache=True, error_model="numpy")
def _sum_up(share: np.ndarray, bins: int, statistics: np.ndarray) -> None:
    """Central moments 11, 21, 12 and 22 and entropy of one plane; only the mean is needed before."""
    mean_i, mean_j = 0.0, 0.0
    for i in range(bins):
        for j in range(bins):
            mean_i += (i + 1) * share[i * bins + j]
            mean_j += (j + 1) * share[i * bins + j]
    m11, m21, m12, m22, entropy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(bins):
        for j in range(bins):
            part, di, dj = share[i * bins + j], i + 1 - mean_i, j + 1 - mean_j
            if part > ZERO:
                m11 += di * dj * part
                m21 += di * di * dj * part
                m12 += di * dj * dj * part
                m22 += di * di * dj * dj * part
                entropy -= part * np.log(part)
    statistics[0], statistics[1], statistics[2], statistics[3], statistics[4] = m11, m21, m12, m22, entropy


@njit(cache=True)
def _normalize(row: np.ndarray) -> None:
    """To absolute values that sum to 1; points of one place have no shape: NaN."""
    total = 0.0
    for value in row:
        total += abs(value)
    row *= np.float32(1.0 / total if total > 0.0 else np.nan)
