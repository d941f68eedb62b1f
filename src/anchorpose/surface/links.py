"""Edges that the pixel grid does not have: between cameras, across bars, over hidden skin."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.surface.surface import Surface


def links(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """(l, 2) int32 every link once, the smaller index first, and (l,) float32 metres its length."""
    source = np.repeat(np.arange(len(surface), dtype=np.int32), np.diff(surface.link_start))
    once = source < surface.link_node
    return np.stack([source[once], surface.link_node[once]], axis=1), surface.link_length_m[once]


def straight_m(points_m: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(l,) float32: how far the nodes of each pair are apart."""
    length: np.ndarray = np.linalg.norm(points_m[pairs[:, 0]] - points_m[pairs[:, 1]], axis=1).astype(np.float32)
    return length


def compress_links(pairs: np.ndarray, length_m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected pairs (m, 2) with their lengths (m,) to compressed rows (link_start, link_node, link_length_m).

    Symmetric, each link once a side, rows in the order of the pairs; of a pair given twice the shorter length counts.
    """
    return _compress(pairs.astype(np.int32), length_m.astype(np.float32), count)


@njit(cache=True)
def _compress(pairs: np.ndarray, length: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    room = np.zeros(count + 1, np.int32)
    for e in range(len(pairs)):
        room[pairs[e, 0] + 1] += 1
        room[pairs[e, 1] + 1] += 1
    for n in range(count):
        room[n + 1] += room[n]
    filled = room[:-1].copy()
    node, metres = np.empty(2 * len(pairs), np.int32), np.empty(2 * len(pairs), np.float32)
    for e in range(len(pairs)):
        for side in range(2):
            here, there = pairs[e, side], pairs[e, 1 - side]
            spot = room[here]
            while spot < filled[here] and node[spot] != there:
                spot += 1
            if spot == filled[here]:
                node[spot], metres[spot] = there, length[e]
                filled[here] += 1
            else:
                metres[spot] = min(metres[spot], length[e])
    start = np.zeros(count + 1, np.int32)
    for n in range(count):  # close the gaps that pairs given twice have left
        size = filled[n] - room[n]
        start[n + 1] = start[n] + size
        for k in range(size):
            node[start[n] + k], metres[start[n] + k] = node[room[n] + k], metres[room[n] + k]
    return start, node[: start[count]].copy(), metres[: start[count]].copy()
