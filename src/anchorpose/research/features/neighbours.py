"""Nodes within a radius of other nodes, as the local descriptors need them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree


class Neighbours(NamedTuple):
    """The nodes around each centre, in ascending order, without the centre itself.

    centre (k,) int32: one node number each. The nodes within ``radius_m`` of centre c are
    ``node[start[c]:start[c + 1]]``, at the squared distances ``distance2_m2``; start (k + 1,) int64, node (m,) int32,
    distance2_m2 (m,) float32. A centre without a position has no neighbours, and such a node is never a neighbour.
    """

    centre: np.ndarray
    start: np.ndarray
    node: np.ndarray
    distance2_m2: np.ndarray
    radius_m: float


def find_neighbours(points_m: np.ndarray, radius_m: float, chosen: np.ndarray | None = None) -> Neighbours:
    """All nodes within a radius, those exactly on the sphere included, of the chosen nodes (k,) int; None: of all.

    points_m (n, 3), any frame; NaN where unknown. Raises ValueError on a radius that is not positive and finite, and
    on node numbers that do not exist.
    """
    require_radius(radius_m)
    points, centre = as_points(points_m, "points_m"), as_chosen(chosen, len(points_m))
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    asked = np.flatnonzero(np.isfinite(points[centre]).all(axis=1))
    within = cKDTree(points[centre[asked]]).sparse_distance_matrix(
        cKDTree(points[known]), radius_m, output_type="ndarray"
    )
    row, node = asked[within["i"]], known[within["j"]]
    apart = node != centre[row]
    found = coo_array((within["v"][apart], (row[apart], node[apart])), shape=(len(centre), len(points))).tocsr()
    found.sort_indices()
    distance2 = (found.data**2).astype(np.float32)
    return Neighbours(centre, found.indptr.astype(np.int64), found.indices.astype(np.int32), distance2, float(radius_m))


def count_within(points_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(n,) int32: number of nodes within a radius of each node (n, 3), itself included; 0 for an unknown position."""
    require_radius(radius_m)
    points = as_points(points_m, "points_m")
    known = np.isfinite(points).all(axis=1)
    count = np.zeros(len(points), np.int32)
    count[known] = cKDTree(points[known]).query_ball_point(points[known], radius_m, return_length=True)
    return count


def require_radius(radius_m: float) -> None:
    if not 0.0 < radius_m < np.inf:
        raise ValueError(f"a radius must be positive and finite, got {radius_m}")


def as_points(values: np.ndarray, name: str) -> np.ndarray:
    """(n, 3) float32, contiguous; ValueError on another shape."""
    values = np.ascontiguousarray(values, np.float32)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ValueError(f"{name} must have shape (n, 3), got {values.shape}")
    return values


def as_oriented(points_m: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals as ``as_points`` makes them; ValueError where their numbers differ."""
    points, unit = as_points(points_m, "points_m"), as_points(normals, "normals")
    if len(points) != len(unit):
        raise ValueError(f"{len(points)} points, but {len(unit)} normals")
    return points, unit


def as_chosen(chosen: np.ndarray | None, count: int) -> np.ndarray:
    """(k,) int32 node numbers, all of them for None; ValueError on numbers outside of 0 to count - 1."""
    if chosen is None:
        return np.arange(count, dtype=np.int32)
    numbers = np.atleast_1d(np.asarray(chosen))
    if numbers.ndim != 1 or (numbers.size and not np.issubdtype(numbers.dtype, np.integer)):
        raise ValueError(f"chosen must be node numbers (k,), got {numbers.dtype} of shape {numbers.shape}")
    if numbers.size and not (numbers.min() >= 0 and numbers.max() < count):
        raise ValueError(f"chosen names nodes that are not among the {count}")
    return numbers.astype(np.int32)
