"""The repeatable local reference frame of SHOT: axes of the neighbourhood, turned to where most neighbours are.

Source: Tombari, Salti, Di Stefano 2010 (doi:10.1007/978-3-642-15558-1_26), Section 3, as PCL 1.13 reads it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.neighbours import Neighbours, as_points
from anchorpose.research.features.principal_axes import principal_axes

FEWEST = 5  # neighbours; axes of fewer are noise, and the authors' program gives up there too


def local_frames(points_m: np.ndarray, neighbours: Neighbours, normals: np.ndarray | None = None) -> np.ndarray:
    """(k, 3, 3) float32: rows x, y, z of the right-handed frame of each centre of the neighbours; NaN where undefined.

    points_m (n, 3). x lies along the widest spread and z across the surface, each towards the side of more neighbours;
    where that is a tie, the five in the middle of the order by distance decide. normals (n, 3): where given, z points
    the way of the centre's normal instead, which a nearly flat surface needs. Undefined: fewer than five neighbours
    apart from the centre, or no normal to go by.
    """
    points = as_points(points_m, "points_m")
    by_normal = normals is not None
    unit = as_points(normals, "normals") if normals is not None else np.empty((0, 3), np.float32)
    near = neighbours
    return _frames(points, near.centre, near.start, near.node, near.distance2_m2, near.radius_m, by_normal, unit)


def as_frames(frames: np.ndarray, count: int) -> np.ndarray:
    """(k, 3, 3) float32 in one block; ValueError on another shape."""
    frames = np.ascontiguousarray(frames, np.float32)
    if frames.shape != (count, 3, 3):
        raise ValueError(f"frames must have shape ({count}, 3, 3), got {frames.shape}")
    return frames


@njit(cache=True, error_model="numpy")
def _frames(
    points: np.ndarray, centre: np.ndarray, start: np.ndarray, node: np.ndarray, distance2: np.ndarray, radius: float,
    by_normal: bool, normals: np.ndarray,
) -> np.ndarray:  # fmt: skip
    frames = np.full((len(centre), 3, 3), np.nan, np.float32)
    spread, axes = np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(centre)):
        own, row = centre[c], slice(start[c], start[c + 1])
        if _spread(points, own, node[row], distance2[row], radius, spread) < FEWEST:
            continue
        principal_axes(spread, axes)
        x, z = axes[0], axes[2]
        if _points_away(points, own, node[row], distance2[row], x):
            x[:] = -x
        if by_normal:
            along = z[0] * normals[own, 0] + z[1] * normals[own, 1] + z[2] * normals[own, 2]
            if not np.isfinite(along):
                continue
            if along < 0.0:
                z[:] = -z
        elif _points_away(points, own, node[row], distance2[row], z):
            z[:] = -z
        frames[c, 0], frames[c, 2] = x, z
        frames[c, 1, 0] = z[1] * x[2] - z[2] * x[1]
        frames[c, 1, 1] = z[2] * x[0] - z[0] * x[2]
        frames[c, 1, 2] = z[0] * x[1] - z[1] * x[0]
    return frames


@njit(cache=True, error_model="numpy")
def _spread(
    points: np.ndarray, own: int, near: np.ndarray, distance2: np.ndarray, radius: float, spread: np.ndarray
) -> int:
    """Fills the covariance about the centre, each neighbour by how far it is from the sphere; how many there were.

    Only its axes are used, so that it is not divided by the sum of the weights.
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = 0
    for m in range(len(near)):
        other = near[m]
        dx = np.float64(points[other, 0] - points[own, 0])
        dy = np.float64(points[other, 1] - points[own, 1])
        dz = np.float64(points[other, 2] - points[own, 2])
        weight = radius - np.sqrt(np.float64(distance2[m]))
        count += distance2[m] > 0.0
        xx, xy, xz = xx + weight * dx * dx, xy + weight * dx * dy, xz + weight * dx * dz
        yy, yz, zz = yy + weight * dy * dy, yz + weight * dy * dz, zz + weight * dz * dz
    spread[0, 0], spread[1, 1], spread[2, 2] = xx, yy, zz
    spread[0, 1] = spread[1, 0] = xy
    spread[0, 2] = spread[2, 0] = xz
    spread[1, 2] = spread[2, 1] = yz
    return count


@njit(cache=True, error_model="numpy")
def _points_away(points: np.ndarray, own: int, near: np.ndarray, distance2: np.ndarray, axis: np.ndarray) -> bool:
    """Whether more of the neighbours lie against the axis than along it."""
    balance = 0
    for m in range(len(near)):
        ahead = _along(points, own, near[m], axis) >= 0.0
        balance += (1 if ahead else -1) if distance2[m] > 0.0 else 0
    if balance != 0:
        return balance < 0
    by_distance = np.argsort(distance2)
    apart = by_distance[np.count_nonzero(distance2 == 0.0) :]
    middle, ahead_count = len(apart) // 2, 0
    for place in range(max(middle - 2, 0), min(middle + 3, len(apart))):
        ahead_count += _along(points, own, near[apart[place]], axis) > 0.0
    return ahead_count < 3


@njit(cache=True)
def _along(points: np.ndarray, own: int, other: int, axis: np.ndarray) -> float:
    dx, dy = points[other, 0] - points[own, 0], points[other, 1] - points[own, 1]
    return dx * axis[0] + dy * axis[1] + (points[other, 2] - points[own, 2]) * axis[2]
