"""Compute rotational projection statistics (RoPS): moments of the neighbours' projections on three planes, after
each of nine rotations.

Source: Guo, Sohel, Bennamoun, Lu, Wan 2013 (doi:10.1007/s11263-013-0627-y), Section 4, as PCL 1.13 implements it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from anchorpose.research.features.circle import ONE, ZERO
from anchorpose.research.features.local_frame import principal_axes
from anchorpose.research.features.neighbours import Neighbours, as_points, find_neighbours
from anchorpose.settings import Count, Positive, settings

STATISTICS = 5  # number of values per projection: the central moments 11, 21, 12 and 22, and the entropy


@settings
class RopsConfig:
    """Settings of RoPS. With three rotations per axis (``turns``), a descriptor has 135 numbers (``columns``)."""

    # m, radius of the neighbourhood; 15 times the mean length of an edge (13 mm), as in the authors' work
    radius_m: Positive = 0.20
    turns: Count = 3  # number of turns about each axis, within a right angle; the authors' choice
    bins: Count = 5  # number of bins along each side of a plane; the authors' choice

    @property
    def columns(self) -> int:
        return 3 * self.turns * 3 * STATISTICS


def rops(points_m: np.ndarray, triangles: np.ndarray, config: RopsConfig | None = None) -> np.ndarray:
    """Return the descriptors (n, 135) float32, whose absolute values sum to 1.

    points_m (n, 3), NaN = unknown. triangles (f, 3) int: ``surface.mesh.faces``. The columns are ordered by axis (x, y,
    z), then turn, then plane (xy, xz, yz), then moment (11, 21, 12, 22) and entropy. The row of a node without
    position, or without a neighbour or triangle within the radius, is NaN.
    """
    config = config or RopsConfig()
    points = as_points(points_m, "points_m")
    near = find_neighbours(points, config.radius_m)
    frames = triangle_frames(points, prepare_triangles(points, triangles), near)
    angle = np.radians(90.0 / (config.turns + 1) * np.arange(1, config.turns + 1))
    turns = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    return _statistics(points, near, frames, turns, config.bins)


@njit(cache=True, error_model="numpy")
def _statistics(
    points: np.ndarray, neighbours: Neighbours, frames: np.ndarray, turns: np.ndarray, bins: int
) -> np.ndarray:
    start, node = neighbours.start, neighbours.node
    result = np.full((len(points), 9 * len(turns) * STATISTICS), np.nan, np.float32)
    most = 1
    for c in range(len(points)):
        most = max(most, start[c + 1] - start[c] + 1)
    local, turned = np.empty((3, most), np.float32), np.empty((2, most), np.float32)
    cell = np.empty((3, most), np.int32)
    share = np.empty((3, bins * bins), np.float32)
    for c in range(len(points)):
        if not np.isfinite(frames[c, 0, 0]):
            continue
        count = _to_local(points, c, node[start[c] : start[c + 1]], frames[c], local)
        column = 0
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3  # the rotation turns axis ``one`` towards axis ``two``
            _into_bins(local[axis], count, bins, cell[axis])
            for turn in range(len(turns)):
                cosine, sine = turns[turn, 0], turns[turn, 1]
                for m in range(count):
                    turned[0, m] = cosine * local[one, m] - sine * local[two, m]
                    turned[1, m] = sine * local[one, m] + cosine * local[two, m]
                _into_bins(turned[0], count, bins, cell[one])
                _into_bins(turned[1], count, bins, cell[two])
                _project(cell, count, bins, share)
                for plane in range(3):
                    _plane_statistics(share[plane], bins, result[c, column : column + STATISTICS])
                    column += STATISTICS
        _normalize(result[c])
    return result


@njit(cache=True)
def _to_local(points: np.ndarray, own: int, near: np.ndarray, frame: np.ndarray, local: np.ndarray) -> int:
    """Fill local with the node itself and its neighbours, in the node's local frame; return their number."""
    local[0, 0] = local[1, 0] = local[2, 0] = ZERO
    px, py, pz = points[own, 0], points[own, 1], points[own, 2]
    for axis in range(3):
        fx, fy, fz = frame[axis, 0], frame[axis, 1], frame[axis, 2]
        for m in range(len(near)):
            q = np.uint32(near[m])
            local[axis, m + 1] = fx * (points[q, 0] - px) + fy * (points[q, 1] - py) + fz * (points[q, 2] - pz)
    return len(near) + 1


@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})  # vectorised only if the compiler may ignore NaN
def _into_bins(values: np.ndarray, count: int, bins: int, cell: np.ndarray) -> None:
    """Fill cell with the bin of each value. Bins divide the range of the values evenly; if all values are equal, all
    are in bin 0.
    """
    low, high = values[0], values[0]
    for m in range(count):
        low = values[m] if values[m] < low else low
        high = values[m] if values[m] > high else high
    width = (high - low) / np.float32(bins)
    width = width if width > ZERO else ONE
    for m in range(count):
        cell[m] = min(np.int32((values[m] - low) / width), np.int32(bins - 1))


@njit(cache=True, error_model="numpy")
def _project(cell: np.ndarray, count: int, bins: int, share: np.ndarray) -> None:
    """Fill share (3, bins * bins): the share of the points in each cell of the planes xy, xz and yz."""
    share[:] = ZERO
    for m in range(count):
        share[0, cell[0, m] * bins + cell[1, m]] += ONE
        share[1, cell[0, m] * bins + cell[2, m]] += ONE
        share[2, cell[1, m] * bins + cell[2, m]] += ONE
    share /= np.float32(count)


