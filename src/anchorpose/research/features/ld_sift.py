"""Compute LD-SIFT, the SIFT descriptor of a depth map around each node.

Source: Darom and Keller 2012 (doi:10.1109/TIP.2012.2183142).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.research.features.circle import FULL_TURN
from anchorpose.research.features.depth_map import (
    CELLS,
    WIDTH,
    cell_shares,
    describe_image,
    draw_depth_map,
    outline_angle,
    triangle_slopes,
)
from anchorpose.research.features.mesh_gradient import tangent_frame
from anchorpose.research.features.rings import Rings, rings_within
from anchorpose.settings import Count, Positive, settings
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface

REACH: Final = np.sqrt(2.0) * (CELLS + 1) / CELLS
"""Distance from the middle of the depth map to its corners, as a multiple of half the width of four cells."""


class Beyond(StrEnum):
    """The value of the depth map at pixels without surface."""

    # pixels without surface are NaN, so they have no gradient, and the end of the camera's view does not count as part
    # of the shape
    UNKNOWN = "unknown"
    FLOOR = "floor"  # a plane floor_m below the node, so that the surface's outline is an edge


@settings
class LdSiftConfig:
    """Settings of LD-SIFT."""

    # m, half the width of the 4 x 4 cells; with a larger width, more places are distinguished, but computing is slow
    radius_m: Positive = 0.15
    beyond: Beyond = Beyond.UNKNOWN
    floor_m: Positive = 0.05  # m, distance of the plane of ``Beyond.FLOOR`` below the node
    samples: Count = 6  # number of pixels on a cell's side; fewer pixels would miss an arm seen from the side


def ld_sift(surface: Surface, config: LdSiftConfig | None = None) -> np.ndarray:
    """Return the descriptors (n, 128) float32, of unit length, with no value below 0.

    A row is NaN if the node has no position, normal or triangle, or if its depth map has no known gradient: the map is
    exactly flat, or its surface is nowhere two pixels wide.

    The depth map shows the triangles whose nodes are within ``REACH * radius_m`` along the edges, seen along the node's
    normal. The map is turned so that the longer principal axis of the area that the surface covers, such as a limb's
    direction, always has the same direction in the image. SIFT then describes the turned map. By default, pixels that
    no triangle covers are unknown and have no gradient, so that the end of the camera's view is not an edge. The
    authors compute descriptors only at detected points of closed meshes, at the scale of each point and turned by the
    gradients around it. This function computes a descriptor for every node, always at the same scale.
    """
    config = config or LdSiftConfig()
    rings = rings_within(surface, config.radius_m * REACH)
    start, others = _fans(faces(surface), len(surface))
    floor = -config.floor_m if config.beyond == Beyond.FLOOR else np.nan
    mesh = _Mesh(surface.points_m, surface.normals, start, others)
    view = _View(config.radius_m, floor, config.samples, cell_shares(config.samples))
    return _describe_all(mesh, rings, view)


def _fans(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """List each triangle at its first node.

    Return the index of each node's first triangle in the list (n + 1,) int64, and the other two nodes of each triangle
    (f, 2) int32.
    """
    order = np.argsort(triangles[:, 0], kind="stable")
    start = np.searchsorted(triangles[order, 0], np.arange(count + 1))
    return start.astype(np.int64), np.ascontiguousarray(triangles[order, 1:])


class _Mesh(NamedTuple):
    """The positions and normals of a surface, and its triangles as listed by ``_fans``."""

    points: np.ndarray
    normals: np.ndarray
    fan_start: np.ndarray
    fan: np.ndarray


class _View(NamedTuple):
    """The settings of the depth map in the form that compiled functions take."""

    half: float  # m, half the width of the four cells in a row
    floor: float  # m, height of the floor; NaN without a floor
    samples: int  # pixels on a cell's side
    shares: np.ndarray  # result of ``cell_shares``


@njit(cache=True)
def _describe_all(mesh: _Mesh, rings: Rings, view: _View) -> np.ndarray:
    count_of_nodes = len(mesh.points)
    descriptors = np.full((count_of_nodes, WIDTH), np.nan, np.float32)
    start, fans, longest = rings.start, len(mesh.fan), 0
    for node in range(count_of_nodes):
        longest = max(longest, start[node + 1] - start[node])
    place, frame = np.full(count_of_nodes, -1, np.int64), np.empty((3, 3))
    local, triangles, slopes = np.empty((longest, 3)), np.empty((fans, 3), np.int64), np.empty((fans, 5))
    image = np.empty((len(view.shares), len(view.shares)))
    pixel = 2.0 * view.half / (CELLS * view.samples)
    for node in range(count_of_nodes):
        if not tangent_frame(mesh.normals[node], frame):
            continue
        near = rings.node[start[node] : start[node + 1]]
        _to_local(mesh.points, node, near, frame, local)
        count = _gather(near, place, mesh, triangles)
        triangle_slopes(local, triangles, count, view.half, slopes)
        turn = outline_angle(slopes, count)
        if np.isfinite(turn):
            draw_depth_map(local[: len(near)], triangles, count, turn * FULL_TURN, pixel, view.floor, image)
            describe_image(image, view.shares, descriptors[node])
    return descriptors


@njit(cache=True)
def _to_local(points: np.ndarray, node: int, near: np.ndarray, frame: np.ndarray, local: np.ndarray) -> None:
    """Fill ``local`` with the positions of the nodes ``near`` in the local frame of ``node``."""
    for c in range(len(near)):
        for row in range(3):
            local[c, row] = 0.0
            for axis in range(3):
                away = np.float64(points[near[c], axis]) - np.float64(points[node, axis])
                local[c, row] += frame[row, axis] * away


@njit(cache=True)
def _gather(near: np.ndarray, place: np.ndarray, mesh: _Mesh, triangles: np.ndarray) -> int:
    """Fill ``triangles`` with the triangles whose three nodes are all near, as indices into near; return their number.

    place (n,) is working memory; it is -1 everywhere, before and after the call.
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
