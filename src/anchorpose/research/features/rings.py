"""Find the neighbourhood of a node on the surface: nodes that edges and links connect with it within some distance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from anchorpose.research.features.neighbours import longer
from anchorpose.surface.surface import Surface


class Rings(NamedTuple):
    """The nodes around each node, one row per node."""

    start: np.ndarray  # (n + 1,) int64, index in ``node`` at which each row begins
    node: np.ndarray  # (m,) int32, numbers of the nodes; each row begins with the node around which the others lie
    distance_m: np.ndarray  # (m,) float32, distance of these nodes along the edges
    reach_m: np.ndarray  # (n,) float64, distance up to which each row was searched


def rings_within(surface: Surface, reach_m: float | np.ndarray) -> Rings:
    """Return, for each node, all nodes to which edges and links lead within reach_m.

    reach_m: largest length in metres of the path along edges and links to a neighbour; one value for all nodes, or
    (n,). A node's row is empty if its reach is NaN or it has no position. A node that is near but not connected (an arm
    in front of the trunk) is not a neighbour. Raises ValueError for a reach that is not positive.
    """
    reach = np.broadcast_to(np.asarray(reach_m, np.float64), (len(surface),)).copy()
    if (reach <= 0).any():
        raise ValueError(f"a reach must be positive, got {reach.min()} m")
    points = surface.points_m
    edges = _Edges(
        surface.ring, _edge_lengths(points, surface.ring), surface.link_start, surface.link_node, surface.link_length_m
    )
    reach_of = np.where(np.isfinite(points.sum(axis=1)), reach, np.nan)
    return Rings(*_search(edges, reach_of), reach)


class _Edges(NamedTuple):
    """The edges of a surface with their lengths in metres: edges of the pixel grid (n, 8), and links (edges outside the
    grid).
    """

    ring: np.ndarray
    length_m: np.ndarray
    link_start: np.ndarray
    link_node: np.ndarray
    link_length_m: np.ndarray


@njit(cache=True)
def _search(edges: _Edges, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays start, node and distance of ``Rings``; a row stays empty if its reach is NaN."""
    count = len(edges.ring)
    best, waits = np.full(count, np.inf, np.float32), np.zeros(count, np.bool_)
    queue = np.empty(max(count, 1), np.int32)
    start = np.zeros(count + 1, np.int64)
    node, distance = np.empty(65 * count, np.int32), np.empty(65 * count, np.float32)
    end = 0
    for k in range(count):
        first, limit = end, np.float32(reach[k])
        if end + count > len(node):
            node, distance = longer(node, count), longer(distance, count)
        if limit > 0:
            best[k], node[end] = 0.0, k
            end = _spread(edges, limit, best, queue, waits, node, end + 1)
        for spot in range(first, end):
            distance[spot] = best[node[spot]]
            best[node[spot]] = np.inf
        start[k + 1] = end
    return start, node[:end].copy(), distance[:end].copy()


@njit(cache=True)
def _spread(
    edges: _Edges, limit: np.float32, best: np.ndarray, queue: np.ndarray, waits: np.ndarray, node: np.ndarray, end: int
) -> int:
    """Find the nodes within ``limit`` metres of node[end - 1]. Append them to ``node``, write their distances to
    ``best``, and return the new number of entries of ``node``.

    Nodes to visit wait in a circular queue. A node is queued again if a shorter path is found, so no heap is needed.
    """
    count, head, size = len(best), 0, 1
    queue[0] = node[end - 1]
    while size > 0:
        here = queue[head]
        head, size, waits[here] = (head + 1) % count, size - 1, False
        links = edges.link_start[here + 1] - edges.link_start[here]
        for place in range(8 + links):
            if place < 8:
                other, onward = edges.ring[here, place], best[here] + edges.length_m[here, place]
            else:
                spot = edges.link_start[here] + place - 8
                other, onward = edges.link_node[spot], best[here] + edges.link_length_m[spot]
            if other < 0 or not (onward <= limit and onward < best[other]):
                continue
            if best[other] == np.inf:
                node[end] = other
                end += 1
            best[other] = onward
            if not waits[other]:
                queue[(head + size) % count] = other
                size, waits[other] = size + 1, True
    return end


@njit(cache=True)
def _edge_lengths(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the edge lengths (n, 8) float32, metres; NaN if either end has no position."""
    length = np.zeros(ring.shape, np.float32)
    for here in range(len(ring)):
        for place in range(8):
            other = ring[here, place]
            if other >= 0:
                square = 0.0
                for axis in range(3):
                    square += (np.float64(points[other, axis]) - np.float64(points[here, axis])) ** 2
                length[here, place] = np.sqrt(square)
    return length
