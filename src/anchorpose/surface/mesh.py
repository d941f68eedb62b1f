"""Mesh one camera's denoised depth image on its pixel grid, with normals (paper, Section III)."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.denoise import denoise, drop_flying_pixels, estimate_noise, extent, jump_coefficients
from anchorpose.surface.joins import bridge_pairs
from anchorpose.surface.links import compress_links, links, pieces, straight_m
from anchorpose.surface.surface import Surface, SurfaceConfig

TILE = 256  # number of pixels of a row that are processed together; the sums of such a tile stay in the fastest cache
S, SU, SV, SUU, SUV, SVV, SW, SUW, SVW, LIMIT, NX, NY, NZ = (np.uint64(TILE * place) for place in range(13))


def estimate_normals(
    depth_m: np.ndarray, rays: np.ndarray, pixel: np.ndarray, radius_px: int, slope: float, spread: float
) -> np.ndarray:
    """Return unit normals (n, 3) float32 in the camera frame, towards the camera; NaN if the neighbours do not
    determine a plane.

    depth_m (height, width) float32 metres, 0 = no reading; rays (height, width, 2) float32 of ``Camera.pixel_rays``;
    pixel (n, 2) int16: row and column of pixels with a reading; the function is fastest if they are sorted by row, then
    by column. slope, spread: coefficients, from ``jump_coefficients``, of the jump limit, the largest depth difference
    per pixel within one surface. Raises ValueError for a pixel without a reading. The plane is fitted to the inverse
    depth, which on a plane is a linear function of the ray's two coordinates. So the fit is exact for planes at any
    slant. If the noise of the depth z grows as z**2, the inverse depth has the same variance at all pixels, so the fit
    need not give less weight to pixels at a greater depth.
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    if not (depth[pixel[:, 0], pixel[:, 1]] > 0).all():
        raise ValueError("a normal was asked for where there is no reading")
    window, top, left = _window(depth, rays, radius_px)
    pixel = np.ascontiguousarray(pixel, dtype=np.int16)
    return _plane_normals(window, pixel, top, left, radius_px, np.float32(slope), np.float32(spread))


class Window(NamedTuple):
    """The part of the depth frame with all readings and a margin, so that access to neighbours needs no bounds test."""

    z: np.ndarray  # (rows, cols) float32 depth, 0 without a reading
    inverse: np.ndarray  # (rows, cols) float32, 1 / z, 0 without a reading
    u: np.ndarray  # (rows, cols) float32, first coordinate of the rays
    v: np.ndarray  # (rows, cols) float32, second coordinate of the rays


def _window(depth: np.ndarray, rays: np.ndarray, margin: int) -> tuple[Window, int, int]:
    """Return the window (the part of the depth frame with all readings, and a margin), and the row and column in the
    depth frame of the window's first pixel inside the margin.
    """
    top, bottom, left, right = extent(depth > 0)
    shape = bottom - top + 2 * margin, right - left + 2 * margin + 1
    window = Window(*(np.zeros(shape, np.float32) for _ in range(4)))
    inside = np.s_[margin : margin + bottom - top, margin : margin + right - left]
    reading, ray = depth[top:bottom, left:right], rays[top:bottom, left:right]
    window.z[inside], window.u[inside], window.v[inside] = reading, ray[:, :, 0], ray[:, :, 1]
    np.divide(np.float32(1.0), reading, out=window.inverse[inside], where=reading > 0)
    return window, top, left


@njit(cache=True, nogil=True)
def _plane_normals(
    window: Window, pixel: np.ndarray, top: int, left: int, radius: int, slope: Any, spread: Any
) -> np.ndarray:
    """Compute ``estimate_normals`` tile by tile (up to ``TILE`` pixels of a row): first sums over the neighbours of
    each pixel, then, from these sums, the plane at each pixel.
    """
    z = window.z
    normals = np.empty((len(pixel), 3), np.float32)
    sums = np.empty(13 * TILE, np.float32)
    node = 0
    while node < len(pixel):
        row, first, end = pixel[node, 0], np.int64(pixel[node, 1]), node
        last = first
        while end < len(pixel) and pixel[end, 0] == row and first <= pixel[end, 1] < first + TILE:
            last = max(last, np.int64(pixel[end, 1]))
            end += 1
        own, at = np.uint64(row - top + radius), np.uint64(first - left + radius)
        count = np.uint64(last + 1 - first)
        for k in range(np.uint64(9 * TILE)):
            sums[k] = 0.0
        for k in range(count):
            sums[LIMIT + k] = slope * z[own, at + k] + spread * z[own, at + k] * z[own, at + k]
        for i in range(-radius, radius + 1):
            for j in range(-radius, radius + 1, 2):
                apart = np.float32(max(1, abs(i), abs(j))), np.float32(max(1, abs(i), abs(j + 1)))
                weight = _tap_weight(i, j, radius), _tap_weight(i, j + 1, radius)
                tap = np.uint64(np.int64(own) + i), np.uint64(np.int64(at) + j)
                _add_taps(window, sums, (own, at), tap, count, apart, weight)
        _solve(window, sums, own, at, count)
        for k in range(node, end):
            spot = np.uint64(pixel[k, 1] - first)
            normals[k, 0], normals[k, 1], normals[k, 2] = sums[NX + spot], sums[NY + spot], sums[NZ + spot]
        node = end
    return normals


