"""Several cameras' meshes as one surface, linked where they see the same skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.surface.mesh import compress_links, links, straight_m
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionConfig:
    """When two nodes of two cameras are the same skin."""

    max_apart_m: float = 0.03  # calibration to about 1 cm, plus half a mesh cell seen slantwise
    max_off_plane_m: float = 0.015  # along the normal: clothes and noise; an arm before the trunk is farther
    max_turn_deg: float = 60.0  # cameras 45 degrees apart see normals of the same skin turned by noise only

    def __post_init__(self) -> None:
        for name in ("max_apart_m", "max_off_plane_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.max_turn_deg <= 180:
            raise ValueError(f"max_turn_deg must lie in (0, 180], got {self.max_turn_deg}")


def fuse(surfaces: Sequence[Surface], cameras: Sequence[Camera], config: FusionConfig | None = None) -> Surface:
    """One surface of all cameras' nodes, in the order given; links join nodes that see the same skin.

    surfaces: one a camera, each in the world frame, as from ``build_surface``. ``camera`` of the result counts through
    the arguments. A node is projected into every other camera and linked to the nearest node of the grid there, when
    that lies close enough, in its tangent plane, with a normal that agrees.
    """
    config = config or FusionConfig()
    if len(surfaces) != len(cameras) or len(surfaces) == 0:
        raise ValueError(f"{len(surfaces)} surfaces for {len(cameras)} cameras")
    if len(surfaces) == 1:
        return surfaces[0]
    first = np.concatenate([[0], np.cumsum([len(surface) for surface in surfaces])])
    points = np.concatenate([surface.points_m for surface in surfaces])
    own = [links(surface) for surface in surfaces]
    pairs = [pair + first[k] for k, (pair, _) in enumerate(own)]
    lengths = [length for _, length in own]
    for target, camera in enumerate(cameras):
        for source in range(len(surfaces)):
            if source != target:
                found = _same_skin(surfaces[source], surfaces[target], camera, config)
                pairs.append(found + np.array([first[source], first[target]]))
                lengths.append(straight_m(points, pairs[-1]))
    start, node, length = compress_links(np.concatenate(pairs), np.concatenate(lengths), int(first[-1]))
    return Surface(
        points_m=points,
        normals=np.concatenate([surface.normals for surface in surfaces]),
        ring=np.concatenate(
            [np.where(s.ring >= 0, s.ring + first[k], -1).astype(np.int32) for k, s in enumerate(surfaces)]
        ),
        link_start=start,
        link_node=node,
        link_length_m=length,
        camera=np.repeat(np.arange(len(surfaces), dtype=np.uint8), np.diff(first)),
        pixel=np.concatenate([surface.pixel for surface in surfaces]),
    )


def _same_skin(source: Surface, target: Surface, camera: Camera, config: FusionConfig) -> np.ndarray:
    """(m, 2) int32 pairs (node of source, node of target): each source node with the nearest node around its pixel."""
    if len(source) == 0 or len(target) == 0:
        return np.empty((0, 2), np.int32)
    step = _grid_step(target)
    grid = np.full((-(-camera.height // step), -(-camera.width // step)), -1, np.int32)
    grid[target.pixel[:, 0] // step, target.pixel[:, 1] // step] = np.arange(len(target))
    pixel = camera.project(transform_points(invert_rigid(camera.require_pose()), source.points_m.astype(np.float64)))
    return _nearest_on_skin(
        pixel / step,
        grid,
        source.points_m,
        source.normals,
        target.points_m,
        target.normals,
        float(config.max_apart_m),
        float(config.max_off_plane_m),
        float(np.cos(np.radians(config.max_turn_deg))),
    )


def _grid_step(surface: Surface) -> int:
    """Pixels between neighbours on the grid the surface was made from."""
    node, place = np.nonzero(surface.ring[:, :1] >= 0)
    if len(node) == 0:
        return 1
    return int(surface.pixel[surface.ring[node[0], place[0]], 1] - surface.pixel[node[0], 1])


@njit(cache=True)
def _nearest_on_skin(
    cell: np.ndarray,
    grid: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    target_points: np.ndarray,
    target_normals: np.ndarray,
    max_apart: float,
    max_off_plane: float,
    min_cosine: float,
) -> np.ndarray:
    """cell (n, 2): where each source node falls on the target's grid, column and row, NaN behind the camera."""
    rows, cols = grid.shape
    pairs = np.empty((len(points), 2), np.int32)
    count = 0
    for node in range(len(points)):
        if not (-1.0 <= cell[node, 0] <= cols and -1.0 <= cell[node, 1] <= rows):
            continue
        row, col = int(np.rint(cell[node, 1])), int(np.rint(cell[node, 0]))
        best, nearest2 = -1, max_apart * max_apart
        for i in range(max(0, row - 1), min(rows, row + 2)):
            for j in range(max(0, col - 1), min(cols, col + 2)):
                if grid[i, j] >= 0:
                    apart2 = 0.0
                    for axis in range(3):
                        apart2 += (np.float64(target_points[grid[i, j], axis]) - points[node, axis]) ** 2
                    if apart2 <= nearest2:
                        best, nearest2 = grid[i, j], apart2
        if best < 0:
            continue
        cosine, off_source, off_target = 0.0, 0.0, 0.0
        for axis in range(3):
            gap = np.float64(target_points[best, axis]) - points[node, axis]
            cosine += normals[node, axis] * target_normals[best, axis]
            off_source += gap * normals[node, axis]
            off_target += gap * target_normals[best, axis]
        if cosine >= min_cosine and abs(off_source) <= max_off_plane and abs(off_target) <= max_off_plane:
            pairs[count, 0], pairs[count, 1] = node, best
            count += 1
    return pairs[:count].copy()
