"""Gather depth readings of free-standing objects near the patient's place, and find bars and plates in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from anchorpose.calibration.first_frames import TOLERANCES_M, noise_per_m
from anchorpose.camera import Camera, transform_points
from anchorpose.settings import Positive, settings

# sigmas of the noise in the height of floor readings; a reading counts as above the floor if it is higher than the
# floor by more than this plus a tolerance
FLOOR_SIGMAS: Final = 4.0
# maximum depth step between pixels of one object: JUMP_M (m), for sides of bars that are seen at an angle, plus
# JUMP_SIGMAS sigmas of the noise
JUMP_M, JUMP_SIGMAS = 0.03, 4.0
# minimum number of a pixel's eight neighbours that have about the pixel's depth; flying pixels have fewer
SUPPORT: Final = 4
# minimum share of an object's pixels that must lie in the searched cylinder; walls and cupboards have less
FREE_SHARE: Final = 0.5
# pixels, width of the rim around free-standing objects in which readings are kept as evidence, since their rays pass
# beside the object
BEYOND_PX: Final = 14
UNREAD_M: Final = 100.0  # m, depth assigned to a large area without readings, since the room is out of range there
UNREAD_PX: Final = 21  # pixels, minimum width of an area out of range; the unread side of a tube is narrower
TOP_M: Final = 2.2  # m, maximum height of the equipment above the floor; lamps and ceiling lifts are not part of it


@settings
class Region:
    """An upright cylinder in which equipment is searched."""

    center_xz_m: tuple[float, float] = (0.0, 0.0)  # the world's origin, where the patient stands
    radius_m: Positive = 1.0  # m; a standing frame, a metre long and wide, is within this distance of its middle


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings of all cameras' empty rooms in and around the region, world frame, one row per pixel.

    origin_m (n, 3): position of the camera; ray (n, 3): vector along the ray with a depth of one metre; depth_m (n,),
    ``UNREAD_M`` without a reading; sigma_m (n,): noise of the depth; pixel_m (n,): breadth of a pixel at this depth;
    stands (n,) bool: True on a free-standing object in the region, False where the ray passes by the object or ends
    beyond it.
    """

    origin_m: np.ndarray
    ray: np.ndarray
    depth_m: np.ndarray
    sigma_m: np.ndarray
    pixel_m: np.ndarray
    stands: np.ndarray

    @property
    def points_m(self) -> np.ndarray:
        """Return the places (n, 3) at which the rays end."""
        return self.origin_m + self.ray * self.depth_m[:, None]


def gather_readings(
    cameras: Sequence[Camera], rooms_m: Sequence[np.ndarray], floor_height_m: float, region: Region
) -> Readings:
    """Gather the readings of all cameras; rooms_m: one (height, width) float32 depth image of the empty room per
    camera, 0 = no reading.
    """
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
    """Return (height, width) bool: pixels that lie above the floor and in the region, and show an object that is mostly
    in the region.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m).astype(np.float64))
    height = points[..., 1] - floor_height_m
    # noise with sigma a z^2 along a ray (a: ``noise``, z: depth) changes the height of a point on the floor by a z h,
    # where h (``lift``) is the camera's height above the floor
    lift = abs(camera.position_m[1] - floor_height_m)
    standing = (room_m > 0) & (height > TOLERANCES_M[0] + FLOOR_SIGMAS * noise * room_m * lift)
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
    """Return (height, width) bool: pixels beside free-standing objects whose depth is not clearly behind these objects.
    Such a pixel mixes object and background, or shows the object.
    """
    nearest = np.where(stands, room_m, 0.0).astype(np.float32)
    around = cv2.dilate(nearest, np.ones((5, 5), np.uint8))
    return (around > 0) & (room_m < around + 3.0 * JUMP_M) & ~stands


def _support(room_m: np.ndarray, mask: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return (height, width): how many of the eight neighbours of a pixel differ in depth by at most ``limit``."""
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
    """Return (height, width) int: the index of each pixel's object, -1 outside the mask; and the number of objects.
    Neighbouring pixels belong to one object if their depths differ by less than ``limit``.
    """
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


