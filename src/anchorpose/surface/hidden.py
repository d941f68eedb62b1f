"""Assign seen nodes to the patient's expected (predicted) skin, and add the expected skin that no camera sees.

Parts near each other in space may be far apart on the body: a hand may lie on the trunk, or one thigh against the other
thigh. If two such parts are near a node, each part gives a candidate for the skin point that the node shows. Which
candidate is chosen depends on which side of the crease between the parts the node lies (``contacts.py``).

Expected skin is added where nothing was seen and nothing contradicts it, and is linked to the rim of the seen surface.
Such hidden skin is inferred, not measured. With hidden skin, shortest paths along the surface (geodesics) run as they
would on the complete body. Hidden skin also shows whether a limb continues behind an object. Registration (which fits
the body), the track tree (which matches nodes from frame to frame) and images of the patient use only seen nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid
from anchorpose.lens import lens_array, pixel_of_ray
from anchorpose.surface.contacts import decide_candidates
from anchorpose.surface.links import add_links, pieces
from anchorpose.surface.surface import HIDDEN_SKIN, ExpectedSkin, MeshArrays, SkinArrays, Surface, geodesic_lower_bound


class Pinhole(NamedTuple):
    """A camera's pose and lens as arrays, which compiled functions (kernels) can read."""

    T_camera_world: np.ndarray  # (4, 4) float32, the transform from the world to the camera
    lens: np.ndarray  # from ``lens_array``


def pinhole(camera: Camera) -> Pinhole:
    """Return the camera's pose and intrinsics; raises ValueError for a camera without pose."""
    T_camera_world = np.ascontiguousarray(invert_rigid(camera.require_pose()), dtype=np.float32)
    return Pinhole(T_camera_world, lens_array(camera.intrinsics))


@njit(cache=True, nogil=True)
def into_camera(camera: Pinhole, points: np.ndarray, k: int) -> tuple[np.float32, np.float32, np.float32]:
    """Return row and column of one point in pixels, and its depth. Row and column are NaN behind the camera and beyond
    the valid radius of the lens.
    """
    T_camera_world, lens = camera.T_camera_world, camera.lens
    x, y, z = T_camera_world[0, 3], T_camera_world[1, 3], T_camera_world[2, 3]
    for axis in range(3):
        x += T_camera_world[0, axis] * points[k, axis]
        y += T_camera_world[1, axis] * points[k, axis]
        z += T_camera_world[2, axis] * points[k, axis]
    if z <= 0.0:
        return np.float32(np.nan), np.float32(np.nan), z
    column, row = pixel_of_ray(x / z, y / z, lens)
    return np.float32(row), np.float32(column), z


# m, maximum distance from a node to the expected skin point that it shows; it is the error with which a fast hand is
# predicted
REACH_M: Any = np.float32(0.12)
MAX_TURN_DEG: Final = 70.0  # degrees, maximum angle between normals of node and skin; excludes a wrist's far side
MIN_COSINE: Any = np.float32(np.cos(np.radians(MAX_TURN_DEG)))
# factor on the part of a node's distance from a skin point that lies along the point's normal. The part of the distance
# along the skin has less weight, since nodes may lie between skin points
OFF_PLANE_WEIGHT: Any = np.float32(3.0)
# m; two skin points are both candidates for a node if their distances from the node differ by less than this
AMBIGUOUS_M: Any = np.float32(0.04)
# m along the body, minimum distance between a node's two candidate skin points; skin points nearer to each other need
# not be distinguished
FAR_ON_BODY_M: Any = np.float32(0.12)

CELL_PX: Final = 6  # pixels, side of a cell of skin points; 4 cm at 2.4 m, slightly more than their spacing
# cosine of 120 degrees, the largest angle between a skin point's normal and the direction back along the optical axis,
# towards the camera; skin with a larger angle cannot be seen. This limit exceeds 90 degrees, since the rays at the
# image's border are not parallel to the optical axis
LEAST_FACING: Any = np.float32(-0.5)
# factor on the width that a pixel covers at the depth of the expected skin point nearest to the camera. The product is
# assumed to be the minimum width that a pixel covers at any node; the factor is below 1, since a node may be nearer to
# the camera than all expected skin
NARROWEST: Any = np.float32(0.75)
MOST_CANDIDATES: Final = 128  # maximum number of skin points kept for one node; about fifty are within reach


