"""Compute MeshHOG: histograms of the gradients of a function on the mesh (Zaharescu et al. 2009, 2012)."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from anchorpose.research.features.circle import FULL_TURN, peak_fraction, smooth, spread_over_two, turn_fraction
from anchorpose.research.features.mesh_gradient import gaussian_curvature, mean_curvature, mesh_gradient, tangent_frame
from anchorpose.research.features.rings import Rings, rings_within
from anchorpose.settings import Positive, settings
from anchorpose.surface.surface import Surface


class ScalarFunction(StrEnum):
    """The function on the surface whose gradients MeshHOG describes. The third function that MeshHOG's authors use,
    colour, does not exist in depth data.
    """

    MEAN_CURVATURE = "mean-curvature"
    GAUSSIAN_CURVATURE = "gaussian-curvature"


TwoOrMore = Annotated[int, Field(ge=2)]


@settings
class MeshHogConfig:
    """Settings of MeshHOG. The default values are from MeshHOG's authors, except for both radii and the smoothing."""

    # m; of the radii from 0.1 to 0.3 m, this radius distinguishes the most places of a body, at a computing time of
    # 0.1 s per frame
    radius_m: Positive = 0.20
    # m; this radius averages out a depth camera's noise, and still resolves a forearm
    curvature_radius_m: Positive = 0.07
    function: ScalarFunction = ScalarFunction.MEAN_CURVATURE
    directions: Annotated[int, Field(ge=4)] = 36  # number of bins of the histogram for the local frame's first axis
    # number of times that the histogram for the local frame's first axis is smoothed with the weights 1 : 2 : 1, since
    # a node's neighbours on the pixel grid lie in only eight directions
    smoothing: Annotated[int, Field(ge=0)] = 16
    slices: TwoOrMore = 4  # number of sectors of each of the three planes, between which nodes are divided by position
    orientations: TwoOrMore = 8  # number of bins for the direction of the gradient in each of these sectors
    spread: Positive = 0.3  # sigma of the Gaussian weight, as a share of radius_m

    @property
    def width(self) -> int:
        """Return the number of columns of the descriptor."""
        return 3 * self.slices * self.orientations


def mesh_hog(surface: Surface, config: MeshHogConfig | None = None) -> np.ndarray:
    """Return the descriptors (n, 3 * slices * orientations) float32, of unit length.

    A row is NaN if the node has no position or normal, or if the function has no gradient at any node around it.

    The local frame consists of the node's normal, the direction in the tangent plane in which the surrounding nodes
    with the largest gradients lie, and the direction perpendicular to both. Positions and gradients of the nodes within
    radius_m along the surface are projected onto the three planes of this frame. In each plane, the weight of such a
    node is the length of its projected gradient times a Gaussian of its distance. The weight is divided between the
    slices (sectors of the plane) nearest to the node's position and the orientations (bins of direction) nearest to its
    gradient. Three things differ from the authors' program, so that no result depends on the grid or on where bins
    begin: the histogram by which the frame's first tangential direction is found is smoothed; its peak is interpolated
    between bins that are counted from a direction that turns with the body; and a gradient is weighted by the length of
    its projection, not by its own length. Sources: Zaharescu et al. 2009 (doi:10.1109/CVPRW.2009.5206748) and 2012
    (doi:10.1007/s11263-012-0528-5).
    """
    config = config or MeshHogConfig()
    gradient = mesh_gradient(surface, scalar_function(surface, config))
    rings = rings_within(surface, config.radius_m)
    layout = _Layout(
        config.radius_m * config.spread, config.directions, config.smoothing, config.slices, config.orientations
    )
    return _histograms(surface.points_m, surface.normals, gradient, rings, layout)


def scalar_function(surface: Surface, config: MeshHogConfig) -> np.ndarray:
    """Return (n,) float32: the configured function of every node."""
    curvature = gaussian_curvature if config.function == ScalarFunction.GAUSSIAN_CURVATURE else mean_curvature
    return curvature(surface, config.curvature_radius_m)


PLANES = ((0, 1, 1.0), (0, 2, -1.0), (2, 1, -1.0))
"""For each plane: the axis from which angles are counted, the axis at a quarter turn from it, and the sign of the
second axis.
"""


