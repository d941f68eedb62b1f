"""Several cameras' meshes as one surface, linked where they see the same skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.surface.mesh import compress_links, links
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
    pairs = [links(surface) + first[k] for k, surface in enumerate(surfaces)]
    for target, camera in enumerate(cameras):
        for source in range(len(surfaces)):
            if source != target:
                found = _same_skin(surfaces[source], surfaces[target], camera, config)
                pairs.append(found + [first[source], first[target]])
    start, node = compress_links(np.concatenate(pairs), int(first[-1]))
    return Surface(
        points_m=np.concatenate([surface.points_m for surface in surfaces]),
        normals=np.concatenate([surface.normals for surface in surfaces]),
        ring=np.concatenate(
            [np.where(s.ring >= 0, s.ring + first[k], -1).astype(np.int32) for k, s in enumerate(surfaces)]
        ),
        link_start=start,
        link_node=node,
        camera=np.repeat(np.arange(len(surfaces), dtype=np.uint8), np.diff(first)),
        pixel=np.concatenate([surface.pixel for surface in surfaces]),
    )


def _same_skin(source: Surface, target: Surface, camera: Camera, config: FusionConfig) -> np.ndarray:
    """(m, 2) pairs (node of source, node of target): each source node with the nearest of the target's grid around it."""
    if len(source) == 0 or len(target) == 0:
        return np.empty((0, 2), np.int64)
    step = _grid_step(target)
    grid = np.full((camera.height // step + 3, camera.width // step + 3), -1)
    grid[target.pixel[:, 0] // step + 1, target.pixel[:, 1] // step + 1] = np.arange(len(target))
    pixel = camera.project(transform_points(invert_rigid(camera.require_pose()), source.points_m.astype(np.float64)))
    cell = np.round(np.nan_to_num(pixel, nan=-1e6) / step).astype(np.int64)[:, ::-1] + 1
    inside = ((cell >= 1) & (cell < np.array(grid.shape) - 1)).all(axis=1)
    node = np.flatnonzero(inside)
    around = np.stack([grid[cell[node, 0] + i, cell[node, 1] + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=1)
    gap = target.points_m[around] - source.points_m[node, None]
    distance = np.where(around >= 0, np.linalg.norm(gap, axis=2), np.inf)
    best = distance.argmin(axis=1)
    row = np.arange(len(node))
    other, gap, distance = around[row, best], gap[row, best], distance[row, best]
    off_plane = np.maximum(
        np.abs((gap * source.normals[node]).sum(axis=1)), np.abs((gap * target.normals[other]).sum(axis=1))
    )
    agree = (source.normals[node] * target.normals[other]).sum(axis=1) >= np.cos(np.radians(config.max_turn_deg))
    same = (distance <= config.max_apart_m) & (off_plane <= config.max_off_plane_m) & agree
    return np.stack([node[same], other[same]], axis=1)


def _grid_step(surface: Surface) -> int:
    """Pixels between neighbours on the grid the surface was made from."""
    node, place = np.nonzero(surface.ring[:, :1] >= 0)
    if len(node) == 0:
        return 1
    return int(surface.pixel[surface.ring[node[0], place[0]], 1] - surface.pixel[node[0], 1])
