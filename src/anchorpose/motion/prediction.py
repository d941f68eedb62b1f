"""Predict the next joints by scaled motion dynamics: the most similar movements at any speed (paper, Section IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from anchorpose.motion.database import COMPARED, MotionDatabase, build_database, joints_after, pose_vectors
from anchorpose.motion.sublists import Matches, best_sublists
from anchorpose.settings import Count, NotNegative, Positive, settings

SPANS: Final = (1, 2, 4)  # frames over which the patient's velocity is measured
DAMPING: Final = 0.85  # of the velocity, after each frame: a limb reverses within a few tenths of a second
OWN_VELOCITY: Final = 0.8  # of how the patient's velocity differs from the matches'; 1 would follow all of its noise
_CHECKED_STEPS: Final = 6  # one-frame predictions that each span is judged by: times some 60 columns, enough
_SHARPNESS: Final = 4  # a span whose squared error is a fifth larger counts half


class MotionRule(StrEnum):
    """What the next poses are predicted from."""

    BLEND = "blend"  # several similar sub-lists and the patient's own velocity, as far as each is to be trusted
    BEST_SUBLIST = "best_sublist"  # the paper's own: the change that follows the one most similar sub-list
    VELOCITY = "velocity"  # no reference movements: the patient's own velocity, damped
    STANDSTILL = "standstill"  # no motion dynamics at all


@settings
class MotionConfig:
    """How movements are compared and continued; a pose vector theta is in metres, see ``motion_database``.

    The numbers were chosen on four subjects of UI-PRMD, each left out in turn (docs/tracking.md).
    """

    rule: MotionRule = MotionRule.BLEND
    history: Annotated[int, Field(ge=2, strict=True)] = 5  # frames compared; at 30 Hz they show a direction
    speeds: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 0.71, 1.0, 1.41, 2.0)  # in half octaves
    displacement_weight: NotNegative = 4.0  # of the displacement over the history; 0 is the paper's equation
    neighbours: Count = 32  # sub-lists averaged: one alone adds its own noise; 64 are no better
    checked: Count = 7  # frames back from which matches and velocity are both tested on what has happened since

    @property
    def uses_database(self) -> bool:
        """Whether reference movements are needed at all."""
        return self.rule in (MotionRule.BLEND, MotionRule.BEST_SUBLIST)

    @property
    def past(self) -> int:
        """Frames that the clip of a sub-list must hold before its newest one."""
        return max(self.history - 1, self.checked, *SPANS)


class PredictionSource(StrEnum):
    """What a prediction rests on."""

    DATABASE = "database"
    OWN_VELOCITY = "own_velocity"  # no reference movements, or a history too short to compare
    STANDSTILL = "standstill"  # one frame of history: no velocity is known


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """theta (steps, d) float64, NaN where the last pose is unknown. matches: None where none were searched or found.

    trust: from 0, the patient's own velocity alone, to 1, what followed the matches.
    """

    theta: np.ndarray
    source: PredictionSource
    matches: Matches | None
    trust: float


@dataclass(frozen=True, slots=True, eq=False)
class JointPrediction:
    """joints_m (steps, 21, 3) float64 world, NaN where the history lacks a joint; source, trust: see ``Prediction``."""

    joints_m: np.ndarray
    source: PredictionSource
    trust: float


def joint_database(
    clips_m: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, config: MotionConfig
) -> MotionDatabase:
    """Motion database of clips of joints, (n_i, 21, 3) world metres each, Y up; any place, any heading, any rate."""
    return reference_motions([pose_vectors(clip) for clip in clips_m], rate_hz, at_hz, COMPARED, config)


def reference_motions(
    clips: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, compared: int, config: MotionConfig
) -> MotionDatabase:
    """The database of clips of pose vectors (n_i, d), recorded at ``rate_hz`` each, for a recording of ``at_hz``."""
    return build_database(clips, rate_hz, at_hz, compared, config.speeds, config.history, config.past)


def predict_joints(
    history_m: np.ndarray, steps: int, database: MotionDatabase | None, config: MotionConfig
) -> JointPrediction:
    """The joints of the next ``steps`` frames from the last ones (k, 21, 3) world metres, newest last."""
    recent = np.asarray(history_m, dtype=np.float64)
    vectors = pose_vectors(recent)
    prediction = predict(vectors, steps, COMPARED, database, config)
    return JointPrediction(joints_after(recent[-1], vectors[-1], prediction.theta), prediction.source, prediction.trust)


def predict(
    history: np.ndarray, steps: int, compared: int, database: MotionDatabase | None, config: MotionConfig
) -> Prediction:
    """The next ``steps`` poses after ``history`` (k, d), newest last. Raises ValueError on an empty history.

    compared: columns that count in how good a prediction was, those of the database.
    The paper's rule is theta^(t+h) = theta^t + theta_s^(j+h) - theta_s^j. Ours takes the mean of that over several
    sub-lists and adds how much faster than they the patient moves. How far that is trusted against the velocity alone
    is what each would have been worth ``checked`` frames ago, seen from now: the share of the velocity's squared error
    in both. So a movement that the database does not know is predicted by its velocity.
    """
    if not len(history):
        raise ValueError("a prediction needs at least one pose")
    history = np.asarray(history, dtype=np.float64)[-(config.checked + max(SPANS) + 1) :]
    if len(history) == 1 or config.rule is MotionRule.STANDSTILL:
        return Prediction(np.repeat(history[-1:], steps, axis=0), PredictionSource.STANDSTILL, None, 0.0)
    matches = _similar(history, steps, database, config) if database is not None and config.uses_database else None
    if matches is None or database is None:
        own = velocity(history, SPANS, span_shares(history[:, :compared], SPANS))
        ahead = history[-1] + _travelled(steps)[:, None] * own
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
    """The weighted mean of the matches and the patient's own velocity, each as far as it is trusted."""
    weight = (1e-6 + matches.distance_m[0]) ** 2 / (1e-6 + matches.distance_m) ** 2
    before = config.past
    matched = np.tensordot(weight / weight.sum(), matches.poses(database, np.arange(-before, steps + 1)), axes=1)
    matched = matched.astype(np.float64)
    shares = span_shares(history[:, : database.compared], SPANS)
    own = velocity(history, SPANS, shares)
    travelled = _travelled(steps)[:, None]
    by_velocity = travelled * own
    faster = own - velocity(matched[: before + 1], SPANS, shares)
    by_matches = matched[before + 1 :] - matched[before] + OWN_VELOCITY * travelled * faster
    trust = _trust(history, matched[: before + 1], shares, database.compared, config.checked)
    ahead = history[-1] + (1.0 - trust) * by_velocity + trust * by_matches
    return Prediction(ahead, PredictionSource.DATABASE, matches, trust)


