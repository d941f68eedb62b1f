"""One camera's depth picture to the surface mesh M = {V, E} (paper, Section III)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from anchorpose.camera import Camera, transform_points
from anchorpose.surface.bridge import BridgeConfig, bridge_pairs
from anchorpose.surface.denoise import DenoiseConfig, denoise, estimate_noise
from anchorpose.surface.edges import EdgeConfig, drop_flying_pixels, jump_coefficients
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
    depth = clean[pixel[:, 0], pixel[:, 1]]
    points = np.concatenate([rays[pixel[:, 0], pixel[:, 1]] * depth[:, None], depth[:, None]], axis=1)
    normals = estimate_normals(clean, rays, pixel, config.normal_radius_px, slope, spread)
    ring = _link_ring(clean, index, pixel.astype(np.int32), RING, config.step, slope, spread)
    pairs = np.empty((0, 2), np.int32)
    if bridge is not None and bridge.any() and len(points) > 0:
        spacing = config.step * float(depth.min()) / max(camera.intrinsics.fx, camera.intrinsics.fy)
        pairs = bridge_pairs(index, bridge, points, normals, config.step, spacing, config.bridge)
    points = transform_points(T_world_camera, points.astype(np.float64)).astype(np.float32)
    start, node, length = compress_links(pairs, straight_m(points, pairs), len(points))
    surface = Surface(
        points_m=points,
        normals=(normals @ T_world_camera[:3, :3].T).astype(np.float32),
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
    node, place = np.nonzero(surface.ring[:, :4] >= 0)
    grid = np.stack([node, surface.ring[node, place]], axis=1)
    return np.sort(np.concatenate([grid, links(surface)[0]]), axis=1).astype(np.int32)


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
    pair, count = edges(surface), len(surface)
    graph = coo_array((np.ones(len(pair), np.int8), (pair[:, 0], pair[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def keep_nodes(surface: Surface, keep: np.ndarray) -> Surface:
    """The part of a surface where keep (n,) bool is true; edges to nodes left out are gone, the order stays."""
    if keep.all():
        return surface
    renumber = np.full(len(surface) + 1, -1, np.int32)  # the last entry answers the -1 of an empty ring place
    renumber[:-1][keep] = np.arange(np.count_nonzero(keep), dtype=np.int32)
    source = renumber[np.repeat(np.arange(len(surface)), np.diff(surface.link_start))]
    target = renumber[surface.link_node]
    stay = (source >= 0) & (target >= 0)
    counts = np.bincount(source[stay], minlength=np.count_nonzero(keep))
    return Surface(
        points_m=surface.points_m[keep],
        normals=surface.normals[keep],
        ring=renumber[surface.ring[keep]],
        link_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        link_node=target[stay],
        link_length_m=surface.link_length_m[stay],
        camera=surface.camera[keep],
        pixel=surface.pixel[keep],
        skin=surface.skin[keep],
    )


def _refuse_wrong_size(camera: Camera, *pictures: np.ndarray | None) -> None:
    for picture in pictures:
        if picture is not None and picture.shape != (camera.height, camera.width):
            raise ValueError(
                f"camera {camera.name} has pictures of {camera.height}x{camera.width}, got {picture.shape}"
            )


def _grid_nodes(depth: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """index (rows, cols) int32, -1 = no node; pixel (n, 2) int16 row and column on the full picture."""
    seen = depth[::step, ::step] > 0
    index = np.full(seen.shape, -1, np.int32)
    index[seen] = np.arange(np.count_nonzero(seen), dtype=np.int32)
    return index, (np.argwhere(seen) * step).astype(np.int16)


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
        row, col = pixel[node, 0], pixel[node, 1]
        for place in range(8):
            i, j = row // step + ring[place, 0], col // step + ring[place, 1]
            if i < 0 or i >= rows or j < 0 or j >= cols or index[i, j] < 0:
                continue
            other = index[i, j]
            far = max(depth[row, col], depth[i * step, j * step])  # of both, so that the test is the same both ways
            limit = slope * far + spread * far * far
            last, whole = depth[row, col], True
            for walk in range(1, step + 1):
                here = depth[row + walk * ring[place, 0], col + walk * ring[place, 1]]
                if here > 0.0:
                    whole = whole and abs(here - last) <= limit
                    last = here
            if whole:
                linked[node, place] = other
    return linked
