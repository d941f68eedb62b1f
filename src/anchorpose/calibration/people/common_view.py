"""What several cameras without poses see at the same moments, each in a frame of its own that stands on the floor.

Where two level cameras stand to each other, from scratch: their maps of the ground laid over one another.

Two cameras that know the floor differ by a turn about the vertical and a shift over the floor. For every turn, the
shift at which people stand in the same places at the same times, and the room's walls and furniture too, is found by
correlation over all shifts at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera, transform_points

NEARER_M: Final = 0.12  # people stand off the room by more than this
SURFACE_STEP_M: Final = 0.07  # neighbours farther apart in depth are not on one surface
NORMAL_PX: Final = 2
RIM_PX: Final = 7  # 2 cm at 2 m to either side: what a limb moves in the 30 ms between two pictures
LEAST_FACING: Final = 0.25  # cosine between normal and ray; flatter surfaces are too noisy


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Surface points of one picture: points, normals (n, 3) float64 camera frame; person (n,) bool: not the room's."""

    points_m: np.ndarray
    normals: np.ndarray
    person: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class LevelView:
    """One camera's part. T_level_camera (4, 4): Y up, origin on the floor below the camera, Z level along its axis
    turned left; depths_m: its pictures (height, width), at the moments that all cameras share; smooth_m: ``smoothed``;
    people (height, width) bool: where people are, with a rim; seen: one a picture; room_m: the empty room or
    what stays.
    """

    camera: Camera
    T_level_camera: np.ndarray
    room_m: np.ndarray
    depths_m: tuple[np.ndarray, ...]
    smooth_m: tuple[np.ndarray, ...]
    people: tuple[np.ndarray, ...]
    seen: tuple[Seen, ...]


def level_view(
    camera: Camera, floor: FloorPlane, background_m: np.ndarray | None, depths_m: Sequence[np.ndarray], step_px: int
) -> LevelView:
    """The view of one camera; depths_m (height, width) float32, 0 = no reading, at least one."""
    stack = np.stack(depths_m)
    room = background_m if background_m is not None else np.quantile(stack, 0.9, axis=0).astype(np.float32)
    smooth = tuple(smoothed(depth) for depth in depths_m)
    seen = tuple(surface_points(camera, depth, room, step_px) for depth in smooth)
    people = tuple(_people(depth, room) for depth in depths_m)
    return LevelView(camera, level_frame(floor), room, tuple(depths_m), smooth, people, seen)


def _people(depth_m: np.ndarray, room_m: np.ndarray) -> np.ndarray:
    """(height, width) bool: nearer than the room, and what is next to it."""
    nearer = (depth_m > 0) & ((room_m <= 0) | (depth_m < room_m - NEARER_M))
    return np.asarray(cv2.dilate(nearer.astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8)) > 0)


def level_frame(floor: FloorPlane) -> np.ndarray:
    """T_level_camera (4, 4): Y along the floor's normal, origin below the camera, X level along the optical axis."""
    ahead = np.array([0.0, 0.0, 1.0])
    forward = ahead - (floor.up @ ahead) * floor.up
    forward /= np.linalg.norm(forward)
    T_level_camera = np.eye(4)
    T_level_camera[:3, :3] = np.stack([forward, floor.up, np.cross(forward, floor.up)])
    T_level_camera[1, 3] = floor.height_m
    return T_level_camera


def smoothed(depth_m: np.ndarray) -> np.ndarray:
    """(height, width) the mean of each 3x3 neighbourhood where it is one surface, elsewhere 0."""
    window = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(depth_m, window)
    one = (nearest > 0) & (cv2.dilate(depth_m, window) - nearest < SURFACE_STEP_M)
    return np.where(one, cv2.blur(depth_m, (3, 3)), np.float32(0.0)).astype(np.float32)


def surface_points(camera: Camera, smooth_m: np.ndarray, room_m: np.ndarray, step_px: int) -> Seen:
    """Points with normals on a grid of every ``step_px``-th pixel, where the surface is smooth and faces the camera."""
    rows, columns = (
        grid.ravel()
        for grid in np.mgrid[
            NORMAL_PX : camera.height - NORMAL_PX : step_px, NORMAL_PX : camera.width - NORMAL_PX : step_px
        ]
    )
    points, normals, good = points_with_normals(camera, smooth_m, rows, columns)
    room = room_m[rows, columns]
    person = (room <= 0) | (smooth_m[rows, columns] < room - NEARER_M)  # where the room is out of reach, people are not
    return Seen(points[good], normals[good], person[good])


