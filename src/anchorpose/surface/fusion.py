"""Several cameras' meshes as one surface: one sheet where they see the same skin, sewn where one ends.

Of two nodes on the same skin the one goes that its camera sees less squarely or from farther off. A border of two rings
stays, and there every node is linked to the corners of the other camera's cell that it falls into.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.links import add_links, into_camera, pinhole
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import ExpectedSkin, Surface, way_over_skin


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionConfig:
    """When two nodes of two cameras are the same skin."""

    max_apart_m: float = 0.03  # calibration to about 1 cm, plus half a mesh cell seen slantwise
    max_off_plane_m: float = 0.015  # along the normal: clothes and noise; an arm before the trunk is farther
    max_turn_deg: float = 60.0  # cameras 45 degrees apart see normals of the same skin turned by noise only
    max_way_m: float = 0.09  # on the body: a thigh against the other is farther, skin points 3 cm apart blur less

    def __post_init__(self) -> None:
        for name in ("max_apart_m", "max_off_plane_m", "max_way_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.max_turn_deg <= 180:
            raise ValueError(f"max_turn_deg must lie in (0, 180], got {self.max_turn_deg}")


def fuse(
    surfaces: Sequence[Surface], cameras: Sequence[Camera], expected: ExpectedSkin | None = None,
    config: FusionConfig | None = None,
) -> Surface:  # fmt: skip
    """One surface of all cameras' nodes, in the order given, without those that another camera sees better.

    surfaces: one a camera, each in the world frame, as from ``build_surface``. ``camera`` of the result counts through
    the arguments. expected: what the ``skin`` of the surfaces counts through; nodes that show skin far apart on the
    body are never the same.
    """
    config = config or FusionConfig()
    if len(surfaces) != len(cameras) or len(surfaces) == 0:
        raise ValueError(f"{len(surfaces)} surfaces for {len(cameras)} cameras")
    if len(surfaces) == 1:
        return surfaces[0]
    if expected is None and any((surface.skin >= 0).any() for surface in surfaces):
        raise ValueError("the surfaces show skin, but which was expected is not given")
    first = np.concatenate([[0], np.cumsum([len(surface) for surface in surfaces])])
    both = _side_by_side(surfaces, first)
    landmarks = np.zeros((1, 1), np.float32) if expected is None else expected.map.landmarks_m
    dropped = np.zeros(len(both), np.bool_)
    inner = _inner(both.ring)
    pairs = [
        _same_skin(
            both, inner, slice(first[source], first[source + 1]), slice(first[target], first[target + 1]),
            cameras[source], camera, landmarks, dropped, config,
        )
        for target, camera in enumerate(cameras) for source in range(len(surfaces)) if source != target
    ]  # fmt: skip
    stay = _with_border(both.ring, dropped)
    sewn, length = _seam(both.points_m, np.concatenate(pairs), stay)
    start, node, length_m = add_links(both, sewn, length, len(both))
    linked = replace(both, link_start=start, link_node=node, link_length_m=length_m)
    return keep_nodes(linked, stay)


def _side_by_side(surfaces: Sequence[Surface], first: np.ndarray) -> Surface:
    """All nodes, each surface's own links, nothing between the cameras."""
    return Surface(
        points_m=np.concatenate([surface.points_m for surface in surfaces]),
        normals=np.concatenate([surface.normals for surface in surfaces]),
        ring=np.concatenate(
            [np.where(s.ring >= 0, s.ring + first[k], -1).astype(np.int32) for k, s in enumerate(surfaces)]
        ),
        link_start=np.concatenate(
            [[0], *(s.link_start[1:] + sum(len(o.link_node) for o in surfaces[:k]) for k, s in enumerate(surfaces))]
        ).astype(np.int32),
        link_node=np.concatenate([s.link_node + first[k] for k, s in enumerate(surfaces)]).astype(np.int32),
        link_length_m=np.concatenate([surface.link_length_m for surface in surfaces]),
        camera=np.repeat(np.arange(len(surfaces), dtype=np.uint8), np.diff(first)),
        pixel=np.concatenate([surface.pixel for surface in surfaces]),
        skin=np.concatenate([surface.skin for surface in surfaces]),
    )


