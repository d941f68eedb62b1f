"""Which nodes lie near each other on the body itself, by the skin that is expected where they were seen.

Near each other in space is not near each other on the body: a hand lies on the trunk, a thigh against the other. The
distances of two skin points to a few landmarks tell the two apart wherever the body is predicted; it is the paper's
descriptor (Definition 3), computed once on the patient's model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid

UNKNOWN = -1
OFF_PLANE = np.float32(3.0)  # a node off the skin counts so many times one along it: skin points are samples of a sheet


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedSkin:
    """The patient's skin where it is predicted.

    points_m, normals (k, 3) float32, world. landmarks_m (k, l) float32: geodesic distance on the body, not on what is
    seen of it, of each skin point to l landmarks.
    """

    points_m: np.ndarray
    normals: np.ndarray
    landmarks_m: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class KinshipConfig:
    """When two places are neighbours on the body."""

    reach_m: float = 0.12  # from a node to the skin point it is taken for: a fast hand's prediction is so far off
    max_turn_deg: float = 70.0  # between their normals; the far side of a wrist looks the other way
    doubt_m: float = 0.02  # skin that is nearer by less may be the other one
    far_m: float = 0.15  # on the body: farther apart, two candidates leave it open where the node belongs
    slack_m: float = 0.04  # skin points are 3 cm apart, and each of the two may be the wrong neighbour
    stretch: float = 1.15  # how much longer the way over the skin may be than the straight one

    def __post_init__(self) -> None:
        for name in ("reach_m", "max_turn_deg", "stretch"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not self.slack_m >= 0:
            raise ValueError(f"slack_m must not be negative, got {self.slack_m}")


def skin_under(
    points_m: np.ndarray, normals: np.ndarray, pixel: np.ndarray, camera: Camera, step: int, expected: ExpectedSkin,
    config: KinshipConfig,
) -> np.ndarray:  # fmt: skip
    """(n, 2) int32: the skin point nearest to each node of one camera, and the nearest far from that one on the body.

    ``UNKNOWN`` where none is near; the second where it is hardly farther off than the first.

    points_m, normals (n, 3) float32 world, pixel (n, 2) row and column, on the grid of every ``step``-th pixel.
    """
    T_camera_world = invert_rigid(camera.require_pose())
    lens = camera.intrinsics
    return _nearest_skin(
        points_m, normals, pixel, expected.points_m, expected.normals, expected.landmarks_m,
        T_camera_world.astype(np.float32),
        np.array([lens.fx, lens.fy, lens.cx, lens.cy], np.float32), camera.height // step + 1,
        camera.width // step + 1, step, np.float32(config.reach_m), np.float32(np.cos(np.radians(config.max_turn_deg))), np.float32(config.doubt_m), np.float32(config.far_m),
    )  # fmt: skip


@njit(cache=True, fastmath=True)
def way_over_skin(landmarks: np.ndarray, a: int, b: int) -> float:
    """A lower bound of the geodesic distance of two skin points: what the triangle inequality leaves."""
    most = np.float32(0.0)
    for k in range(landmarks.shape[1]):
        most = max(most, abs(landmarks[a, k] - landmarks[b, k]))
    return most


@njit(cache=True, fastmath=True)
def _nearest_skin(
    points: np.ndarray, normals: np.ndarray, pixel: np.ndarray, skin: np.ndarray, skin_normals: np.ndarray,
    landmarks: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray, rows: int, cols: int, step: int, reach: float,
    min_cosine: float, doubt: float, far: float,
) -> np.ndarray:  # fmt: skip
    """Skin points hang in lists on the pixel grid; a node looks around its own pixel, ring after ring."""
    head = np.full((rows, cols), -1, np.int32)
    following = np.full(len(skin), -1, np.int32)
    finest = np.float32(np.inf)  # metres that a step of the grid spans where the skin is nearest
    for k in range(len(skin)):
        x, y, z = np.float32(0), np.float32(0), np.float32(0)
        for axis in range(3):
            x += T_camera_world[0, axis] * skin[k, axis]
            y += T_camera_world[1, axis] * skin[k, axis]
            z += T_camera_world[2, axis] * skin[k, axis]
        x, y, z = x + T_camera_world[0, 3], y + T_camera_world[1, 3], z + T_camera_world[2, 3]
        if z <= 0.0:
            continue
        row, col = int(np.rint((lens[1] * y / z + lens[3]) / step)), int(np.rint((lens[0] * x / z + lens[2]) / step))
        if 0 <= row < rows and 0 <= col < cols:
            following[k] = head[row, col]
            head[row, col] = k
            finest = min(finest, z * step / max(lens[0], lens[1]))
    under = np.full((len(points), 2), -1, np.int32)
    if not finest < np.inf:
        return under
    widest = int(np.ceil(reach / finest))
    near = np.empty(256, np.int32)
    away = np.empty(256, np.float32)
    for n in range(len(points)):
        row, col = pixel[n, 0] // step, pixel[n, 1] // step
        nearest = reach
        count = 0
        for ring in range(widest + 1):
            if max(ring - 1, 0) * finest > nearest + doubt:
                break
            for i in range(max(0, row - ring), min(rows, row + ring + 1)):
                whole = i == row - ring or i == row + ring
                j = col - ring
                while j <= col + ring:
                    if 0 <= j < cols:
                        k = head[i, j]
                        while k >= 0:
                            d0, d1, d2 = (points[n, 0] - skin[k, 0], points[n, 1] - skin[k, 1],
                                          points[n, 2] - skin[k, 2])  # fmt: skip
                            off = d0 * skin_normals[k, 0] + d1 * skin_normals[k, 1] + d2 * skin_normals[k, 2]
                            d = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + (OFF_PLANE * OFF_PLANE - 1) * off * off)
                            if d < nearest + doubt and count < 256:
                                cosine = (normals[n, 0] * skin_normals[k, 0] + normals[n, 1] * skin_normals[k, 1]
                                          + normals[n, 2] * skin_normals[k, 2])  # fmt: skip
                                if cosine > min_cosine:
                                    near[count], away[count] = k, d
                                    count += 1
                                    if d < nearest:
                                        nearest, under[n, 0] = d, k
                            k = following[k]
                    j += 1 if whole else max(2 * ring, 1)
        second = nearest + doubt
        for c in range(count):
            if away[c] < second and way_over_skin(landmarks, near[c], under[n, 0]) > far:
                second, under[n, 1] = away[c], near[c]
    return under