def find_ambiguous_skin(expected: ExpectedSkin) -> np.ndarray:
    """Return (k,) bool: ambiguous skin points, which are near other skin in space but far from it along the body. A
    node near such a point may show the point or the other skin.

    Two skin points are near each other in space if they are less than twice ``AMBIGUOUS_M`` apart. If the predicted
    skin is off by more than ``AMBIGUOUS_M``, some ambiguous points are not found.
    """
    skin = expected.arrays
    order = np.argsort(skin.points_m[:, 1])
    ambiguous = np.empty(len(order), bool)
    ambiguous[order] = _beside_far_skin(np.ascontiguousarray(skin.points_m[order].T), skin.landmarks_m[order])
    return ambiguous


def assign_skin(surface: Surface, camera: Camera, expected: ExpectedSkin, ambiguous: np.ndarray) -> Surface:
    """Return one camera's surface with the field ``skin``: the skin point that each node shows, -1 if no skin point is
    near.

    ambiguous (k,): from ``find_ambiguous_skin``.
    """
    if len(surface) == 0:
        return surface
    mesh, skin = surface.arrays, expected.arrays
    shape = camera.height // CELL_PX + 1, camera.width // CELL_PX + 1
    grid = _sort_into_cells(skin, pinhole(camera), *shape)
    candidates = _candidates(mesh, surface.pixel, skin, ambiguous, grid)
    return replace(surface, skin=decide_candidates(mesh, candidates, skin.landmarks_m))


class SkinGrid(NamedTuple):
    """Skin points that may face a camera, sorted into square cells of the camera's pixels."""

    start: np.ndarray  # (rows * cols + 1,) int32, where each cell begins in ``which``
    which: np.ndarray  # (m,) int32, the skin points, cell by cell
    place: np.ndarray  # (6, m) float32, positions and normals of these points
    rows: int  # number of rows of cells
    cols: int  # number of columns of cells
    span_m: float  # minimum width that a pixel covers on the skin; inf without skin


