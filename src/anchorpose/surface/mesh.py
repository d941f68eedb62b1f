"""One camera's depth frame to the surface mesh M = {V, E} (paper, Section III)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.denoise import denoise, drop_flying_pixels, estimate_noise, jump_coefficients
from anchorpose.surface.joins import bridge_pairs
from anchorpose.surface.links import compress_links, links, pieces, straight_m
from anchorpose.surface.normals import estimate_normals
from anchorpose.surface.surface import Surface, SurfaceConfig

NORMAL_RADIUS_PX: Final = 3  # a plane over 4 cm at 2.4 m: wider than wrinkles, narrower than a wrist

RING = np.array([[0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1]], dtype=np.int64)
"""Row and column offset of the eight ring places, E NE N NW W SW S SE."""


def build_surface(
    depth_m: np.ndarray,
    mask: np.ndarray,
    camera: Camera,
    config: SurfaceConfig | None = None,
    bridge: np.ndarray | None = None,
) -> Surface:
    """Smooth, mesh and orient the masked pixels of one depth frame; nodes in the world frame.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool: the patient. bridge (height, width) bool:
    pixels where equipment hides what is behind; None = nothing is bridged. Pieces of surface smaller than
    ``min_piece_m2`` are left out, and so are nodes without a normal. An empty mask gives a surface of no nodes.
    Raises ValueError on frames of another size than the camera's, or a camera without pose.
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
    surface = Surface(points, oriented, ring, start, node, length, camera=first, pixel=pixel, skin=unknown)
    patch_m2 = (step * depth) ** 2 / (lens.fx * lens.fy)
    return keep_nodes(surface, _large_pieces(surface, patch_m2, config.min_piece_m2) & np.isfinite(normals[:, 0]))


def edges(surface: Surface) -> np.ndarray:
    """(e, 2) int32: every edge once, grid edges and links, the smaller index first."""
    return np.concatenate([grid_edges(surface), links(surface)[0]])


def grid_edges(surface: Surface) -> np.ndarray:
    """(e, 2) int32: every edge of the grid once, the smaller index first."""
    node, place = np.nonzero(surface.ring[:, :4] >= 0)
    return np.sort(np.stack([node, surface.ring[node, place]], axis=1), axis=1).astype(np.int32)


def faces(surface: Surface) -> np.ndarray:
    """(f, 3) int32 triangles, counter-clockwise as the camera sees them; each cell of the grid is cut one way.

    Links carry no triangles. A cell takes the diagonal that gives more triangles, on a tie the one down to the right.
    """
    right, down_left, down, down_right = surface.ring[:, 0], surface.ring[:, 5], surface.ring[:, 6], surface.ring[:, 7]
    left = surface.ring[:, 4]
    node = np.arange(len(surface), dtype=np.int32)

    def joined(a: np.ndarray, place: int, b: np.ndarray) -> np.ndarray:
        return (a >= 0) & (b >= 0) & (surface.ring[a, place] == b)

    fall_low = (down >= 0) & joined(down, 0, down_right)  # (a, c, d) of the cell a b over c d
    fall_high = (right >= 0) & joined(right, 6, down_right)  # (a, d, b)
    rise_high = (left >= 0) & joined(left, 6, down_left)  # (b, a, c), from node b
    rise_low = (down >= 0) & joined(down_left, 0, down)  # (b, c, d)
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
    """The part of a surface where keep (n,) bool is true; edges to nodes left out are gone, the order stays."""
    if keep.all():
        return surface
    old = np.flatnonzero(keep)
    new = np.full(len(keep) + 1, -1, np.int32)  # the last entry stands for the -1 of an empty ring place
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
    """index (rows, cols) int32, -1 = no node; pixel (n, 2) int16 row and column of the whole depth frame."""
    present = depth[::step, ::step] > 0.0
    pixel = np.argwhere(present)
    index = np.full(present.shape, -1, np.int32)
    index[present] = np.arange(len(pixel))
    return index, np.ascontiguousarray(pixel * step, dtype=np.int16)


def _place_nodes(depth: np.ndarray, rays: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """(n, 3) float32 camera frame."""
    row, col = pixel.T
    z = depth[row, col]
    return np.stack([rays[row, col, 0] * z, rays[row, col, 1] * z, z], axis=1)


def _moved(T_target_source: np.ndarray, vectors: np.ndarray, point: float) -> np.ndarray:
    """(n, 3) float32: points turned and shifted (point 1), or directions turned (point 0), in double precision."""
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
    """Neighbours that every pixel step on the way confirms; a single lost reading on the way may not hide a jump."""
    rows, cols = index.shape
    linked = np.full((len(pixel), 8), -1, np.int32)
    for node in range(len(pixel)):
        row, col = np.int64(pixel[node, 0]), np.int64(pixel[node, 1])
        own, here_row, here_col = depth[row, col], row // step, col // step
        for place in range(4):  # the other four are the same edges from their other ends
            down, right = ring[place, 0], ring[place, 1]
            i, j = here_row + down, here_col + right
            if i < 0 or i >= rows or j < 0 or j >= cols or index[i, j] < 0:
                continue
            far = max(own, depth[i * step, j * step])  # of both, so that the test is the same both ways
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
