"""The floor plane in the depth frames of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from anchorpose.calibration.first_frames import MAD_OF_NORMAL, NEARER_M, noise_per_m
from anchorpose.camera import Camera

LEAST_READINGS: Final = 1000  # a hundredth of the smallest depth image
REFITS: Final = 6  # the gate settles after three or four
FLATNESS_M: Final = 0.003  # of a hard floor; keeps near pixels from outvoting all others
TOLERANCES_M: Final = (0.02, 0.08)  # floors are flat to 2 cm; cameras that smooth make waves of 8
NOISE_GATE: Final = 3.0  # sigmas of the sensor's noise, added to each tolerance
WORST_TILT_RAD: Final = 0.87  # 50 degrees between the camera's up and the floor's: cameras look down, hardly roll
IMAGE_UP: Final = np.array([0.0, -1.0, 0.0])  # of a camera whose pose is not known
STANDS_M, LEAST_STANDING = 0.2, 0.02  # who stands on a floor: of what moves, a share within a shoe's and shin's height
LEAST_HEIGHT_M: Final = 0.3  # of the camera above its floor; nearer planes are tables
MOST_BELOW: Final = 0.1  # points below the floor, as a share of those on it: mirrors and flying pixels
MOST_SUNK: Final = 0.05  # share of what moves that may lie below: legs beside a table top are a third of a person
SUNK_M: Final = 0.10  # below the plane: a shoe's height, and what a tilted plane may be off
LEAST_SHARE: Final = 0.02  # of the readings: the direction of a smaller patch is uncertain
LEAST_EXTENT_M: Final = 0.5  # in its narrower direction, for the same reason
TRIALS: Final = 300  # with 10 % of inliers, three good points are drawn once in 1000; planes here hold 20 to 50 %
SAMPLE: Final = 6000  # readings that vote


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """Points p on the floor satisfy up @ p + height_m = 0 in the camera frame.

    up (3,) float64 unit normal, away from the floor; height_m: of the camera above it; residual_m: root mean square of
    the inliers; inlier_share: of all readings.
    """

    up: np.ndarray
    height_m: float
    residual_m: float
    inlier_share: float


class NoFloor(StrEnum):
    """Why no floor was found: a result, because a frame of people alone has none."""

    NO_READINGS = "the depth image has too few readings"
    NO_PLANE = "no plane below the camera has enough readings and nothing under it"
    NARROW = "what may be the floor is too narrow to measure its direction"


def floor_of_room(
    camera: Camera, background_m: np.ndarray | None, frames_m: Sequence[np.ndarray]
) -> FloorPlane | NoFloor:
    """The floor in the depth image of the empty room or, without one, in the median of the frames.

    What stands before the room in the frames, people above all, stands on it: a plane with legs below it is a table.
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
    """(3,) where up is in the camera frame, by its pose; without one the image's upper border is up."""
    return IMAGE_UP if camera.T_world_camera is None else np.asarray(camera.T_world_camera[1, :3], np.float64)


def is_upside_down(
    floor: FloorPlane | NoFloor, camera: Camera, background_m: np.ndarray | None, frames_m: Sequence[np.ndarray]
) -> bool:
    """Whether people stand on a plane that lies above the camera by its pose, and on none below it.

    floor: by ``floor_of_room``, of the same frames. False where nobody moves or no plane is seen: nothing tells then.
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
    """(n, 3) camera points of what stands before the room, ``SAMPLE`` of them at most."""
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
    """The largest plane that faces up, with next to nothing below it.

    depth_m (height, width) float32, best without people; noise_per_m: ``first_frames``; standing_m (n, 3) camera
    points of what stands on the floor; up (3,): about, in the camera frame. RANSAC on a sample, first with the strict
    tolerance; then weighted least squares on the inliers, whose gate shrinks to three of their own deviations: the foot
    of a wall within the first gate would tilt the plane.
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
    """(4,) plane (up, height) with the most votes, less those of points below it; None where none is a floor.

    Depth noise a z^2 along a ray that meets the floor at a grazing angle is a z h across it, h the camera's height.
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

    Triples on a line are left out.
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
    return FloorPlane(plane[:3], float(plane[3]), residual, float(on_it.mean()))


def _fit_plane(points_m: np.ndarray, sigma_m: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """(4,) weighted least squares plane (up, height), centred for conditioning; None where the patch is narrow.

    up (3,): about.
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
