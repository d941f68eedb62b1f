"""Find the planes of an empty room, and gaps in its walls: doorways, windows or mirrors.

A depth camera measures along the path of light, so it shows a mirrored room, and mirrored people, beyond a mirror's
plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.first_frames import NOISE_GATE, TOLERANCES_M, drawn_planes
from anchorpose.camera import Camera
from anchorpose.isolation.scene import Scene
from anchorpose.rotations import UP

PLANES: Final = 6  # maximum number of planes that are searched for: floor, ceiling and the walls in view
# number of random draws of three points per plane; if a fifth of all points lies on a plane, one draw in 125 has its
# three points on this plane
TRIALS: Final = 200
VOTERS: Final = 5000  # number of sampled points against which each plane is tested
# minimum share of the image that a plane of the room covers; a smaller plane is taken for furniture, or a person's back
LEAST_SHARE: Final = 0.03
# maximum share of all readings that may lie beyond a wall; in an ideal image, no reading does
MOST_BEYOND: Final = 0.02


def depth_of_room(room_m: np.ndarray, camera: Camera, noise_per_m: float) -> np.ndarray:
    """Return (height, width) float32 depth of the nearest wall, floor or ceiling along each ray; 0 if the ray meets
    none of these.

    room_m (height, width) float32: the known room, 0 = unknown. Walls are planes with many readings on them and hardly
    any behind them. A room is assumed to be convex, so the nearest plane along a ray is the visible plane.
    """
    nearest = np.full(room_m.shape, np.inf, np.float32)
    for plane in find_planes(room_m, camera, noise_per_m):
        nearest = np.minimum(nearest, depth_of_plane(plane, camera))
    return np.where(np.isfinite(nearest), nearest, np.float32(0.0))


def depth_of_plane(plane: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the depth (height, width) float32 at which rays meet a plane (4,) from ``find_planes``; inf for rays that
    do not meet the plane.
    """
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1), np.float32)], axis=-1)
    towards = rays @ plane[:3].astype(np.float32)
    depth = np.where(towards > 1e-3, plane[3] / np.maximum(towards, 1e-3), np.inf)
    return np.asarray(depth, dtype=np.float32)


def find_planes(
    room_m: np.ndarray, camera: Camera, noise_per_m: float, most_beyond: float = MOST_BEYOND
) -> list[np.ndarray]:
    """Return planes (4,) in the camera frame, largest first: unit normal away from the camera, then offset, with
    ``normal @ p = offset`` for every point p of the plane.

    room_m: as in ``depth_of_room``; most_beyond: maximum share of the readings that may lie on the far side of a plane.
    """
    points = camera.back_project(room_m).reshape(-1, 3).astype(np.float64)
    points = points[np.isfinite(points[:, 2])]
    rng = np.random.default_rng(0)
    share = min(1.0, VOTERS / max(len(points), 1))
    points = points[rng.random(len(points)) < share]
    return _planes(points, LEAST_SHARE * share * room_m.size, noise_per_m, most_beyond, rng)


def _planes(
    points_m: np.ndarray, least: float, noise_per_m: float, most_beyond: float, rng: np.random.Generator
) -> list[np.ndarray]:
    """Return the planes (4,) on which more than ``least`` of the points (n, 3) lie, the plane with the most points
    first; at most ``PLANES``.
    """
    found, left = list[np.ndarray](), points_m
    while len(found) < PLANES and len(left) > max(least, 3):
        plane = _best(left, points_m, least, noise_per_m, most_beyond, rng)
        if plane is None:
            break
        found.append(plane)
        left = left[np.abs(left @ plane[:3] - plane[3]) > off_plane_m(left[:, 2], noise_per_m)]
    return found


