"""Compute the Laplace-Beltrami operator of a surface's triangles, on their intrinsic Delaunay triangulation.

Depth meshes have slivers (very thin triangles) along their outline. The cotangents of their obtuse angles are strongly
negative, so heat would, according to the operator, flow from cold nodes to warm nodes. Therefore edges are flipped
within the surface: the edge between two triangles is replaced by the other diagonal of their quadrilateral. Flipping
needs only the lengths of edges, changes no distance on the surface and leaves no negative weight. Outline edges have a
triangle on one side only. Therefore each triangle exists twice, as front and as back. Front and back are glued along
the outline, where this mirror image satisfies Neumann's condition (no heat flows across the outline). If an edge has
three or more triangles, each triangle is glued to the next in the same way. Sources: Bobenko and Springborn 2007
(doi:10.1007/s00454-007-9006-1), the flips; Sharp and Crane 2020 (doi:10.1111/cgf.14069), both sides of each triangle
and the slight lengthening of edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import connected_components

from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface

# minimum excess of the sum of two sides of a triangle over the third side, as a share of the mean edge length
MIN_SLACK: Final = 1e-5
FLIPS_PER_EDGE: Final = 50  # maximum flips per half-edge, more than any mesh needs; rounding might cause endless flips
# rounding error of the sum of two cotangents; an edge is flipped only if the sum of its two cotangents is less than
# minus this value
TOLERANCE: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Laplacian:
    """The Laplace-Beltrami operator on those nodes of a surface that belong to a triangle."""

    node: np.ndarray  # (v,) int32, numbers of these nodes on the surface; all other arrays are in this order
    # (v, v) float64, sparse, cotangent weights: symmetric, positive semidefinite, no positive entry off the diagonal
    stiffness: csc_array
    # (v,) float64, area that is nearer to the node than to all other nodes (Voronoi); unlike a third of each triangle's
    # area, it does not depend on which diagonal divides a square
    mass_m2: np.ndarray
    piece: np.ndarray  # (v,) int32, number of the node's connected component; triangles with a common corner connect


def surface_laplacian(surface: Surface) -> Laplacian:
    """Return cotangent weights and lumped mass on the intrinsic Delaunay triangulation, with Neumann's condition.

    Links (edges without triangles) conduct no heat. Triangles with a node whose position is not finite are left out.
    """
    triangles = faces(surface)
    return mesh_laplacian(surface.points_m, triangles[np.isfinite(surface.points_m).all(axis=1)[triangles].all(axis=1)])


def mesh_laplacian(points_m: np.ndarray, triangles: np.ndarray) -> Laplacian:
    """Return the operator of ``surface_laplacian`` for any triangles (f, 3) int of points (n, 3) in metres.

    An edge may belong to three or more triangles.
    """
    node, own = np.unique(triangles, return_inverse=True)
    count = len(node)
    edges, values = intrinsic_delaunay(np.asarray(points_m, np.float64)[node], own.reshape(-1, 3))
    tail, head = edges.T
    weight = np.where(tail == head, 0.0, values[:, 0] / 2.0)  # halved, since each triangle has a front and a back
    off = coo_array((np.tile(-weight, 2), (np.append(tail, head), np.append(head, tail))), shape=(count, count)).tocsc()
    diagonal = np.bincount(np.append(tail, head), np.tile(weight, 2), count)
    stiffness = (off + coo_array((diagonal, (np.arange(count), np.arange(count))), shape=(count, count))).tocsc()
    mass_m2 = np.bincount(np.append(tail, head), np.tile(values[:, 1] / 2.0, 2), count)
    piece = connected_components(coo_array((np.ones(len(tail), np.int8), (tail, head)), shape=(count, count)), False)[1]
    return Laplacian(node.astype(np.int32), csc_array(stiffness), mass_m2, piece.astype(np.int32))


def intrinsic_delaunay(points_m: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a cotangent weight and an area for each half-edge, on the triangulation after all flips.

    points_m (n, 3) float64 metres; triangles (f, 3) int of finite points, with any orientation. Returns edges (6 f, 2)
    int32 and values (6 f, 2) float64. An edge is its tail and head node, which are the same if the edge was flipped
    across the outline. The two values of an edge are half the cotangent of the opposite angle, and the area, m², of the
    part of the triangle beside this edge that is nearest to the tail; the part nearest to the head is as large. Each
    triangle counts twice, as front and as back.
    """
    tail, after, twin = _both_sides(np.asarray(triangles, np.int64))
    apart = points_m[tail] - points_m[tail[after]]
    length = np.sqrt((apart**2).sum(axis=1))
    if len(length):
        slack = length[after] + length[after[after]] - length
        length = length + max(MIN_SLACK * length.mean() - slack.min(), 0.0)
        _flip_all(tail, after, twin, length)
    edges = np.stack([tail, tail[after]], axis=1).astype(np.int32)
    return edges, _weights(after, length)


