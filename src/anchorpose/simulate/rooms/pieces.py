"""Build furniture of boxes, cylinders and other meshes; each piece stands on the floor around its own origin."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.recording.equipment import Box, Cylinder, EquipmentPart
from anchorpose.rotations import RIGHT, UP, turns_about
from anchorpose.simulate.aids import build_stool
from anchorpose.simulate.rooms.free_meshes import crumpled_sheet, folded_curtain, hanging_coat, leaves, pillow
from anchorpose.simulate.rooms.plan import Clutter

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A piece of furniture, in axes with y up, the floor at y = 0, and the front towards +X."""

    triangles: np.ndarray  # (n, 3, 3) triangles of the surface, m
    shiny: np.ndarray  # (n,) bool, triangles of bare metal

    @property
    def radius_m(self) -> float:
        """Return the radius of the circle on the floor, around the origin, that contains the piece."""
        return float(np.linalg.norm(self.triangles[..., [0, 2]], axis=-1).max())

    @property
    def height_m(self) -> float:
        """Return the height of the top."""
        return float(self.triangles[..., 1].max())

    def placed(self, place_m: np.ndarray, yaw: float) -> Piece:
        """Return the piece turned to the left by ``yaw`` and moved to a place (x, z)."""
        turned = self.triangles @ turns_about(UP, np.array([yaw]))[0].T
        return Piece(turned + np.array([place_m[0], 0.0, place_m[1]]), self.shiny)


def piece_of(
    parts: Iterable[EquipmentPart], metal: Iterable[EquipmentPart] = (), sheets: np.ndarray | None = None
) -> Piece:
    """Make a piece from parts, parts of bare metal, and ``sheets``: triangles (n, 3, 3) of cloth, leaves and paper."""
    dull, bare = triangles_of(parts), triangles_of(metal)
    cloth = np.zeros((0, 3, 3)) if sheets is None else sheets
    triangles = np.concatenate([dull, cloth, bare])
    return Piece(triangles, np.arange(len(triangles)) >= len(dull) + len(cloth))


def triangles_of(parts: Iterable[EquipmentPart]) -> np.ndarray:
    """Return (n, 3, 3) all triangles of some parts."""
    found = [vertices[faces] for vertices, faces in (part.triangles() for part in parts)]
    return np.concatenate([np.zeros((0, 3, 3)), *found])


def box(center_m: Place, size_m: Place, yaw: float = 0.0) -> Box:
    """Return a cuboid turned to the left by ``yaw``."""
    return Box("", np.array(center_m), np.array(size_m), turns_about(UP, np.array([yaw]))[0])


def pole(center_m: Place, radius_m: float, length_m: float, axis: np.ndarray = UP) -> Cylinder:
    """Return a round tube."""
    return Cylinder("", np.array(center_m), axis, radius_m, length_m)


def table(rng: np.random.Generator) -> Piece:
    long_m, deep_m, high_m = rng.uniform(0.7, 1.5), rng.uniform(0.5, 0.8), rng.uniform(0.6, 0.78)
    things = [
        box(
            (rng.uniform(-0.2, 0.2) * deep_m, high_m + tall / 2.0, rng.uniform(-0.35, 0.35) * long_m), (0.2, tall, 0.25)
        )
        for tall in rng.uniform(0.03, 0.25, int(rng.integers(0, 3)))
    ]
    top = box((0.0, high_m - 0.015, 0.0), (deep_m, 0.03, long_m))
    return piece_of([top, *things], _legs(deep_m - 0.06, long_m - 0.06, high_m - 0.03, 0.02))


def chair(rng: np.random.Generator) -> Piece:
    seat_m, back_m = rng.uniform(0.42, 0.48), rng.uniform(0.8, 1.0)
    parts = [
        box((0.0, seat_m - 0.02, 0.0), (0.44, 0.04, 0.44)),
        box((-0.21, (seat_m + 0.15 + back_m) / 2.0, 0.0), (0.03, back_m - seat_m - 0.15, 0.42)),
        *(box((-0.21, (seat_m + back_m) / 2.0, z), (0.03, back_m - seat_m, 0.03)) for z in (-0.19, 0.19)),
    ]
    return piece_of(parts, _legs(0.4, 0.4, seat_m - 0.03, 0.015))


def stool(rng: np.random.Generator) -> Piece:
    return piece_of(build_stool(rng, (0.0, 0.0), rng.uniform(0.42, 0.6)))


def shelf(rng: np.random.Generator) -> Piece:
    long_m, deep_m, high_m = rng.uniform(0.6, 1.2), rng.uniform(0.25, 0.4), rng.uniform(1.0, 2.1)
    boards_m = np.linspace(0.05, high_m - 0.02, int(rng.integers(3, 6)))
    parts = [box((0.0, y, 0.0), (deep_m, 0.025, long_m)) for y in boards_m]
    parts += [box((0.0, high_m / 2.0, way * long_m / 2.0), (deep_m, high_m, 0.025)) for way in (-1.0, 1.0)]
    for y, gap_m in zip(boards_m[:-1], np.diff(boards_m), strict=True):
        for z in rng.uniform(-0.4, 0.4, int(rng.integers(0, 4))) * long_m:
            tall, wide = rng.uniform(0.3, 0.85) * gap_m, rng.uniform(0.04, 0.25)
            parts.append(box((rng.uniform(-0.05, 0.0), y + 0.0125 + tall / 2.0, z), (0.2, tall, wide)))
    return piece_of(parts)


