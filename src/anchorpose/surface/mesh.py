"""One camera's depth picture to the surface mesh M = {V, E} (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.bridge import BridgeConfig, bridge_pairs
from anchorpose.surface.denoise import DenoiseConfig, denoise, estimate_noise, extent
from anchorpose.surface.edges import EdgeConfig, connected_pieces, drop_flying_pixels, jump_coefficients
from anchorpose.surface.links import compress_links, links, straight_m
from anchorpose.surface.normals import estimate_normals
from anchorpose.surface.surface import Surface

RING = np.array([[0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1]], dtype=np.int64)
"""Row and column offset of the eight ring places, E NE N NW W SW S SE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetConfig:
    """From depth picture to mesh."""

    step: int = 2  # every second pixel: 13 mm at 2.4 m, a quarter of the time for 3 mm more geodesic error
    min_piece_m2: float = 0.0020  # half the palm of a hand; smaller pieces are crumbs of clothes, bars and floor
    max_join_m: float = 0.10  # a chin stands up to this far before the neck; 0 leaves pieces apart
    normal_radius_px: int = 3  # a plane over 4 cm at 2.4 m: wider than wrinkles, narrower than a wrist
    denoise: DenoiseConfig = field(default_factory=DenoiseConfig)
    edge: EdgeConfig = field(default_factory=EdgeConfig)
    bridge: BridgeConfig = field(default_factory=BridgeConfig)

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"step must be at least 1, got {self.step}")
        for name in ("min_piece_m2", "max_join_m"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.normal_radius_px < 1:
            raise ValueError(f"normal_radius_px must be at least 1, got {self.normal_radius_px}")


def build_surface(
    depth_m: np.ndarray,
    mask: np.ndarray,
    camera: Camera,
    config: SheetConfig | None = None,
    bridge: np.ndarray | None = None,
) -> Surface:
    """Smooth, mesh and orient the masked pixels of one depth picture; nodes in the world frame.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool: the patient. bridge (height, width) bool:
    pixels where equipment hides what is behind; None = nothing is bridged. Pieces of surface smaller than
    ``min_piece_m2`` are left out, and so are nodes without a normal. An empty mask gives a surface of no nodes.
    Raises ValueError on pictures of another size than the camera's, or a camera without pose.
    """
    config = config or SheetConfig()
    T_world_camera = camera.require_pose()
    _refuse_wrong_size(camera, depth_m, mask, bridge)
    noise = estimate_noise(depth_m, mask, config.denoise)
    slope, spread = jump_coefficients(min(camera.intrinsics.fx, camera.intrinsics.fy), noise, config.edge)
    clean = denoise(depth_m, mask, noise, config.denoise)
    clean = drop_flying_pixels(clean, slope, spread, config.edge.min_support)

    rays = camera.pixel_rays()
    index, pixel = _grid_nodes(clean, config.step)
    points = _place_nodes(clean, rays, pixel)
    depth = points[:, 2]
    normals = estimate_normals(clean, rays, pixel, config.normal_radius_px, slope, spread)
    ring = _link_ring(clean, index, pixel, RING, config.step, slope, spread)
    pairs = np.empty((0, 2), np.int32)
    if bridge is not None and bridge.any() and len(points) > 0:
        spacing = config.step * float(depth.min()) / max(camera.intrinsics.fx, camera.intrinsics.fy)
        pairs = bridge_pairs(index, bridge, points, normals, config.step, spacing, config.bridge)
    points = _moved(T_world_camera, points, 1.0)
    start, node, length = compress_links(pairs, straight_m(points, pairs), len(points))
    surface = Surface(
        points_m=points,
        normals=_moved(T_world_camera, normals, 0.0),
        ring=ring,
        link_start=start,
        link_node=node,
        link_length_m=length,
        camera=np.zeros(len(points), np.uint8),
        pixel=pixel,
        skin=np.full(len(points), -1, np.int32),
    )
    patch_m2 = (config.step * depth) ** 2 / (camera.intrinsics.fx * camera.intrinsics.fy)
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


def pieces(surface: Surface) -> np.ndarray:
    """(n,) int32: number of the connected piece that each node belongs to."""
    return connected_pieces(surface.ring, surface.link_start, surface.link_node)


def keep_nodes(surface: Surface, keep: np.ndarray) -> Surface:
    """The part of a surface where keep (n,) bool is true; edges to nodes left out are gone, the order stays."""
    if keep.all():
        return surface
    old = np.flatnonzero(keep)
    ring, start, node, length = _renumber(
        surface.ring, surface.link_start, surface.link_node, surface.link_length_m, keep, old
    )
    return Surface(
        points_m=surface.points_m.take(old, axis=0),
        normals=surface.normals.take(old, axis=0),
        ring=ring,
        link_start=start,
        link_node=node,
        link_length_m=length,
        camera=surface.camera.take(old),
        pixel=surface.pixel.take(old, axis=0),
        skin=surface.skin.take(old),
    )


@njit(cache=True)
def _renumber(
    ring: np.ndarray, link_start: np.ndarray, link_node: np.ndarray, link_length: np.ndarray, keep: np.ndarray,
    old: np.ndarray,
) -> tuple:  # fmt: skip
    """Ring and links of the nodes that are kept, old (k,), by their new numbers."""
    new = np.full(len(keep) + 1, -1, np.int32)  # the last entry answers the -1 of an empty ring place
    for k in range(len(old)):
        new[old[k]] = k
    kept = np.empty((len(old), 8), np.int32)
    start, node = np.zeros(len(old) + 1, np.int32), np.empty(len(link_node), np.int32)
    length = np.empty(len(link_node), np.float32)
    count = 0
    for k in range(len(old)):
        for place in range(8):
            kept[k, place] = new[ring[old[k], place]]
        for spot in range(link_start[old[k]], link_start[old[k] + 1]):
            if keep[link_node[spot]]:
                node[count], length[count] = new[link_node[spot]], link_length[spot]
                count += 1
        start[k + 1] = count
    return kept, start, node[:count].copy(), length[:count].copy()


def _refuse_wrong_size(camera: Camera, *pictures: np.ndarray | None) -> None:
    for picture in pictures:
        if picture is not None and picture.shape != (camera.height, camera.width):
            raise ValueError(
                f"camera {camera.name} has pictures of {camera.height}x{camera.width}, got {picture.shape}"
            )


def _grid_nodes(depth: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """index (rows, cols) int32, -1 = no node; pixel (n, 2) int16 row and column on the full picture."""
    index = np.full((-(-depth.shape[0] // step), -(-depth.shape[1] // step)), -1, np.int32)
    return index, _number_nodes(depth, index, step, *extent(depth))


@njit(cache=True)
def _number_nodes(
    depth: np.ndarray, index: np.ndarray, step: int, top: int, bottom: int, left: int, right: int
) -> np.ndarray:
    """Fill in the index; returns pixel (n, 2) int16."""
    pixel = np.empty(((bottom - top) // step + 1) * ((right - left) // step + 1), np.int32)
    count = 0
    for i in range((top + step - 1) // step, (bottom + step - 1) // step):
        for j in range((left + step - 1) // step, (right + step - 1) // step):
            if depth[i * step, j * step] > 0.0:
                index[i, j] = count
                pixel[count] = (i * step << 16) | (j * step)
                count += 1
    nodes = np.empty((count, 2), np.int16)
    for node in range(count):
        nodes[node, 0], nodes[node, 1] = pixel[node] >> 16, pixel[node] & 0xFFFF
    return nodes


@njit(cache=True)
def _place_nodes(depth: np.ndarray, rays: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """(n, 3) float32 camera frame."""
    points = np.empty((len(pixel), 3), np.float32)
    for node in range(len(pixel)):
        row, col = np.int64(pixel[node, 0]), np.int64(pixel[node, 1])
        z = depth[row, col]
        points[node, 0], points[node, 1], points[node, 2] = rays[row, col, 0] * z, rays[row, col, 1] * z, z
    return points


@njit(cache=True)
def _moved(T_target_source: np.ndarray, vectors: np.ndarray, point: float) -> np.ndarray:
    """(n, 3) float32: points turned and shifted (point 1), or directions turned (point 0), in double precision."""
    T, moved = T_target_source, np.empty((len(vectors), 3), np.float32)
    for k in range(len(vectors)):
        x, y, z = np.float64(vectors[k, 0]), np.float64(vectors[k, 1]), np.float64(vectors[k, 2])
        for axis in range(3):
            moved[k, axis] = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2] * z + point * T[axis, 3]
    return moved


def _large_pieces(surface: Surface, patch_m2: np.ndarray, min_piece_m2: float) -> np.ndarray:
    piece = pieces(surface)
    return np.bincount(piece, weights=patch_m2)[piece] >= min_piece_m2


@njit(cache=True)
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
