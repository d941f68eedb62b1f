"""Learning the patient's body on a first pass, from all that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.body.learning import REACHES_M, REFINING_M, learn_body, most_different
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.prior_shape import known_beliefs, likeliest
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import LEAST_EXPLAINED

CANDIDATES: Final = 2  # times as many frames are kept of a window as it is learnt from: those with different poses are


@dataclass(frozen=True, slots=True, eq=False)
class LearntPatient:
    """The belief in the patient's shape at the end and after the first window; seconds: how long it was learnt from."""

    belief: ShapeBelief
    first: ShapeBelief
    seconds: float

    @property
    def shape(self) -> FittedShape:
        """The body to track with."""
        return self.belief.shape


def learn_patient(run: Run, frames: Iterable[FrameSet]) -> LearntPatient | None:
    """The patient's shape, or None where the patient is never found.

    The first window begins with the first frame in which the patient is found. Tracking goes on with what was learnt so
    far, and each window's frames add what they show. Only the frames of one window are kept.
    """
    room, learning, beliefs = run.room, run.config.learning, known_beliefs(run.room.recording, run.config)
    interval_s = learning.window_s / learning.frame_count / CANDIDATES
    learnt: LearntPatient | None = None
    kept, began_s = list[Estimate](), None
    choice = room.initial_frame.choice if room.initial_frame else None
    for estimate, tracker in follow_openly(run, frames, choice, None):
        time_s = estimate.frame_set.time_s
        if began_s is not None and abs(time_s - began_s) > learning.longest_s:
            break
        if estimate.belief is None or estimate.shape is None or estimate.explained < LEAST_EXPLAINED:
            continue
        if room.review.why_unusable(estimate.frame_set.frame) is not None:
            continue
        if not learning.own_shape:
            fixed = replace(likeliest(beliefs, estimate.shape), shape=estimate.shape)
            return LearntPatient(fixed, fixed, 0.0)
        began_s = time_s if began_s is None else began_s
        if kept and _apart_s(kept[0], estimate) > learning.window_s:
            learnt, kept = _learn_more(learnt, beliefs, began_s, kept, run), []
            if tracker is not None:
                tracker.use_shape(learnt.shape)
        if not kept or _apart_s(kept[-1], estimate) >= interval_s - 1e-6:
            kept.append(estimate)
    return learnt if began_s is None or not kept else _learn_more(learnt, beliefs, began_s, kept, run)


def _apart_s(one: Estimate, other: Estimate) -> float:
    """Time between two frames; the learning pass may go backward."""
    return abs(other.frame_set.time_s - one.frame_set.time_s)


def _learn_more(
    learnt: LearntPatient | None, beliefs: Sequence[ShapeBelief], began_s: float, kept: Sequence[Estimate], run: Run
) -> LearntPatient:
    """What is known after one more window."""
    last_s = kept[-1].frame_set.time_s
    count = run.config.learning.frame_count if learnt is None else run.config.learning.frame_count // 2
    poses = [estimate.belief.pose for estimate in kept if estimate.belief]
    with run.stage("body shape"):
        shape = next(estimate.shape for estimate in kept if estimate.shape)
        kept = [kept[place] for place in most_different(body_points(), poses, count)]
        belief = learn_body(
            body_points(),
            shape,
            [estimate.belief.pose for estimate in kept if estimate.belief],
            [estimate.observation.evidence for estimate in kept if estimate.observation],
            likeliest(beliefs, shape) if learnt is None else learnt.belief,
            run.config.registration,
            REACHES_M if learnt is None else REFINING_M,
        ).belief
    first = belief if learnt is None else learnt.first
    return LearntPatient(belief, first, abs(last_s - began_s))
