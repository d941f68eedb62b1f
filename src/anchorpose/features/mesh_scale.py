"""The scale of the shape around each node: where its surface stands out most as it is smoothed (Darom and Keller)."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.surface.surface import Surface


def intrinsic_scale(surface: Surface, levels: int) -> tuple[np.ndarray, np.ndarray]:
    """sigma_m (n,) float32: the standard deviation of the smoothing at each node's scale, NaN where it has none;
    found (n,) bool: whether the response is larger there than at the levels before and after.

    Positions are smoothed over their rings again and again, with Gaussian weights as wide as the node's edges are long
    (its density). The difference of two levels along the normal, times the variance between them to make it comparable
    across scales, is the response; the scale is that of the highest response inside the range, at an end of it where
    there is none inside. On a Gaussian bump's top sigma_m is the bump's own.
    Source: Darom and Keller 2012 (doi:10.1109/TIP.2012.2183142).
    Raises ValueError for fewer than three levels.
    """
    if levels < 3:
        raise ValueError(f"a scale is found among three levels or more, got {levels}")
    responses = np.empty((levels, len(surface)))
    points, normals = surface.points_m.astype(np.float64), surface.normals.astype(np.float64)
    density, variance = mean_edge_m(surface), np.empty(len(surface))
    _smoothed(points, surface.ring, density, variance)
    steps, unused = np.arange(levels) + 0.5, np.empty(len(surface))
    for level in range(levels):
        smoothed = _smoothed(points, surface.ring, density, unused)
        responses[level] = steps[level] * np.abs(((smoothed - points) * normals).sum(axis=1))
        points = smoothed
    inside = responses[1:-1]
    peak = (inside > responses[:-2]) & (inside > responses[2:])
    found = peak.any(axis=0)
    best = np.where(found, 1 + np.where(peak, inside, -1.0).argmax(axis=0), responses.argmax(axis=0))
    known = np.isfinite(responses).all(axis=0) & np.isfinite(density)
    sigma = np.where(known, np.sqrt(variance * steps[best]), np.nan)
    return sigma.astype(np.float32), found & known


def mean_edge_m(surface: Surface) -> np.ndarray:
    """(n,) float64: how long the edges of a node are on the grid, on average; NaN where it has none."""
    points = surface.points_m.astype(np.float64)
    there = surface.ring >= 0
    length = np.linalg.norm(points[surface.ring] - points[:, None], axis=2)
    count = there.sum(axis=1)
    return np.where(count > 0, np.where(there, length, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


@njit(cache=True)
def _smoothed(points: np.ndarray, ring: np.ndarray, density: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(n, 3): each point replaced by the weighted mean of itself and its ring; variance (n,) gets what one such step
    adds to the width of a shape, in each of the surface's two directions."""
    smoothed = np.empty_like(points)
    for node in range(len(points)):
        x, y, z, total, spread = points[node, 0], points[node, 1], points[node, 2], 1.0, 0.0
        for place in range(8):
            other = ring[node, place]
            if other < 0:
                continue
            square = 0.0
            for axis in range(3):
                square += (points[other, axis] - points[node, axis]) ** 2
            weight = np.exp(-0.5 * square / density[node] ** 2)
            x, y, z = x + weight * points[other, 0], y + weight * points[other, 1], z + weight * points[other, 2]
            total, spread = total + weight, spread + weight * square
        variance[node] = 0.5 * spread / total
        smoothed[node, 0], smoothed[node, 1], smoothed[node, 2] = x / total, y / total, z / total
    return smoothed
