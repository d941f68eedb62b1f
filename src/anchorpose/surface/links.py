"""Store links, which are edges outside the pixel grid, and find the connected pieces of a mesh.

A link connects the nodes of two cameras, the two sides of a bar or a gap, or nodes of hidden skin.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.isolation.components import find_root, unite
from anchorpose.surface.surface import MeshArrays, Surface


def links(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return every link once, (l, 2) int32 with the smaller index first, and the lengths (l,) float32 in metres."""
    source = np.repeat(np.arange(len(surface), dtype=np.int32), np.diff(surface.link_start))
    once = source < surface.link_node
    return np.stack([source[once], surface.link_node[once]], axis=1), surface.link_length_m[once]


def straight_m(points_m: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return the straight-line distance (l,) float32 between the two nodes of each pair."""
    length: np.ndarray = np.linalg.norm(points_m[pairs[:, 0]] - points_m[pairs[:, 1]], axis=1).astype(np.float32)
    return length


def compress_links(pairs: np.ndarray, length_m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert undirected pairs (m, 2) of ``count`` nodes, with lengths (m,), to the compressed rows (CSR format)
    link_start, link_node and link_length_m of ``Surface``.

    Each link appears in the rows of both its nodes. A node's links are in the order of the pairs. For repeated pairs,
    the shortest length counts.
    """
    none = np.empty(0, np.int32)
    return _compress(
        np.zeros(1, np.int32), none, none.view(np.float32), pairs.astype(np.int32), length_m.astype(np.float32), count
    )


def add_links(
    surface: Surface, pairs: np.ndarray, length_m: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the surface's own links followed by new links, in the form of ``compress_links``.

    pairs (m, 2) int32, length_m (m,) float32: the new links; count: number of nodes, at least the surface's number.
    """
    return _compress(surface.link_start, surface.link_node, surface.link_length_m, pairs, length_m, count)


@njit(cache=True, nogil=True)
def _compress(
    own_start: np.ndarray,
    own_node: np.ndarray,
    own_length: np.ndarray,
    pairs: np.ndarray,
    length: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute ``add_links`` in compiled code: append the pairs to the compressed rows (own_*) of the first o nodes.
    own_start: (o + 1,).
    """
    owners = len(own_start) - 1
    room = np.zeros(count + 1, np.int32)
    for n in range(owners):
        room[n + 1] = own_start[n + 1] - own_start[n]
    for e in range(len(pairs)):
        room[pairs[e, 0] + 1] += 1
        room[pairs[e, 1] + 1] += 1
    for n in range(count):
        room[n + 1] += room[n]
    filled = room[:-1].copy()
    node, metres = np.empty(room[count], np.int32), np.empty(room[count], np.float32)
    for n in range(owners):
        for spot in range(own_start[n], own_start[n + 1]):
            node[filled[n]], metres[filled[n]] = own_node[spot], own_length[spot]
            filled[n] += 1
    for e in range(len(pairs)):
        for side in range(2):
            here = pairs[e, side]
            node[filled[here]], metres[filled[here]] = pairs[e, 1 - side], length[e]
            filled[here] += 1
    start, place = np.zeros(count + 1, np.int32), np.full(count, -1, np.int32)
    end = 0
    # merge repeated pairs; place[m]: position of node m among the links of node n; it is less than start[n] if node m
    # has not occurred among them yet
    for n in range(count):
        for spot in range(room[n], room[n + 1]):
            there, metre = node[spot], metres[spot]
            if place[there] < start[n]:
                place[there], node[end], metres[end] = end, there, metre
                end += 1
            else:
                metres[place[there]] = min(metres[place[there]], metre)
        start[n + 1] = end
    return start, node[:end].copy(), metres[:end].copy()


def pieces(surface: Surface) -> np.ndarray:
    """Return, for each node, the number (n,) int32 of the connected piece of mesh to which it belongs. Pieces are
    numbered in the order of their first nodes.
    """
    return _connected_pieces(surface.arrays)


@njit(cache=True, nogil=True)
def _connected_pieces(mesh: MeshArrays) -> np.ndarray:
    """Compute ``pieces`` in compiled code; the root of a piece is its first node.

    Source: Tarjan 1975 (doi:10.1145/321879.321884), with path halving.
    """
    ring, link_start, link_node = mesh.ring, mesh.link_start, mesh.link_node
    count = len(ring)
    root = np.arange(count, dtype=np.int32)
    for node in range(count):
        for place in range(4):  # E NE N NW, so that every edge of the grid occurs once
            if ring[node, place] >= 0:
                unite(root, np.int64(node), np.int64(ring[node, place]))
        for spot in range(link_start[node], link_start[node + 1]):
            unite(root, np.int64(node), np.int64(link_node[spot]))
    piece = np.empty(count, np.int32)
    found = 0
    for node in range(count):
        first = find_root(root, np.int64(node))
        if first == node:
            piece[node] = found
            found += 1
        else:
            piece[node] = piece[first]
    return piece
