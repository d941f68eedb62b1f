"""Edges that the pixel grid does not have: between cameras, across bars, over hidden skin."""

from __future__ import annotations

import numpy as np

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


def compress_links(
    pairs: np.ndarray, length_m: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected pairs (m, 2) with their lengths (m,) to compressed rows (link_start, link_node, link_length_m).

    Symmetric, each link once a side; of a pair given twice the shorter length counts.
    """
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).astype(np.int64).T
    key, length = one * count + other, np.concatenate([length_m, length_m])
    order = np.lexsort((length, key))
    key, length = key[order], length[order]
    first = np.ones(len(key), bool)
    first[1:] = key[1:] != key[:-1]
    row, node = np.divmod(key[first], max(count, 1))
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
    return start.astype(np.int32), node.astype(np.int32), length[first].astype(np.float32)
