"""Predict the joints of the next frames by scaled motion dynamics: find the movements in the database that are most
similar to the last frames, by an exact search, and continue them (paper, Section V).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from numba import njit
from pydantic import Field

from anchorpose.errors import InputError
from anchorpose.motion.database import (
    COLUMNS,
    COMPARED,
    MOTION_REMEDY,
    MotionDatabase,
    SubLists,
    build_database,
    joints_after,
    pose_vectors,
    poses_at,
    read_motions,
)
from anchorpose.settings import Count, NotNegative, Positive, settings

# number of segments (groups of sub-lists) that are searched first; the costs found there become the limit above which
# other segments are skipped
_SEEDS: Final = 16
# factor on lower bounds, and metres (``_SLACK_M``) that are subtracted from lower bounds, since single precision may
# round a bound up
_ROUNDED: Final = np.float32(0.9999)
_SLACK_M: Final = np.float32(1e-5)


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """The sub-lists (short series of poses in reference movements) that are most similar to the patient's last poses,
    the best first.
    """

    place: np.ndarray  # (m,) database row of the newest pose, as in ``SubLists``
    stride: np.ndarray  # (m,) database rows per frame of the recording
    distance_m: np.ndarray  # (m,) cost of each match per frame, converted to a root-mean-square distance between joints

    def poses(self, database: MotionDatabase, frames: np.ndarray) -> np.ndarray:
        """Return pose vectors (m, f, d) of each match. ``frames`` (f,): number of frames from the match's newest pose
        to each pose returned; negative: before the newest pose.
        """
        return poses_at(database.theta, self.place[:, None] + frames * self.stride[:, None])


def best_sublists(
    history: np.ndarray, database: MotionDatabase, steps: int, count: int, displacement_weight: float
) -> Matches | None:
    """Return the ``count`` sub-lists most similar to the last poses; None if every column of these poses has a missing
    value, or if no clip is long enough.

    The cost of a sub-list has two terms. The first term is the sum of k Euclidean distances, each between one of the
    patient's last k poses and the corresponding pose of the sub-list (in the paper: the sum over v of ed(theta^(t-v),
    theta_s^(j-v)), where ed is the Euclidean distance, theta^t is the patient's newest pose, and theta_s^j is the
    newest pose of the sub-list s). The second term is ``displacement_weight * k`` times the distance between the two
    displacements (newest pose minus oldest pose). The second term is needed, since the same pose occurs in movements of
    any direction and speed. history (k, d): the patient's last k poses, the newest last. Only sub-lists that are
    followed by ``steps`` more frames are used. Sub-lists are skipped if a lower bound of their cost exceeds the costs
    of the best ``count`` sub-lists so far. The result is still exact, since a lower bound never exceeds the cost: the
    sum of k distances between poses is at least k times the distance between the two mean poses, and leaving out
    columns can only reduce this distance. Among sub-lists with equal costs, the earlier sub-list is taken. A column of
    the pose vectors that has a missing value anywhere in ``history`` is not compared; the lower bounds cannot be used
    then, so every sub-list is tested.
    """
    k, listed = len(history), database.sublists
    known = np.flatnonzero(np.isfinite(history[:, : database.compared]).all(axis=0))
    if not len(known):
        return None
    if len(known) == database.compared:
        recent = history[:, : database.compared] @ database.basis.astype(np.float64)
        leading = recent[:, :COLUMNS]
        query = np.stack([leading.mean(axis=0), leading[-1] - leading[0]]).astype(np.float32)
        columns = database.turned
    else:
        columns, recent, query = np.ascontiguousarray(database.theta[:, known]), history[:, known], None
    recent = np.ascontiguousarray(recent, dtype=np.float32)
    chosen, cost = _rank(columns, recent, query, listed, steps, count, displacement_weight)
    if not len(chosen):
        return None
    return Matches(listed.place[chosen], listed.stride[chosen], cost / k / float(np.sqrt(len(known) / 3.0)))


@njit(cache=True)
def _rank(
    theta: np.ndarray,
    history: np.ndarray,
    query: np.ndarray | None,
    sublists: SubLists,
    steps: int,
    count: int,
    displacement_weight: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the best sub-lists by increasing cost, and the costs. query: mean pose and displacement of ``history``
    (``summarise``), for the lower bounds; None: every sub-list is tested, without bounds.
    """
    best, cost = np.full(count, -1, dtype=np.int64), np.full(count, np.inf)
    place, stride, followed, segment = sublists.place, sublists.stride, sublists.followed, sublists.segment
    found = 0
    scale, weight = np.float32(len(history)) * _ROUNDED, np.float32(displacement_weight)
    bound = np.zeros(len(segment) - 1, dtype=np.float32)
    seeds = np.zeros(0, dtype=np.int64)
    if query is not None:
        seeds = _bound_segments(sublists.centre, sublists.radius, query, scale, weight, bound)
    for turn in range(len(seeds) + len(bound)):
        s = seeds[turn] if turn < len(seeds) else turn - len(seeds)
        if bound[s] < 0 or bound[s] > cost[-1]:
            continue
        bound[s] = -1.0  # this segment has been searched
        for w in range(segment[s], segment[s + 1]):
            if followed[w] < steps:
                continue
            if query is not None and scale * _apart(sublists.summary[w], query, weight) - _SLACK_M > cost[-1]:
                continue
            total = _cost(theta, history, place[w], stride[w], displacement_weight, cost[-1])
            found = _insert(best, cost, found, w, total)
    return best[:found], cost[:found]


