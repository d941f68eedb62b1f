"""Which nodes hang together, by union-find on the surface's own arrays."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def connected_pieces(ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray) -> np.ndarray:
    """(n,) int32: number of each node's piece, counted in the order of the pieces' first nodes.

    ring (n, 8), link_start (n + 1,), link_node (m,) int32 of ``Surface``. The root of a piece is its first node.
    Source: Tarjan 1975 (doi:10.1145/321879.321884), with path halving.
    """
    count = len(ring)
    root = np.arange(count, dtype=np.int32)
    for node in range(count):
        for place in range(4):  # E NE N NW: every edge of the grid once
            if ring[node, place] >= 0:
                _unite(root, node, ring[node, place])
        for spot in range(link_start[node], link_start[node + 1]):
            _unite(root, node, link_node[spot])
    piece = np.empty(count, np.int32)
    found = 0
    for node in range(count):
        first = _find(root, node)
        if first == node:
            piece[node] = found
            found += 1
        else:
            piece[node] = piece[first]
    return piece


@njit(cache=True)
def _unite(root: np.ndarray, one: int, other: int) -> None:
    one, other = _find(root, one), _find(root, other)
    if one < other:
        root[other] = one
    else:
        root[one] = other


@njit(cache=True)
def _find(root: np.ndarray, node: int) -> int:
    while root[node] != node:
        root[node] = root[root[node]]
        node = root[node]
    return node
