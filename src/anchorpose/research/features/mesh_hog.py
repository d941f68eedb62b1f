"""MeshHOG: histograms of the gradients of a function on the mesh (Zaharescu et al. 2009, 2012)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numba import njit

from anchorpose.research.features.circle import FULL_TURN, peak_fraction, smooth, spread_over_two, turn_fraction
from anchorpose.research.features.mesh_gradient import gaussian_curvature, mean_curvature, mesh_gradient, tangent_frame
from anchorpose.research.features.rings import rings_within
from anchorpose.surface.surface import Surface


class ScalarFunction(StrEnum):
    """The function whose gradients are described; the authors' third, colour, is not in depth data."""

    MEAN_CURVATURE = "mean-curvature"
    GAUSSIAN_CURVATURE = "gaussian-curvature"


class FirstAxis(StrEnum):
    """What the histogram over directions counts whose peak is the first axis of the local frame."""

    WHERE = "where"  # in which direction from the node the gradients are large, as the authors' program does
    WHITHER = "whither"  # in which direction they point, as SIFT does


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshHogConfig:
    """What MeshHOG looks at; the numbers are the authors' but for both radii and the smoothing."""

    radius_m: float = 0.20  # of 0.1 to 0.3 m what tells most places of a body apart at 0.1 s a frame
    curvature_radius_m: float = 0.07  # bridges the noise of a depth camera, resolves a forearm
    function: ScalarFunction = ScalarFunction.MEAN_CURVATURE
    first_axis: FirstAxis = FirstAxis.WHERE
    directions: int = 36  # bins of the histogram that gives the first axis
    smoothing: int = 16  # rounds of 1 : 2 : 1 over them: near nodes on a grid lie in eight directions only
    slices: int = 4  # of each of the three planes, by position
    orientations: int = 8  # in each slice, by direction of the gradient
    spread: float = 0.3  # sigma of the Gaussian weight, as a part of radius_m

    def __post_init__(self) -> None:
        for name in ("radius_m", "curvature_radius_m", "spread"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name, least in (("directions", 4), ("smoothing", 0), ("slices", 2), ("orientations", 2)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be {least} or more, got {getattr(self, name)}")
        ScalarFunction(self.function), FirstAxis(self.first_axis)

    @property
    def width(self) -> int:
        """Columns of the descriptor."""
        return 3 * self.slices * self.orientations


def mesh_hog(
    surface: Surface, config: MeshHogConfig | None = None, chosen: np.ndarray | None = None,
    values: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """(k, 3 * slices * orientations) float32, unit length, a row for each chosen node (k,) int; None: for all n.

    values (n,): another function of the nodes instead of ``config.function``. A row is NaN where the node has no
    position or normal, or where the function has no gradient anywhere around it.

    The local frame is the normal and the direction in the tangent plane in which gradients are largest. Positions and
    gradients of the nodes within radius_m along the surface are projected onto its three planes; in each plane a
    node's weight, the projected gradient's length times a Gaussian of the distance, goes to the slice of its position
    and the orientation of its gradient, shared with the next ones. Three things differ from the authors' program, so
    that no result hangs on the grid or on where bins begin: the histogram for the first axis is smoothed, its peak is
    found between bins counted from a direction that turns with the body, and a gradient weighs what its projection is
    long, not what it is itself.
    Sources: Zaharescu et al. 2009 (doi:10.1109/CVPRW.2009.5206748) and 2012 (doi:10.1007/s11263-012-0528-5).
    """
    config = config or MeshHogConfig()
    chosen = np.arange(len(surface)) if chosen is None else np.asarray(chosen, np.int64)
    gradient = mesh_gradient(surface, scalar_function(surface, config) if values is None else values)
    rings = rings_within(surface, config.radius_m, chosen)
    return _histograms(
        surface.points_m, surface.normals, gradient, chosen, rings.start, rings.node, rings.distance_m,
        config.radius_m * config.spread, config.first_axis == FirstAxis.WHITHER,
        config.directions, config.smoothing, config.slices, config.orientations,
    )  # fmt: skip


def scalar_function(surface: Surface, config: MeshHogConfig) -> np.ndarray:
    """(n,) float32: the configured function of every node."""
    curvature = gaussian_curvature if config.function == ScalarFunction.GAUSSIAN_CURVATURE else mean_curvature
    return curvature(surface, config.curvature_radius_m)


PLANES = ((0, 1, 1.0), (0, 2, -1.0), (2, 1, -1.0))
"""Of each plane the axis angles are counted from, the axis a quarter turn on, and its sign."""


@njit(cache=True)
def _histograms(
    points: np.ndarray, normals: np.ndarray, gradient: np.ndarray, chosen: np.ndarray, start: np.ndarray,
    ring: np.ndarray, distance: np.ndarray, sigma: float, whither: bool, directions: int, rounds: int,
    slices: int, orientations: int,
) -> np.ndarray:  # fmt: skip
    histograms = np.full((len(chosen), 3 * slices * orientations), np.nan, np.float32)
    longest = 0
    for k in range(len(chosen)):
        longest = max(longest, start[k + 1] - start[k])
    local, frame, polar = np.empty((longest, 7)), np.empty((3, 3)), np.empty(directions)
    bins = np.empty((3, slices, orientations))
    for k in range(len(chosen)):
        if not tangent_frame(normals[chosen[k]], frame):
            continue
        count = _lay_out(points, gradient, chosen[k], ring, distance, start[k], start[k + 1], frame, sigma, local)
        angle = _first_axis(local, count, whither, rounds, polar)
        if not np.isfinite(angle):
            continue
        _turn(local, count, np.cos(angle), np.sin(angle))
        bins[:] = 0.0
        for plane in range(3):
            _fill(local, count, PLANES[plane], bins[plane])
        size = np.sqrt((bins * bins).sum())
        if size > 0.0:
            histograms[k] = (bins / size).ravel()
    return histograms


@njit(cache=True)
def _lay_out(
    points: np.ndarray, gradient: np.ndarray, node: int, ring: np.ndarray, distance: np.ndarray, first: int, last: int,
    frame: np.ndarray, sigma: float, local: np.ndarray,
) -> int:  # fmt: skip
    """Fills local with position (3), gradient (3) and weight of each neighbour that has a gradient; how many."""
    count = 0
    for spot in range(first, last):
        other = ring[spot]
        if other == node or not np.isfinite(gradient[other, 0]):
            continue
        for row in range(3):
            local[count, row], local[count, 3 + row] = 0.0, 0.0
            for axis in range(3):
                away = np.float64(points[other, axis]) - np.float64(points[node, axis])
                local[count, row] += frame[row, axis] * away
                local[count, 3 + row] += frame[row, axis] * np.float64(gradient[other, axis])
        local[count, 6] = np.exp(-0.5 * (distance[spot] / sigma) ** 2)
        count += 1
    return count


@njit(cache=True)
def _first_axis(local: np.ndarray, count: int, whither: bool, rounds: int, polar: np.ndarray) -> float:
    """Angle of the first axis from the first tangent, NaN where no gradient has a length."""
    column = 3 if whither else 0
    x, y, total = 0.0, 0.0, 0.0
    for c in range(count):
        size = np.sqrt(local[c, column] ** 2 + local[c, column + 1] ** 2)
        if size > 0.0:
            weight = local[c, 6] * _length(local[c], whither)
            x, y = x + weight * local[c, column] / size, y + weight * local[c, column + 1] / size
            total += weight
    if not total > 0.0:
        return np.nan
    begin = turn_fraction(x, y, 0.0)  # turns with the body, unlike the tangents
    polar[:] = 0.0
    for c in range(count):
        if local[c, column] != 0.0 or local[c, column + 1] != 0.0:
            fraction = turn_fraction(local[c, column], local[c, column + 1], begin)
            spread_over_two(polar, fraction, local[c, 6] * _length(local[c], whither))
    smooth(polar, rounds)
    return (begin + peak_fraction(polar)) * FULL_TURN


@njit(cache=True)
def _length(row: np.ndarray, projected: bool) -> float:
    flat2 = row[3] * row[3] + row[4] * row[4]
    return np.sqrt(flat2) if projected else np.sqrt(flat2 + row[5] * row[5])


@njit(cache=True)
def _turn(local: np.ndarray, count: int, cosine: float, sine: float) -> None:
    """Counts positions and gradients from the first axis."""
    for c in range(count):
        for column in (0, 3):
            x, y = local[c, column], local[c, column + 1]
            local[c, column], local[c, column + 1] = cosine * x + sine * y, cosine * y - sine * x


@njit(cache=True)
def _fill(local: np.ndarray, count: int, plane: tuple, bins: np.ndarray) -> None:
    """Adds to bins (slices, orientations) of one plane."""
    first, second, sign = plane
    slices, orientations = bins.shape
    for c in range(count):
        gx, gy = local[c, 3 + first], sign * local[c, 3 + second]
        weight = local[c, 6] * np.sqrt(gx * gx + gy * gy)
        if not weight > 0.0:
            continue
        at = turn_fraction(local[c, first], sign * local[c, second], 0.0) * slices - 0.5
        to = turn_fraction(gx, gy, 0.0) * orientations - 0.5
        s, o = int(np.floor(at)), int(np.floor(to))
        ds, do = at - s, to - o
        bins[s % slices, o % orientations] += weight * (1.0 - ds) * (1.0 - do)
        bins[s % slices, (o + 1) % orientations] += weight * (1.0 - ds) * do
        bins[(s + 1) % slices, o % orientations] += weight * ds * (1.0 - do)
        bins[(s + 1) % slices, (o + 1) % orientations] += weight * ds * do