def _best(
    left_m: np.ndarray,
    points_m: np.ndarray,
    least: float,
    noise_per_m: float,
    most_beyond: float,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """Return the plane through three of the points ``left_m`` that has most points on it and few points beyond it; None
    if too few points are on every such plane.
    """
    normals, offsets = drawn_planes(left_m, TRIALS, rng)
    sign = np.where(offsets < 0, -1.0, 1.0)
    best, best_votes = None, least
    gate, limit = off_plane_m(left_m[:, 2], noise_per_m), off_plane_m(points_m[:, 2], noise_per_m)
    for normal, offset in zip(normals * sign[:, None], offsets * sign, strict=True):
        votes = int(np.count_nonzero(np.abs(left_m @ normal - offset) < gate))
        if votes <= best_votes or np.mean(points_m @ normal - offset > 2.0 * limit) > most_beyond:
            continue
        best, best_votes = np.append(normal, offset), votes
    return None if best is None else _refitted(best, left_m, gate)


def off_plane_m(depth_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """Return the maximum distance (m), for each depth, of a reading from the plane that it shows."""
    return np.asarray(TOLERANCES_M[0] + NOISE_GATE * noise_per_m * depth_m**2)


def _refitted(plane: np.ndarray, points_m: np.ndarray, gate_m: np.ndarray) -> np.ndarray:
    """Return the plane refitted to its inliers by least squares."""
    own = points_m[np.abs(points_m @ plane[:3] - plane[3]) < gate_m]
    centre = own.mean(axis=0)
    normal = np.linalg.eigh(np.cov((own - centre).T))[1][:, 0]
    normal *= np.sign(normal @ plane[:3])
    return np.append(normal, normal @ centre)


# maximum cosine between an upright plane's normal and the vertical, so that the plane may lean by 11 degrees
UPRIGHT: Final = 0.2
FRAMED: Final = 0.6  # minimum share of a gap's border that is wall; a doorway has no wall at its lower border


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """An upright plane in one camera's empty room; the room is on the plane's near side."""

    camera: Camera
    normal: np.ndarray  # (3,) unit vector in the world, away from the camera, with ``normal @ p = offset_m``
    offset_m: float
    depth_m: np.ndarray  # (height, width) float32, depth of the plane along each ray; inf if the ray does not meet it
    on_it: np.ndarray  # (height, width) bool, pixels of the empty room that show the plane
    # (height, width) bool, pixels that show nothing, or something beyond the plane, and lie in the convex hull of the
    # pixels that show the plane (``on_it``)
    gap: np.ndarray

    def beyond_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the distance (...) of points (..., 3) beyond the plane; negative on the camera's side."""
        return np.asarray(points_m @ self.normal - self.offset_m)

    def reflected(self, points_m: np.ndarray) -> np.ndarray:
        """Return (..., 3) the places where a mirror in this plane would show points (..., 3)."""
        return np.asarray(points_m - 2.0 * self.beyond_m(points_m)[..., None] * self.normal)

    def gap_before(self, point_m: np.ndarray) -> np.ndarray | None:
        """Return (height, width) bool: the connected part of the gap through which this camera sees a point (3,); None
        if the point is not seen through the gap.
        """
        _, piece = cv2.connectedComponents(self.gap.astype(np.uint8), connectivity=4)
        _, [own], [inside] = self.camera.look(point_m[None], piece)
        return np.asarray(piece == own) if inside and own else None

    def frames(self, gap: np.ndarray) -> bool:
        """Return whether the plane surrounds a gap (height, width) instead of only bordering on it."""
        border = cv2.dilate(gap.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ~gap
        return bool(border.any() and self.on_it[border].mean() > FRAMED)


def find_walls(scene: Scene) -> list[Wall]:
    """Return the upright planes of a camera's empty room, largest first; they include fronts of furniture."""
    camera, room_m, noise = scene.camera, scene.background.depth_m, scene.background.sensor.noise_per_m
    T_world_camera, found = camera.require_pose(), list[Wall]()
    for plane in find_planes(room_m, camera, noise, most_beyond=1.0):
        normal = T_world_camera[:3, :3] @ plane[:3]
        if abs(normal @ UP) > UPRIGHT:
            continue
        beyond = np.nan_to_num(camera.back_project(room_m) @ plane[:3].astype(np.float32) - plane[3], nan=np.inf)
        limit_m = off_plane_m(room_m, noise)
        on_it = (room_m > 0) & (np.abs(beyond) < limit_m)
        gap = _within(on_it) & ~on_it & (beyond > limit_m)
        offset_m = float(plane[3] + normal @ camera.position_m)
        found.append(Wall(camera, normal, offset_m, depth_of_plane(plane, camera), on_it, gap))
    return found


def _within(mask: np.ndarray) -> np.ndarray:
    """Return (height, width) bool: the convex hull of the pixels of a mask."""
    filled = np.zeros(mask.shape, np.uint8)
    hull = cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32))
    return cv2.fillConvexPoly(filled, hull, 1).astype(bool)


def with_wall(scene: Scene, wall: Wall, gap: np.ndarray) -> Scene:
    """Return the scene with the wall in place of the gap (height, width), so that no person is seen beyond the wall."""
    model = scene.background
    depth_m = np.where(gap, wall.depth_m, model.depth_m)
    sigma_m = np.where(gap, model.sensor.noise.sigma_m(wall.depth_m).astype(np.float32), model.sigma_m)
    return replace(scene, background=replace(model, depth_m=depth_m, sigma_m=sigma_m))
