"""Which pixel of a camera each skin point falls on, compiled: ``Camera.pixel_of`` is the plain form."""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.camera import Camera


def lens_of(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """fx, fy, cx, cy (4,) and OpenCV's k1, k2, p1, p2, k3 (5,)."""
    lens = camera.intrinsics
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy]), np.array(lens.distortion, dtype=np.float64)


@njit(cache=True)
def pixels_of(
    points: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray, distortion: np.ndarray, height: int, width: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column and row (n,), -1 where a point falls outside the picture, and its depth z (n,) metres."""
    column, row = np.full(len(points), -1, np.int64), np.full(len(points), -1, np.int64)
    depth = np.empty(len(points))
    k1, k2, p1, p2, k3 = distortion
    for p in range(len(points)):
        place = T_camera_world[:3, 3].copy()
        for i in range(3):
            for j in range(3):
                place[i] += T_camera_world[i, j] * points[p, j]
        depth[p] = place[2]
        if place[2] <= 1e-6:
            continue
        x, y = place[0] / place[2], place[1] / place[2]
        squared = x * x + y * y
        radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
        u = lens[0] * (x * radial + 2.0 * p1 * x * y + p2 * (squared + 2.0 * x * x)) + lens[2]
        v = lens[1] * (y * radial + p1 * (squared + 2.0 * y * y) + 2.0 * p2 * x * y) + lens[3]
        if -0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5:
            c, r = int(np.rint(u)), int(np.rint(v))
            if 0 <= c < width and 0 <= r < height:
                column[p], row[p] = c, r
    return column, row, depth
