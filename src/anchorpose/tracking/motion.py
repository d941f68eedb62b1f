"""Scaled motion dynamics: the next poses, from the most similar movements at any speed (paper, Section IV).

How fast the patient moves by himself, measured over as many frames as his own last frames show to be best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from anchorpose.tracking.motion_database import MotionDatabase, build_database
from anchorpose.tracking.sublists import Matches, best_sublists

_CHECKED: Final = 6  # one-frame predictions that each span is judged by: times some 60 columns, enough
_SHARPNESS: Final = 4  # a span whose squared error is a fifth larger counts half


def span_shares(history: np.ndarray, spans: Sequence[int]) -> np.ndarray:
    """(s,) float64, sum 1: how much the velocity over each span (frames, rising) is to be believed.

    A short span follows the movement, a long one averages the noise out; which is better is seen in how well each would
    have predicted the newest frames from the ones before, all columns together. A span that the history (k, d), newest
    last, is too short to judge has no share; with two frames the shortest has all. Columns with missing values are left
    out.
    """
    known = history[:, np.isfinite(history).all(axis=0)]
    squared = np.full(len(spans), np.inf)
    for number, span in enumerate(spans):
        if len(history) < span + 2:
            break
        velocity = (known[span:-1] - known[: -1 - span]) / span
        missed = known[span + 1 :] - known[span:-1] - velocity
        squared[number] = (missed[-_CHECKED:] ** 2).sum(axis=1).mean() if known.size else np.inf
    if not np.isfinite(squared).any():
        return np.eye(len(spans))[0]
    share = ((squared.min() + 1e-12) / (squared + 1e-12)) ** _SHARPNESS
    return share / share.sum()


def velocity(poses: np.ndarray, spans: Sequence[int], shares: np.ndarray, at: int = -1) -> np.ndarray:
    """(..., d) a frame: at pose ``at`` (from the end) of (..., k, d), newest last; a span that does not fit is cut."""
    total = np.zeros(poses.shape[:-2] + poses.shape[-1:])
    for span, share in zip(spans, shares, strict=True):
        if share > 0:
            reach = min(span, poses.shape[-2] + at)
            total += share * (poses[..., at, :] - poses[..., at - reach, :]) / reach
    return total


class MotionRule(StrEnum):
    """What the next poses are predicted from."""

    BLEND = "blend"  # several similar sub-lists and the patient's own velocity, as far as each is to be trusted
    BEST_SUBLIST = "best_sublist"  # the paper's own: the change that follows the one most similar sub-list
    VELOCITY = "velocity"  # no reference movements: the patient's own velocity, damped
    STANDSTILL = "standstill"  # no motion dynamics at all


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """How movements are compared and continued; a pose vector theta is in metres, see ``joint_motion``.

    The numbers were chosen on four subjects of UI-PRMD, each left out in turn (see ``benchmarks/motions.py``).
    """

    rule: MotionRule = MotionRule.BLEND
    history: int = 5  # frames compared; a sixth of a second at 30 Hz tells a direction from noise
    speeds: tuple[float, ...] = (0.5, 0.71, 1.0, 1.41, 2.0)  # half to double speed in half octaves
    displacement_weight: float = 4.0  # of the way moved over the history; 0 is the paper's equation
    neighbours: int = 32  # sub-lists averaged: one alone adds its own noise; 64 are no better
    own_velocity: float = 0.8  # of what his velocity differs from theirs; 1 would take all of its noise for movement
    spans: tuple[int, ...] = (1, 2, 4)  # frames over which the velocity is measured
    damping: float = 0.85  # of the velocity, after each frame: a limb reverses within a few tenths of a second
    checked: int = 7  # frames back from which both ways are tried on what has happened since

    def __post_init__(self) -> None:
        if self.history < 2:
            raise ValueError(f"history must be at least 2 frames, got {self.history}")
        if not self.speeds or min(self.speeds) <= 0:
            raise ValueError(f"speeds must be positive, got {self.speeds}")
        if not self.displacement_weight >= 0:
            raise ValueError(f"displacement_weight must not be negative, got {self.displacement_weight}")
        if self.neighbours < 1:
            raise ValueError(f"neighbours must be at least 1, got {self.neighbours}")
        if not self.spans or min(self.spans) < 1 or list(self.spans) != sorted(set(self.spans)):
            raise ValueError(f"spans must be rising numbers of frames, got {self.spans}")
        for name in ("own_velocity", "damping"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {getattr(self, name)}")
        if self.checked < 1:
            raise ValueError(f"checked must be at least 1 frame, got {self.checked}")

    @property
    def uses_database(self) -> bool:
        """Whether reference movements are asked for at all."""
        return self.rule in (MotionRule.BLEND, MotionRule.BEST_SUBLIST)

    @property
    def past(self) -> int:
        """Frames that the clip of a sub-list must hold before its newest one."""
        return max(self.history - 1, self.checked, *self.spans)


class PredictionSource(StrEnum):
    """What a prediction rests on."""

    DATABASE = "database"
    OWN_VELOCITY = "own_velocity"  # no reference movements, or a history too short to compare
    STANDSTILL = "standstill"  # one frame of history: no velocity is known


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """theta (steps, d) float64, NaN where the last pose is unknown. matches: None where none were looked for or found.

    trust: from 0, the own velocity alone, to 1, what followed the matches.
    """

    theta: np.ndarray
    source: PredictionSource
    matches: Matches | None
    trust: float


def reference_motions(
    clips: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, compared: int, config: MotionConfig
) -> MotionDatabase:
    """The database of pose vectors (n_i, d) a clip, recorded at ``rate_hz`` each, for a recording of ``at_hz``."""
    return build_database(clips, rate_hz, at_hz, compared, config.speeds, config.history, config.past)


def predict(
    history: np.ndarray, steps: int, compared: int, database: MotionDatabase | None, config: MotionConfig
) -> Prediction:
    """The next ``steps`` poses after ``history`` (k, d), newest last. Raises ValueError on an empty history.

    compared: columns that count in how good a prediction was, those of the database.
    The paper's rule is theta^(t+h) = theta^t + theta_s^(j+h) - theta_s^j. Ours takes the mean of that over several
    sub-lists and adds how much faster than they the patient moves. How far that is trusted against his velocity alone
    is what each would have been worth ``checked`` frames ago, seen from now: the share of the velocity's squared error
    in both. So a movement that the database does not know is predicted by its velocity.
    """
    if not len(history):
        raise ValueError("a prediction needs at least one pose")
    history = np.asarray(history, dtype=np.float64)[-(config.checked + max(config.spans) + 1) :]
    if len(history) == 1 or config.rule is MotionRule.STANDSTILL:
        return Prediction(np.repeat(history[-1:], steps, axis=0), PredictionSource.STANDSTILL, None, 0.0)
    matches = _similar(history, steps, database, config) if database is not None and config.uses_database else None
    if matches is None or database is None:
        shares = span_shares(history[:, :compared], config.spans)
        own = velocity(history, config.spans, shares)
        ahead = history[-1] + _travelled(steps, config)[:, None] * own
        return Prediction(ahead, PredictionSource.OWN_VELOCITY, None, 0.0)
    if config.rule is MotionRule.BEST_SUBLIST:
        followed = matches.poses(database, np.arange(steps + 1))[0]
        return Prediction(history[-1] + followed[1:] - followed[0], PredictionSource.DATABASE, matches, 1.0)
    return _blend(history, steps, database, matches, config)


def _similar(history: np.ndarray, steps: int, database: MotionDatabase, config: MotionConfig) -> Matches | None:
    if len(history) < config.history:
        return None
    count = config.neighbours if config.rule is MotionRule.BLEND else 1
    return best_sublists(history[-config.history :], database, steps, count, config.displacement_weight)


def _blend(
    history: np.ndarray, steps: int, database: MotionDatabase, matches: Matches, config: MotionConfig
) -> Prediction:
    weight = (1e-6 + matches.distance_m[0]) ** 2 / (1e-6 + matches.distance_m) ** 2
    before = config.past
    theirs = np.tensordot(weight / weight.sum(), matches.poses(database, np.arange(-before, steps + 1)), axes=1)
    theirs = theirs.astype(np.float64)
    shares = span_shares(history[:, : database.compared], config.spans)
    own = velocity(history, config.spans, shares)
    travelled = _travelled(steps, config)[:, None]
    by_velocity = travelled * own
    faster = own - velocity(theirs[: before + 1], config.spans, shares)
    by_matches = theirs[before + 1 :] - theirs[before] + config.own_velocity * travelled * faster
    trust = _trust(history, theirs[: before + 1], shares, database.compared, config)
    ahead = history[-1] + (1.0 - trust) * by_velocity + trust * by_matches
    return Prediction(ahead, PredictionSource.DATABASE, matches, trust)


def _trust(history: np.ndarray, theirs: np.ndarray, shares: np.ndarray, compared: int, config: MotionConfig) -> float:
    """How much better the change of the matches tells the last frames of the history than its velocity before them."""
    back = min(config.checked, len(history) - 2)
    known = np.flatnonzero(np.isfinite(history[:, :compared]).all(axis=0))
    happened = history[-1] - history[-1 - back]
    expected = _travelled(back, config)[-1] * velocity(history, config.spans, shares, at=-1 - back)
    off = ((happened - (theirs[-1] - theirs[-1 - back]))[known] ** 2).sum()
    off_by_velocity = ((happened - expected)[known] ** 2).sum()
    return float(off_by_velocity / (off + off_by_velocity)) if off > 0 else 1.0


def _travelled(steps: int, config: MotionConfig) -> np.ndarray:
    """(steps,) frames' worth of velocity after each step."""
    return np.cumsum(config.damping ** np.arange(steps))
