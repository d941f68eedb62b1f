"""The equipment model chi_0, prepared once for all cameras: points on its surface and just outside, its symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.calibration.equipment_render import EquipmentCaster
from anchorpose.camera import transform_points
from anchorpose.recording.equipment import EquipmentModel, Mesh

SURFACE_POINTS: Final = 2000  # one per 10 cm^2 of a standing frame's 2 m^2
LEAST_PER_PART: Final = 24  # a small part may be what distinguishes front from back
OUTSIDE_POINTS: Final = 1000
OUTSIDE_M: Final = (0.05, 0.09)  # beyond flying pixels, near enough that a wall behind would fill it
SEED: Final = 0

STEP_DEG: Final = 5
SAME_M: Final = 0.012  # as far as a part may be from its place in equipment.json
ALIKE_M: Final = 0.10  # near enough to be mistaken in a search
TRIED_POINTS: Final = 400
ROUND_SHARE: Final = 0.9  # of all turns


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentSamples:
    """Points of chi_0, all in Gamma_0.

    surface_m (n, 3) float64 spread evenly, none inside another part; normal (n, 3) unit, outward; two_sided (n,) bool:
    of a mesh, whose triangles may face either way; outside_m (m, 3) within ``OUTSIDE_M`` of the surface, where nothing
    of the equipment is; centre_m (3,) and radius_m of a sphere around all of it.
    """

    surface_m: np.ndarray
    normal: np.ndarray
    two_sided: np.ndarray
    outside_m: np.ndarray
    centre_m: np.ndarray
    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """Turns about a vertical axis, each T_model_model (4, 4), the identity left out.

    same: chi_0 coincides with itself within ``SAME_M``; alike: nearly; round: so many turns that its direction means
    nothing.
    """

    same: tuple[np.ndarray, ...]
    alike: tuple[np.ndarray, ...]
    round: bool


@dataclass(frozen=True, slots=True, eq=False)
class Equipment:
    """chi_0, prepared once for all cameras."""

    model: EquipmentModel
    samples: EquipmentSamples
    caster: EquipmentCaster
    symmetry: Symmetry

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parts."""
        return tuple(part.name for part in self.model.parts)


def prepare_equipment(model: EquipmentModel) -> Equipment:
    """Everything that depends on chi_0 alone."""
    samples = sample_equipment(model)
    return Equipment(model, samples, EquipmentCaster(model), find_symmetry(model, samples))


def sample_equipment(model: EquipmentModel) -> EquipmentSamples:
    """The same points for the same model, every time."""
    rng = np.random.default_rng(SEED)
    corners = [vertices[faces] for vertices, faces in (part.triangles() for part in model.parts)]
    areas = [_areas(part_corners).sum() for part_corners in corners]
    surface, normal, two_sided = [], [], []
    for part, part_corners, area in zip(model.parts, corners, areas, strict=True):
        count = max(LEAST_PER_PART, round(SURFACE_POINTS * area / sum(areas)))
        points, normals = _on_triangles(part_corners, count, rng)
        others = [other for other in model.parts if other is not part and not isinstance(other, Mesh)]
        free = np.all([other.distance_m(points) > -1e-3 for other in others], axis=0) if others else np.ones(1, bool)
        free = np.broadcast_to(free, len(points))
        surface.append(points[free])
        normal.append(normals[free])
        two_sided.append(np.full(int(free.sum()), isinstance(part, Mesh)))
    points = np.concatenate(surface)
    low, high = points.min(axis=0), points.max(axis=0)
    return EquipmentSamples(
        surface_m=points,
        normal=np.concatenate(normal),
        two_sided=np.concatenate(two_sided),
        outside_m=_outside(model, points, rng),
        centre_m=(low + high) / 2.0,
        radius_m=float(np.linalg.norm(high - low) / 2.0),
    )


def _areas(corners_m: np.ndarray) -> np.ndarray:
    edges = corners_m[:, 1:] - corners_m[:, :1]
    area: np.ndarray = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2.0
    return area


def _on_triangles(corners_m: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (count, 3) spread evenly over triangles (f, 3, 3), and the normals there."""
    area = _areas(corners_m)
    place = (np.arange(count) + rng.random(count)) / count  # stratified: no part is left bare by chance
    chosen = np.minimum(np.searchsorted(np.cumsum(area) / area.sum(), place), len(area) - 1)
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    a, b, c = corners_m[chosen].transpose(1, 0, 2)
    points = (1 - u)[:, None] * a + (u * (1 - v))[:, None] * b + (u * v)[:, None] * c
    normal = np.cross(b - a, c - a)
    return points, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _outside(model: EquipmentModel, surface_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    near, far = OUTSIDE_M
    offset = rng.normal(size=(4 * OUTSIDE_POINTS, 3))
    offset *= rng.uniform(near, far, (len(offset), 1)) / np.linalg.norm(offset, axis=1, keepdims=True)
    points = surface_m[rng.integers(0, len(surface_m), len(offset))] + offset
    return points[model.distance_m(points) > near][:OUTSIDE_POINTS]


def find_symmetry(model: EquipmentModel, samples: EquipmentSamples) -> Symmetry:
    """Tries every turn in steps of ``STEP_DEG`` about two centres, of the bounding box and of the surface.

    Any symmetry leaves both in place, but a model that mixes round and square tubes shifts the second.
    """
    points = samples.surface_m[:: max(1, len(samples.surface_m) // TRIED_POINTS)]
    same, alike, apart = list[np.ndarray](), list[np.ndarray](), list[float]()
    turns = []
    for degrees in range(STEP_DEG, 360, STEP_DEG):
        tried = [
            _turn_about(centre, np.radians(degrees)) for centre in (samples.centre_m, samples.surface_m.mean(axis=0))
        ]
        off = [float(np.quantile(np.abs(model.distance_m(transform_points(T, points))), 0.95)) for T in tried]
        turns.append(tried[int(np.argmin(off))])
        apart.append(min(off))
    around = np.array([np.inf, *apart, np.inf])
    for index in range(1, len(turns) - 1):  # turns next to the identity are not distinct from it
        if around[index + 1] > min(around[index], around[index + 2]):
            continue
        if apart[index] < SAME_M:
            same.append(turns[index])
        elif apart[index] < ALIKE_M:
            alike.append(turns[index])
    is_round = np.mean(np.array(apart) < SAME_M) > ROUND_SHARE
    return Symmetry(tuple(same), tuple(alike), bool(is_round))


def _turn_about(centre_m: np.ndarray, angle_rad: float) -> np.ndarray:
    """(4, 4) turn about the vertical (Y) through a point."""
    T = np.eye(4)
    T[:3, :3] = rotation_about_y(angle_rad)
    T[:3, 3] = centre_m - T[:3, :3] @ centre_m
    return T


def rotation_about_y(angle_rad: float) -> np.ndarray:
    """(3, 3) right-handed."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