@njit(cache=True, nogil=True)
def _candidates(
    mesh: MeshArrays, pixel: np.ndarray, skin: SkinArrays, ambiguous: np.ndarray, grid: SkinGrid
) -> np.ndarray:
    """Return (n, 2) int32: the nearest skin point of each node and, if this point is ambiguous, the nearest skin point
    far from it on the body.

    The search for the skin point nearest to a node starts around the node's own pixel, then covers all pixels that may
    have a nearer point than the nearest point so far.
    """
    points, landmarks, cols = mesh.points_m, skin.landmarks_m, grid.cols
    found = np.full((len(points), 2), -1, np.int32)
    start, which, span = grid.start, grid.which, grid.span_m
    if not span < np.inf:
        return found
    squared = np.empty(len(which), np.float32)
    near, away = np.empty(MOST_CANDIDATES, np.int32), np.empty(MOST_CANDIDATES, np.float32)
    for n in range(len(points)):
        limit2 = REACH_M * REACH_M
        for again in range(2):
            reached = np.sqrt(limit2) / span if again else np.float32(CELL_PX // 2)
            top, bottom, left, right = _window(pixel, n, reached, grid)
            for row in range(top, bottom):
                first, last = start[row * cols + left], start[row * cols + right]
                _measure(mesh, n, grid.place, np.uint64(first), np.uint64(last), squared)
                for spot in range(first, last):
                    if squared[spot] < limit2:
                        limit2, found[n, 0] = squared[spot], which[spot]
        if found[n, 0] < 0 or not ambiguous[found[n, 0]]:
            continue
        limit = np.sqrt(limit2) + AMBIGUOUS_M
        count = 0
        top, bottom, left, right = _window(pixel, n, limit / span, grid)
        for row in range(top, bottom):
            first, last = start[row * cols + left], start[row * cols + right]
            _measure(mesh, n, grid.place, np.uint64(first), np.uint64(last), squared)
            for spot in range(first, last):
                if squared[spot] < limit * limit and count < MOST_CANDIDATES:
                    near[count], away[count] = which[spot], np.sqrt(squared[spot])
                    count += 1
        for c in range(count):
            if away[c] < limit and geodesic_lower_bound(landmarks, near[c], found[n, 0]) > FAR_ON_BODY_M:
                limit, found[n, 1] = away[c], near[c]
    return found


@njit(cache=True, nogil=True)
def _measure(mesh: MeshArrays, n: int, place: np.ndarray, first: Any, last: Any, squared: np.ndarray) -> None:
    """Write to ``squared`` the squared distance from node n to each skin point in ``place`` from ``first`` on, up to
    the point before ``last``. The part of the distance along the skin's normal has more weight (``OFF_PLANE_WEIGHT``).
    The result is inf if the normals of node and skin differ by more than ``MAX_TURN_DEG``. First and last are unsigned,
    so that the loop is vectorised.
    """
    points, normals = mesh.points_m, mesh.normals
    steep = OFF_PLANE_WEIGHT * OFF_PLANE_WEIGHT - np.float32(1.0)
    at_x, at_y, at_z = points[n, 0], points[n, 1], points[n, 2]
    up_x, up_y, up_z = normals[n, 0], normals[n, 1], normals[n, 2]
    for spot in range(first, last):
        x, y, z = at_x - place[0, spot], at_y - place[1, spot], at_z - place[2, spot]
        off = x * place[3, spot] + y * place[4, spot] + z * place[5, spot]
        cosine = up_x * place[3, spot] + up_y * place[4, spot] + up_z * place[5, spot]
        away = x * x + y * y + z * z + steep * off * off
        squared[spot] = away if cosine > MIN_COSINE else np.float32(np.inf)


@njit(cache=True, nogil=True)
def _window(pixel: np.ndarray, n: int, reach_px: Any, grid: SkinGrid) -> tuple[int, int, int, int]:
    """Return the range of cells within ``reach_px`` pixels of a node's pixel, as (top, bottom, left, right); bottom and
    right are one past the last cell.
    """
    row, col, away = int(pixel[n, 0]), int(pixel[n, 1]), int(reach_px) + 1
    top, bottom = max(row - away, 0) // CELL_PX, (row + away) // CELL_PX + 1
    left, right = max(col - away, 0) // CELL_PX, (col + away) // CELL_PX + 1
    return top, min(bottom, grid.rows), left, min(right, grid.cols)


@njit(cache=True, nogil=True)
def _sort_into_cells(skin: SkinArrays, camera: Pinhole, rows: int, cols: int) -> SkinGrid:
    """Return the skin points that may face the camera and lie within its image, sorted into cells of pixels."""
    points, normals = skin.points_m, skin.normals
    T_camera_world, lens = camera
    cell, start = np.full(len(points), -1, np.int32), np.zeros(rows * cols + 1, np.int32)
    nearest = np.float32(np.inf)
    for k in range(len(points)):
        high, left, z = into_camera(camera, points, k)
        facing = np.float32(0.0)
        for axis in range(3):
            facing -= T_camera_world[2, axis] * normals[k, axis]
        if z <= 0.0 or facing < LEAST_FACING:
            continue
        row, col = int(np.floor(high / CELL_PX)), int(np.floor(left / CELL_PX))
        if 0 <= row < rows and 0 <= col < cols:
            cell[k] = row * cols + col
            start[cell[k] + 1] += 1
            nearest = min(nearest, z)
    for c in range(rows * cols):
        start[c + 1] += start[c]
    which, place = np.empty(start[-1], np.int32), np.empty((6, start[-1]), np.float32)
    filled = start.copy()
    for k in range(len(points)):
        if cell[k] >= 0:
            spot = filled[cell[k]]
            filled[cell[k]] += 1
            which[spot] = k
            for axis in range(3):
                place[axis, spot], place[3 + axis, spot] = points[k, axis], normals[k, axis]
    return SkinGrid(start, which, place, rows, cols, NARROWEST * nearest / max(lens[0], lens[1]))


@njit(cache=True, nogil=True)
def _beside_far_skin(place: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Compute ``find_ambiguous_skin`` (k,) bool for skin points sorted by their height.

    place (3, k) float32: the points; landmarks (k, l) float32: their distances along the body to l landmarks, as in
    ``BodyMap``. Points are sorted by height, so points whose height differs by at most 2 ``AMBIGUOUS_M`` are
    contiguous.
    """
    x, y, z = place[0], place[1], place[2]
    radius = np.float32(2.0) * AMBIGUOUS_M
    marked, near = np.zeros(len(x), np.bool_), np.empty(len(x) + 1, np.int32)
    end = 0
    for a in range(len(x)):
        while end < len(x) and y[end] - y[a] <= radius:
            end += 1
        count = 0
        for b in range(a + 1, end):  # the loop has no ``if``, since the processor would mispredict one branch in ten
            squared = (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2 + (z[b] - z[a]) ** 2
            near[count] = b
            count += int(squared < radius * radius)
        for c in range(count):
            b = near[c]
            if not (marked[a] and marked[b]) and geodesic_lower_bound(landmarks, np.int32(a), b) > FAR_ON_BODY_M:
                marked[a] = True
                marked[b] = True
    return marked


# m; if a camera's reading lies more than this behind an expected skin point, no skin is at this place
SEEN_THROUGH_M: Any = np.float32(0.05)
# factor on the length of a path from skin point to skin point, since such a path is 2 % longer than the direct path
# along the skin
STRETCH: Any = np.float32(0.98)


def add_hidden_skin(
    surface: Surface, expected: ExpectedSkin, depths_m: Sequence[np.ndarray], cameras: Sequence[Camera]
) -> Surface:
    """Return the surface to which hidden skin points (expected skin that was not seen) are added as nodes, after the
    seen nodes. The added nodes have links, but no ring of grid neighbours.

    depths_m: every camera's whole depth frame (height, width) float32 metres, 0 = no reading. A skin point is left out
    if no node shows it and some camera sees through its place, that is, reads a surface more than ``SEEN_THROUGH_M``
    behind it. Nodes at the rim of the seen surface are linked to the skin point that they show. This skin point becomes
    a node, too, even if a camera sees through its place: the predicted outline may be a few pixels too wide.
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
    """Return (k,) bool: skin points that cannot be at their expected place, since a camera sees a farther surface
    through this place.
    """
    absent = np.zeros(len(expected.points_m), np.bool_)
    for depth, camera in zip(depths_m, cameras, strict=True):
        _mark_seen_through(expected.points_m, pinhole(camera), depth, absent)
    return absent


@njit(cache=True, nogil=True)
def _mark_seen_through(skin: np.ndarray, camera: Pinhole, depth: np.ndarray, absent: np.ndarray) -> None:
    """Mark in ``absent`` (k,) the skin points that lie more than ``SEEN_THROUGH_M`` in front of a camera's reading."""
    for k in range(len(skin)):
        high, left, z = into_camera(camera, skin, k)
        if z <= 0.0:
            continue
        row, col = int(np.rint(high)), int(np.rint(left))
        if 0 <= row < depth.shape[0] and 0 <= col < depth.shape[1] and depth[row, col] > z + SEEN_THROUGH_M:
            absent[k] = True


class Seen(NamedTuple):
    """The nodes that cameras saw, as arrays for compiled functions."""

    points_m: np.ndarray  # (n, 3) float32
    skin: np.ndarray  # (n,) int32, the skin point that each node shows, -1 = unknown
    rim: np.ndarray  # (n,) bool, nodes without a complete ring of neighbours
    piece: np.ndarray  # (n,) int32, number of the connected piece of mesh to which each node belongs


class Paths(NamedTuple):
    """Expected skin and the paths between neighbouring skin points, as in ``BodyMap``."""

    points_m: np.ndarray  # (k, 3) float32
    pairs: np.ndarray
    via: np.ndarray
    straight: np.ndarray


@njit(cache=True, nogil=True)
def _place_hidden(seen: Seen, pairs: np.ndarray, absent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays for the skin points. place (k,): the number of the new node (of hidden skin) for the point, -1
    = no new node. shown (k,): the piece of mesh of a node that shows the point, -1 if no inner node (a node off the
    rim) shows the point.

    A skin point that an inner node (a node off the rim) shows becomes a new node in two cases only. Either a node at
    the rim shows it, too, or a neighbouring skin point that no inner node shows becomes a new node.
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
    """Return the links (m, 2) between the new nodes (of hidden skin), and from seen nodes at the rim to new nodes, and
    the lengths (m,) float32 of these links.

    Two skin points that nodes of the same piece of mesh show are not linked, since the mesh connects them.
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
