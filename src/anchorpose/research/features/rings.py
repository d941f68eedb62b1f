"""The neighbourhood of a node as it lies on the surface: what the edges reach within some distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """start (k + 1,) int64: where the rows begin; node (m,) int32, a row's own node first; distance_m (m,) float32.

    reach_m (k,) float64: how far each row was searched.
    """

    start: np.ndarray
    node: np.ndarray
    distance_m: np.ndarray
    reach_m: np.ndarray


def rings_within(surface: Surface, reach_m: float | np.ndarray, chosen: np.ndarray | None = None) -> Rings:
    """Every node that edges and links lead to within reach_m of the chosen nodes (k,) int; None: of all n.

    reach_m: metres along the edges, one for all or (k,); a row is empty where it is NaN or the node has no position.
    Whatever lies near without being joined (an arm before the trunk) is no neighbour. Raises ValueError for a reach
    that is not positive.
    """
    chosen = np.arange(len(surface)) if chosen is None else np.asarray(chosen, np.int64)
    reach = np.broadcast_to(np.asarray(reach_m, np.float64), chosen.shape).copy()
    if (reach <= 0).any():
        raise ValueError(f"a reach must be positive, got {reach.min()} m")
    start, node, distance = _spread(
        surface.points_m, surface.ring, surface.link_start, surface.link_node, surface.link_length_m, chosen, reach
    )
    return Rings(start=start, node=node, distance_m=distance, reach_m=reach)


@njit(cache=True)
def _spread(
    points: np.ndarray, ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, link_length: np.ndarray,
    chosen: np.ndarray, reach: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Nodes wait in a circle for their turn and once more when they come nearer, so that no heap is needed."""
    count, length = len(points), _edge_lengths(points, ring)
    best, waits = np.full(count, np.inf, np.float32), np.zeros(count, np.bool_)
    queue = np.empty(max(count, 1), np.int32)
    start = np.zeros(len(chosen) + 1, np.int64)
    node, distance = np.empty(64 * len(chosen) + count, np.int32), np.empty(64 * len(chosen) + count, np.float32)
    end = 0
    for k in range(len(chosen)):
        first, limit = end, np.float32(reach[k])
        if end + count > len(node):
            node, distance = _longer(node, count), _longer(distance, count)
        if limit > 0 and np.isfinite(points[chosen[k]].sum()):
            best[chosen[k]], queue[0], node[end] = 0.0, chosen[k], chosen[k]
            end, head, size = end + 1, 0, 1
            while size > 0:
                here = queue[head]
                head, size, waits[here] = (head + 1) % count, size - 1, False
                links = link_start[here + 1] - link_start[here]
                for place in range(8 + links):
                    if place < 8:
                        other, onward = ring[here, place], best[here] + length[here, place]
                    else:
                        spot = link_start[here] + place - 8
                        other, onward = link_node[spot], best[here] + link_length[spot]
                    if other < 0 or not (onward <= limit and onward < best[other]):
                        continue
                    if best[other] == np.inf:
                        node[end] = other
                        end += 1
                    best[other] = onward
                    if not waits[other]:
                        queue[(head + size) % count] = other
                        size, waits[other] = size + 1, True
        for spot in range(first, end):
            distance[spot] = best[node[spot]]
            best[node[spot]] = np.inf
        start[k + 1] = end
    return start, node[:end].copy(), distance[:end].copy()


@njit(cache=True)
def _longer(array: np.ndarray, extra: int) -> np.ndarray:
    longer = np.empty(2 * len(array) + extra, array.dtype)
    longer[: len(array)] = array
    return longer


@njit(cache=True)
def _edge_lengths(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """(n, 8) float32, NaN where either end has no position."""
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