@njit(cache=True)
def _insert(best: np.ndarray, cost: np.ndarray, found: int, w: int, total: float) -> int:
    """Insert the sub-list w into ``best``, the list of the cheapest sub-lists, if its cost ``total`` is low enough;
    return the number of sub-lists in the list.
    """
    if found == len(best):
        if total > cost[-1] or (total == cost[-1] and w > best[-1]):
            return found
        found -= 1
    spot = found
    while spot > 0 and (cost[spot - 1] > total or (cost[spot - 1] == total and best[spot - 1] > w)):
        best[spot], cost[spot] = best[spot - 1], cost[spot - 1]
        spot -= 1
    best[spot], cost[spot] = w, total
    return found + 1


@njit(cache=True, fastmath=True)
def _apart(summary: np.ndarray, query: np.ndarray, weight: np.float32) -> np.float32:
    pose, moved = np.float32(0.0), np.float32(0.0)
    for column in range(summary.shape[1]):
        pose += (summary[0, column] - query[0, column]) ** 2
        moved += (summary[1, column] - query[1, column]) ** 2
    return np.sqrt(pose) + weight * np.sqrt(moved)


@njit(cache=True, fastmath=True)
def _bound_segments(
    centre: np.ndarray, radius: np.ndarray, query: np.ndarray, scale: np.float32, weight: np.float32, bound: np.ndarray
) -> np.ndarray:
    """Fill ``bound`` with a lower bound, per segment, of the costs of its sub-lists; return the segments whose mean
    summaries (``centre``) are nearest to ``query``; they are searched first.
    """
    nearest = np.full(min(_SEEDS, len(centre)), -1, dtype=np.int64)
    reach = np.full(len(nearest), np.float32(3.4e38), dtype=np.float32)
    for s in range(len(centre)):
        pose, moved = np.float32(0.0), np.float32(0.0)
        for column in range(centre.shape[2]):
            pose += (centre[s, 0, column] - query[0, column]) ** 2
            moved += (centre[s, 1, column] - query[1, column]) ** 2
        pose, moved = np.sqrt(pose), np.sqrt(moved)
        away = pose + weight * moved
        pose, moved = max(np.float32(0.0), pose - radius[s, 0]), max(np.float32(0.0), moved - radius[s, 1])
        bound[s] = max(np.float32(0.0), scale * (pose + weight * moved) - _SLACK_M)
        if away < reach[-1]:
            spot = len(reach) - 1
            while spot > 0 and reach[spot - 1] > away:
                nearest[spot], reach[spot] = nearest[spot - 1], reach[spot - 1]
                spot -= 1
            nearest[spot], reach[spot] = s, away
    return nearest


@njit(cache=True)
def _cost(
    theta: np.ndarray, history: np.ndarray, place: float, stride: float, displacement_weight: float, limit: float
) -> float:
    """Return the cost of one sub-list; inf if the cost exceeds ``limit``."""
    k, d = history.shape
    last = len(theta) - 1
    new, old = int(place), int(place - (k - 1) * stride)
    a, b = np.float32(place - new), np.float32(place - (k - 1) * stride - old)
    squared = np.float32(0.0)
    for column in range(d):
        moved = theta[new, column] + a * (theta[min(new + 1, last), column] - theta[new, column])
        moved -= theta[old, column] + b * (theta[old + 1, column] - theta[old, column])
        squared += (moved - (history[k - 1, column] - history[0, column])) ** 2
    total = displacement_weight * k * np.sqrt(squared)
    for back in range(k):
        if total > limit:
            return np.inf
        at = place - back * stride
        low = int(at)
        share, high = np.float32(at - low), min(low + 1, last)
        squared = np.float32(0.0)
        for column in range(d):
            squared += (
                theta[low, column] + share * (theta[high, column] - theta[low, column]) - history[k - 1 - back, column]
            ) ** 2
        total += np.sqrt(squared)
    return total if total <= limit else np.inf