def _both_sides(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three arrays (h,), h = 6 f, with one value per half-edge (a side of one triangle, with a direction).

    tail: the half-edge's first node. after: the next half-edge of the same triangle. twin: the opposite half-edge (same
    two nodes, other direction), in the triangle to which this side is glued.
    """
    corners = np.concatenate([triangles, triangles[:, [0, 2, 1]]])
    tail = corners.ravel()
    half = np.arange(len(tail)).reshape(-1, 3)
    after = np.roll(half, -1, axis=1).ravel()
    head, face = tail[after], np.tile(np.repeat(np.arange(len(triangles)), 3), 2)
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = np.lexsort([face, high, low, tail > head])
    up, down = order[: len(order) // 2], order[len(order) // 2 :]  # up[i], down[i]: front and back of a triangle's side
    first = np.ones(len(up), bool)
    first[1:] = (low[up[1:]] != low[up[:-1]]) | (high[up[1:]] != high[up[:-1]])
    start = np.flatnonzero(first)
    follower = np.arange(1, len(up) + 1)
    follower[np.append(start[1:], len(up)) - 1 if len(up) else start] = start
    twin = np.empty(len(tail), np.int64)
    twin[up], twin[down[follower]] = down[follower], up
    return tail, after, twin


@njit(cache=True)
def _flip_all(tail: np.ndarray, after: np.ndarray, twin: np.ndarray, length: np.ndarray) -> int:
    """Flip edges in place until every edge is Delaunay (its two opposite angles sum to at most half a turn).

    Return the number of flips, which is at most ``FLIPS_PER_EDGE`` per half-edge.
    """
    waiting, queued = np.arange(len(tail)), np.ones(len(tail), np.bool_)
    first, size, flips = 0, len(tail), 0
    while size > 0 and flips < FLIPS_PER_EDGE * len(tail):
        h = waiting[first]
        first, size = (first + 1) % len(tail), size - 1
        queued[h] = False
        g = twin[h]
        if _cotangent(h, after, length) + _cotangent(g, after, length) >= -TOLERANCE or after[h] == g or after[g] == h:
            continue
        length[h] = length[g] = _other_diagonal(h, g, after, length)
        to_k, to_i, to_m, to_j = after[h], after[after[h]], after[g], after[after[g]]
        tail[h], tail[g] = tail[to_i], tail[to_j]
        after[h], after[to_j], after[to_k] = to_j, to_k, h
        after[g], after[to_i], after[to_m] = to_i, to_m, g
        flips += 1
        for side in (to_k, to_i, to_m, to_j):
            if not queued[side] and not queued[twin[side]]:
                queued[side] = True
                waiting[(first + size) % len(tail)] = side
                size += 1
    return flips


@njit(cache=True)
def _other_diagonal(h: int, g: int, after: np.ndarray, length: np.ndarray) -> float:
    """Return the distance between the two corners opposite an edge when both triangles are laid in one plane."""
    base = length[h]
    beside, from_j, from_i = 2.0 * _area(h, after, length) / base, length[after[h]], length[after[after[h]]]
    along = (base * base + from_i * from_i - from_j * from_j) / (2.0 * base)
    below, from_i, from_j = 2.0 * _area(g, after, length) / base, length[after[g]], length[after[after[g]]]
    along -= (base * base + from_i * from_i - from_j * from_j) / (2.0 * base)
    return np.sqrt(along * along + (beside + below) ** 2)


@njit(cache=True)
def _area(h: int, after: np.ndarray, length: np.ndarray) -> float:
    """Return the area of the half-edge's triangle by Heron's formula in Kahan's order, which is accurate for
    slivers.
    """
    a, b, c = length[h], length[after[h]], length[after[after[h]]]
    long, short = max(a, b, c), min(a, b, c)
    mid = max(min(a, b), min(max(a, b), c))
    square = (long + (mid + short)) * (short - (long - mid)) * (short + (long - mid)) * (long + (mid - short))
    return 0.25 * np.sqrt(max(square, 0.0))


@njit(cache=True)
def _cotangent(h: int, after: np.ndarray, length: np.ndarray) -> float:
    """Return the cotangent of the angle opposite the half-edge."""
    a, b, c = length[h], length[after[h]], length[after[after[h]]]
    return (b * b + c * c - a * a) / max(4.0 * _area(h, after, length), 1e-300)


@njit(cache=True)
def _weights(after: np.ndarray, length: np.ndarray) -> np.ndarray:
    values = np.empty((len(after), 2))
    for h in range(len(after)):
        values[h, 0] = 0.5 * _cotangent(h, after, length)
        values[h, 1] = 0.25 * values[h, 0] * length[h] ** 2
    return values
