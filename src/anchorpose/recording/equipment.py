"""The model chi_0 of the equipment (paper, Section III): boxes, cylinders and meshes in its own frame Gamma_0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

CYLINDER_SIDES: Final = 32
"""Of the prism that a cylinder is drawn as: within half a per cent of its radius, less than a depth camera resolves."""

_BOX_CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_BOX_FACES: Final = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ],
    dtype=np.int32,
)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A cuboid: ``p = center_m + rotation @ local``, |local| <= size_m / 2 on each axis."""

    name: str
    center_m: np.ndarray  # (3,)
    size_m: np.ndarray  # (3,) full edge lengths
    rotation: np.ndarray  # (3, 3)

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (8, 3) float64 and faces (12, 3) int32, counter-clockwise seen from outside."""
        return self.center_m + (_BOX_CORNERS * self.size_m) @ self.rotation.T, _BOX_FACES

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return (n,) signed distance to the surface, exact; negative inside."""
        beyond = np.abs((points_m - self.center_m) @ self.rotation) - self.size_m / 2.0
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A solid tube with flat ends; ``center_m`` is the middle of its axis."""

    name: str
    center_m: np.ndarray  # (3,)
    axis: np.ndarray  # (3,) unit
    radius_m: float
    length_m: float

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (2 s + 2, 3) float64 and faces (4 s, 3) int32 with s = ``CYLINDER_SIDES``."""
        sideways = np.eye(3)[np.argmin(np.abs(self.axis))]
        u = np.cross(self.axis, sideways)
        u /= np.linalg.norm(u)
        v = np.cross(self.axis, u)
        angle = 2.0 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
        rim = self.radius_m * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
        half = self.axis * self.length_m / 2.0
        vertices = self.center_m + np.concatenate([rim - half, rim + half, [-half, half]])
        low, after = np.arange(CYLINDER_SIDES), (np.arange(CYLINDER_SIDES) + 1) % CYLINDER_SIDES
        high, high_after = low + CYLINDER_SIDES, after + CYLINDER_SIDES
        bottom, top = np.full_like(low, 2 * CYLINDER_SIDES), np.full_like(low, 2 * CYLINDER_SIDES + 1)
        rings = [(low, after, high_after), (low, high_after, high), (bottom, after, low), (top, high, high_after)]
        return vertices, np.concatenate([np.stack(ring, axis=1) for ring in rings]).astype(np.int32)

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return (n,) signed distance to the surface, exact; negative inside."""
        offset = points_m - self.center_m
        along = offset @ self.axis
        across = np.linalg.norm(offset - along[..., None] * self.axis, axis=-1)
        beyond = np.stack([across - self.radius_m, np.abs(along) - self.length_m / 2.0], axis=-1)
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of any shape; they need not enclose a volume."""

    name: str
    vertices_m: np.ndarray  # (v, 3) float64
    faces: np.ndarray  # (f, 3) int32

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (v, 3) float64 and faces (f, 3) int32."""
        return self.vertices_m, self.faces

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return (n,) distance to the nearest triangle, exact; never negative."""
        return mesh_distance_m(points_m, self.vertices_m, self.faces)


EquipmentPart = Box | Cylinder | Mesh


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentModel:
    """All parts of the equipment, in Gamma_0 (ISB axes, metres)."""

    parts: tuple[EquipmentPart, ...]

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all parts as one mesh: vertices (v, 3) float64 and faces (f, 3) int32."""
        vertices, faces, count = [], [], 0
        for part in self.parts:
            part_vertices, part_faces = part.triangles()
            vertices.append(part_vertices)
            faces.append(part_faces + count)
            count += len(part_vertices)
        return np.concatenate(vertices), np.concatenate(faces).astype(np.int32)

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return (n,) float64 distance of points (n, 3) in Gamma_0 to the nearest part's surface, exact.

        Negative inside a box or a cylinder; a mesh is a sheet, its distance is never negative. NaN where a point is.
        """
        points = np.asarray(points_m, dtype=np.float64)
        return np.min([part.distance_m(points) for part in self.parts], axis=0)


def mesh_distance_m(points_m: np.ndarray, vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (n,) float64 distance of each point (n, 3) to the nearest triangle; never negative: a mesh need not be
    closed.

    vertices_m (v, 3), faces (f, 3) indices. NaN where a point is NaN.
    Source: closest point on a triangle, Ericson, Real-Time Collision Detection (2005), Section 5.1.5. A sphere around
    each triangle skips those that cannot be nearest.
    """
    corners = np.ascontiguousarray(vertices_m[faces], dtype=np.float64)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    return _nearest(points, corners, centres, radii)


@numba.njit(cache=True)
def _nearest(points: np.ndarray, corners: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    distances = np.empty(len(points))
    for i in range(len(points)):
        best = np.inf
        for f in range(len(corners)):
            if np.sqrt(np.sum((points[i] - centres[f]) ** 2)) - radii[f] < best:
                best = min(best, _to_triangle(points[i], corners[f, 0], corners[f, 1], corners[f, 2]))
        distances[i] = best if np.isfinite(points[i].sum()) else np.nan
    return distances


@numba.njit(cache=True)
def _to_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2 = np.sum(ab * ap), np.sum(ac * ap)
    d3, d4 = np.sum(ab * bp), np.sum(ac * bp)
    d5, d6 = np.sum(ab * cp), np.sum(ac * cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0  # corner a
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0  # corner b
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0  # corner c
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / (d1 - d3), 0.0  # edge ab
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / (d2 - d6)  # edge ac
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))  # edge bc
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
    return np.sqrt(np.sum((ap - v * ab - w * ac) ** 2))
