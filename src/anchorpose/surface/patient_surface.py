"""Turn one frame's labelled depth images into the patient's surface: mesh each image, cut the mesh where body parts
touch, fuse the meshes of all cameras, and add hidden (predicted) skin.

If two cameras have nodes on the same skin, the nodes of the camera with fewer readings per area of skin are dropped,
since this camera sees the skin at a slant or from farther away. Nodes within two grid steps of the kept nodes are not
dropped but stay as a border; each node of the border is linked to the four corners of the other camera's grid cell in
which it lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.contacts import cut_contacts
from anchorpose.surface.hidden import Pinhole, add_hidden_skin, assign_skin, find_ambiguous_skin, into_camera, pinhole
from anchorpose.surface.joins import join_pieces, join_rest
from anchorpose.surface.links import add_links
from anchorpose.surface.mesh import build_surface, keep_nodes
from anchorpose.surface.surface import ExpectedSkin, Surface, SurfaceConfig, geodesic_lower_bound
from anchorpose.threads import each

# m, maximum distance along the normal between two cameras' nodes on the same skin, due to clothes and noise. The skin
# of an arm that lies on the trunk is farther than this from the skin of the trunk, so the two are not taken for the
# same skin
MAX_OFF_PLANE_M: Any = np.float32(0.015)
# degrees, maximum angle between the normals that two cameras measure on the same skin, due to noise
MAX_TURN_DEG: Final = 60.0
MIN_COSINE: Any = np.float32(np.cos(np.radians(MAX_TURN_DEG)))
# m along the body, maximum distance between the skin points of two nodes on the same skin. The limit allows for the
# spacing of skin points; skin points of two thighs are farther apart than this
MAX_ON_BODY_M: Any = np.float32(0.09)


def fuse(
    surfaces: Sequence[Surface],
    cameras: Sequence[Camera],
    expected: ExpectedSkin | None = None,
    config: SurfaceConfig | None = None,
) -> Surface:
    """Join all cameras' nodes to one surface, in the order of ``surfaces``, without nodes that another camera sees
    better.

    surfaces: one per camera, each in the world frame, as from ``build_surface``. In the result, the field ``camera`` of
    a node is the index of the node's surface in ``surfaces``. expected: the skin to which ``skin`` of the surfaces
    refers; nodes that show skin far apart on the body are never merged. Raises ValueError if cameras are missing, or if
    surfaces refer to expected skin that is not given.
    """
    config = config or SurfaceConfig()
    if len(surfaces) != len(cameras) or len(surfaces) == 0:
        raise ValueError(f"{len(surfaces)} surfaces for {len(cameras)} cameras")
    if len(surfaces) == 1:
        return surfaces[0]
    if expected is None and any((surface.skin >= 0).any() for surface in surfaces):
        raise ValueError("the surfaces refer to expected skin, which is not given")
    first = np.concatenate([[0], np.cumsum([len(surface) for surface in surfaces])])
    both = _side_by_side(surfaces, first)
    landmarks = np.zeros((1, 1), np.float32) if expected is None else expected.arrays.landmarks_m
    inner, dropped = np.all(both.ring >= 0, axis=1), np.zeros(len(both), np.bool_)
    nodes = Nodes(both.points_m, both.normals, inner, both.skin, dropped, landmarks)
    pairs = [
        _same_skin(both, nodes, first[source:][:2], first[target:][:2], (cameras[source], camera), config)
        for target, camera in enumerate(cameras)
        for source in range(len(surfaces))
        if source != target
    ]
    stay = _with_border(both.ring, nodes.dropped)
    seam = np.concatenate(pairs)
    seam = seam[stay[seam].all(axis=1)]
    start, node, length_m = add_links(both, seam, _lengths_m(both.points_m, seam), len(both))
    linked = replace(both, link_start=start, link_node=node, link_length_m=length_m)
    return keep_nodes(linked, stay)


def _side_by_side(surfaces: Sequence[Surface], first: np.ndarray) -> Surface:
    """Return the nodes and links of all surfaces as a single surface, without links between cameras. first (k + 1,):
    index of the first node of each of the k surfaces in the result.
    """
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


class Nodes(NamedTuple):
    """All cameras' nodes as arrays, which compiled functions (kernels) can read."""

    points_m: np.ndarray  # (n, 3) float32, places of the nodes in the world
    normals: np.ndarray  # (n, 3) float32, unit normals of the nodes in the world
    inner: np.ndarray  # (n,) bool, nodes with a complete ring of neighbours
    skin: np.ndarray  # (n,) int32, the skin point that each node shows
    dropped: np.ndarray  # (n,) bool, nodes that another camera sees better
    landmarks_m: np.ndarray  # (k, l) float32, distances of skin points to landmarks, as in ``BodyMap``


