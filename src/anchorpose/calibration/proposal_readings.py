"""Readings of what stands free on the floor of the empty room, near the place where the patient stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import Camera, transform_points
from anchorpose.settings import Positive, settings

FLAT_M: Final = 0.02  # floors and mats are level to this
FLOOR_SIGMAS: Final = 4.0  # of the depth noise as seen across the floor
JUMP_M, JUMP_SIGMAS = 0.03, 4.0  # between neighbours on one object: a bar's slanted side, and noise
SUPPORT: Final = 4  # of eight neighbours at a pixel's own depth; flying pixels and their like have fewer
FREE_SHARE: Final = 0.5  # of an object's pixels near the patient's place; walls and cupboards reach farther
BEYOND_PX: Final = 14  # around what stands free: rays that pass by it
UNREAD_M: Final = 100.0  # where a large area has no reading, the room is out of range and the rays passed all in it
UNREAD_PX: Final = 21  # such an area; the side of a tube at a grazing angle is unread as well, but narrower
TOP_M: Final = 2.2  # above the floor; lamps and ceiling lifts are not what the patient holds


@settings
class Region:
    """An upright cylinder: where equipment is sought."""

    center_xz_m: tuple[float, float] = (0.0, 0.0)  # Gamma_0's origin lies where the patient stands
    radius_m: Positive = 1.0  # a standing frame is a metre long and as wide, measured from its middle


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings of all cameras' empty rooms in and around the region, world frame, one row per pixel.

    origin_m (n, 3): the camera that looked; ray (n, 3): one metre of depth long; depth_m (n,), ``UNREAD_M`` where
    nothing was read; sigma_m (n,): noise of the depth; pixel_m (n,): breadth of a pixel there; stands (n,) bool: on an
    object that stands free in the region, False where the ray passes by or ends beyond.
    """

    origin_m: np.ndarray
    ray: np.ndarray
    depth_m: np.ndarray
    sigma_m: np.ndarray
    pixel_m: np.ndarray
    stands: np.ndarray

    @property
    def points_m(self) -> np.ndarray:
        """(n, 3) where each ray ends."""
        return self.origin_m + self.ray * self.depth_m[:, None]


def gather_readings(
    cameras: Sequence[Camera], rooms_m: Sequence[np.ndarray], floor_height_m: float, region: Region
) -> Readings:
    """All cameras together; rooms_m: one (height, width) float32 depth image of the empty room per camera, 0 = no
    reading."""
    each = [_of_one_camera(camera, room, floor_height_m, region) for camera, room in zip(cameras, rooms_m, strict=True)]
    return Readings(*(np.concatenate(rows) for rows in zip(*each, strict=True)))


def _of_one_camera(camera: Camera, room_m: np.ndarray, floor_height_m: float, region: Region) -> tuple[np.ndarray, ...]:
    T_world_camera = camera.require_pose()
    noise = noise_per_m([room_m])
    stands = _stands_free(camera, room_m, noise, floor_height_m, region)
    near = cv2.dilate(stands.astype(np.uint8), np.ones((2 * BEYOND_PX + 1,) * 2, np.uint8)) > 0
    blind = cv2.morphologyEx((room_m <= 0).astype(np.uint8), cv2.MORPH_OPEN, np.ones((UNREAD_PX,) * 2, np.uint8))
    unread = cv2.erode(blind, np.ones((5, 5), np.uint8)) > 0
    chosen = near & (((room_m > 0) & (stands | ~_uncertain(room_m, stands))) | unread)
    rays = np.concatenate([camera.pixel_rays()[chosen], np.ones((int(chosen.sum()), 1))], axis=1)
    depth = np.where(unread, UNREAD_M, room_m)[chosen].astype(np.float64)
    return (
        np.broadcast_to(camera.position_m, rays.shape),
        rays @ T_world_camera[:3, :3].T,
        depth,
        noise * depth**2,
        depth / camera.intrinsics.fx,
        stands[chosen],
    )


def _stands_free(camera: Camera, room_m: np.ndarray, noise: float, floor_height_m: float, region: Region) -> np.ndarray:
    """(height, width) bool: above the floor, in the region, and part of an object that mostly lies in it."""
    points = transform_points(camera.require_pose(), camera.back_project(room_m).astype(np.float64))
    height = points[..., 1] - floor_height_m
    lift = abs(camera.position_m[1] - floor_height_m)  # depth noise a z^2 is a z h across a floor h below
    standing = (room_m > 0) & (height > FLAT_M + FLOOR_SIGMAS * noise * room_m * lift)
    limit = JUMP_M + JUMP_SIGMAS * noise * room_m**2
    supported = _support(room_m, standing, limit) >= SUPPORT
    ground = points[..., [0, 2]] - np.array(region.center_xz_m)
    inside = (np.linalg.norm(ground, axis=-1) < region.radius_m) & (height < TOP_M)
    owner, count = _objects(room_m, supported, limit)
    share = np.bincount(owner[supported], inside[supported], count) / np.maximum(
        np.bincount(owner[supported], minlength=count), 1
    )
    free: np.ndarray = supported & inside & (share[np.maximum(owner, 0)] >= FREE_SHARE)
    return free


def _uncertain(room_m: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """(height, width) bool: pixels beside what stands free, not clearly behind it: mixed, or the same object."""
    nearest = np.where(stands, room_m, 0.0).astype(np.float32)
    around = cv2.dilate(nearest, np.ones((5, 5), np.uint8))
    return (around > 0) & (room_m < around + 3.0 * JUMP_M) & ~stands


def _support(room_m: np.ndarray, mask: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """(height, width) how many of a pixel's eight neighbours lie within the limit of its depth."""
    padded, inside = np.pad(room_m, 1), np.pad(mask, 1)
    count = np.zeros(room_m.shape, np.int64)
    height, width = room_m.shape
    for row in (0, 1, 2):
        for column in (0, 1, 2):
            if (row, column) != (1, 1):
                there = np.s_[row : row + height, column : column + width]
                count += inside[there] & (np.abs(padded[there] - room_m) < limit)
    return np.where(mask, count, 0)


def _objects(room_m: np.ndarray, mask: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, int]:
    """(height, width) int: number of the connected object, -1 outside of the mask; and how many there are."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    pairs = []
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        joined = mask[one] & mask[other] & (np.abs(room_m[one] - room_m[other]) < limit[one])
        pairs.append(np.stack([index[one][joined], index[other][joined]]))
    start, end = np.concatenate(pairs, axis=1)
    size = int(mask.sum())
    graph = coo_array((np.ones(len(start), np.int8), (start, end)), shape=(size, size))
    count, labels = connected_components(graph, directed=False)
    objects = np.full(mask.shape, -1)
    objects[mask] = labels
    return objects, max(int(count), 1)