@njit(cache=True, nogil=True)
def _tap_weight(i: int, j: int, radius: int) -> Any:
    """Return the weight of a neighbour i rows and j columns away. The weight is 0 beyond the radius: neighbours are
    processed in pairs, and the second neighbour of a row's last pair may lie outside.
    """
    return np.float32(1.0 - (i**2 + j**2) / (2.0 * (radius + 1) ** 2)) if j <= radius else np.float32(0.0)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _add_taps(
    window: Window, sums: np.ndarray, own_place: Any, tap_place: Any, count: Any, apart: Any, weight: Any
) -> None:
    """Add two neighbours, a and b, of each pixel to the sums from which the pixel's plane is computed. The pixel's own
    ray and inverse depth are subtracted from the rays and inverse depths of its neighbours, so that float32 is precise
    enough.

    own_place, tap_place: row and column of the tile's first pixel, and of its neighbour a; b is the next pixel to the
    right of a. apart, weight: distance in pixels (for the jump limit) and weight of the neighbours a and b.
    """
    (apart_a, apart_b), (weight_a, weight_b) = apart, weight
    z, inverse, u, v = window
    row, at = own_place
    i, there = tap_place
    for k in range(count):
        a, b = there + k, there + k + np.uint64(1)
        limit, own, w = sums[LIMIT + k], z[row, at + k], inverse[row, at + k]
        own_u, own_v = u[row, at + k], v[row, at + k]
        seen_a = (abs(z[i, a] - own) <= limit * apart_a) & (inverse[i, a] > np.float32(0.0))
        seen_b = (abs(z[i, b] - own) <= limit * apart_b) & (inverse[i, b] > np.float32(0.0))
        wa, wb = weight_a if seen_a else np.float32(0.0), weight_b if seen_b else np.float32(0.0)
        ua, va, ia = u[i, a] - own_u, v[i, a] - own_v, inverse[i, a] - w
        ub, vb, ib = u[i, b] - own_u, v[i, b] - own_v, inverse[i, b] - w
        wua, wva, wub, wvb = wa * ua, wa * va, wb * ub, wb * vb
        sums[S + k] += wa + wb
        sums[SU + k] += wua + wub
        sums[SV + k] += wva + wvb
        sums[SUU + k] += wua * ua + wub * ub
        sums[SUV + k] += wua * va + wub * vb
        sums[SVV + k] += wva * va + wvb * vb
        sums[SW + k] += wa * ia + wb * ib
        sums[SUW + k] += wua * ia + wub * ib
        sums[SVW + k] += wva * ia + wvb * ib


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(window: Window, sums: np.ndarray, row: Any, at: Any, count: Any) -> None:
    """Solve for the plane a u + b v + c = 1 / z, where (u, v) is a ray and z the depth; NaN if the pixels lie on a
    point or a line.
    """
    _, inverse, u, v = window
    for k in range(count):
        s, su, sv = np.float64(sums[S + k]), np.float64(sums[SU + k]), np.float64(sums[SV + k])
        cuu, cuv, cvv = sums[SUU + k] - su * su / s, sums[SUV + k] - su * sv / s, sums[SVV + k] - sv * sv / s
        cuw, cvw = sums[SUW + k] - su * sums[SW + k] / s, sums[SVW + k] - sv * sums[SW + k] / s
        determinant = cuu * cvv - cuv * cuv
        a = (cuw * cvv - cvw * cuv) / determinant
        b = (cvw * cuu - cuw * cuv) / determinant
        c = inverse[row, at + k] + (sums[SW + k] - a * su - b * sv) / s
        c -= a * u[row, at + k] + b * v[row, at + k]
        fixed = (determinant > 1e-6 * (cuu + cvv) ** 2) & (determinant > 0.0)
        length = -np.sqrt(a * a + b * b + c * c) if fixed else np.nan
        sums[NX + k], sums[NY + k], sums[NZ + k] = a / length, b / length, c / length


# pixels, radius of the plane fit around a node; at 2.4 m its window covers 4 cm, wider than wrinkles, narrower than a
# wrist
NORMAL_RADIUS_PX: Final = 3

