"""Learn one camera's noise, the still surfaces, the floor and the patient's place from the camera's first frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import described
from anchorpose.descriptor.people import LEAST_CERTAINTY, find_people, people_mask
from anchorpose.recording.recording import FrameSet

MAD_OF_NORMAL: Final = 0.6745  # median of |x| of a standard normal distribution
# minimum share of a pixel's readings that show a surface, for this surface to be the room; the other readings may show
# people in front
STAYS_SHARE: Final = 0.3
SAME_M, SAME_SIGMAS = 0.02, 3.0  # two readings of one surface differ by less than 0.02 m plus 3 sigmas of the noise


def noise_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Return the factor a of the sensor's noise law sigma(z) = a z^2 (unit 1/m), from second differences along rows.

    depths_m: depth frames (height, width) float32, 0 = no reading. The second difference along a plane is zero, so
    second differences are noise; medians ignore edges. The factor includes the error that is due to rounding depth to
    whole grey values. Source of the law: Khoshelham and Elberink 2012 (doi:10.3390/s120201437). Raises ValueError if no
    three neighbouring pixels have a reading.
    """
    ratios = []
    for depth in depths_m:
        depth = depth.astype(np.float64)
        left, middle, right = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
        seen = (left > 0) & (middle > 0) & (right > 0)
        ratios.append(np.abs(left - 2 * middle + right)[seen] / middle[seen] ** 2)
    every = np.concatenate(ratios) if ratios else np.empty(0)
    if not every.size:
        raise ValueError("no three neighbouring pixels have a reading: the noise cannot be measured")
    white = float(np.median(every)) / (MAD_OF_NORMAL * np.sqrt(6.0))
    return float(np.hypot(white, step_per_m(depths_m) / np.sqrt(12.0)))


