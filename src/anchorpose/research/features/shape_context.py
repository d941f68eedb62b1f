"""Compute 3D shape contexts: the density of points in the cells of a sphere, which consists of shells that are thinner
towards the centre of the sphere.

Sources: Frome, Huber, Kolluri, Buelow, Malik 2004 (doi:10.1007/978-3-540-24672-5_18), cells and weights as in PCL 1.13.
The paper does not define where azimuth begins, and compares descriptors at every rotation about the normal. One
repeatable frame per node makes the descriptor unique: Tombari, Salti, Di Stefano 2010b (doi:10.1145/1877808.1877821).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

from anchorpose.research.features.circle import PI, ZERO, angle_of
from anchorpose.research.features.local_frame import as_frames, local_frames
from anchorpose.research.features.neighbours import Neighbours, as_oriented, as_points, count_within, find_neighbours
from anchorpose.settings import Count, Positive, settings

_TWO_PI = np.float32(2 * np.pi)
# Minimum sine of the angle between x axis and normal; with a smaller sine, the direction of x in the tangent plane is
# undetermined.
PARALLEL = 1e-3


@settings
class ShapeContextConfig:
    """Settings of shape contexts; by default, a shape context has 1980 numbers, see ``cells``."""

    # Radius of the sphere in m. The sphere contains a limb with its edges; in a smaller sphere, all surfaces look flat.
    radius_m: Positive = 0.20
    # share of ``radius_m`` at which the geometric series of the shells' radii begins; the first shell itself begins at
    # 0
    innermost: Annotated[float, Field(gt=0, lt=1)] = 0.1
    # radius, as a share of radius_m, within which points are counted for the density around a point
    density: Positive = 0.2
    # numbers of azimuths, elevations and shells, all as in PCL and in the authors' experiments
    azimuths: Count = 12
    elevations: Count = 11
    shells: Count = 15

    @property
    def cells(self) -> int:
        return self.azimuths * self.elevations * self.shells


def shape_context(
    points_m: np.ndarray,
    normals: np.ndarray,
    config: ShapeContextConfig | None = None,
    frames: np.ndarray | None = None,
) -> np.ndarray:
    """Return the shape contexts (n, 1980) float32: the weighted number of points in each cell, 1 / m.

    points_m, normals (n, 3) are in one frame, and normals have unit length; NaN = unknown. The weight of a point is 1
    divided by the number of points around it (within ``density``) and by the cube root of its cell's volume. frames (n,
    3, 3): rows x, y, z; None = the result of ``tangent_frames``. Columns are ordered by azimuth from x, then elevation
    from z down, then shell outwards, which changes fastest. The row of a node without frame is NaN.
    """
    config = config or ShapeContextConfig()
    points, unit = as_oriented(points_m, normals)
    near = find_neighbours(points, config.radius_m)
    frames = as_frames(tangent_frames(points, unit, near) if frames is None else frames, len(points))
    density = count_within(points, config.density * config.radius_m)
    edges = config.radius_m * np.geomspace(config.innermost, 1.0, config.shells + 1)
    weights = _cell_weights(edges, config)
    inner = edges[1:-1].astype(np.float32)
    return _contexts(points, near, frames, density, inner, weights, config.azimuths)


def tangent_frames(points_m: np.ndarray, normals: np.ndarray, neighbours: Neighbours) -> np.ndarray:
    """Return (n, 3, 3) float32: rows x, y, z of each node's frame, z along its normal (n, 3).

    x is the x axis of ``local_frames``, projected onto the tangent plane. NaN if the node has no normal, or x has no
    direction in the tangent plane.
    """
    z = as_points(normals, "normals").astype(np.float64)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    axis = local_frames(points_m, neighbours)[:, 0].astype(np.float64)
    x = axis - (axis * z).sum(axis=1, keepdims=True) * z
    length = np.linalg.norm(x, axis=1, keepdims=True)
    x = np.where(length > PARALLEL, x / np.where(length > PARALLEL, length, 1.0), np.nan)
    return np.stack([x, np.cross(z, x), np.where(np.isnan(x), np.nan, z)], axis=1).astype(np.float32)


def _cell_weights(edges: np.ndarray, config: ShapeContextConfig) -> np.ndarray:
    """Return (elevations, shells) float32: 1 divided by the cube root of a cell's volume, 1 / m."""
    sink = -np.diff(np.cos(np.linspace(0.0, np.pi, config.elevations + 1)))
    volume = 2 * np.pi / config.azimuths * sink[:, None] * (np.diff(edges**3) / 3.0)
    return (volume ** (-1.0 / 3.0)).astype(np.float32)


