"""Edges that the pixel grid does not have: between cameras, across bars, over hidden skin.

Points into a camera, inside compiled kernels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid
from anchorpose.surface.surface import Surface


def links(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """(l, 2) int32 every link once, the smaller index first, and (l,) float32 metres its length."""
    source = np.repeat(np.arange(len(surface), dtype=np.int32), np.diff(surface.link_start))
    once = source < surface.link_node
    return np.stack([source[once], surface.link_node[once]], axis=1), surface.link_length_m[once]


def straight_m(points_m: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(l,) float32: how far the nodes of each pair are apart."""
    length: np.ndarray = np.linalg.norm(points_m[pairs[:, 0]] - points_m[pairs[:, 1]], axis=1).astype(np.float32)
    return length


def compress_links(pairs: np.ndarray, length_m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected pairs (m, 2) with their lengths (m,) to compressed rows (link_start, link_node, link_length_m).

    Symmetric, each link once a side, rows in the order of the pairs; of a pair given twice the shorter length counts.
    """
    none = np.empty(0, np.int32)
    return _compress(
        np.zeros(1, np.int32), none, none.view(np.float32), pairs.astype(np.int32), length_m.astype(np.float32), count
    )


def add_links(
    surface: Surface, pairs: np.ndarray, length_m: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface's own links, and after them those of ``compress_links``, for count nodes, of which it may have fewer.

    pairs (m, 2) int32, length_m (m,) float32.
    """
    return _compress(surface.link_start, surface.link_node, surface.link_length_m, pairs, length_m, count)


@njit(cache=True)
def _compress(
    own_start: np.ndarray, own_node: np.ndarray, own_length: np.ndarray, pairs: np.ndarray, length: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """own_start (o + 1,) of the first o nodes, whose rows are as they should be."""
    owners = len(own_start) - 1
    room = np.zeros(count + 1, np.int32)
    for n in range(owners):
        room[n + 1] = own_start[n + 1] - own_start[n]
    for e in range(len(pairs)):
        room[pairs[e, 0] + 1] += 1
        room[pairs[e, 1] + 1] += 1
    for n in range(count):
        room[n + 1] += room[n]
    filled = room[:-1].copy()
    node, metres = np.empty(room[count], np.int32), np.empty(room[count], np.float32)
    for n in range(owners):
        for spot in range(own_start[n], own_start[n + 1]):
            node[filled[n]], metres[filled[n]] = own_node[spot], own_length[spot]
            filled[n] += 1
    for e in range(len(pairs)):
        for side in range(2):
            here = pairs[e, side]
            node[filled[here]], metres[filled[here]] = pairs[e, 1 - side], length[e]
            filled[here] += 1
    start, place = np.zeros(count + 1, np.int32), np.full(count, -1, np.int32)
    end = 0
    for n in range(count):  # close the gaps that pairs given twice leave; place: where each node stands in this row
        for spot in range(room[n], room[n + 1]):
            there, metre = node[spot], metres[spot]
            if place[there] < start[n]:
                place[there], node[end], metres[end] = end, there, metre
                end += 1
            else:
                metres[place[there]] = min(metres[place[there]], metre)
        start[n + 1] = end
    return start, node[:end].copy(), metres[:end].copy()


def pinhole(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """T_camera_world (4, 4) float32, and fx, fy, cx, cy (4,) float32."""
    lens = camera.intrinsics
    T_camera_world = invert_rigid(camera.require_pose()).astype(np.float32)
    return T_camera_world, np.array([lens.fx, lens.fy, lens.cx, lens.cy], np.float32)


@njit(cache=True)
def into_camera(
    T_camera_world: np.ndarray, lens: np.ndarray, points: np.ndarray, k: int
) -> tuple[np.float32, np.float32, np.float32]:
    """Row and column in pixels of one point, and its depth; NaN behind the camera."""
    x, y, z = T_camera_world[0, 3], T_camera_world[1, 3], T_camera_world[2, 3]
    for axis in range(3):
        x += T_camera_world[0, axis] * points[k, axis]
        y += T_camera_world[1, axis] * points[k, axis]
        z += T_camera_world[2, axis] * points[k, axis]
    if z <= 0.0:
        return np.float32(np.nan), np.float32(np.nan), z
    return lens[1] * y / z + lens[3], lens[0] * x / z + lens[2], z