# m, maximum distance from a bar's middle line to its surface; bars are tubes of 3 cm to pads of 9 cm
BAR_RADIUS_M: Final = 0.055
# m from a bar's middle line, up to which readings beside the bar are counted. Few readings lie beside a real bar, but
# many lie beside a strip of a plate that looks like a bar
SURROUNDINGS_M: Final = 0.10
# maximum ratio of the readings beside a bar to the readings on it; above 0, since other bars may start from the bar
MOST_BESIDE: Final = 0.5
LEAST_LENGTH_M: Final = 0.15  # m, minimum length of a bar; shorter pieces are handles, screws and corners
SLENDERNESS: Final = 2.5  # minimum ratio of length to breadth of a bar
GAP_M: Final = 0.06  # m, maximum length of a stretch of a bar without readings, which another bar may hide
SEEDS: Final = 120  # number of places, drawn at random, at which each bar or plate is searched
# m, radius of a ball around a seed (a place drawn at random); the points in the ball give a bar's first direction,
# since the ball is twice as wide as a thick bar
NEAR_M: Final = 0.12
LEAST_PIXELS: Final = 40  # minimum number of pixels of a bar or plate; fewer pixels give no direction
PLATE_RADIUS_M: Final = 0.09  # m, radius of a disc that readings on a plate can fill, but readings on a bar cannot
PLATE_FILLED: Final = 0.85  # minimum share of the disc's cells that must have readings for the disc to count as filled
PLATE_FLATNESS_M: Final = 0.02  # m, maximum deviation of readings from a plate's plane, due to noise and upholstery
PLATE_EDGE_M: Final = 0.05  # m, thickness of a seat's edge, which is not a separate bar
CELL_M: Final = 0.02  # m, side of a cell of the disc; three pixels at 2.4 m
MOST_PARTS: Final = 40  # maximum number of parts of one piece of equipment


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A detected part. rotation (3, 3): the part's axes as columns; the last column is the direction of a bar, or the
    normal of a plate.

    low, high (3,): extent of the part's visible points along the axes, relative to ``center_m``; members: indices of
    these points.
    """

    plate: bool
    center_m: np.ndarray
    rotation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    members: np.ndarray


def find_parts(points_m: np.ndarray) -> list[Found]:
    """Find plates, then bars, in points (n, 3), largest first; the points of each found part are removed before the
    next search.
    """
    rng = np.random.default_rng(0)
    left = np.arange(len(points_m))
    parts: list[Found] = []
    for plate, grow, near_m in ((True, _plate_at, PLATE_RADIUS_M), (False, _bar_at, NEAR_M)):
        while len(left) >= LEAST_PIXELS and len(parts) < MOST_PARTS:
            points = points_m[left]
            largest = _largest(points, rng, grow, near_m)
            if largest is None:
                break
            parts.append(_found(plate, points_m, left[largest.members], largest.rotation))
            left = left[~_inside(points, parts[-1], 0.01, PLATE_EDGE_M if plate else 0.01)]
    return parts


def _inside(points_m: np.ndarray, part: Found, margin_m: float, margin_last_m: float) -> np.ndarray:
    """Return (n,) bool: points within the part's extent enlarged by a margin; the margin along its last axis is given
    separately.
    """
    local = (points_m - part.center_m) @ part.rotation
    margin = np.array([margin_m, margin_m, margin_last_m])
    return np.asarray(((local > part.low - margin) & (local < part.high + margin)).all(axis=1))


class _Grown(NamedTuple):
    """A part that was found around a starting point. members: indices of the part's points; rotation (3, 3): the part's
    axes as columns; the last column is the direction of a bar, or the normal of a plate.
    """

    members: np.ndarray
    rotation: np.ndarray


_Grow = Callable[[np.ndarray, np.ndarray, np.ndarray], _Grown | None]
"""A function that returns the part at a place, None without a part there. Its arguments are all points, the place (3,),
and the points near the place.
"""


def _largest(points: np.ndarray, rng: np.random.Generator, grow: _Grow, near_m: float) -> _Grown | None:
    """Search for a part around each of some points drawn at random, and return the part with the most points; None if
    no part is found.
    """
    tree = cKDTree(points)
    places = points[rng.choice(len(points), min(SEEDS, len(points)), replace=False)]
    grown = (grow(points, place, points[tree.query_ball_point(place, near_m)]) for place in places)
    return max((part for part in grown if part is not None), key=lambda part: len(part.members), default=None)


def _bar_at(points: np.ndarray, place: np.ndarray, nearby: np.ndarray) -> _Grown | None:
    line = _grow_line(points, place, _main_direction(nearby)) if len(nearby) >= LEAST_PIXELS // 2 else None
    return None if line is None else _Grown(np.flatnonzero(line[0]), _axes_of_bar(line[1]))


def _grow_line(points: np.ndarray, place: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (n,) bool: the points on the bar that passes through ``place``, and the bar's direction; None if no bar
    passes there.
    """
    middle = place
    radius = 1.5 * BAR_RADIUS_M
    for _ in range(6):
        along, across = _cylindrical(points, middle, axis)
        on_line = across < radius
        reach = _unbroken(along, on_line)
        if reach is None:
            return None
        chosen = on_line & (along >= reach[0]) & (along <= reach[1])
        if chosen.sum() < LEAST_PIXELS:
            return None
        middle, axis = points[chosen].mean(axis=0), _main_direction(points[chosen])
        # for a thin bar, only points within its breadth are used, so that adjoining bars do not turn its axis
        radius = float(np.clip(2.5 * np.median(across[chosen]), 0.4 * BAR_RADIUS_M, BAR_RADIUS_M))
    along, across = _cylindrical(points, middle, axis)
    chosen = (across < radius) & (along >= along[chosen].min()) & (along <= along[chosen].max())
    length = float(np.ptp(along[chosen]))
    beside = (across >= 1.2 * BAR_RADIUS_M) & (across < SURROUNDINGS_M)
    beside &= (along >= along[chosen].min()) & (along <= along[chosen].max())
    breadth = 2.0 * float(np.percentile(across[chosen], 90))
    if length < max(LEAST_LENGTH_M, SLENDERNESS * breadth):
        return None
    return (chosen, axis) if beside.sum() < MOST_BESIDE * chosen.sum() else None


