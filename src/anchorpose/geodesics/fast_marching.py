"""Geodesic distance on the organised surface by fast marching with unfolding.

A front leaves the source and fixes the nodes in the order of distance. A node takes its distance from the triangle of
two fixed neighbours by laying both and their distances flat, which is exact where the surface is flat; across a link
between cameras or a bridged gap it takes the straight edge.
Source: Kimmel and Sethian 1998 (doi:10.1073/pnas.95.15.8431), with the point-source update of Novotni and Klein 2002.
"""

from __future__ import annotations

import numpy as np
from numba import njit


def march(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    sources: np.ndarray,
    max_distance: float,
) -> np.ndarray:
    """(s, n) float32: one field a source; inf where it does not reach, or beyond ``max_distance``.

    points (n, 3) float32, finite; ring, link_start, link_node, link_length as in ``Surface``; sources (s,) int32, nodes. Nothing is
    checked here: ``distance.geodesic_distance`` is the way in.
    """
    fields = np.empty((len(sources), len(points)), np.float32)
    for row in range(len(sources)):
        fields[row] = _march(points, ring, link_start, link_node, link_length, sources[row : row + 1], np.float64(max_distance))
    return fields


def march_from_set(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    sources: np.ndarray,
    max_distance: float,
) -> np.ndarray:
    """(n,) float32: the front leaves all sources at once; else as ``march``."""
    field = _march(points, ring, link_start, link_node, link_length, sources, np.float64(max_distance))
    return field.astype(np.float32)


@njit(cache=True)
def _march(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    sources: np.ndarray,
    max_distance: float,
) -> np.ndarray:
    count = len(points)
    distance = np.full(count, np.inf)
    fixed = np.zeros(count, np.uint8)
    place = np.full(count, -1, np.int32)
    heap = np.empty(count, np.int32)
    size = 0
    for source in sources:
        if distance[source] > 0.0:
            distance[source] = 0.0
            size = _lift(heap, place, distance, size, source)
    while size > 0:
        node = heap[0]
        size = _pop(heap, place, distance, size)
        if distance[node] > max_distance:
            distance[node] = np.inf
            continue
        fixed[node] = 1
        size = _spread(points, ring, link_start, link_node, link_length, distance, fixed, heap, place, size, node)
    return distance


@njit(cache=True)
def _spread(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    distance: np.ndarray,
    fixed: np.ndarray,
    heap: np.ndarray,
    place: np.ndarray,
    size: int,
    node: int,
) -> int:
    """Offer a newly fixed node's distance to its neighbours; returns the new size of the heap."""
    for k in range(8):
        other = ring[node, k]
        if other < 0 or fixed[other]:
            continue
        best = distance[node] + _apart(points, node, other)
        back = (k + 4) % 8  # where the neighbour sees this node
        for side in (-1, 1):
            third = ring[other, (back + side) % 8]
            if third >= 0 and fixed[third]:
                best = min(best, _unfold(points, distance, other, node, third))
        if best < distance[other]:
            distance[other] = best
            size = _lift(heap, place, distance, size, other)
    for k in range(link_start[node], link_start[node + 1]):
        other = link_node[k]
        if not fixed[other]:
            along = distance[node] + link_length[k]
            if along < distance[other]:
                distance[other] = along
                size = _lift(heap, place, distance, size, other)
    return size


@njit(cache=True)
def _apart(points: np.ndarray, a: int, b: int) -> float:
    dx = np.float64(points[a, 0]) - points[b, 0]
    dy = np.float64(points[a, 1]) - points[b, 1]
    dz = np.float64(points[a, 2]) - points[b, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True)
def _unfold(points: np.ndarray, distance: np.ndarray, node: int, a: int, b: int) -> float:
    """Distance of a node from the flat image of the source behind edge a-b; inf where the ray misses the edge.

    In the triangle's plane, a at the origin and b at (c, 0): the source lies at (sx, -sy), the node at (px, py).
    """
    c2, p2, along = 0.0, 0.0, 0.0
    for axis in range(3):
        edge = np.float64(points[b, axis]) - points[a, axis]
        arm = np.float64(points[node, axis]) - points[a, axis]
        c2 += edge * edge
        p2 += arm * arm
        along += edge * arm
    if c2 <= 0.0:
        return np.inf
    c = np.sqrt(c2)
    px = along / c
    py = np.sqrt(max(p2 - px * px, 0.0))
    sx = (distance[a] ** 2 - distance[b] ** 2 + c2) / (2.0 * c)
    sy2 = distance[a] ** 2 - sx * sx
    if sy2 < 0.0:
        return np.inf
    sy = np.sqrt(sy2)
    if sy + py <= 0.0:
        return np.inf
    crossing = sx + (px - sx) * sy / (sy + py)
    if crossing < 0.0 or crossing > c:
        return np.inf
    return np.sqrt((px - sx) ** 2 + (py + sy) ** 2)


@njit(cache=True)
def _lift(heap: np.ndarray, place: np.ndarray, distance: np.ndarray, size: int, node: int) -> int:
    """Put a node into the heap, or move it up after its distance fell; returns the new size."""
    spot = place[node]
    if spot < 0:
        spot = size
        size += 1
    own = distance[node]
    while spot > 0:
        parent = (spot - 1) >> 1
        above = heap[parent]
        if distance[above] <= own:
            break
        heap[spot] = above
        place[above] = spot
        spot = parent
    heap[spot] = node
    place[node] = spot
    return size


@njit(cache=True)
def _pop(heap: np.ndarray, place: np.ndarray, distance: np.ndarray, size: int) -> int:
    """Take the nearest node off the heap; returns the new size."""
    place[heap[0]] = -1
    size -= 1
    if size == 0:
        return 0
    node = heap[size]
    own = distance[node]
    spot = 0
    while True:
        child = 2 * spot + 1
        if child >= size:
            break
        if child + 1 < size and distance[heap[child + 1]] < distance[heap[child]]:
            child += 1
        if distance[heap[child]] >= own:
            break
        heap[spot] = heap[child]
        place[heap[child]] = spot
        spot = child
    heap[spot] = node
    place[node] = spot
    return size