class _Layout(NamedTuple):
    """The settings of the histograms in the form that compiled functions take."""

    sigma_m: float  # sigma of the Gaussian weight
    directions: int
    smoothing: int
    slices: int
    orientations: int


@njit(cache=True)
def _histograms(
    points: np.ndarray, normals: np.ndarray, gradient: np.ndarray, rings: Rings, layout: _Layout
) -> np.ndarray:
    histograms = np.full((len(points), 3 * layout.slices * layout.orientations), np.nan, np.float32)
    longest = 0
    for k in range(len(points)):
        longest = max(longest, rings.start[k + 1] - rings.start[k])
    local, frame, polar = np.empty((longest, 7)), np.empty((3, 3)), np.empty(layout.directions)
    bins = np.empty((3, layout.slices, layout.orientations))
    for k in range(len(points)):
        if not tangent_frame(normals[k], frame):
            continue
        row = slice(rings.start[k], rings.start[k + 1])
        near, distance = rings.node[row], rings.distance_m[row]
        count = _to_local(points, gradient, k, near, distance, frame, layout.sigma_m, local)
        angle = _first_axis(local, count, layout.smoothing, polar)
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
def _to_local(
    points: np.ndarray,
    gradient: np.ndarray,
    node: int,
    near: np.ndarray,
    distance: np.ndarray,
    frame: np.ndarray,
    sigma: float,
    local: np.ndarray,
) -> int:
    """Fill local with position (3), gradient (3) and weight of each neighbour with a gradient; return their number."""
    count = 0
    for spot in range(len(near)):
        other = near[spot]
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
def _first_axis(local: np.ndarray, count: int, rounds: int, polar: np.ndarray) -> float:
    """Return the angle (rad) from the frame's first tangent to the local frame's first axis, the direction in which the
    neighbours with the largest gradients lie; NaN if all gradients are zero.
    """
    x, y, total = 0.0, 0.0, 0.0
    for c in range(count):
        size = np.sqrt(local[c, 0] ** 2 + local[c, 1] ** 2)
        if size > 0.0:
            weight = local[c, 6] * _length(local[c])
            x, y = x + weight * local[c, 0] / size, y + weight * local[c, 1] / size
            total += weight
    if not total > 0.0:
        return np.nan
    # Angles are counted from the weighted mean direction (x, y) of the neighbours, since this direction turns with the
    # body, unlike the frame's tangents
    begin = turn_fraction(x, y, 0.0)
    polar[:] = 0.0
    for c in range(count):
        if local[c, 0] != 0.0 or local[c, 1] != 0.0:
            fraction = turn_fraction(local[c, 0], local[c, 1], begin)
            spread_over_two(polar, fraction, local[c, 6] * _length(local[c]))
    smooth(polar, rounds)
    return (begin + peak_fraction(polar)) * FULL_TURN


@njit(cache=True)
def _length(row: np.ndarray) -> float:
    return np.sqrt(row[3] * row[3] + row[4] * row[4] + row[5] * row[5])


@njit(cache=True)
def _turn(local: np.ndarray, count: int, cosine: float, sine: float) -> None:
    """Rotate the neighbours' positions and gradients about the normal so that angles count from the local frame's first
    axis.
    """
    for c in range(count):
        for column in (0, 3):
            x, y = local[c, column], local[c, column + 1]
            local[c, column], local[c, column + 1] = cosine * x + sine * y, cosine * y - sine * x


@njit(cache=True)
def _fill(local: np.ndarray, count: int, plane: tuple, bins: np.ndarray) -> None:
    """Add the weights of all neighbours to the bins (slices, orientations) of one plane."""
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
        s, o = s if s >= 0 else slices - 1, o if o >= 0 else orientations - 1  # indices wrap around; % would be slow
        s_after, o_after = s + 1 if s + 1 < slices else 0, o + 1 if o + 1 < orientations else 0
        bins[s, o] += weight * (1.0 - ds) * (1.0 - do)
        bins[s, o_after] += weight * (1.0 - ds) * do
        bins[s_after, o] += weight * ds * (1.0 - do)
        bins[s_after, o_after] += weight * ds * do