@njit(cache=True, error_model="numpy")
def _plane_statistics(share: np.ndarray, bins: int, statistics: np.ndarray) -> None:
    """Fill in the central moments 11, 21, 12 and 22 and the entropy of the shares in one plane's cells."""
    mean_i, mean_j = 0.0, 0.0
    for i in range(bins):
        for j in range(bins):
            mean_i += (i + 1) * share[i * bins + j]
            mean_j += (j + 1) * share[i * bins + j]
    m11, m21, m12, m22, entropy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(bins):
        for j in range(bins):
            part, di, dj = share[i * bins + j], i + 1 - mean_i, j + 1 - mean_j
            if part > ZERO:
                m11 += di * dj * part
                m21 += di * di * dj * part
                m12 += di * dj * dj * part
                m22 += di * di * dj * dj * part
                entropy -= part * np.log(part)
    statistics[0], statistics[1], statistics[2], statistics[3], statistics[4] = m11, m21, m12, m22, entropy


@njit(cache=True)
def _normalize(row: np.ndarray) -> None:
    """Scale the row so that its absolute values sum to 1; NaN if all points coincide and so have no shape."""
    total = 0.0
    for value in row:
        total += abs(value)
    row *= np.float32(1.0 / total if total > 0.0 else np.nan)


class Triangles(NamedTuple):
    """The triangles of a surface, listed at each of their corners."""

    start: np.ndarray  # the triangles at node i are ``corner_of[start[i]:start[i + 1]]``
    corner_of: np.ndarray  # int32
    # (f, 10) float64: centroid x y z, area, then the corners' scatter xx xy xz yy yz zz about the centroid in m^2
    shape: np.ndarray


def prepare_triangles(points: np.ndarray, faces: np.ndarray) -> Triangles:
    """Return the faces (f, 3) int of points (n, 3) in the form that compiled functions take. Faces with a corner of
    unknown position are left out.

    Raises ValueError if a corner is not a node.
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
    """Return (n, 3, 3) float32: rows x, y, z of the right-handed frame of each node; NaN if it has no triangle.

    points_m (n, 3) float32. The axes are principal axes of the surface, from all triangles with a corner within the
    radius, each weighted by its area times the squared distance of its centroid from the surface of the sphere with
    this radius: x lies along the surface's widest spread and z across the surface; each points to the side with more
    surface. Source: Guo et al. 2013, Section 3.
    """
    return _frames(points_m, neighbours, triangles)


@njit(cache=True, error_model="numpy")
def _frames(points: np.ndarray, neighbours: Neighbours, triangles: Triangles) -> np.ndarray:
    start, node, radius = neighbours.start, neighbours.node, neighbours.radius_m
    first, corner_of, shape = triangles.start, triangles.corner_of, triangles.shape
    frames = np.full((len(points), 3, 3), np.nan, np.float32)
    listed = np.full(len(shape), -1, np.int32)
    around = np.empty(len(shape) + 1, np.int32)
    scatter, axes, moment = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for own in range(len(points)):
        count = _list_triangles(own, own, first, corner_of, listed, around, 0)
        for m in range(start[own], start[own + 1]):
            count = _list_triangles(node[m], own, first, corner_of, listed, around, count)
        if _scatter(points[own], radius, shape, around[:count], scatter, moment) <= 0.0:
            continue
        principal_axes(scatter, axes)
        x, z = axes[0], axes[2]
        if x[0] * moment[0] + x[1] * moment[1] + x[2] * moment[2] < 0.0:
            x[:] = -x
        if z[0] * moment[0] + z[1] * moment[1] + z[2] * moment[2] < 0.0:
            z[:] = -z
        frames[own, 0], frames[own, 2] = x, z
        frames[own, 1, 0] = z[1] * x[2] - z[2] * x[1]
        frames[own, 1, 1] = z[2] * x[0] - z[0] * x[2]
        frames[own, 1, 2] = z[0] * x[1] - z[1] * x[0]
    return frames


@njit(cache=True)
def _list_triangles(
    node: int, c: int, first: np.ndarray, corner_of: np.ndarray, listed: np.ndarray, around: np.ndarray, count: int
) -> int:
    """Add to ``around`` the triangles at ``node`` that are not yet listed for the node ``c``, whose neighbourhood
    contains ``node``; return the new number of listed triangles.
    """
    for spot in range(first[node], first[node + 1]):
        triangle = corner_of[spot]
        around[count] = triangle
        count += listed[triangle] != c
        listed[triangle] = c
    return count


@njit(cache=True, error_model="numpy")
def _scatter(
    point: np.ndarray, radius: float, shape: np.ndarray, around: np.ndarray, scatter: np.ndarray, moment: np.ndarray
) -> float:
    """Fill the second moments (scatter) and the first moment of the surface about a point, both up to a factor.

    Return the sum of the triangles' weights.

    The integral of p p^T over a triangle is, up to a factor, the scatter of its corners plus twelve times p p^T of its
    centroid. A triangle's weight is its area times the squared distance of its centroid from the surface of the sphere
    with this radius about the point.
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
    moment[0], moment[1], moment[2] = lx, ly, lz
    return total