RING = np.array([[0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1]], dtype=np.int64)
"""Row and column offsets of a node's eight grid neighbours, in the order of ``Surface.ring``: E NE N NW W SW S SE."""


def build_surface(
    depth_m: np.ndarray,
    mask: np.ndarray,
    camera: Camera,
    config: SurfaceConfig | None = None,
    bridge: np.ndarray | None = None,
) -> Surface:
    """Smooth the masked pixels of one depth frame, mesh them and compute normals; nodes are in the world frame.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool: the patient. bridge (height, width) bool:
    pixels hidden by equipment; None = nothing is bridged. Pieces of surface smaller than ``min_piece_m2`` are left out,
    and so are nodes without a normal. An empty mask gives a surface without nodes. Raises ValueError for a frame of
    another size than the camera's, and for a camera without a pose.
    """
    config = config or SurfaceConfig()
    T_world_camera, lens, step = camera.require_pose(), camera.intrinsics, config.step
    _refuse_wrong_size(camera, depth_m, mask, bridge)
    noise = estimate_noise(depth_m, mask)
    slope, spread = jump_coefficients(min(lens.fx, lens.fy), noise)
    clean = denoise(depth_m, mask, noise, config.denoise_radius_px)
    clean = drop_flying_pixels(clean, slope, spread, config.min_support)

    rays = camera.pixel_rays()
    index, pixel = _grid_nodes(clean, step)
    points = _place_nodes(clean, rays, pixel)
    depth = points[:, 2]
    normals = estimate_normals(clean, rays, pixel, NORMAL_RADIUS_PX, slope, spread)
    ring = _link_ring(clean, index, pixel, RING, step, slope, spread)
    pairs = np.empty((0, 2), np.int32)
    if bridge is not None and bridge.any() and len(points) > 0:
        pairs = bridge_pairs(index, bridge, points, normals, max(lens.fx, lens.fy), config)
    points = _moved(T_world_camera, points, 1.0)
    start, node, length = compress_links(pairs, straight_m(points, pairs), len(points))
    first, unknown = np.zeros(len(points), np.uint8), np.full(len(points), -1, np.int32)
    oriented = _moved(T_world_camera, normals, 0.0)
    surface = Surface(points, oriented, first, pixel, ring, start, node, length, unknown)
    patch_m2 = (step * depth) ** 2 / (lens.fx * lens.fy)
    return keep_nodes(surface, _large_pieces(surface, patch_m2, config.min_piece_m2) & np.isfinite(normals[:, 0]))


def edges(surface: Surface) -> np.ndarray:
    """Return every edge of the surface once, (e, 2) int32 with the smaller index first: edges of the pixel grid, then
    links (all other edges).
    """
    return np.concatenate([grid_edges(surface), links(surface)[0]])


def grid_edges(surface: Surface) -> np.ndarray:
    """Return every edge between neighbours on the pixel grid once, (e, 2) int32 with the smaller index first."""
    node, place = np.nonzero(surface.ring[:, :4] >= 0)
    return np.sort(np.stack([node, surface.ring[node, place]], axis=1), axis=1).astype(np.int32)


def faces(surface: Surface) -> np.ndarray:
    """Return the triangles of the mesh (f, 3) int32, with corners counter-clockwise as the camera sees them; each grid
    cell is cut along one diagonal.

    Links have no triangles. A grid cell is cut along the diagonal that gives more triangles; if both diagonals give the
    same number, along the diagonal down to the right.
    """
    right, down_left, down, down_right = surface.ring[:, 0], surface.ring[:, 5], surface.ring[:, 6], surface.ring[:, 7]
    left = surface.ring[:, 4]
    node = np.arange(len(surface), dtype=np.int32)

    def joined(a: np.ndarray, place: int, b: np.ndarray) -> np.ndarray:
        return (a >= 0) & (b >= 0) & (surface.ring[a, place] == b)

    fall_low = (down >= 0) & joined(down, 0, down_right)  # triangle (a, c, d) of a cell with the corners a b over c d
    fall_high = (right >= 0) & joined(right, 6, down_right)  # triangle (a, d, b) of this cell
    rise_high = (left >= 0) & joined(left, 6, down_left)  # triangle (b, a, c) of the cell with the node at b
    rise_low = (down >= 0) & joined(down_left, 0, down)  # triangle (b, c, d) of the cell with the node at b
    corner_b = np.where(right >= 0, right, np.where(down_right >= 0, surface.ring[down_right, 2], -1))
    falls = fall_low.astype(np.int8) + fall_high
    rises = np.where(corner_b >= 0, (rise_high.astype(np.int8) + rise_low)[corner_b], 0)
    takes_fall = (falls > 0) & (falls >= rises)
    covered = np.zeros(len(surface), bool)
    covered[corner_b[takes_fall & (corner_b >= 0)]] = True
    return np.concatenate(
        [
            np.stack([node, down, down_right], axis=1)[takes_fall & fall_low],
            np.stack([node, down_right, right], axis=1)[takes_fall & fall_high],
            np.stack([node, left, down_left], axis=1)[~covered & rise_high],
            np.stack([node, down_left, down], axis=1)[~covered & rise_low],
        ]
    ).astype(np.int32)


