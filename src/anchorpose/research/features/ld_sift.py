"""LD-SIFT: the SIFT descriptor of a depth map around each node, at a fixed or at the shape's own scale.

Source: Darom and Keller 2012 (doi:10.1109/TIP.2012.2183142).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from anchorpose.research.features.circle import FULL_TURN
from anchorpose.research.features.depth_map import (
    CELLS,
    DIRECTIONS,
    WIDTH,
    cell_shares,
    describe_image,
    draw_depth_map,
    gradient_angle,
    principal_angle,
    triangle_slopes,
)
from anchorpose.research.features.mesh_gradient import tangent_frame
from anchorpose.research.features.rings import Rings, rings_within
from anchorpose.settings import Count, Positive, settings
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface


def intrinsic_scale(surface: Surface, levels: int) -> tuple[np.ndarray, np.ndarray]:
    """sigma_m (n,) float32: the standard deviation of the smoothing at each node's scale, NaN where it has none;
    found (n,) bool: whether the response is larger there than at the levels before and after.

    Positions are smoothed over their rings again and again, with Gaussian weights as wide as the node's edges are long
    (its density). The difference of two levels along the normal, times the variance between them to make it comparable
    across scales, is the response; the scale is that of the highest response inside the range, at an end of it where
    there is none inside. At the top of a Gaussian bump sigma_m is the bump's own.
    Raises ValueError for fewer than three levels.
    """
    if levels < 3:
        raise ValueError(f"a scale is found among three levels or more, got {levels}")
    responses = np.empty((levels, len(surface)))
    points, normals = surface.points_m.astype(np.float64), surface.normals.astype(np.float64)
    density, variance = mean_edge_m(surface), np.empty(len(surface))
    _smoothed(points, surface.ring, density, variance)
    steps, unused = np.arange(levels) + 0.5, np.empty(len(surface))
    for level in range(levels):
        smoothed = _smoothed(points, surface.ring, density, unused)
        responses[level] = steps[level] * np.abs(((smoothed - points) * normals).sum(axis=1))
        points = smoothed
    inside = responses[1:-1]
    peak = (inside > responses[:-2]) & (inside > responses[2:])
    found = peak.any(axis=0)
    best = np.where(found, 1 + np.where(peak, inside, -1.0).argmax(axis=0), responses.argmax(axis=0))
    known = np.isfinite(responses).all(axis=0) & np.isfinite(density)
    sigma = np.where(known, np.sqrt(variance * steps[best]), np.nan)
    return sigma.astype(np.float32), found & known


def mean_edge_m(surface: Surface) -> np.ndarray:
    """(n,) float64: mean length of a node's edges on the grid; NaN where it has none."""
    points = surface.points_m.astype(np.float64)
    there = surface.ring >= 0
    length = np.linalg.norm(points[surface.ring] - points[:, None], axis=2)
    count = there.sum(axis=1)
    return np.where(count > 0, np.where(there, length, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


@njit(cache=True)
def _smoothed(points: np.ndarray, ring: np.ndarray, density: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(n, 3): each point replaced by the weighted mean of itself and its ring.

    Fills variance (n,): what one such step adds to the width of a shape, in each of the surface's two directions.
    """
    smoothed = np.empty_like(points)
    for node in range(len(points)):
        x, y, z, total, spread = points[node, 0], points[node, 1], points[node, 2], 1.0, 0.0
        for place in range(8):
            other = ring[node, place]
            if other < 0:
                continue
            square = 0.0
            for axis in range(3):
                square += (points[other, axis] - points[node, axis]) ** 2
            weight = np.exp(-0.5 * square / density[node] ** 2)
            x, y, z = x + weight * points[other, 0], y + weight * points[other, 1], z + weight * points[other, 2]
            total, spread = total + weight, spread + weight * square
        variance[node] = 0.5 * spread / total
        smoothed[node, 0], smoothed[node, 1], smoothed[node, 2] = x / total, y / total, z / total
    return smoothed


REACH: Final = np.sqrt(2.0) * (CELLS + 1) / CELLS
"""Distance of the depth map's corners, relative to the half width of its cells."""


class Scale(StrEnum):
    """What determines the width of the depth map."""

    FIXED = "fixed"
    INTRINSIC = "intrinsic"  # by the scale at which the shape around the node stands out


class Angle(StrEnum):
    """What determines which way the depth map is upright."""

    SLOPES = "slopes"  # the longer principal axis of its gradients
    OUTLINE = "outline"  # the longer principal axis of the area that the surface covers, as along a limb
    PEAK = "peak"  # of the histogram of its gradients, as in SIFT


class Beyond(StrEnum):
    """What the depth map holds where there is no surface."""

    UNKNOWN = "unknown"  # no gradient: the end of the camera's view is not part of the shape
    FLOOR = "floor"  # a plane floor_m below the node, so that the outline is an edge


@settings
class LdSiftConfig:
    """What LD-SIFT describes."""

    radius_m: Positive = 0.15  # half the width of the 4 x 4 cells; wider distinguishes more, and costs more
    scale: Scale = Scale.FIXED
    angle: Angle = Angle.OUTLINE
    beyond: Beyond = Beyond.UNKNOWN
    floor_m: Positive = 0.05
    samples: Count = 6  # pixels of the depth map on a cell's side; fewer miss an arm seen from the side
    levels: Annotated[int, Field(ge=3)] = 20  # of smoothing, for the intrinsic scale
    width: Positive = 6.0  # half width over the intrinsic scale's sigma
    max_radius_m: Positive = 0.25  # of the intrinsic scale: beyond it, every node would see the whole body


def ld_sift(surface: Surface, config: LdSiftConfig | None = None, chosen: np.ndarray | None = None) -> np.ndarray:
    """(k, 128) float32, unit length, none below 0; a row for each chosen node (k,) int; None: for all n.

    A row is NaN where the node has no position, normal or triangle, and where no gradient of its depth map is known:
    it is flat to the last bit, or covered nowhere two pixels wide.

    The triangles within reach along the edges are seen from above the node's tangent plane; the map is turned upright
    by its dominant angle and described by SIFT. By default, pixels that no triangle covers are unknown and have no
    gradient, so that the end of the camera's view is not an edge. The authors describe detected points of closed meshes
    at their scale; here every node is described, and by default at one scale.
    """
    config = config or LdSiftConfig()
    chosen = np.arange(len(surface)) if chosen is None else np.asarray(chosen, np.int64)
    half = half_widths(surface, config)[chosen]
    rings = rings_within(surface, half * REACH, chosen)
    start, others = _fans(faces(surface), len(surface))
    floor = -config.floor_m if config.beyond == Beyond.FLOOR else np.nan
    mesh = _Mesh(surface.points_m, surface.normals, start, others)
    shares = cell_shares(config.samples)
    view = _View(1 if config.angle == Angle.OUTLINE else 3, config.angle == Angle.PEAK, floor, config.samples, shares)
    return _describe_all(mesh, chosen, half, rings, view)


def half_widths(surface: Surface, config: LdSiftConfig) -> np.ndarray:
    """(n,) float64: half the width of the 4 x 4 cells of every node, metres; NaN where it has no scale."""
    if config.scale == Scale.FIXED:
        return np.full(len(surface), config.radius_m)
    return np.minimum(config.width * intrinsic_scale(surface, config.levels)[0].astype(np.float64), config.max_radius_m)


def _fans(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """start (n + 1,) int64, others (f, 2) int32: each triangle once, listed at its first node."""
    order = np.argsort(triangles[:, 0], kind="stable")
    start = np.searchsorted(triangles[order, 0], np.arange(count + 1))
    return start.astype(np.int64), np.ascontiguousarray(triangles[order, 1:])


class _Mesh(NamedTuple):
    """A surface; the triangles of ``_fans``."""

    points: np.ndarray
    normals: np.ndarray
    fan_start: np.ndarray
    fan: np.ndarray


class _View(NamedTuple):
    """column: as in ``principal_angle``; peak: whether ``Angle.PEAK``; floor: its height in metres, NaN for none;
    samples and shares of ``cell_shares``."""

    column: int
    peak: bool
    floor: float
    samples: int
    shares: np.ndarray


@njit(cache=True)
def _describe_all(mesh: _Mesh, chosen: np.ndarray, half: np.ndarray, rings: Rings, view: _View) -> np.ndarray:
    descriptors = np.full((len(chosen), WIDTH), np.nan, np.float32)
    start, fans, longest = rings.start, len(mesh.fan), 0
    for k in range(len(chosen)):
        longest = max(longest, start[k + 1] - start[k])
    place, frame, polar = np.full(len(mesh.points), -1, np.int64), np.empty((3, 3)), np.empty(DIRECTIONS)
    local, triangles, slopes = np.empty((longest, 3)), np.empty((fans, 3), np.int64), np.empty((fans, 5))
    image = np.empty((len(view.shares), len(view.shares)))
    for k in range(len(chosen)):
        if not tangent_frame(mesh.normals[chosen[k]], frame):
            continue
        near = rings.node[start[k] : start[k + 1]]
        _to_local(mesh.points, chosen[k], near, frame, local)
        count = _gather(near, place, mesh, triangles)
        triangle_slopes(local, triangles, count, half[k], slopes)
        turn = principal_angle(slopes, count, view.column)
        if view.peak:
            turn = gradient_angle(slopes, count, turn, polar)
        if np.isfinite(turn):
            pixel = 2.0 * half[k] / (CELLS * view.samples)
            draw_depth_map(local[: len(near)], triangles, count, turn * FULL_TURN, pixel, view.floor, image)
            describe_image(image, view.shares, descriptors[k])
    return descriptors


@njit(cache=True)
def _to_local(points: np.ndarray, node: int, near: np.ndarray, frame: np.ndarray, local: np.ndarray) -> None:
    """Fill local with the neighbours' positions in the node's frame."""
    for c in range(len(near)):
        for row in range(3):
            local[c, row] = 0.0
            for axis in range(3):
                away = np.float64(points[near[c], axis]) - np.float64(points[node, axis])
                local[c, row] += frame[row, axis] * away


@njit(cache=True)
def _gather(near: np.ndarray, place: np.ndarray, mesh: _Mesh, triangles: np.ndarray) -> int:
    """Fill triangles with those whose three nodes are all near, as indices into near; return their number.

    place (n,): -1 everywhere, before and after.
    """
    count = 0
    for c in range(len(near)):
        place[near[c]] = c
    for c in range(len(near)):
        for spot in range(mesh.fan_start[near[c]], mesh.fan_start[near[c] + 1]):
            b, d = place[mesh.fan[spot, 0]], place[mesh.fan[spot, 1]]
            if b >= 0 and d >= 0:
                triangles[count, 0], triangles[count, 1], triangles[count, 2] = c, b, d
                count += 1
    for c in range(len(near)):
        place[near[c]] = -1
    return count