def step_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Return the factor s (unit 1/m) in the law s z^2 for the step from one grey value to the next at depth z; 0 if all
    values are equal.

    depths_m: as for ``noise_per_m``. In cameras that measure disparity, the steps between grey values grow with the
    square of the distance.
    """
    steps = []
    for depth in depths_m:
        values = np.unique(depth[depth > 0]).astype(np.float64)
        if len(values) > 1:
            steps.append(np.median(np.diff(values) / values[1:] ** 2))
    return float(np.median(steps)) if steps else 0.0


def what_stays(frames_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """Return (height, width) float32: the depth of the farthest surface that at least ``STAYS_SHARE`` of a pixel's
    readings show.

    frames_m (n, height, width), 0 = no reading. The farthest surface is the room, since people stand in front of it. An
    edge pixel of a bar, which sometimes reads the bar and sometimes the background, counts as bar if it mostly reads
    the bar. The result is 0 where fewer than ``STAYS_SHARE`` of the frames have a reading.
    """
    if len(frames_m) == 1:
        return frames_m[0]
    rising = np.sort(frames_m, axis=0)
    count = (rising > 0).sum(axis=0)
    needed = np.maximum(np.ceil(STAYS_SHARE * np.maximum(count, 1)).astype(np.int64), 1)
    level = np.take_along_axis(rising, (len(rising) - needed)[None], axis=0)[0]
    near = np.abs(rising - level) < SAME_M + SAME_SIGMAS * noise_per_m * level**2
    near &= rising > 0
    total = np.where(near, rising, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return np.where(count >= STAYS_SHARE * len(frames_m), total, 0.0).astype(np.float32)


# m; readings nearer than the room by more than this are on people or objects in front of it; a body is thicker than
# this
NEARER_M: Final = 0.15
# limits for an image from which the room was removed: ALONE_SHARE is the maximum share of its pixels with readings,
# ALONE_DEPTH_M the maximum depth range in m
ALONE_SHARE, ALONE_DEPTH_M = 0.5, 1.5
# minimum share of the readings that show people in an image from which the room was removed, median over frames. In 139
# recordings from which the room was removed, the share of readings that show people is 1.0. In images with the room,
# the share of readings that show people is 0.2 if the camera's range ends at 3 m, and 0.65 if five people fill the
# image
ALONE_PEOPLE: Final = 0.6
FRAMES_NEEDED: Final = 8  # minimum number of frames for a percentile of a pixel's readings over time to be meaningful
USUAL_DISTANCE_M: Final = 2.5  # m, assumed distance of the patient from the camera if no person is found


def start_of_patient(
    camera: Camera, sample_frames: Sequence[FrameSet], up: np.ndarray, height_m: float | None
) -> tuple[np.ndarray, str]:
    """Return a point (3,) in the camera frame below the pelvis of a person, and a note on how it was found. The person
    is the most visible person in the first sampled frame with a person. The point is on the floor or, without a floor,
    at the height of the lowest visible point.

    up (3,), camera frame; height_m: height of the camera above the floor, None if unknown. If the learnt descriptor
    finds no person, the point is straight ahead of the camera.
    """
    for frame in sample_frames:
        depth = frame.depths_m[0]
        if depth is None:
            continue
        said = described(depth, camera)
        for one in find_people([said], [depth], [np.eye(4)]):
            if one.certainty >= LEAST_CERTAINTY and one.rays[0] is not None:
                seen_m = camera.back_project(depth)[said.row[one.rays[0]], said.column[one.rays[0]]]
                place = _dropped(one.pelvis_m, seen_m.astype(np.float64), up, height_m)
                return place, f"the origin is below the person who shows most in frame {frame.frame}"
    ahead = np.array([0.0, 0.0, USUAL_DISTANCE_M])
    place = _dropped(ahead, ahead[None], up, height_m)
    return place, f"nobody was found: the origin is {USUAL_DISTANCE_M} m ahead of the camera"


def people_only(frames_m: Sequence[np.ndarray], camera: Camera) -> bool:
    """Return whether the recorder has removed the room from the depth images (height, width) of a camera. Such images
    have few readings, all within the depth range that a person can fill, and the learnt descriptor finds people at most
    of these readings. A camera that reads only a few metres far also gives few readings, but they show floor and
    furniture.
    """
    if not all(_may_be_alone(frame) for frame in frames_m):
        return False
    shares = [np.mean(people_mask(frame, camera)[frame > 0]) for frame in frames_m if (frame > 0).any()]
    return not shares or bool(np.median(shares) >= ALONE_PEOPLE)


def _may_be_alone(depth_m: np.ndarray) -> bool:
    """Return whether a depth image has as few readings, and as small a depth range, as people without a room."""
    readings = depth_m[depth_m > 0]
    if readings.size == 0:
        return True
    low, high = np.percentile(readings, [1, 99])
    return bool(readings.size < ALONE_SHARE * depth_m.size and high - low < ALONE_DEPTH_M)


def _dropped(point_m: np.ndarray, points_m: np.ndarray, up: np.ndarray, height_m: float | None) -> np.ndarray:
    """Return ``point_m`` moved along ``up`` to the floor or, without a floor, to the lowest of the points."""
    lowest = -height_m if height_m is not None else float(np.percentile(points_m @ up, 1))
    moved: np.ndarray = point_m + (lowest - point_m @ up) * up
    return moved


# minimum number of readings in which a floor is searched, and of points on people that show which way is up; the
# smallest depth image has a hundred times as many pixels
LEAST_READINGS: Final = 1000
REFITS: Final = 6  # number of refits of the plane; after three or four, the limit for inliers has converged
# m, unevenness of a hard floor. The unevenness is added to the noise of the readings; otherwise near pixels, which have
# little noise, would dominate the fit of the floor
FLATNESS_M: Final = 0.003
# m, maximum distances from the floor's plane, tried in this order: floors are flat to 2 cm, but a camera's smoothing
# makes waves of 8 cm
TOLERANCES_M: Final = (0.02, 0.08)
NOISE_GATE: Final = 3.0  # sigmas of the sensor's noise that are added to each tolerance
# rad (50 degrees), maximum angle between the camera's upward direction and the floor's normal; cameras look down, but
# hardly roll
WORST_TILT_RAD: Final = 0.87
IMAGE_UP: Final = np.array([0.0, -1.0, 0.0])  # upward direction of a camera whose pose is unknown
# people stand on a plane if at least the share LEAST_STANDING of the points in front of the room (mainly people) lies
# within STANDS_M (metres) of the plane: these points are shoes and part of the shins
STANDS_M, LEAST_STANDING = 0.2, 0.02
LEAST_HEIGHT_M: Final = 0.3  # m, minimum height of the camera above its floor; nearer planes are tables
# maximum ratio of the number of points below the floor to the number of points on it; mirrors and flying pixels cause a
# few points below the floor
MOST_BELOW: Final = 0.1
# maximum share of the points in front of the room (mainly people) that may be below the floor; if a table top is taken
# for the floor, a third of these points (a person's legs) is below it
MOST_SUNK: Final = 0.05
# m; a point in front of the room counts as below a plane if it is lower by more than this: the height of a shoe plus
# the error of a tilted plane
SUNK_M: Final = 0.10
# minimum share of all readings that must lie on the floor; the direction of a smaller patch is uncertain
LEAST_SHARE: Final = 0.02
# m, minimum extent of a floor in its narrower direction; the direction of a narrower patch is uncertain
LEAST_EXTENT_M: Final = 0.5
# number of planes drawn at random, each through three readings. In real rooms, 20 to 50 % of the readings are on the
# floor, so at least one draw in 125 has all three readings on the floor; with only 10 %, it would be one draw in 1000
TRIALS: Final = 300
SAMPLE: Final = 6000  # number of readings drawn at random; readings on and below each plane are counted among these


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """A floor plane: points p on it satisfy up @ p + height_m = 0 in the camera frame.

    up (3,) float64 unit normal, away from the floor; height_m: height of the camera above the floor; residual_m: root
    mean square residual of the inliers.
    """

    up: np.ndarray
    height_m: float
    residual_m: float


def level_of_pose(T_world_camera: np.ndarray) -> FloorPlane:
    """Return the plane Y = 0 of the world, in the camera frame."""
    return FloorPlane(np.asarray(T_world_camera[1, :3], np.float64), float(T_world_camera[1, 3]), 0.0)


class NoFloor(StrEnum):
    """The reason why no floor was found. Such a reason is a result and not an error: a frame may show only people."""

    NO_READINGS = "the depth image has too few readings"
    NO_PLANE = "no plane below the camera has enough readings and nothing under it"
    NARROW = "what may be the floor is too narrow to measure its direction"


def floor_of_room(
    camera: Camera, background_m: np.ndarray | None, frames_m: Sequence[np.ndarray]
) -> FloorPlane | NoFloor:
    """Return the floor in the depth image of the empty room or, without such an image, in the median of the frames.

    Almost no points of people and other objects in front of the room may lie below the floor: a plane with legs below
    it is a table.
    """
    if background_m is None and not frames_m:
        return NoFloor.NO_READINGS
    room = _room(background_m, frames_m)
    try:
        noise = noise_per_m(frames_m or [room])
    except ValueError:
        return NoFloor.NO_READINGS
    return find_floor(room, camera, noise, _before(room, frames_m, camera), up_of(camera))


def _room(background_m: np.ndarray | None, frames_m: Sequence[np.ndarray]) -> np.ndarray:
    if background_m is not None:
        return background_m
    return np.median(np.stack(frames_m), axis=0).astype(np.float32)


def up_of(camera: Camera) -> np.ndarray:
    """Return the upward direction (3,) in the camera frame, by the camera's pose; without a pose, the direction towards
    the image's upper border.
    """
    return IMAGE_UP if camera.T_world_camera is None else np.asarray(camera.T_world_camera[1, :3], np.float64)


def is_upside_down(
    floor: FloorPlane | NoFloor, camera: Camera, background_m: np.ndarray | None, frames_m: Sequence[np.ndarray]
) -> bool:
    """Return whether people stand on a plane above the camera (according to the camera's pose), and on no plane below
    it.

    floor: result of ``floor_of_room`` from the same frames. Also return False if no person moves or no plane is seen,
    since the frames then do not show which way is up.
    """
    if not frames_m or floor is NoFloor.NO_READINGS:
        return False
    room = _room(background_m, frames_m)
    people = _before(room, frames_m, camera)
    if len(people) < LEAST_READINGS or _is_stood_on(floor, people):
        return False
    return _is_stood_on(find_floor(room, camera, noise_per_m(frames_m), people, -up_of(camera)), people)


def _is_stood_on(floor: FloorPlane | NoFloor, people_m: np.ndarray) -> bool:
    if isinstance(floor, NoFloor):
        return False
    return bool(np.mean(np.abs(people_m @ floor.up + floor.height_m) < STANDS_M) >= LEAST_STANDING)


def _before(room_m: np.ndarray, frames_m: Sequence[np.ndarray], camera: Camera) -> np.ndarray:
    """Return about ``SAMPLE`` of the points (n, 3), camera frame, in front of the room: mainly people."""
    nearer = [np.where((room_m <= 0) | (depth < room_m - NEARER_M), depth, 0.0) for depth in frames_m]
    found = [points[np.isfinite(points[..., 2])] for points in map(camera.back_project, nearer)]
    points = np.concatenate([np.zeros((0, 3)), *found])
    return np.asarray(points[:: max(1, len(points) // SAMPLE)])


def find_floor(
    depth_m: np.ndarray,
    camera: Camera,
    noise_per_m: float,
    standing_m: np.ndarray | None = None,
    up: np.ndarray = IMAGE_UP,
) -> FloorPlane | NoFloor:
    """Return the largest plane that faces up and has almost nothing below it.

    depth_m (height, width) float32, preferably without people; noise_per_m (1/m): factor a of the noise's sigma a z^2;
    standing_m (n, 3): points, in the camera frame, on people and objects that stand on the floor; up (3,): approximate
    upward direction in the camera frame. The plane is found by RANSAC on a sample, first with the smaller tolerance of
    ``TOLERANCES_M`` and, if no plane is found, with the larger tolerance. Then the plane is fitted by weighted least
    squares to the inliers. The maximum distance of an inlier shrinks to three standard deviations of the inliers'
    distances. Otherwise the foot of a wall, which is among the first inliers, would tilt the plane.
    """
    points = camera.back_project(depth_m).reshape(-1, 3).astype(np.float64)
    points = points[np.isfinite(points[:, 2])]
    if len(points) < LEAST_READINGS:
        return NoFloor.NO_READINGS
    rng = np.random.default_rng(0)
    voters = points[rng.choice(len(points), min(SAMPLE, len(points)), replace=False)]
    standing = np.zeros((0, 3)) if standing_m is None else standing_m
    for tolerance in TOLERANCES_M:
        plane = _vote(voters, standing, tolerance, noise_per_m, rng, up)
        if plane is not None:
            return _refined(plane, points, tolerance, noise_per_m)
    return NoFloor.NO_PLANE


def _vote(
    points_m: np.ndarray,
    standing_m: np.ndarray,
    tolerance_m: float,
    noise_per_m: float,
    rng: np.random.Generator,
    up: np.ndarray,
) -> np.ndarray | None:
    """Return the plane (4,) (up, height) for which the number of points on it, minus the number of points below it, is
    largest; None if no plane is a floor.

    Noise of the depth z with the standard deviation a z^2 (a: ``noise_per_m``) displaces a point on the floor along its
    ray. Perpendicular to the floor, the displacement is only a z h, where h is the camera's height above the floor,
    since the ray meets the floor at a grazing angle.
    """
    normals, offsets = drawn_planes(points_m, TRIALS, rng)
    sign = np.where(normals @ up < 0.0, -1.0, 1.0)
    normals, heights = normals * sign[:, None], -offsets * sign
    possible = (normals @ up > np.cos(WORST_TILT_RAD)) & (heights > LEAST_HEIGHT_M)
    best, best_votes = None, LEAST_SHARE * len(points_m)
    for normal, height in zip(normals[possible], heights[possible], strict=True):
        distance = points_m @ normal + height
        limit = tolerance_m + NOISE_GATE * noise_per_m * height * points_m[:, 2]
        on_it = int(np.count_nonzero(np.abs(distance) < limit))
        below = int(np.count_nonzero(distance < -limit))
        if below > MOST_BELOW * on_it or on_it - below <= best_votes:
            continue
        sunk = int(np.count_nonzero(standing_m @ normal + height < -SUNK_M))
        if sunk <= MOST_SUNK * len(standing_m):
            best, best_votes = np.append(normal, height), on_it - below
    return best


def drawn_planes(points_m: np.ndarray, trials: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw planes through three of the points (n, 3): unit normals (k, 3) and offsets (k,), ``normal @ p = offset``.

    Triples of collinear points are left out.
    """
    corners = points_m[rng.integers(0, len(points_m), (trials, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    return normals, np.einsum("ij,ij->i", normals, corners[length > 1e-6, 0])


def _refined(plane: np.ndarray, points_m: np.ndarray, tolerance_m: float, noise_per_m: float) -> FloorPlane | NoFloor:
    scale = 1.0
    for _ in range(REFITS):
        distance = points_m @ plane[:3] + plane[3]
        sigma = FLATNESS_M + noise_per_m * plane[3] * points_m[:, 2]
        on_it = np.abs(distance) < scale * (tolerance_m + NOISE_GATE * noise_per_m * plane[3] * points_m[:, 2])
        fitted = _fit_plane(points_m[on_it], sigma[on_it], plane[:3])
        if fitted is None:
            return NoFloor.NARROW
        spread = np.median(np.abs(distance[on_it]) / sigma[on_it]) / MAD_OF_NORMAL
        gate = tolerance_m / sigma + NOISE_GATE
        scale = min(1.0, 3.0 * float(spread) / float(np.median(gate[on_it])))
        plane = fitted
    residual = float(np.sqrt(np.mean((points_m[on_it] @ plane[:3] + plane[3]) ** 2)))
    return FloorPlane(plane[:3], float(plane[3]), residual)


def _fit_plane(points_m: np.ndarray, sigma_m: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """Fit a plane (4,) (up, height) by weighted least squares to centred points; None if their patch is too narrow.

    up (3,): approximate upward direction.
    """
    if len(points_m) < 3:
        return None
    weight = 1.0 / sigma_m**2
    centre = np.average(points_m, axis=0, weights=weight)
    spread, axes = np.linalg.eigh(((points_m - centre) * weight[:, None]).T @ (points_m - centre) / weight.sum())
    if np.sqrt(12.0 * spread[1]) < LEAST_EXTENT_M:  # a uniform strip of width w has variance w^2 / 12
        return None
    normal = axes[:, 0] if axes[:, 0] @ up >= 0.0 else -axes[:, 0]
    return np.append(normal, -normal @ centre)
