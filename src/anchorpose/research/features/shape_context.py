"""3D shape contexts: how dense the points are in the cells of a sphere, narrower towards its centre.

Sources: Frome, Huber, Kolluri, Buelow, Malik 2004 (doi:10.1007/978-3-540-24672-5_18), cells and weights as in PCL 1.13.
Where azimuth begins, the paper leaves open and compares every turn; one repeatable frame for each node makes it unique:
Tombari, Salti, Di Stefano 2010b (doi:10.1145/1877808.1877821).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.research.features.circle import PI, ZERO, angle_of
from anchorpose.research.features.local_frame import as_frames, local_frames
from anchorpose.research.features.neighbours import (
    Neighbours,
    as_points,
    count_within,
    require_radius,
    shared_or_found,
)

_TWO_PI = np.float32(2 * np.pi)
PARALLEL = 1e-3  # sine; an x axis this near to the normal has no direction in the tangent plane


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeContextConfig:
    """1980 numbers, unless the cells are other ones; ``cells`` tells how many."""

    radius_m: float = 0.20  # a limb with its edges: nearer, the body is a smooth sheet everywhere
    innermost: float = 0.1  # of the radius: the outer end of the first shell; what is nearer counts there too
    density: float = 0.2  # of the radius: within it a point's neighbours share its weight
    azimuths: int = 12  # the numbers of PCL, and of the paper's own experiments
    elevations: int = 11
    shells: int = 15

    def __post_init__(self) -> None:
        require_radius(self.radius_m)
        if not 0.0 < self.innermost < 1.0:
            raise ValueError(f"innermost must be between 0 and 1, got {self.innermost}")
        if not self.density > 0.0:
            raise ValueError(f"density must be positive, got {self.density}")
        for name in ("azimuths", "elevations", "shells"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")

    @property
    def cells(self) -> int:
        return self.azimuths * self.elevations * self.shells


def shape_context(
    points_m: np.ndarray,
    normals: np.ndarray,
    config: ShapeContextConfig | None = None,
    chosen: np.ndarray | None = None,
    neighbours: Neighbours | None = None,
    frames: np.ndarray | None = None,
) -> np.ndarray:
    """(k, 1980) float32 for the chosen nodes (k,) int, or for all (None): weighed points in each cell, 1 / m.

    points_m, normals (n, 3) in one frame, normals of unit length; NaN where not known. A point weighs one by how many
    there are around it and by the cube root of its cell's volume. neighbours: those of the chosen nodes within
    ``radius_m``, and frames (k, 3, 3): rows x, y, z, where a caller has them; otherwise ``tangent_frames``. Column:
    azimuth from x, then elevation from z down, then shell outwards, the last running fastest. NaN row: no frame.
    """
    config = config or ShapeContextConfig()
    points, unit = as_points(points_m, "points_m"), as_points(normals, "normals")
    if len(points) != len(unit):
        raise ValueError(f"{len(points)} points, but {len(unit)} normals")
    near = shared_or_found(neighbours, points, config.radius_m, chosen)
    frames = as_frames(tangent_frames(points, unit, near) if frames is None else frames, len(near))
    density = count_within(points, config.density * config.radius_m)
    edges = config.radius_m * np.geomspace(config.innermost, 1.0, config.shells + 1)
    weights = _cell_weights(edges, config)
    inner = edges[1:-1].astype(np.float32)
    row = (near.centre, near.start, near.node, near.distance2_m2)
    return _contexts(points, *row, frames, density, inner, weights, config.azimuths)


def tangent_frames(points_m: np.ndarray, normals: np.ndarray, neighbours: Neighbours) -> np.ndarray:
    """(k, 3, 3) float32: z is the centre's normal (n, 3), x the x axis of ``local_frames`` laid into the tangent plane.

    NaN where the centre has no normal or the axis has no direction there.
    """
    z = as_points(normals, "normals")[neighbours.centre].astype(np.float64)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    axis = local_frames(points_m, neighbours)[:, 0].astype(np.float64)
    x = axis - (axis * z).sum(axis=1, keepdims=True) * z
    length = np.linalg.norm(x, axis=1, keepdims=True)
    x = np.where(length > PARALLEL, x / np.where(length > PARALLEL, length, 1.0), np.nan)
    return np.stack([x, np.cross(z, x), np.where(np.isnan(x), np.nan, z)], axis=1).astype(np.float32)


def _cell_weights(edges: np.ndarray, config: ShapeContextConfig) -> np.ndarray:
    """(elevations, shells) float32: one by the cube root of a cell's volume, 1 / m."""
    sink = -np.diff(np.cos(np.linspace(0.0, np.pi, config.elevations + 1)))
    volume = 2 * np.pi / config.azimuths * sink[:, None] * (np.diff(edges**3) / 3.0)
    return (volume ** (-1.0 / 3.0)).astype(np.float32)


@njit(cache=True, error_model="numpy")
def _contexts(
    points: np.ndarray, centre: np.ndarray, start: np.ndarray, node: np.ndarray, distance2: np.ndarray,
    frames: np.ndarray, density: np.ndarray, inner: np.ndarray, weights: np.ndarray,
    azimuths: int,
) -> np.ndarray:  # fmt: skip
    elevations, shells = weights.shape
    result = np.zeros((len(centre), azimuths * elevations * shells), np.float32)
    most = 1
    for c in range(len(centre)):
        most = max(most, start[c + 1] - start[c])
    cell = np.empty((3, most), np.int32)
    for c in range(len(centre)):
        if not np.isfinite(frames[c, 0, 0] + frames[c, 2, 0]):
            result[c] = np.nan
            continue
        near = node[start[c] : start[c + 1]]
        away2 = distance2[start[c] : start[c + 1]]
        _locate(points, centre[c], near, away2, frames[c], inner, azimuths, elevations, cell)
        for m in range(len(near)):
            if away2[m] > ZERO:
                spot = (cell[0, m] * elevations + cell[1, m]) * shells + cell[2, m]
                result[c, spot] += weights[cell[1, m], cell[2, m]] / density[near[m]]
    return result


@njit(cache=True, error_model="numpy")
def _locate(
    points: np.ndarray, own: int, near: np.ndarray, away2: np.ndarray, frame: np.ndarray, inner: np.ndarray,
    azimuths: int, elevations: int, cell: np.ndarray,
) -> None:  # fmt: skip
    """The cell of each neighbour: azimuth, elevation and shell."""
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
        cell[2, m] = 0
    for edge in inner:
        edge2 = edge * edge
        for m in range(len(near)):
            cell[2, m] += np.int32(away2[m] > edge2)