SPANS: Final = (1, 2, 4)  # numbers of frames over which the patient's velocity is measured
# ratio of the velocities in two successive predicted frames; below 1, since a limb reverses its movement within a few
# tenths of a second
DAMPING: Final = 0.85
# share of the velocity difference (patient minus matches) that is added to the matches' velocity. The share is below 1,
# since the difference between the velocities of patient and matches is noisy
OWN_VELOCITY: Final = 0.8
# number of newest frames on which the velocity over each of ``SPANS`` is tested. Each frame is predicted from the
# frames before it; the squared errors of these predictions, summed over about 60 columns of the pose vector, determine
# the span's weight
_CHECKED_STEPS: Final = 6
# a span's weight is 1 / (squared error to this power), so a squared error that is larger by a fifth halves the weight
_SHARPNESS: Final = 4


class MotionRule(StrEnum):
    """The rule by which the patient's next poses are predicted."""

    BLEND = "blend"  # several similar sub-lists and the patient's own velocity, weighted by their reliability
    # the paper's rule: the last pose plus the change of pose that follows the most similar sub-list
    BEST_SUBLIST = "best_sublist"
    VELOCITY = "velocity"  # the patient's own damped velocity, without reference movements
    STANDSTILL = "standstill"  # the last pose is repeated, without motion dynamics


@settings
class MotionConfig:
    """Settings of how the patient's movement is compared with reference movements, and how it is continued. The module
    ``motion.database`` describes pose vectors.

    The default values were chosen on four people of the data set UI-PRMD, each left out in turn (docs/tracking.md).
    """

    rule: MotionRule = MotionRule.BLEND
    # number of past frames that are compared; at 30 Hz, five show the direction of a movement
    history: Annotated[int, Field(ge=2, strict=True)] = 5
    # factors on the speed of reference movements, in steps of half an octave (a factor of 1.41)
    speeds: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 0.71, 1.0, 1.41, 2.0)
    displacement_weight: NotNegative = 4.0  # weight of the displacement over the history; 0 = the paper's equation
    # number of similar sub-lists that are averaged; with a single sub-list, its noise would reach the prediction, and
    # 64 sub-lists are not better than 32
    neighbours: Count = 32
    # number of frames before the newest pose. From there, the newest pose is predicted twice as a test: by similar
    # sub-lists of the database, and by the patient's velocity. The method with the better test prediction gets more
    # weight
    checked: Count = 7

    @property
    def uses_database(self) -> bool:
        """Return whether the prediction rule needs reference movements."""
        return self.rule in (MotionRule.BLEND, MotionRule.BEST_SUBLIST)

    @property
    def past(self) -> int:
        """Return the number of frames that a clip must have before the newest frame of a sub-list."""
        return max(self.history - 1, self.checked, *SPANS)


