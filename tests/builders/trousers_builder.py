"""Two touching legs with a known map: a depth image joins them, the body does not."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from surface_builder import kinect

from anchorpose.camera import transform_points
from anchorpose.surface.surface import BodyMap, ExpectedSkin

CAMERA = kinect()
RADIUS_M, CROTCH_M, TOP_M, BOTTOM_M, AWAY_M = 0.06, 0.15, 0.25, -0.25, 2.0
ANGLES = np.radians(np.linspace(-75, 75, 9))
HEIGHTS = np.linspace(BOTTOM_M, TOP_M, 26)


def legs_depth() -> np.ndarray:
    """(height, width) depth of two upright half pipes side by side, their crease in the middle of the image."""
    rays = CAMERA.pixel_rays()
    x, up = rays[..., 0] * AWAY_M, -rays[..., 1] * AWAY_M
    across = np.abs(x) - RADIUS_M
    root = RADIUS_M**2 - across**2
    inside = (root > 0) & (up > BOTTOM_M) & (up < TOP_M)
    return np.where(inside, AWAY_M - np.sqrt(np.maximum(root, 0)), 0.0).astype(np.float32)


def expected_legs(shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ExpectedSkin:
    """The legs' skin as predicted, off by a shift in the camera frame: legs meet above the crotch only."""
    side, angle, up = (a.ravel() for a in np.meshgrid([-1, 1], ANGLES, HEIGHTS, indexing="ij"))
    normals = np.stack([np.sin(angle), np.zeros_like(up), -np.cos(angle)], axis=1)
    points = np.stack([side * RADIUS_M, -up, np.full_like(up, AWAY_M)], axis=1) + RADIUS_M * normals
    pairs, length = _neighbours(points, len(ANGLES), len(HEIGHTS), up)
    graph = csr_array((length, pairs.T), shape=(len(points), len(points)))
    ends = [0, len(HEIGHTS) - 1, len(points) // 2, len(points) - 1, len(points) // 4, 3 * len(points) // 4]
    turn = CAMERA.require_pose()[:3, :3]
    return ExpectedSkin(
        points_m=transform_points(CAMERA.require_pose(), points + shift_m).astype(np.float32),
        normals=(normals @ turn.T).astype(np.float32),
        map=BodyMap(
            landmarks_m=dijkstra(graph, directed=False, indices=ends).T.astype(np.float32),
            pairs=pairs.astype(np.int32),
            via=pairs[:, 0].astype(np.int32),
            straight=np.ones(len(pairs), np.float32),
        ),
    )


def _neighbours(points: np.ndarray, angles: int, heights: int, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges along and across each leg and from leg to leg above the crotch."""
    index = np.arange(len(points)).reshape(2, angles, heights)
    pairs = [
        np.stack([a.ravel(), b.ravel()], axis=1)
        for a, b in (
            (index[:, 1:], index[:, :-1]),
            (index[:, :, 1:], index[:, :, :-1]),
            (index[:, 1:, 1:], index[:, :-1, :-1]),
            (index[:, 1:, :-1], index[:, :-1, 1:]),
        )
    ]
    meet = up.reshape(2, angles, heights)[0, 0] >= CROTCH_M
    pairs.append(np.stack([index[0, -1, meet], index[1, 0, meet]], axis=1))
    edges = np.concatenate(pairs)
    return edges, np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
