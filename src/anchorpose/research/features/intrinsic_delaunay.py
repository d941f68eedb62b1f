"""Edge lengths of triangles, flipped until no edge has obtuse angles against it: an intrinsic Delaunay triangulation.

Depth meshes have slivers along their outline, whose cotangents are hugely negative, and heat would flow from cold to
warm there. Flipping edges within the surface, lengths only, changes no distance on it and leaves no negative weight.
An outline has triangles on one side only; so each triangle is there twice, front and back, and the two sheets hang
together along the outline, where a mirror is what Neumann's condition asks for. Edges of three triangles and more are
glued the same way, each to the next.
Sources: Bobenko and Springborn 2007 (doi:10.1007/s00454-007-9006-1), the flips; Sharp and Crane 2020
(doi:10.1111/cgf.14069), both sides of each triangle and the lengthening of edges by a trifle.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TRIFLE = 1e-5
"""Of the mean edge: by so much at least two sides of every triangle are longer than the third."""
FLIPS_PER_EDGE = 50  # far more than any mesh needs: flips end by themselves, but for rounding
TOLERANCE = 1e-9  # of a cotangent


def intrinsic_delaunay(points_m: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weight of each half-edge and the area on either half of it, on the triangulation after all flips.

    points_m (n, 3) float64 metres, triangles (f, 3) int of finite points, sides of any orientation. Returns
    edges (6 f, 2) int32, tail and head node, which are the same where an edge was flipped across the outline;
    values (6 f, 2) float64: half the cotangent of the angle opposite, and what of the triangle's area in m² lies at
    this edge and is nearest to its tail, which equals that nearest to its head. Each triangle counts twice, as front
    and as back.
    """
    tail, after, twin = _both_sides(np.asarray(triangles, np.int64))
    apart = points_m[tail] - points_m[tail[after]]
    length = np.sqrt((apart**2).sum(axis=1))
    if len(length):
        slack = length[after] + length[after[after]] - length
        length = length + max(TRIFLE * length.mean() - slack.min(), 0.0)
        _flip_all(tail, after, twin, length)
    edges = np.stack([tail, tail[after]], axis=1).astype(np.int32)
    return edges, _weights(after, length)


def _both_sides(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """tail (h,) node, after (h,) the next half-edge around its triangle, twin (h,) the one it is glued to; h = 6 f."""
    corners = np.concatenate([triangles, triangles[:, [0, 2, 1]]])
    tail = corners.ravel()
    half = np.arange(len(tail)).reshape(-1, 3)
    after = np.roll(half, -1, axis=1).ravel()
    head, face = tail[after], np.tile(np.repeat(np.arange(len(triangles)), 3), 2)
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = np.lexsort([face, high, low, tail > head])
    up, down = order[: len(order) // 2], order[len(order) // 2 :]  # the same edge and triangle in the same row
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
    """Flip in place until every edge is Delaunay; returns how many flips that took."""
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
    """Distance between the two corners off an edge, both triangles laid flat."""
    base = length[h]
    beside, from_j, from_i = 2.0 * _area(h, after, length) / base, length[after[h]], length[after[after[h]]]
    along = (base * base + from_i * from_i - from_j * from_j) / (2.0 * base)
    below, from_i, from_j = 2.0 * _area(g, after, length) / base, length[after[g]], length[after[after[g]]]
    along -= (base * base + from_i * from_i - from_j * from_j) / (2.0 * base)
    return np.sqrt(along * along + (beside + below) ** 2)


@njit(cache=True)
def _area(h: int, after: np.ndarray, length: np.ndarray) -> float:
    """Of the half-edge's triangle, by Heron's formula in the order of Kahan, which slivers do not upset."""
    a, b, c = length[h], length[after[h]], length[after[after[h]]]
    long, short = max(a, b, c), min(a, b, c)
    mid = max(min(a, b), min(max(a, b), c))
    square = (long + (mid + short)) * (short - (long - mid)) * (short + (long - mid)) * (long + (mid - short))
    return 0.25 * np.sqrt(max(square, 0.0))


@njit(cache=True)
def _cotangent(h: int, after: np.ndarray, length: np.ndarray) -> float:
    """Of the angle opposite the half-edge."""
    a, b, c = length[h], length[after[h]], length[after[after[h]]]
    return (b * b + c * c - a * a) / max(4.0 * _area(h, after, length), 1e-300)


@njit(cache=True)
def _weights(after: np.ndarray, length: np.ndarray) -> np.ndarray:
    values = np.empty((len(after), 2))
    for h in range(len(after)):
        values[h, 0] = 0.5 * _cotangent(h, after, length)
        values[h, 1] = 0.25 * values[h, 0] * length[h] ** 2
    return values