class PredictionSource(StrEnum):
    """The data from which the next poses are predicted: reference movements, the patient's own velocity, or only the
    last pose.
    """

    DATABASE = "database"
    # the patient's own velocity is continued, since the rule uses no reference movements, the history is too short, or
    # no similar movement was found
    OWN_VELOCITY = "own_velocity"
    STANDSTILL = "standstill"  # the last pose is repeated: the velocity is unknown, or the rule asks for it


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The predicted pose vectors of the next frames."""

    theta: np.ndarray  # (steps, d) float64, NaN where the last pose is unknown
    source: PredictionSource
    matches: Matches | None  # the similar sub-lists; None if no sub-lists were searched for or found
    trust: float  # from 0 (only the patient's own velocity) to 1 (only the continuation of the matches)


@dataclass(frozen=True, slots=True, eq=False)
class JointPrediction:
    """Predicted joints; fields without a comment are described in ``Prediction``."""

    joints_m: np.ndarray  # (steps, 21, 3) float64 world, NaN for joints that the history lacks
    source: PredictionSource
    trust: float


def joint_database(
    clips_m: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, config: MotionConfig
) -> MotionDatabase:
    """Build the motion database from clips of joints, (n_i, 21, 3) metres, Y up, with any place, heading and rate."""
    return reference_motions([pose_vectors(clip) for clip in clips_m], rate_hz, at_hz, COMPARED, config)


def load_motions(path: Path, at_hz: float, config: MotionConfig) -> MotionDatabase | None:
    """Read a file of reference movements and build the database for a recording of ``at_hz`` frames per second; return
    None if the prediction rule (``config.rule``) needs no database. Raises InputError if the file cannot be used.
    """
    if not config.uses_database:
        return None
    clips = read_motions(path)
    try:
        return joint_database(clips.joints_m, clips.rate_hz, at_hz, config)
    except ValueError as error:
        raise InputError(path, f"cannot be used at {at_hz:.3g} frames per second ({error})", MOTION_REMEDY) from None


def reference_motions(
    clips: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, compared: int, config: MotionConfig
) -> MotionDatabase:
    """Build the database for a recording of ``at_hz`` frames per second from clips of pose vectors (n_i, d). rate_hz:
    frames per second of each clip.
    """
    return build_database(clips, rate_hz, at_hz, compared, config.speeds, config.history, config.past)


def predict_joints(
    history_m: np.ndarray, steps: int, database: MotionDatabase | None, config: MotionConfig
) -> JointPrediction:
    """Predict the joints of the next ``steps`` frames from the last frames (k, 21, 3), world, metres, newest last."""
    recent = np.asarray(history_m, dtype=np.float64)
    vectors = pose_vectors(recent)
    prediction = predict(vectors, steps, COMPARED, database, config)
    return JointPrediction(joints_after(recent[-1], vectors[-1], prediction.theta), prediction.source, prediction.trust)


def predict(
    history: np.ndarray, steps: int, compared: int, database: MotionDatabase | None, config: MotionConfig
) -> Prediction:
    """Predict the next ``steps`` poses after ``history`` (k, d), newest last. Raises ValueError on an empty history.

    compared: number of leading columns of a pose vector on which predictions are tested, as in ``MotionDatabase``; the
    other columns (the path) are only predicted. The paper's rule is theta^(t+h) = theta^t + theta_s^(j+h) - theta_s^j,
    where theta^t is the patient's newest pose, theta_s^j is the newest pose of the best sub-list s, and h counts the
    frames after these poses. Our rule takes the mean change theta_s^(j+h) - theta_s^j of several sub-lists and adds
    most of the difference between the patient's velocity and the sub-lists' velocity. The result is mixed with a
    prediction by the patient's velocity alone. The weights follow from the squared errors that both predictions of the
    newest pose would have had if they had been made ``checked`` frames ago. So a movement that the database does not
    contain is predicted by its velocity.
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
    """Return the weighted mean of two predictions: by the matches (similar sub-lists), and by the patient's own
    velocity. The weight of the matches is the trust in them (``_trust``): over 0.5 if the matches would have predicted
    the newest pose better than the velocity.
    """
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
    """Return the trust in the matches (similar sub-lists), 0 to 1. Two predictions of the newest pose are made from
    ``checked`` frames before, by velocity and by the matches. The trust is the squared error by velocity, divided by
    the sum of both squared errors.
    """
    back = min(checked, len(history) - 2)
    known = np.flatnonzero(np.isfinite(history[:, :compared]).all(axis=0))
    happened = history[-1] - history[-1 - back]
    expected = _travelled(back)[-1] * velocity(history, SPANS, shares, at=-1 - back)
    off = ((happened - (matched[-1] - matched[-1 - back]))[known] ** 2).sum()
    off_by_velocity = ((happened - expected)[known] ** 2).sum()
    return float(off_by_velocity / (off + off_by_velocity)) if off > 0 else 1.0


def _travelled(steps: int) -> np.ndarray:
    """Return (steps,) the distances that a movement has covered after 1, 2, ... frames if ``DAMPING`` slows it down in
    each frame; the unit is the distance covered in the first frame.
    """
    return np.cumsum(DAMPING ** np.arange(steps))


def span_shares(history: np.ndarray, spans: Sequence[int]) -> np.ndarray:
    """Return, for each span (number of frames), the weight (s,) float64 of the velocity that is measured over this
    span; the weights add up to 1. spans: in rising order.

    The velocity over a short span follows the movement quickly; the velocity over a long span averages out noise. The
    velocity over each span is tested: it predicts each of the newest frames from the frames before it. The smaller the
    squared error, summed over all columns, the larger the span's weight. A span that is too long to be tested on the
    history (k, d), newest last, has weight 0; with two frames the shortest span has weight 1. Columns with missing
    values are left out.
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
    """Return the velocity (..., d) per frame at pose ``at`` (negative: counted from the end) of poses (..., k, d),
    newest last, as a mean over ``spans`` weighted by ``shares``. Spans that begin before the first pose are shortened.
    """
    total = np.zeros(poses.shape[:-2] + poses.shape[-1:])
    for span, share in zip(spans, shares, strict=True):
        if share > 0:
            reach = min(span, poses.shape[-2] + at)
            total += share * (poses[..., at, :] - poses[..., at - reach, :]) / reach
    return total