class Grid(NamedTuple):
    """The nodes of a camera, by their places on the grid of every ``step``-th pixel."""

    node: np.ndarray  # (rows, cols) int32, the node at every ``step``-th pixel, -1 = no node
    step: int  # pixels between neighbouring nodes


def _same_skin(
    both: Surface,
    nodes: Nodes,
    source: np.ndarray,
    target: np.ndarray,
    cameras: tuple[Camera, Camera],
    config: SurfaceConfig,
) -> np.ndarray:
    """Return pairs (m, 2) int32 of nodes on the same skin. A pair consists of a node of the source surface and a node
    of the target surface that is a corner of the grid cell in which the target's camera sees the first node.

    source, target (2,): first node, and one past the last node; cameras: the cameras of source and target. Nodes of the
    source that the target's camera sees better are marked in ``dropped``.
    """
    begin, end = target.tolist()
    if source[0] == source[1] or begin == end:
        return np.empty((0, 2), np.int32)
    camera = cameras[1]
    step, pixel = _grid_step(both.ring[begin:end], both.pixel, begin), both.pixel[begin:end]
    node = np.full((-(-camera.height // step), -(-camera.width // step)), -1, np.int32)
    node[pixel[:, 0] // step, pixel[:, 1] // step] = np.arange(begin, end)
    eyes = np.array([one.position_m for one in cameras], np.float32)
    apart_m = np.float32(config.fusion_max_apart_m)
    return _pair_corners(nodes, source[0], source[1], Grid(node, step), pinhole(camera), eyes, apart_m)


def _grid_step(ring: np.ndarray, pixel: np.ndarray, first: int) -> int:
    """Return the number of pixels between grid neighbours of a surface whose first node has the index ``first``."""
    east = np.flatnonzero(ring[:, 0] >= 0)
    if len(east) == 0:
        return 1
    return int(pixel[ring[east[0], 0], 1] - pixel[first + east[0], 1])


def _lengths_m(points_m: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return the distance (m,) between the nodes of each pair, computed in single precision."""
    x, y, z = (points_m[pairs[:, 0]] - points_m[pairs[:, 1]]).T
    length: np.ndarray = np.sqrt(x**2 + y**2 + z**2)
    return length


def _with_border(ring: np.ndarray, dropped: np.ndarray) -> np.ndarray:
    """Return (n,) bool, nodes to keep: all nodes that are not dropped, and dropped nodes at most two grid steps away
    from a node that is not dropped.
    """
    stay = ~dropped
    for _ in range(2):
        stay = stay | np.append(stay, False)[ring].any(axis=1)
    return stay


@njit(cache=True, nogil=True)
def _pair_corners(
    nodes: Nodes, begin: int, end: int, grid: Grid, camera: Pinhole, eyes: np.ndarray, max_apart: np.float32
) -> np.ndarray:
    """Compute ``_same_skin`` for the source's nodes from ``begin`` to ``end`` - 1. grid, camera: grid and camera of the
    target surface; eyes (2, 3) float32: positions of the source's and of the target's camera.
    """
    points, shown, step = nodes.points_m, nodes.skin, grid.step
    rows, cols = grid.node.shape
    pairs = np.empty((4 * (end - begin), 2), np.int32)
    count = 0
    for p in range(begin, end):
        high, left, _ = into_camera(camera, points, p)
        high, left = high / step, left / step
        if not (-1.0 <= high <= rows and -1.0 <= left <= cols):
            continue
        row, col = int(np.floor(high)), int(np.floor(left))
        whole, corners = True, 0
        for i in range(row, row + 2):
            for j in range(col, col + 2):
                if not (0 <= i < rows and 0 <= j < cols) or grid.node[i, j] < 0:
                    whole = False
                    continue
                q = grid.node[i, j]
                if not _one_skin(nodes, p, q, max_apart) or _far_on_body(nodes.landmarks_m, shown[p], shown[q]):
                    whole = False
                    continue
                pairs[count, 0], pairs[count, 1] = p, q
                count += 1
                corners += 1
                whole = whole and nodes.inner[q]
        if whole and corners == 4:
            q = pairs[count - 1, 1]
            here, there = _squareness(nodes, p, q, eyes[0]), _squareness(nodes, p, q, eyes[1])
            nodes.dropped[p] = nodes.dropped[p] or there > here
    return pairs[:count].copy()


@njit(cache=True, nogil=True)
def _far_on_body(landmarks: np.ndarray, one: int, other: int) -> bool:
    """Return whether two skin points are too far apart on the body to be the same; False for unknown points (-1)."""
    if one < 0 or other < 0 or one == other:
        return False
    return bool(geodesic_lower_bound(landmarks, one, other) > MAX_ON_BODY_M)


@njit(cache=True, nogil=True)
def _one_skin(nodes: Nodes, p: int, q: int, max_apart: np.float32) -> bool:
    """Return whether two nodes show the same skin: they are near each other, each near the tangent plane of the other,
    and have similar normals.
    """
    points, normals = nodes.points_m, nodes.normals
    apart2, cosine, off_p, off_q = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        cosine += normals[p, axis] * normals[q, axis]
        off_p += gap * normals[p, axis]
        off_q += gap * normals[q, axis]
    near = apart2 <= max_apart * max_apart and abs(off_p) <= MAX_OFF_PLANE_M and abs(off_q) <= MAX_OFF_PLANE_M
    return bool(near and cosine >= MIN_COSINE)


@njit(cache=True, nogil=True)
def _squareness(nodes: Nodes, p: int, q: int, eye: np.ndarray) -> np.float32:
    """Return a number proportional to how many readings a camera at ``eye`` (3,) has per square metre of the skin at
    nodes p and q; it is larger if the camera is near and sees the skin squarely.
    """
    points, normals = nodes.points_m, nodes.normals
    along, away2 = np.float32(0), np.float32(0)
    for axis in range(3):
        sight = eye[axis] - points[p, axis]
        along += sight * (normals[p, axis] + normals[q, axis])
        away2 += sight * sight
    return along / (away2 * np.sqrt(away2))


def patient_surface(
    views: Sequence[View],
    cameras: Sequence[Camera],
    expected: ExpectedSkin | None = None,
    config: SurfaceConfig | None = None,
) -> Surface:
    """Build the patient's surface of one frame: seen nodes of all cameras, then hidden skin where the body is expected.

    views: one per camera, in the order of the cameras; a camera without a depth frame has a blank view. expected: the
    patient's predicted skin. Without expected skin, the surface is bridged behind bars if both sides lie in one plane,
    and pieces are joined where they are nearest to each other; touching parts are not cut, and no hidden skin is added.
    """
    config = config or SurfaceConfig()
    if expected is None or not config.by_body:
        bridged = each(lambda view, camera: _bridged_mesh(view, camera, config), views, cameras)
        return fuse(bridged, cameras, None, config)
    ambiguous = find_ambiguous_skin(expected)
    meshes = each(lambda view, camera: _cut_mesh(view, camera, expected, ambiguous, config), views, cameras)
    surface = fuse(meshes, cameras, expected, config)
    whole = add_hidden_skin(surface, expected, [view.depth_m for view in views], cameras)
    return join_rest(whole, config.max_join_m)


def _bridged_mesh(view: View, camera: Camera, config: SurfaceConfig) -> Surface:
    """Mesh one camera's view of the patient, joined behind bars and across gaps."""
    mesh = build_surface(view.depth_m, view.patient, camera, config, view.hidden_by_equipment)
    return join_pieces(mesh, config.step, config.max_join_m)


def _cut_mesh(
    view: View, camera: Camera, expected: ExpectedSkin, ambiguous: np.ndarray, config: SurfaceConfig
) -> Surface:
    """Mesh one camera's view of the patient, cut where parts of the expected body touch."""
    mesh = build_surface(view.depth_m, view.patient, camera, config)
    mesh = cut_contacts(assign_skin(mesh, camera, expected, ambiguous), expected)
    return join_pieces(mesh, config.step, config.max_join_m)


def blank_view(camera: Camera) -> View:
    """Return the view of a camera without a depth frame: no pixel has a reading."""
    shape = camera.height, camera.width
    return View(np.zeros(shape, np.float32), np.full(shape, PixelLabel.NO_READING, np.uint8))