def cupboard(rng: np.random.Generator) -> Piece:
    long_m, deep_m, high_m = rng.uniform(0.5, 1.3), rng.uniform(0.35, 0.6), rng.uniform(0.8, 2.0)
    parts = [box((0.0, high_m / 2.0, 0.0), (deep_m, high_m, long_m))]
    handles = [pole((deep_m / 2.0 + 0.03, 0.55 * high_m, z), 0.008, 0.2) for z in (-0.04, 0.04)]
    return piece_of(parts, handles)


def monitor(rng: np.random.Generator) -> Piece:
    high_m, wide_m = rng.uniform(1.1, 1.6), rng.uniform(0.4, 1.1)
    tall_m = 0.6 * wide_m
    screen = box((0.04, high_m, 0.0), (0.05, tall_m, wide_m), rng.uniform(-0.3, 0.3))
    feet = [box((0.0, 0.04, 0.0), (0.5, 0.04, 0.08)), box((0.0, 0.04, 0.0), (0.08, 0.04, 0.5))]
    return piece_of([screen, *feet], [pole((0.0, high_m / 2.0, 0.0), 0.025, high_m)])


def boxes(rng: np.random.Generator) -> Piece:
    parts, top_m = [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform(0.22, 0.45, 3)
        if top_m + size[1] > 0.85:
            break
        parts.append(
            box(
                (rng.uniform(-0.04, 0.04), top_m + size[1] / 2.0, rng.uniform(-0.04, 0.04)),
                tuple(size),
                rng.uniform(0, 1.5),
            )
        )
        top_m += size[1]
    return piece_of(parts)


def plant(rng: np.random.Generator) -> Piece:
    pot_m, high_m = rng.uniform(0.25, 0.4), rng.uniform(0.8, 1.7)
    trunk = pole((0.0, (pot_m + high_m) / 2.0, 0.0), 0.015, high_m - pot_m)
    return piece_of([pole((0.0, pot_m / 2.0, 0.0), 0.16, pot_m), trunk], (), leaves(rng, pot_m + 0.1, high_m))


def coat_rack(rng: np.random.Generator) -> Piece:
    high_m = rng.uniform(1.6, 1.85)
    coats = [hanging_coat(rng, high_m - 0.12, way) for way in rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(1, 4)))]
    base = [pole((0.0, 0.02, 0.0), 0.22, 0.04)]
    return piece_of(base, [pole((0.0, high_m / 2.0, 0.0), 0.02, high_m)], np.concatenate(coats))


def bed(rng: np.random.Generator) -> Piece:
    high_m, wide_m = rng.uniform(0.45, 0.7), rng.uniform(0.8, 0.95)
    parts = [
        box((0.0, high_m - 0.08, 0.0), (wide_m, 0.16, 2.0)),
        *(box((0.0, high_m, z), (wide_m, 0.5, 0.03)) for z in (-1.0, 1.0)),
    ]
    quilt = crumpled_sheet(rng, wide_m, 1.3) + np.array([0.0, high_m + 0.02, 0.25])
    head = pillow(rng) + np.array([0.0, high_m, -0.7])
    rail = [pole((wide_m / 2.0, high_m + 0.2, 0.0), 0.015, 1.2, RIGHT)]
    return piece_of(parts, [*rail, *_legs(wide_m - 0.1, 1.8, high_m - 0.16, 0.025)], np.concatenate([quilt, head]))


def curtain(rng: np.random.Generator) -> Piece:
    wide_m = rng.uniform(0.8, 2.0)
    return piece_of([pole((0.0, 2.15, 0.0), 0.012, wide_m + 0.1, RIGHT)], (), folded_curtain(rng, wide_m, 2.12))


def wheelchair(rng: np.random.Generator) -> Piece:
    seat_m, half_m = rng.uniform(0.46, 0.52), rng.uniform(0.2, 0.25)
    cloth = [
        box((0.0, seat_m, 0.0), (0.42, 0.04, 2.0 * half_m)),
        box((-0.21, seat_m + 0.22, 0.0), (0.03, 0.42, 2.0 * half_m)),
    ]
    metal: list[EquipmentPart] = []
    for z in (-half_m - 0.03, half_m + 0.03):
        cloth.append(box((0.0, seat_m + 0.22, z), (0.3, 0.03, 0.05)))
        metal += [pole((-0.13, 0.3, z), 0.3, 0.03, RIGHT), pole((0.17, 0.08, z), 0.08, 0.03, RIGHT)]
        metal += [pole((-0.22, 0.5 * seat_m + 0.28, z), 0.015, seat_m + 0.4), box((-0.29, 0.93, z), (0.12, 0.03, 0.03))]
        metal.append(box((0.3, 0.12, 0.6 * z), (0.16, 0.02, 0.12)))
    return piece_of(cloth, metal)


def _legs(deep_m: float, long_m: float, high_m: float, radius_m: float) -> list[Cylinder]:
    return [
        pole((x * deep_m / 2.0, high_m / 2.0, z * long_m / 2.0), radius_m, high_m)
        for x in (-1.0, 1.0)
        for z in (-1.0, 1.0)
    ]


PIECES: Final[dict[Clutter, Callable[[np.random.Generator], Piece]]] = {
    "table": table,
    "chair": chair,
    "stool": stool,
    "shelf": shelf,
    "cupboard": cupboard,
    "monitor": monitor,
    "boxes": boxes,
    "plant": plant,
    "coat-rack": coat_rack,
    "bed": bed,
    "curtain": curtain,
    "wheelchair": wheelchair,
}
AT_WALLS: Final[tuple[Clutter, ...]] = ("shelf", "cupboard", "bed", "curtain")
"""Furniture that stands with its back to a wall."""
