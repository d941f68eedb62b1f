"""Where two level cameras stand to each other, from scratch: their maps of the ground laid over one another.

Two cameras that know the floor differ by a turn about the vertical and a shift over the floor. For every turn, the
shift at which people stand in the same places at the same times, and the room's walls and furniture too, is found by
correlation over all shifts at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from anchorpose.calibration.people.common_view import LevelView
from anchorpose.camera import transform_points

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
