"""Find the last piece of the shortest path from a source to each node, given the distances of all nodes from the
source, which any solver may have computed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", inline="always")
def came_from(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    distance: np.ndarray,
    node: int,
) -> tuple[int, int, float]:
    """Return the point from which the shortest path reaches a node, as two nodes a, b and a share: the point (1 -
    share) a + share b on an edge between two of the node's neighbours, or a single neighbour (a = b). Both nodes are -1
    if no neighbour is nearer to the source.

    points (n, 3 or more) float32: the places in the first columns; ring, link_start, link_node and link_length: fields
    of ``MeshArrays``, passed separately to save time, since this function is called for every node; distance (n,)
    float32: the distance of each node from the source.
    """
    one: Any
    other: Any
    best, share = np.inf, 0.0
    # these node numbers are int64 from the start, so that the functions called with them are compiled for a single type
    one, other = np.int64(-1), np.int64(-1)
    for k in range(8):
        a, b = np.int64(ring[node, k]), np.int64(ring[node, (k + 1) % 8])
        if b < 0 and _across(ring, node, k):
            b = np.int64(ring[node, (k + 2) % 8])
        if a >= 0 and distance[a] < distance[node]:
            reached = distance[a] + apart(points, node, a)
            if reached < best:
                best, one, other, share = reached, a, a, 0.0
        if a >= 0 and b >= 0 and distance[a] < distance[node] and distance[b] < distance[node]:
            reached, crossing = unfolded(points, distance, node, a, b)
            if reached < best:
                best, one, other, share = reached, a, b, crossing
    for k in range(link_start[node], link_start[node + 1]):
        a = np.int64(link_node[k])
        if distance[a] < distance[node]:
            reached = distance[a] + link_length[k]
            if reached < best:
                best, one, other, share = reached, a, a, 0.0
    return one, other, share


@njit(cache=True, error_model="numpy")
def unfolded(points: np.ndarray, distance: np.ndarray, node: int, a: Any, b: Any) -> tuple[float, float]:
    """Return the distance of a node from the source by a path across the edge a-b, with the triangle of a, b and the
    node laid flat. Also return where the path crosses the edge, as a share of the way from a to b. The distance is inf
    if the path misses the edge.
    """
    c2, p2, dot = 0.0, 0.0, 0.0
    for axis in range(3):
        edge = np.float64(points[b, axis]) - points[a, axis]
        arm = np.float64(points[node, axis]) - points[a, axis]
        c2 += edge * edge
        p2 += arm * arm
        dot += edge * arm
    if c2 <= 0.0:
        return np.inf, 0.0
    c = np.sqrt(c2)
    node_x = dot / c
    node_y = np.sqrt(max(p2 - node_x * node_x, 0.0))
    d_a, d_b = np.float64(distance[a]), np.float64(distance[b])
    source_x = (d_a * d_a - d_b * d_b + c2) / (2.0 * c)
    source_y = np.sqrt(max(d_a * d_a - source_x * source_x, 0.0))
    if source_y + node_y <= 0.0:
        return np.inf, 0.0
    crossing = (source_x + (node_x - source_x) * source_y / (source_y + node_y)) / c
    if crossing < 0.0 or crossing > 1.0:
        return np.inf, 0.0
    return np.sqrt((node_x - source_x) ** 2 + (node_y + source_y) ** 2), crossing


@njit(cache=True, error_model="numpy")
def apart(points: np.ndarray, a: Any, b: Any) -> float:
    """Return the straight-line distance between two nodes."""
    total = 0.0
    for axis in range(3):
        total += (np.float64(points[a, axis]) - points[b, axis]) ** 2
    return np.sqrt(total)


@njit(cache=True, error_model="numpy", inline="always")
def adjoin(ring: np.ndarray, node: Any, other: int) -> bool:
    """Return whether two nodes are neighbours on the grid."""
    for k in range(8):  # noqa: SIM110
        if ring[node, k] == other:
            return True
    return False


@njit(cache=True, error_model="numpy", inline="always")
def is_bare(ring: np.ndarray, node: int, other: int) -> bool:
    """Return whether the edge from ``node`` to its neighbour ``other`` belongs to no triangle."""
    for k in range(8):
        if ring[node, k] == other:
            # a node next to both ``node`` and ``other`` is one or two places from ``other`` in the ring of ``node``
            for way in (1, 2, 6, 7):
                third = np.int64(ring[node, (k + way) % 8])
                if third >= 0 and adjoin(ring, third, other):
                    return False
            return True
    return False


@njit(cache=True, error_model="numpy")
def open_nodes(ring: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Return (n,) bool: rim nodes that are open, that is, whose triangles do not surround them completely. A missing
    diagonal neighbour leaves no gap if the two neighbours beside it form a triangle with the node.
    """
    is_open = np.zeros(len(ring), np.bool_)
    for node in range(len(ring)):
        if rim[node]:
            for k in range(8):
                if ring[node, k] < 0 and not _across(ring, node, (k + 7) % 8):
                    is_open[node] = True
    return is_open


@njit(cache=True, error_model="numpy")
def _across(ring: np.ndarray, node: int, k: int) -> bool:
    """Return whether the two neighbours beside a missing diagonal neighbour are neighbours of each other: then they
    form a triangle with the node.
    """
    if k % 2 == 1 or ring[node, k] < 0 or ring[node, (k + 2) % 8] < 0 or ring[node, (k + 1) % 8] >= 0:
        return False
    return ring[ring[node, k], (k + 3) % 8] == ring[node, (k + 2) % 8]


@njit(cache=True, error_model="numpy")
def by_distance(distance: np.ndarray) -> np.ndarray:
    """Return the nodes with a finite distance, sorted by distance, the nearest first; the algorithm is a bucket sort
    with as many buckets as nodes.
    """
    farthest, count = 0.0, 0
    for value in distance:
        if np.isfinite(value):
            farthest = max(farthest, np.float64(value))
            count += 1
    order = np.empty(count, np.int32)
    scale = count / max(farthest, 1e-9)
    start = np.zeros(count + 3, np.int32)
    for value in distance:
        if np.isfinite(value):
            start[int(value * scale) + 2] += 1
    for k in range(1, len(start)):
        start[k] += start[k - 1]
    for node in range(len(distance)):
        if np.isfinite(distance[node]):
            place = int(distance[node] * scale) + 1
            order[start[place]] = node
            start[place] += 1
    for k in range(1, count):
        node = order[k]
        spot = k
        while spot > 0 and distance[order[spot - 1]] > distance[node]:
            order[spot] = order[spot - 1]
            spot -= 1
        order[spot] = node
    return order