def keep_nodes(surface: Surface, keep: np.ndarray) -> Surface:
    """Return the part of a surface where keep (n,) bool is True; edges to dropped nodes are removed, and the order of
    the other nodes is kept.
    """
    if keep.all():
        return surface
    old = np.flatnonzero(keep)
    new = np.full(len(keep) + 1, -1, np.int32)  # the last entry maps -1 (an empty ring place) to -1
    new[old] = np.arange(len(old))
    source = np.repeat(np.arange(len(keep)), np.diff(surface.link_start))
    stay = keep[source] & keep[surface.link_node]
    count = np.bincount(new[source[stay]], minlength=len(old))
    return Surface(
        points_m=surface.points_m.take(old, axis=0),
        normals=surface.normals.take(old, axis=0),
        ring=new[surface.ring.take(old, axis=0)],
        link_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        link_node=new[surface.link_node[stay]],
        link_length_m=surface.link_length_m[stay],
        camera=surface.camera.take(old),
        pixel=surface.pixel.take(old, axis=0),
        skin=surface.skin.take(old),
    )


def _refuse_wrong_size(camera: Camera, *frames: np.ndarray | None) -> None:
    for frame in frames:
        if frame is not None and frame.shape != (camera.height, camera.width):
            raise ValueError(f"camera {camera.name} has frames of {camera.height}x{camera.width}, got {frame.shape}")


def _grid_nodes(depth: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Return index (rows, cols) int32: the node at each place of the grid, -1 = no node; and pixel (n, 2) int16: each
    node's row and column in the whole depth frame.
    """
    present = depth[::step, ::step] > 0.0
    pixel = np.argwhere(present)
    index = np.full(present.shape, -1, np.int32)
    index[present] = np.arange(len(pixel))
    return index, np.ascontiguousarray(pixel * step, dtype=np.int16)


def _place_nodes(depth: np.ndarray, rays: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Return the nodes' positions (n, 3) float32 in the camera frame."""
    row, col = pixel.T
    z = depth[row, col]
    return np.stack([rays[row, col, 0] * z, rays[row, col, 1] * z, z], axis=1)


def _moved(T_target_source: np.ndarray, vectors: np.ndarray, point: float) -> np.ndarray:
    """Return (n, 3) float32, computed in double precision: rotated and translated points (point = 1), or rotated
    directions (point = 0).
    """
    x, y, z = vectors.T.astype(np.float64)
    moved = [row[0] * x + row[1] * y + row[2] * z + point * row[3] for row in T_target_source[:3]]
    return np.stack(moved, axis=1).astype(np.float32)


def _large_pieces(surface: Surface, patch_m2: np.ndarray, min_piece_m2: float) -> np.ndarray:
    piece = pieces(surface)
    return np.bincount(piece, weights=patch_m2)[piece] >= min_piece_m2


@njit(cache=True, nogil=True)
def _link_ring(
    depth: np.ndarray, index: np.ndarray, pixel: np.ndarray, ring: np.ndarray, step: int, slope: float, spread: float
) -> np.ndarray:
    """Return each node's neighbours ``ring`` (n, 8): two nodes next to each other on the grid are linked if no two
    successive readings between them differ by more than the jump limit (the largest depth difference within one
    surface). Lost readings between two neighbours are skipped, so that a jump across them is still found.
    """
    rows, cols = index.shape
    linked = np.full((len(pixel), 8), -1, np.int32)
    for node in range(len(pixel)):
        row, col = np.int64(pixel[node, 0]), np.int64(pixel[node, 1])
        own, here_row, here_col = depth[row, col], row // step, col // step
        for place in range(4):  # the other four places hold the same edges, seen from their other ends
            down, right = ring[place, 0], ring[place, 1]
            i, j = here_row + down, here_col + right
            if i < 0 or i >= rows or j < 0 or j >= cols or index[i, j] < 0:
                continue
            far = max(own, depth[i * step, j * step])  # the larger of both depths, so that the test is symmetric
            limit = slope * far + spread * far * far
            last, whole = own, True
            for walk in range(1, step + 1):
                here = depth[row + walk * down, col + walk * right]
                if here > 0.0:
                    whole = whole and abs(here - last) <= limit
                    last = here
            if whole:
                linked[node, place], linked[index[i, j], place + 4] = index[i, j], node
    return linked