def _same_skin(
    both: Surface, inner: np.ndarray, source: slice, target: slice, seen_by: Camera, camera: Camera,
    landmarks: np.ndarray, dropped: np.ndarray, config: FusionConfig,
) -> np.ndarray:  # fmt: skip
    """(m, 2) int32 pairs: each node of the source with the corners of the target's cell that it falls into.

    Marks in ``dropped`` the nodes of the source that the target's camera sees better.
    """
    if source.start == source.stop or target.start == target.stop:
        return np.empty((0, 2), np.int32)
    step = _grid_step(both.ring[target], both.pixel, target.start)
    grid = np.full((-(-camera.height // step), -(-camera.width // step)), -1, np.int32)
    grid[both.pixel[target, 0] // step, both.pixel[target, 1] // step] = np.arange(target.start, target.stop)
    return _pair_corners(
        both.points_m, both.normals, inner, both.skin, source.start, source.stop, grid, step, *pinhole(camera),
        seen_by.position_m.astype(np.float32),
        camera.position_m.astype(np.float32), landmarks, dropped, np.float32(config.max_apart_m),
        np.float32(config.max_off_plane_m), np.float32(np.cos(np.radians(config.max_turn_deg))),
        np.float32(config.max_way_m),
    )  # fmt: skip


def _grid_step(ring: np.ndarray, pixel: np.ndarray, first: int) -> int:
    """Pixels between neighbours on the grid the surface was made from."""
    east = np.flatnonzero(ring[:, 0] >= 0)
    if len(east) == 0:
        return 1
    return int(pixel[ring[east[0], 0], 1] - pixel[first + east[0], 1])


@njit(cache=True)
def _inner(ring: np.ndarray) -> np.ndarray:
    """(n,) bool: nodes with a whole ring."""
    inner = np.ones(len(ring), np.bool_)
    for n in range(len(ring)):
        for k in range(8):
            inner[n] &= ring[n, k] >= 0
    return inner


@njit(cache=True)
def _with_border(ring: np.ndarray, dropped: np.ndarray) -> np.ndarray:
    """(n,) bool: what stays: nodes that are not dropped, and two rings around them to sew them on to."""
    stay = ~dropped
    for _ in range(2):
        before = stay.copy()
        for n in range(len(ring)):
            for k in range(8):
                stay[n] |= ring[n, k] >= 0 and before[ring[n, k]]
    return stay


@njit(cache=True)
def _seam(points: np.ndarray, pairs: np.ndarray, stay: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2) int32 the pairs of which both stay, and (m,) float32 how far they are apart."""
    sewn, length = np.empty_like(pairs), np.empty(len(pairs), np.float32)
    count = 0
    for e in range(len(pairs)):
        p, q = pairs[e, 0], pairs[e, 1]
        if stay[p] and stay[q]:
            squared = np.float32(0.0)
            for axis in range(3):
                squared += (points[p, axis] - points[q, axis]) ** 2
            sewn[count, 0], sewn[count, 1], length[count] = p, q, np.sqrt(squared)
            count += 1
    return sewn[:count], length[:count]


@njit(cache=True)
def _pair_corners(
    points: np.ndarray, normals: np.ndarray, inner: np.ndarray, shown: np.ndarray, begin: int, end: int,
    grid: np.ndarray, step: int, T_camera_world: np.ndarray, lens: np.ndarray, seen_from: np.ndarray,
    other_from: np.ndarray, landmarks: np.ndarray, dropped: np.ndarray, max_apart: np.float32,
    max_off_plane: np.float32, min_cosine: np.float32, max_way: np.float32,
) -> np.ndarray:  # fmt: skip
    rows, cols = grid.shape
    pairs = np.empty((4 * (end - begin), 2), np.int32)
    count = 0
    for p in range(begin, end):
        high, left, _ = into_camera(T_camera_world, lens, points, p)
        high, left = high / step, left / step
        if not (-1.0 <= high <= rows and -1.0 <= left <= cols):
            continue
        row, col = int(np.floor(high)), int(np.floor(left))
        whole, corners = True, 0
        for i in range(row, row + 2):
            for j in range(col, col + 2):
                if not (0 <= i < rows and 0 <= j < cols) or grid[i, j] < 0:
                    whole = False
                    continue
                q = grid[i, j]
                if not _one_skin(points, normals, p, q, max_apart, max_off_plane, min_cosine) or (
                    shown[p] >= 0
                    and shown[q] >= 0
                    and shown[p] != shown[q]
                    and way_over_skin(landmarks, shown[p], shown[q]) > max_way
                ):
                    whole = False
                    continue
                pairs[count, 0], pairs[count, 1] = p, q
                count += 1
                corners += 1
                whole = whole and inner[q]
        if whole and corners == 4:
            q = pairs[count - 1, 1]
            here = _squareness(points, normals, p, q, seen_from)
            there = _squareness(points, normals, p, q, other_from)
            dropped[p] = dropped[p] or there > here
    return pairs[:count].copy()


@njit(cache=True)
def _one_skin(
    points: np.ndarray,
    normals: np.ndarray,
    p: int,
    q: int,
    max_apart: np.float32,
    max_off_plane: np.float32,
    min_cosine: np.float32,
) -> bool:
    apart2, cosine, off_p, off_q = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        cosine += normals[p, axis] * normals[q, axis]
        off_p += gap * normals[p, axis]
        off_q += gap * normals[q, axis]
    near = apart2 <= max_apart * max_apart and abs(off_p) <= max_off_plane and abs(off_q) <= max_off_plane
    return bool(near and cosine >= min_cosine)


@njit(cache=True)
def _squareness(points: np.ndarray, normals: np.ndarray, p: int, q: int, position: np.ndarray) -> np.float32:
    """Readings that a camera has for each square metre of the skin at p and q, up to a constant."""
    along, away2 = np.float32(0), np.float32(0)
    for axis in range(3):
        sight = position[axis] - points[p, axis]
        along += sight * (normals[p, axis] + normals[q, axis])
        away2 += sight * sight
    return along / (away2 * np.sqrt(away2))
