"""Scaled motion dynamics: the next poses, from the most similar movement at any speed (paper, Section IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numba import njit


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """How movements are compared; a pose vector theta is in metres, see ``joint_motion``."""

    history: int = 5  # frames compared; a sixth of a second at 30 Hz tells a direction from noise
    speeds: tuple[float, ...] = (0.5, 0.71, 1.0, 1.41, 2.0)  # half to double speed in half octaves
    worst_match_m: float = 0.12  # per joint, way moved included: bodies of another size come to 0.05 to 0.10
    displacement_weight: float = 2.0  # of the way moved over the history; 0 is the paper's equation
    damping: float = 0.8  # of the velocity per frame, without a match: a limb reverses within a few tenths of a second

    def __post_init__(self) -> None:
        if self.history < 2:
            raise ValueError(f"history must be at least 2 frames, got {self.history}")
        if not self.speeds or min(self.speeds) <= 0:
            raise ValueError(f"speeds must be positive, got {self.speeds}")
        if not self.worst_match_m > 0:
            raise ValueError(f"worst_match_m must be positive, got {self.worst_match_m}")
        if not self.displacement_weight >= 0:
            raise ValueError(f"displacement_weight must not be negative, got {self.displacement_weight}")
        if not 0 <= self.damping <= 1:
            raise ValueError(f"damping must lie between 0 and 1, got {self.damping}")


class PredictionSource(StrEnum):
    """What a prediction rests on."""

    DATABASE = "database"
    CONSTANT_VELOCITY = "constant_velocity"  # no movement of the database is similar, or there is none
    STANDSTILL = "standstill"  # one frame of history: no velocity is known


@dataclass(frozen=True, slots=True, eq=False)
class MotionDatabase:
    """Reference movements D_s at all speeds, end to end.

    theta (n, d) float32; start (clips + 1,) int64: where each clip begins and the last one ends; speed (clips,).
    The first ``compared`` columns decide how similar two poses are; the others (a path over the floor, whose origin
    means nothing) are only predicted.
    """

    theta: np.ndarray
    start: np.ndarray
    speed: np.ndarray
    compared: int


@dataclass(frozen=True, slots=True)
class Match:
    """The best matched sub-list: its last frame (row of the database), its speed and the mean distance of a frame."""

    row: int
    speed: float
    distance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """theta (steps, d) float64, NaN where the last pose is unknown; match: the best one found, good enough or not."""

    theta: np.ndarray
    source: PredictionSource
    match: Match | None


def build_database(
    clips: Sequence[np.ndarray], rate_hz: float, at_hz: float, compared: int, config: MotionConfig
) -> MotionDatabase:
    """D_s = interpolated and resampled clips, (n_i, d) each, recorded at ``rate_hz``, for a recording at ``at_hz``.

    Raises ValueError where a clip holds missing values or no clip is long enough for a history and one step.
    """
    pieces, speeds = [], []
    for clip in clips:
        if not np.isfinite(clip).all():
            raise ValueError("a clip of the motion database has missing values; cut it there")
        for speed in config.speeds:
            frames = np.arange(0.0, len(clip) - 1 + 1e-9, speed * rate_hz / at_hz)
            if len(frames) > config.history:
                pieces.append(_resample(np.asarray(clip, dtype=np.float64), frames))
                speeds.append(speed)
    if not pieces:
        raise ValueError(f"no clip of the motion database is longer than {config.history} frames")
    start = np.cumsum([0, *(len(piece) for piece in pieces)]).astype(np.int64)
    return MotionDatabase(np.concatenate(pieces).astype(np.float32), start, np.array(speeds), compared)


def best_match(history: np.ndarray, database: MotionDatabase, steps: int, displacement_weight: float) -> Match | None:
    """s, j = argmin of the sum over v of ed(theta^(t-v), theta_s^(j-v)), exactly; None where no clip is long enough.

    To the sum comes ``displacement_weight`` k times the distance of the ways moved over the history: a pose is passed
    in both directions and at every speed, and alone it does not tell them apart.
    history (k, d): the newest pose last. Only sub-lists that are followed by ``steps`` more frames count. A column
    that is missing anywhere in the history is not compared; None where none is left.
    """
    k = len(history)
    known = np.flatnonzero(np.isfinite(history[:, : database.compared]).all(axis=0))
    if not len(known):
        return None
    first, last = database.start[:-1] + k - 1, database.start[1:] - steps
    columns = np.ascontiguousarray(database.theta[:, known])
    recent = np.ascontiguousarray(history[:, known], dtype=np.float32)
    row, total = _search(columns, recent, first, last, displacement_weight)
    if row < 0:
        return None
    clip = int(np.searchsorted(database.start, row, side="right")) - 1
    return Match(row, float(database.speed[clip]), total / k / float(np.sqrt(len(known) / 3.0)))


def predict(history: np.ndarray, steps: int, database: MotionDatabase | None, config: MotionConfig) -> Prediction:
    """theta^(t+h) = theta^t + theta_s^(j+h) - theta_s^j for h = 1...steps, newest pose of the history (k, d) last.

    Falls back to a damped constant velocity, and says so, where the history is short, or the best match is farther off
    than ``worst_match_m``: then the database knows no such movement. Raises ValueError on an empty history.
    """
    if not len(history):
        raise ValueError("a prediction needs at least one pose")
    history = np.asarray(history, dtype=np.float64)[-config.history :]
    match = None
    if database is not None and len(history) == config.history:
        match = best_match(history, database, steps, config.displacement_weight)
        if match is not None and match.distance_m <= config.worst_match_m:
            ahead = database.theta[match.row + 1 : match.row + 1 + steps] - database.theta[match.row]
            return Prediction(history[-1] + ahead, PredictionSource.DATABASE, match)
    if len(history) == 1:
        return Prediction(np.repeat(history, steps, axis=0), PredictionSource.STANDSTILL, match)
    span = min(2, len(history) - 1)  # over two frames: half the noise of one
    velocity = (history[-1] - history[-1 - span]) / span
    travelled = np.cumsum(config.damping ** np.arange(1, steps + 1))
    return Prediction(history[-1] + travelled[:, None] * velocity, PredictionSource.CONSTANT_VELOCITY, match)


def _resample(clip: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(m, d): the clip at fractional frames, linear."""
    low = np.minimum(frames.astype(np.int64), len(clip) - 2)
    share = (frames - low)[:, None]
    return (1.0 - share) * clip[low] + share * clip[low + 1]


@njit(cache=True)
def _search(
    theta: np.ndarray, history: np.ndarray, first: np.ndarray, last: np.ndarray, displacement_weight: float
) -> tuple[int, float]:
    """Row that ends the best window and its sum of distances; a window is left as soon as it cannot win."""
    k, d = history.shape
    best, best_row = np.inf, -1
    for clip in range(len(first)):
        for row in range(first[clip], last[clip]):
            total = 0.0
            for back in range(k):
                room = (best - total) ** 2
                squared = 0.0
                for column in range(d):
                    difference = theta[row - back, column] - history[k - 1 - back, column]
                    squared += difference * difference
                    if squared >= room:
                        break
                total += np.sqrt(squared)
                if total >= best:
                    break
            if total >= best:
                continue
            squared = 0.0
            for column in range(d):
                moved = theta[row, column] - theta[row - k + 1, column]
                squared += (moved - (history[k - 1, column] - history[0, column])) ** 2
            total += displacement_weight * k * np.sqrt(squared)
            if total < best:
                best, best_row = total, row
    return best_row, best
