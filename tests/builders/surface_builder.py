"""Pictures and meshes of shapes whose geometry is known, for the tests of surface, geodesics and association."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics
from anchorpose.surface.links import compress_links, straight_m
from anchorpose.surface.surface import Surface

RING = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))

FACING_X = np.array([[0.0, 0.0, -1.0, 2.4], [0.0, -1.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""T_world_camera of a camera 2.4 m in front of the world's origin, 1 m high, looking back along X."""


def kinect(width: int = 128, height: int = 106, T_world_camera: np.ndarray | None = FACING_X) -> Camera:
    """A camera with the pixels of a Kinect v2, only fewer of them."""
    size = {"name": "front", "width": width, "height": height, "depth_scale": 0.001}
    lens = Intrinsics(fx=365.0, fy=365.0, cx=(width - 1) / 2, cy=(height - 1) / 2)
    return Camera(**size, intrinsics=lens, T_world_camera=T_world_camera)


def plane_depth(camera: Camera, normal: np.ndarray, distance_m: float) -> np.ndarray:
    """(height, width) depth of the plane ``normal @ p = distance_m`` in the camera frame."""
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1))], axis=2)
    return (distance_m / (rays @ normal)).astype(np.float32)


def sphere_depth(camera: Camera, centre_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(height, width) depth of a sphere in the camera frame, 0 beside it."""
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1))], axis=2).astype(np.float64)
    a, b, c = (rays**2).sum(axis=2), rays @ centre_m, centre_m @ centre_m - radius_m**2
    root = b * b - a * c
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, 0.0).astype(np.float32)


def grid_surface(points_m: np.ndarray, present: np.ndarray | None = None) -> Surface:
    """A mesh whose nodes are the present entries of a (rows, cols, 3) grid of world points, all neighbours linked."""
    rows, cols = points_m.shape[:2]
    present = np.ones((rows, cols), bool) if present is None else present
    index = np.full((rows + 2, cols + 2), -1, np.int32)
    index[1:-1, 1:-1][present] = np.arange(np.count_nonzero(present))
    pixel = np.argwhere(present)
    ring = np.stack([index[pixel[:, 0] + 1 + i, pixel[:, 1] + 1 + j] for i, j in RING], axis=1)
    count = len(pixel)
    start, node, length = no_links(count)
    return Surface(
        points_m=points_m[present].astype(np.float32),
        normals=np.tile(np.array([1, 0, 0], np.float32), (count, 1)),
        ring=ring,
        link_start=start,
        link_node=node,
        link_length_m=length,
        camera=np.zeros(count, np.uint8),
        pixel=pixel.astype(np.int16),
        skin=np.full(count, -1, np.int32),
    )


def no_links(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """link_start, link_node and link_length_m of a surface without links."""
    return compress_links(np.empty((0, 2), np.int32), np.empty(0, np.float32), count)


def with_links(surface: Surface, pairs: np.ndarray, length_m: np.ndarray | None = None) -> Surface:
    """The surface with these links only, straight ones unless their lengths are given."""
    pairs = np.asarray(pairs, np.int32)
    length_m = straight_m(surface.points_m, pairs) if length_m is None else np.asarray(length_m, np.float32)
    start, node, length = compress_links(pairs, length_m, len(surface))
    return replace(surface, link_start=start, link_node=node, link_length_m=length)


def flat_grid(rows: int, cols: int, spacing_m: float, present: np.ndarray | None = None) -> Surface:
    """A flat sheet in the world's Y-Z plane, row downwards, column towards the patient's left."""
    row, col = np.mgrid[:rows, :cols] * spacing_m
    return grid_surface(np.stack([np.zeros_like(row), -row, -col], axis=2), present)


def star(arms: dict[str, tuple[float, float]], spacing_m: float = 0.02, width_m: float = 0.08) -> Surface:
    """A paper figure: strips from the origin to each (left, up) end in metres, in the Y-Z plane, facing X."""
    reach = max(max(abs(value) for value in end) for end in arms.values()) + width_m
    half = int(reach / spacing_m) + 1
    row, col = np.mgrid[-half : half + 1, -half : half + 1] * spacing_m
    up, left = -row, col
    present = np.zeros(row.shape, bool)
    for end in arms.values():
        length = float(np.hypot(*end))
        direction = np.array(end) / length
        along = left * direction[0] + up * direction[1]
        across = np.abs(left * direction[1] - up * direction[0])
        present |= (along >= 0) & (along <= length) & (across <= width_m / 2)
    return grid_surface(np.stack([np.zeros_like(row), up, -left], axis=2), present)


def moved(surface: Surface) -> Surface:
    """The surface somewhere else."""
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    return replace(surface, points_m=(surface.points_m @ turn.T + [0.3, -0.2, 1.0]).astype(np.float32))
