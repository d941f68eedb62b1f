"""The local reference frame of RoPS: axes of the surface itself, every triangle by its area, not of its nodes.

Source: Guo, Sohel, Bennamoun, Lu, Wan 2013 (doi:10.1007/s11263-013-0627-y), Section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.research.features.neighbours import Neighbours
from anchorpose.research.features.principal_axes import principal_axes


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """corners (f, 3) int32; the triangles at node i are ``corner_of[start[i]:start[i + 1]]``, int32.

    shape (f, 10) float64: centroid x y z, area, then xx xy xz yy yz zz: scatter of the corners about the centroid, m^2.
    """

    start: np.ndarray
    corner_of: np.ndarray
    shape: np.ndarray


def prepare_triangles(points: np.ndarray, faces: np.ndarray) -> Triangles:
    """Triangles (f, 3) int of points (n, 3); those with a corner whose position is not known are left out.

    Raises ValueError where a corner is no node.
    """
    faces = np.asarray(faces)
    if faces.ndim != 2 or faces.shape[1] != 3 or (faces.size and not np.issubdtype(faces.dtype, np.integer)):
        raise ValueError(f"triangles must be node numbers (f, 3), got {faces.dtype} of shape {faces.shape}")
    if faces.size and not (faces.min() >= 0 and faces.max() < len(points)):
        raise ValueError(f"a triangle has a corner that is not among the {len(points)} nodes")
    corners = points[faces.astype(np.int64)].astype(np.float64)
    whole = np.isfinite(corners).all(axis=(1, 2))
    faces, corners = faces[whole], corners[whole]
    centroid = corners.mean(axis=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    arms = corners - centroid[:, None]
    scatter = np.einsum("fci,fcj->fij", arms, arms)[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]
    owner = faces.ravel()
    start = np.zeros(len(points) + 1, np.int64)
    np.cumsum(np.bincount(owner, minlength=len(points)), out=start[1:])
    corner_of = (np.argsort(owner, kind="stable") // 3).astype(np.int32)
    return Triangles(start, corner_of, np.concatenate([centroid, area[:, None], scatter], axis=1))


def triangle_frames(points_m: np.ndarray, triangles: Triangles, neighbours: Neighbours) -> np.ndarray:
    """(k, 3, 3) float32: rows x, y, z of the right-handed frame of each centre; NaN where it is in no surface.

    points_m (n, 3) float32. The surface is every triangle with a corner within the radius; x lies along its widest
    spread and z across it, each towards the side of more surface.
    """
    near = neighbours
    return _frames(
        points_m, near.centre, near.start, near.node, near.radius_m, triangles.start, triangles.corner_of,
        triangles.shape,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _frames(
    points: np.ndarray, centre: np.ndarray, start: np.ndarray, node: np.ndarray, radius: float,
    first: np.ndarray, corner_of: np.ndarray, shape: np.ndarray,
) -> np.ndarray:  # fmt: skip
    frames = np.full((len(centre), 3, 3), np.nan, np.float32)
    met = np.full(len(shape), -1, np.int32)
    around = np.empty(len(shape) + 1, np.int32)
    scatter, axes, lean = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for c in range(len(centre)):
        own = centre[c]
        count = _meet(own, c, first, corner_of, met, around, 0)
        for m in range(start[c], start[c + 1]):
            count = _meet(node[m], c, first, corner_of, met, around, count)
        if _scatter(points[own], radius, shape, around[:count], scatter, lean) <= 0.0:
            continue
        principal_axes(scatter, axes)
        x, z = axes[0], axes[2]
        if x[0] * lean[0] + x[1] * lean[1] + x[2] * lean[2] < 0.0:
            x[:] = -x
        if z[0] * lean[0] + z[1] * lean[1] + z[2] * lean[2] < 0.0:
            z[:] = -z
        frames[c, 0], frames[c, 2] = x, z
        frames[c, 1, 0] = z[1] * x[2] - z[2] * x[1]
        frames[c, 1, 1] = z[2] * x[0] - z[0] * x[2]
        frames[c, 1, 2] = z[0] * x[1] - z[1] * x[0]
    return frames


@njit(cache=True)
def _meet(
    node: int, c: int, first: np.ndarray, corner_of: np.ndarray, met: np.ndarray, around: np.ndarray, count: int
) -> int:
    """Adds the triangles at a node that were not met yet around centre c."""
    for spot in range(first[node], first[node + 1]):
        triangle = corner_of[spot]
        around[count] = triangle
        count += met[triangle] != c
        met[triangle] = c
    return count


@njit(cache=True, error_model="numpy")
def _scatter(
    point: np.ndarray, radius: float, shape: np.ndarray, around: np.ndarray, scatter: np.ndarray, lean: np.ndarray
) -> float:
    """Fills the surface's scatter about a point and where it leans to, up to a factor; returns the sum of the weights.

    A triangle's integral of p p^T is its corners' scatter and twelve times its centroid's; it weighs by its area and
    by the square of how far its centroid is from the sphere.
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    lx, ly, lz, total = 0.0, 0.0, 0.0, 0.0
    px, py, pz = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    for triangle in around:
        x, y, z = shape[triangle, 0] - px, shape[triangle, 1] - py, shape[triangle, 2] - pz
        weight = shape[triangle, 3] * (radius - np.sqrt(x * x + y * y + z * z)) ** 2
        xx += weight * (shape[triangle, 4] + 12.0 * x * x)
        xy += weight * (shape[triangle, 5] + 12.0 * x * y)
        xz += weight * (shape[triangle, 6] + 12.0 * x * z)
        yy += weight * (shape[triangle, 7] + 12.0 * y * y)
        yz += weight * (shape[triangle, 8] + 12.0 * y * z)
        zz += weight * (shape[triangle, 9] + 12.0 * z * z)
        lx, ly, lz, total = lx + weight * x, ly + weight * y, lz + weight * z, total + weight
    scatter[0, 0], scatter[1, 1], scatter[2, 2] = xx, yy, zz
    scatter[0, 1] = scatter[1, 0] = xy
    scatter[0, 2] = scatter[2, 0] = xz
    scatter[1, 2] = scatter[2, 1] = yz
    lean[0], lean[1], lean[2] = lx, ly, lz
    return total