@njit(cache=True, error_model="numpy")
def _contexts(
    points: np.ndarray,
    neighbours: Neighbours,
    frames: np.ndarray,
    density: np.ndarray,
    inner: np.ndarray,
    weights: np.ndarray,
    azimuths: int,
) -> np.ndarray:
    """Return the shape contexts (n, cells) float32.

    density (n,): number of nodes around each node. inner (shells - 1,): radii between the shells. weights: the result
    of ``_cell_weights``.
    """
    start, node, distance2 = neighbours.start, neighbours.node, neighbours.distance2_m2
    elevations, shells = weights.shape
    result = np.zeros((len(points), azimuths * elevations * shells), np.float32)
    most = 1
    for c in range(len(points)):
        most = max(most, start[c + 1] - start[c])
    cell = np.empty((3, most), np.int32)
    for c in range(len(points)):
        if not np.isfinite(frames[c, 0, 0] + frames[c, 2, 0]):
            result[c] = np.nan
            continue
        near = node[start[c] : start[c + 1]]
        away2 = distance2[start[c] : start[c + 1]]
        _direction_cells(points, c, near, frames[c], azimuths, elevations, cell)
        _shells(away2, inner, cell[2])
        for m in range(len(near)):
            if away2[m] > ZERO:
                spot = (cell[0, m] * elevations + cell[1, m]) * shells + cell[2, m]
                result[c, spot] += weights[cell[1, m], cell[2, m]] / density[near[m]]
    return result


@njit(cache=True, error_model="numpy")
def _direction_cells(
    points: np.ndarray, own: int, near: np.ndarray, frame: np.ndarray, azimuths: int, elevations: int, cell: np.ndarray
) -> None:
    """Write the indices of each neighbour's azimuth bin and elevation bin to the first two rows of cell (3, k)."""
    px, py, pz = points[own, 0], points[own, 1], points[own, 2]
    x0, x1, x2 = frame[0, 0], frame[0, 1], frame[0, 2]
    y0, y1, y2 = frame[1, 0], frame[1, 1], frame[1, 2]
    z0, z1, z2 = frame[2, 0], frame[2, 1], frame[2, 2]
    per_turn, per_half = np.float32(azimuths) / _TWO_PI, np.float32(elevations) / PI
    for m in range(len(near)):
        q = np.uint32(near[m])
        dx, dy, dz = points[q, 0] - px, points[q, 1] - py, points[q, 2] - pz
        x, y, z = dx * x0 + dy * x1 + dz * x2, dx * y0 + dy * y1 + dz * y2, dx * z0 + dy * z1 + dz * z2
        azimuth = angle_of(y, x)
        azimuth += _TWO_PI if azimuth < ZERO else ZERO
        cell[0, m] = min(np.int32(azimuth * per_turn), np.int32(azimuths - 1))
        cell[1, m] = min(np.int32(angle_of(np.sqrt(x * x + y * y), z) * per_half), np.int32(elevations - 1))


@njit(cache=True, error_model="numpy")
def _shells(away2: np.ndarray, inner: np.ndarray, shell: np.ndarray) -> None:
    """Fill the first entries of ``shell`` with the number of each neighbour's shell."""
    shell[: len(away2)] = 0
    for edge in inner:
        edge2 = edge * edge
        for m in range(len(away2)):
            shell[m] += np.int32(away2[m] > edge2)