def points_with_normals(
    camera: Camera, smooth_m: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and unit normals (n, 3) at pixels ``NORMAL_PX`` or more inside the picture; whether both can be used."""
    rays = camera.pixel_rays()
    aside = ((0, 0), (0, -NORMAL_PX), (0, NORMAL_PX), (-NORMAL_PX, 0), (NORMAL_PX, 0))
    places = [(rows + r, columns + c) for r, c in aside]
    point, left, right, above, below = (
        np.column_stack([rays[at] * smooth_m[at][:, None], smooth_m[at]]).astype(np.float64) for at in places
    )
    normal = np.cross(right - left, below - above)
    length = np.linalg.norm(normal, axis=1)
    seen = np.logical_and.reduce([smooth_m[at] > 0 for at in places])
    flat = np.maximum(np.abs(right - left)[:, 2], np.abs(below - above)[:, 2]) < 2.0 * SURFACE_STEP_M
    normal /= np.maximum(length, 1e-12)[:, None]
    towards = -np.einsum("ij,ij->i", normal, point)
    normal *= np.sign(towards)[:, None]
    facing = np.abs(towards) > LEAST_FACING * np.linalg.norm(point, axis=1)
    return point, normal, seen & flat & facing & (length > 0)


CELL_M: Final = 0.1
MOMENTS: Final = 12  # of those in view: more tell the same
REACH_M: Final = 6.0  # from each camera: beyond it depth cameras see little
BLUR_M: Final = 0.12  # two cameras see other sides of a body
TURNS: Final = 120  # 3 degrees: half a body's breadth at 5 m
BODY_M: Final = 0.1  # from the skin that is seen to the middle of a trunk
LOW_M, HIGH_M = 0.2, 2.2  # heights that count: above the floor's noise, below the ceiling
APART_RAD, APART_M = 0.35, 0.4  # nearer places are one


@dataclass(frozen=True, slots=True, eq=False)
class GroundPlace:
    """T_first_second (4, 4) between level frames, and how well the maps agree there, 0 to 1."""

    T_first_second: np.ndarray
    agreement: float


def search_ground(first: LevelView, second: LevelView, places: int) -> tuple[GroundPlace, ...]:
    """The best ``places`` placings of the second camera against the first, best first, all distinct."""
    maps = _maps(first, 0.0)
    size = next_fast_len(2 * maps.shape[1])
    spectra = rfft2(maps, s=(size, size))
    weight = np.array([1.0 / max(1, len(maps) - 1)] * (len(maps) - 1) + [0.5])  # the room, last, counts half
    found: list[tuple[float, float, float, float]] = []
    for turn in np.arange(TURNS) * 2.0 * np.pi / TURNS:
        other = rfft2(_maps(second, float(turn)), s=(size, size))
        score = irfft2((spectra * other.conj() * weight[:, None, None]).sum(axis=0), s=(size, size))
        for _ in range(2):
            row, column = np.unravel_index(int(score.argmax()), score.shape)
            shift = [(k if k < size // 2 else k - size) * CELL_M for k in (int(row), int(column))]
            found.append((float(score[row, column]), float(turn), shift[0], shift[1]))
            _blot(score, int(row), int(column))
    return tuple(
        GroundPlace(_placing(*place[1:]), place[0] / float(weight.sum())) for place in _distinct(found, places)
    )


def _maps(view: LevelView, turn: float) -> np.ndarray:
    """(moments + 1, cells, cells) float32 of unit norm: where people are at each moment, and at the end the room."""
    T = view.T_level_camera
    moments = [_deeper(transform_points(T, seen.points_m[seen.person])) for seen in view.seen[:: _every(view)]]
    still = np.concatenate([transform_points(T, seen.points_m[~seen.person]) for seen in view.seen[:1]])
    return np.stack([_map(points, turn) for points in (*moments, still)])


def _every(view: LevelView) -> int:
    """Every how many-th moment is looked at."""
    return -(-len(view.seen) // MOMENTS)


def _deeper(points_level_m: np.ndarray) -> np.ndarray:
    """Points of people's skin moved away from the camera, to about their axes."""
    ground = points_level_m * [1.0, 0.0, 1.0]
    away = ground / np.maximum(np.linalg.norm(ground, axis=1, keepdims=True), 1e-6)
    return np.asarray(points_level_m + BODY_M * away)


def _map(points_level_m: np.ndarray, turn: float) -> np.ndarray:
    cells = int(2 * REACH_M / CELL_M)
    points = points_level_m[(points_level_m[:, 1] > LOW_M) & (points_level_m[:, 1] < HIGH_M)]
    ground = points[:, [0, 2]] @ _turn(turn).T
    cell = np.floor((ground + REACH_M) / CELL_M).astype(np.int64)
    cell = cell[((cell >= 0) & (cell < cells)).all(axis=1)]
    mass = np.bincount(cell[:, 0] * cells + cell[:, 1], minlength=cells * cells).reshape(cells, cells)
    blurred = cv2.GaussianBlur(np.sqrt(mass.astype(np.float32)), (0, 0), BLUR_M / CELL_M)
    norm = float(np.linalg.norm(blurred))
    return blurred / norm if norm > 0 else blurred


def _turn(angle: float) -> np.ndarray:
    """(2, 2) on (x, z) of a right-handed turn about Y."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _placing(turn: float, shift_x_m: float, shift_z_m: float) -> np.ndarray:
    T_first_second = np.eye(4)
    T_first_second[np.ix_([0, 2], [0, 2])] = _turn(turn)
    T_first_second[[0, 2], 3] = shift_x_m, shift_z_m
    return T_first_second


def _blot(score: np.ndarray, row: int, column: int) -> None:
    reach = int(2 * APART_M / CELL_M)
    rows, columns = (np.arange(centre - reach, centre + reach + 1) % len(score) for centre in (row, column))
    score[np.ix_(rows, columns)] = -np.inf


def _distinct(found: list[tuple[float, float, float, float]], places: int) -> list[tuple[float, float, float, float]]:
    kept: list[tuple[float, float, float, float]] = []
    for place in sorted(found, reverse=True):
        near = (
            abs((place[1] - other[1] + np.pi) % (2 * np.pi) - np.pi) < APART_RAD
            and np.hypot(place[2] - other[2], place[3] - other[3]) < APART_M
            for other in kept
        )
        if not any(near):
            kept.append(place)
        if len(kept) == places:
            break
    return kept