def _cylindrical(points: np.ndarray, middle: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offset = points - middle
    along = offset @ axis
    return along, np.linalg.norm(offset - along[:, None] * axis, axis=1)


def _unbroken(along: np.ndarray, on_line: np.ndarray) -> tuple[float, float] | None:
    """Return the ends of the stretch of readings around position 0 that has no gap longer than ``GAP_M``; None without
    readings.
    """
    places = np.sort(along[on_line])
    if not len(places):
        return None
    breaks = np.flatnonzero(np.diff(places) > GAP_M)
    starts, ends = places[np.concatenate([[0], breaks + 1])], places[np.concatenate([breaks, [len(places) - 1]])]
    middle = int(np.argmin(np.maximum(starts, 0.0) - np.minimum(ends, 0.0)))
    return float(starts[middle]), float(ends[middle])


def _main_direction(points: np.ndarray) -> np.ndarray:
    offset = points - points.mean(axis=0)
    direction: np.ndarray = np.linalg.eigh(offset.T @ offset)[1][:, -1]
    return direction


def _axes_of_bar(axis: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) of a bar in the direction ``axis``. Unless the bar is upright, the first axis across the
    bar is level, so that a level bar has upright and level sides.
    """
    upward = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(upward, axis)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(axis, side), axis], axis=1)


def _found(plate: bool, points_m: np.ndarray, members: np.ndarray, rotation: np.ndarray) -> Found:
    center = points_m[members].mean(axis=0)
    low, high = np.percentile((points_m[members] - center) @ rotation, [1, 99], axis=0)
    return Found(plate, center, rotation, low, high, members)


def _plate_at(points: np.ndarray, place: np.ndarray, nearby: np.ndarray) -> _Grown | None:
    if len(nearby) < LEAST_PIXELS:
        return None
    spread, axes = np.linalg.eigh(np.cov((nearby - place).T))
    if np.sqrt(spread[0]) > PLATE_FLATNESS_M or _filled(nearby - place, axes) < PLATE_FILLED:
        return None
    return _grow_plate(points, place, axes)


def _filled(offset: np.ndarray, axes: np.ndarray) -> float:
    """Divide a disc into cells, and return the share of the cells that contain a point. offset (n, 3): points relative
    to the disc's centre.
    """
    reach = int(PLATE_RADIUS_M / CELL_M)
    cell = np.rint(offset @ axes[:, 1:] / CELL_M).astype(int)
    cell = cell[(np.abs(cell) <= reach).all(axis=1)] + reach
    grid = np.zeros((2 * reach + 1,) * 2, dtype=bool)
    grid[tuple(cell.T)] = True
    row, column = np.indices(grid.shape) - reach
    disc = row**2 + column**2 <= reach**2
    return float(grid[disc].mean())


def _grow_plate(points: np.ndarray, place: np.ndarray, axes: np.ndarray) -> _Grown | None:
    """Return the connected flat surface around a place as its smallest enclosing rectangle; None if this rectangle is
    as narrow as a bar.
    """
    offset = points - place
    on_plane = np.abs(offset @ axes[:, 0]) < PLATE_FLATNESS_M
    flat = offset[on_plane] @ axes[:, 1:]
    cell = np.floor(flat / CELL_M).astype(int)
    first = cell.min(axis=0) - 1
    grid = np.zeros(cell.max(axis=0) - first + 2, dtype=bool)
    grid[tuple((cell - first).T)] = True
    grid = ndimage.binary_opening(grid, np.ones((5, 5), bool))  # removes bars that lie in the same plane
    label, _ = ndimage.label(grid)
    here = label[tuple(-first)]
    if here == 0:
        return None
    chosen = np.flatnonzero(on_plane)[label[tuple((cell - first).T)] == here]
    if len(chosen) < LEAST_PIXELS:
        return None
    (_, size, degrees) = cv2.minAreaRect((points[chosen] - place).astype(np.float32) @ axes[:, 1:].astype(np.float32))
    if min(size) < 2.0 * BAR_RADIUS_M:
        return None
    turn = np.radians(degrees)
    one = axes[:, 1:] @ [np.cos(turn), np.sin(turn)]
    return _Grown(chosen, np.stack([one, np.cross(axes[:, 0], one), axes[:, 0]], axis=1))
