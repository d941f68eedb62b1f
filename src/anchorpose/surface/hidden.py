"""The skin that no camera sees closes the surface: behind a bar or an arm, in the armpits, on the back.

Expected skin is added where nothing was seen and nothing contradicts it, linked to the rim of what was seen. It is
inferred, never a measurement: with it geodesics run as they do on the body, and it shows whether a limb continues.
Registration, track tree and pictures of the patient use only what was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.links import add_links, pieces
from anchorpose.surface.pinhole import Pinhole, into_camera, pinhole
from anchorpose.surface.surface import HIDDEN_SKIN, ExpectedSkin, Surface

SEEN_THROUGH_M: Any = np.float32(0.05)  # a reading so far behind a skin point shows that no skin is there
STRETCH: Any = np.float32(0.98)  # paths over neighbours, and over their neighbours, are 2 % longer than straight ones


def add_hidden_skin(
    surface: Surface, expected: ExpectedSkin, depths_m: Sequence[np.ndarray], cameras: Sequence[Camera]
) -> Surface:
    """The surface with the hidden skin as further nodes, after the seen ones: no grid, all links.

    depths_m: every camera's whole depth frame (height, width) float32 metres, 0 = no reading. A skin point that no node
    shows and some camera sees through is left out. Nodes at the rim of what is seen are linked to the skin point that
    they show, which then becomes a node too, even if a camera sees through it: there the outline is predicted some
    pixels too wide.
    """
    body, first = expected.map, len(surface)
    absent = _seen_through(expected, depths_m, cameras)
    seen = Seen(surface.points_m, surface.skin, np.any(surface.ring < 0, axis=1), pieces(surface))
    place, shown = _place_hidden(seen, body.pairs, absent)
    added = np.flatnonzero(place >= 0)
    if len(added) == 0:
        return surface
    paths = Paths(expected.points_m, body.pairs, body.via, body.straight)
    pairs, length = _link_hidden(seen, paths, place, shown)
    start, node, length_m = add_links(surface, pairs, length, first + len(added))
    return Surface(
        points_m=np.concatenate([surface.points_m, expected.points_m[added]]),
        normals=np.concatenate([surface.normals, expected.normals[added]]),
        ring=np.concatenate([surface.ring, np.full((len(added), 8), -1, np.int32)]),
        link_start=start,
        link_node=node,
        link_length_m=length_m,
        camera=np.concatenate([surface.camera, np.full(len(added), HIDDEN_SKIN, np.uint8)]),
        pixel=np.concatenate([surface.pixel, np.full((len(added), 2), -1, np.int16)]),
        skin=np.concatenate([surface.skin, added.astype(np.int32)]),
    )


def _seen_through(expected: ExpectedSkin, depths_m: Sequence[np.ndarray], cameras: Sequence[Camera]) -> np.ndarray:
    """(k,) bool: skin points that are not there, for a camera sees what is behind them."""
    absent = np.zeros(len(expected.points_m), np.bool_)
    for depth, camera in zip(depths_m, cameras, strict=True):
        _mark_seen_through(expected.points_m, pinhole(camera), depth, absent)
    return absent


@njit(cache=True, nogil=True)
def _mark_seen_through(skin: np.ndarray, camera: Pinhole, depth: np.ndarray, absent: np.ndarray) -> None:
    """Mark in ``absent`` (k,) the skin points in front of what the camera reads."""
    for k in range(len(skin)):
        high, left, z = into_camera(camera, skin, k)
        if z <= 0.0:
            continue
        row, col = int(np.rint(high)), int(np.rint(left))
        if 0 <= row < depth.shape[0] and 0 <= col < depth.shape[1] and depth[row, col] > z + SEEN_THROUGH_M:
            absent[k] = True


class Seen(NamedTuple):
    """The seen nodes: points_m (n, 3) float32; skin (n,) int32: the skin point that each shows, -1 unknown; rim (n,)
    bool: without a whole ring; piece (n,) int32: the connected piece of mesh."""

    points_m: np.ndarray
    skin: np.ndarray
    rim: np.ndarray
    piece: np.ndarray


class Paths(NamedTuple):
    """Expected skin points_m (k, 3) float32 and the paths between neighbours among them, as in ``BodyMap``."""

    points_m: np.ndarray
    pairs: np.ndarray
    via: np.ndarray
    straight: np.ndarray


@njit(cache=True, nogil=True)
def _place_hidden(seen: Seen, pairs: np.ndarray, absent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """place (k,): the new node of each skin point, -1 for none; shown (k,): the piece of mesh that shows it, -1 none.

    A skin point that the mesh shows becomes a node next to hidden ones and where a rim shows it.
    """
    skin, first = seen.skin, len(seen.skin)
    shown = np.full(len(absent), -1, np.int32)
    inner = np.zeros(len(absent), np.bool_)
    wanted = np.zeros(len(absent), np.bool_)
    for n in range(len(skin)):
        if skin[n] < 0:
            continue
        rim = seen.rim[n]
        shown[skin[n]] = seen.piece[n]
        inner[skin[n]] = inner[skin[n]] or not rim
        wanted[skin[n]] = wanted[skin[n]] or rim
    for k in range(len(absent)):
        if not inner[k] and not wanted[k]:
            wanted[k] = not absent[k]
    for e in range(len(pairs)):
        a, b = pairs[e, 0], pairs[e, 1]
        if wanted[a] and not inner[a] and inner[b]:
            wanted[b] = True
        elif wanted[b] and not inner[b] and inner[a]:
            wanted[a] = True
    place = np.full(len(absent), -1, np.int32)
    for k in range(len(absent)):
        if wanted[k]:
            place[k] = first
            first += 1
        if not inner[k]:
            shown[k] = -1
    return place, shown


@njit(cache=True, nogil=True)
def _link_hidden(seen: Seen, paths: Paths, place: np.ndarray, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2) links among new nodes and from the rim to them; (m,) float32 their lengths.

    Between two that one piece of mesh shows there is none: the mesh leads from one to the other.
    """
    skin, skin_points, pairs, via = seen.skin, paths.points_m, paths.pairs, paths.via
    most = len(pairs) + len(skin)
    found, length = np.empty((most, 2), np.int32), np.empty(most, np.float32)
    count = 0
    for e in range(len(pairs)):
        a, b = pairs[e, 0], pairs[e, 1]
        if place[a] < 0 or place[b] < 0 or (shown[a] >= 0 and shown[a] == shown[b]):
            continue
        way = _apart(skin_points, np.int64(a), skin_points, b)
        if via[e] != a:
            way = _apart(skin_points, np.int64(a), skin_points, via[e])
            way += _apart(skin_points, np.int64(via[e]), skin_points, b)
        found[count, 0], found[count, 1], length[count] = place[a], place[b], STRETCH * paths.straight[e] * way
        count += 1
    for n in range(len(skin)):
        if seen.rim[n] and skin[n] >= 0 and place[skin[n]] >= 0:
            found[count, 0], found[count, 1] = n, place[skin[n]]
            length[count] = _apart(seen.points_m, n, skin_points, skin[n])
            count += 1
    return found[:count].copy(), length[:count].copy()


@njit(cache=True, nogil=True)
def _apart(points: np.ndarray, a: Any, others: np.ndarray, b: int) -> np.float32:
    squared = np.float32(0.0)
    for axis in range(3):
        squared += (points[a, axis] - others[b, axis]) ** 2
    return np.sqrt(squared)