def _trust(history: np.ndarray, matched: np.ndarray, shares: np.ndarray, compared: int, checked: int) -> float:
    """How much better the matches explain the last frames of the history than the velocity before them does, 0 to 1."""
    back = min(checked, len(history) - 2)
    known = np.flatnonzero(np.isfinite(history[:, :compared]).all(axis=0))
    happened = history[-1] - history[-1 - back]
    expected = _travelled(back)[-1] * velocity(history, SPANS, shares, at=-1 - back)
    off = ((happened - (matched[-1] - matched[-1 - back]))[known] ** 2).sum()
    off_by_velocity = ((happened - expected)[known] ** 2).sum()
    return float(off_by_velocity / (off + off_by_velocity)) if off > 0 else 1.0


def _travelled(steps: int) -> np.ndarray:
    """(steps,) frames' worth of velocity after each step."""
    return np.cumsum(DAMPING ** np.arange(steps))


def span_shares(history: np.ndarray, spans: Sequence[int]) -> np.ndarray:
    """(s,) float64, sum 1: how much the velocity over each span (frames, rising) is to be trusted.

    A short span follows the movement, a long one averages the noise out. Which is better is measured by how well each
    would have predicted the newest frames from the ones before, all columns together. A span that the history (k, d),
    newest last, is too short to judge has no share; with two frames the shortest has all. Columns with missing values
    are left out.
    """
    known = history[:, np.isfinite(history).all(axis=0)]
    squared = np.full(len(spans), np.inf)
    for number, span in enumerate(spans):
        if len(history) < span + 2:
            break
        velocity = (known[span:-1] - known[: -1 - span]) / span
        missed = known[span + 1 :] - known[span:-1] - velocity
        squared[number] = (missed[-_CHECKED_STEPS:] ** 2).sum(axis=1).mean() if known.size else np.inf
    if not np.isfinite(squared).any():
        return np.eye(len(spans))[0]
    share = ((squared.min() + 1e-12) / (squared + 1e-12)) ** _SHARPNESS
    return share / share.sum()


def velocity(poses: np.ndarray, spans: Sequence[int], shares: np.ndarray, at: int = -1) -> np.ndarray:
    """(..., d) per frame: at pose ``at`` (from the end) of (..., k, d), newest last; too long a span is cut."""
    total = np.zeros(poses.shape[:-2] + poses.shape[-1:])
    for span, share in zip(spans, shares, strict=True):
        if share > 0:
            reach = min(span, poses.shape[-2] + at)
            total += share * (poses[..., at, :] - poses[..., at - reach, :]) / reach
    return total
