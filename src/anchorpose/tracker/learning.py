"""Learning the patient's body on a first pass, from all that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.body.learning import REACHES_M, REFINING_M, learn_body, most_different
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.recording.recording import FrameSet
from anchorpose.recording.subject import Subject
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.prior_shape import contradiction, known_beliefs, likeliest
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import LEAST_EXPLAINED

CANDIDATES: Final = 2  # times as many frames are kept of a window as it is learnt from: those with different poses are


@dataclass(frozen=True, slots=True, eq=False)
class LearntPatient:
    """The belief in the patient's shape at the end and after the first window; seconds: how long it was learnt from.

    contradiction: how what is stated about the patient contradicts the images, empty where it does not.
    """

    belief: ShapeBelief
    first: ShapeBelief
    seconds: float
    contradiction: str = ""

    @property
    def shape(self) -> FittedShape:
        """The body to track with."""
        return self.belief.shape


def learn_patient(run: Run, frames: Iterable[FrameSet]) -> LearntPatient | None:
    """The patient's shape, or None where the patient is never found.

    The first window begins with the first frame in which the patient is found. Tracking goes on with what was learnt so
    far, and each window's frames add what they show. Only the frames of one window are kept.
    """
    room, learning = run.room, run.config.learning
    interval_s = learning.window_s / learning.frame_count / CANDIDATES
    learnt: LearntPatient | None = None
    kept, began_s = list[Estimate](), None
    initial = room.initial_frame
    choice, begin = (initial.choice, initial.start) if initial else (None, None)
    for estimate, tracker in follow_openly(run, frames, choice, None, begin):
        time_s = estimate.frame_set.time_s
        if began_s is not None and abs(time_s - began_s) > learning.longest_s:
            break
        if estimate.belief is None or estimate.shape is None or estimate.explained < LEAST_EXPLAINED:
            continue
        if room.review.why_unusable(estimate.frame_set.frame) is not None:
            continue
        if not learning.own_shape:
            beliefs = known_beliefs(room.recording.subject, run.config)
            fixed = replace(likeliest(beliefs, estimate.shape), shape=estimate.shape)
            return LearntPatient(fixed, fixed, 0.0)
        began_s = time_s if began_s is None else began_s
        if kept and _apart_s(kept[0], estimate) > learning.window_s:
            learnt, kept = _learn_more(learnt, began_s, kept, run), []
            if tracker is not None:
                tracker.use_shape(learnt.shape)
        if not kept or _apart_s(kept[-1], estimate) >= interval_s - 1e-6:
            kept.append(estimate)
    return learnt if began_s is None or not kept else _learn_more(learnt, began_s, kept, run)


def _apart_s(one: Estimate, other: Estimate) -> float:
    """Time between two frames; the learning pass may go backward."""
    return abs(other.frame_set.time_s - one.frame_set.time_s)


def _learn_more(learnt: LearntPatient | None, began_s: float, kept: Sequence[Estimate], run: Run) -> LearntPatient:
    """What is known after one more window."""
    seconds = abs(kept[-1].frame_set.time_s - began_s)
    with run.stage("body shape"):
        if learnt is None:
            return _learn_first(seconds, kept, run)
        belief = _learn(learnt.belief, kept, run.config.learning.frame_count // 2, REFINING_M, run)
        return replace(learnt, belief=belief, seconds=seconds)


def _learn_first(seconds: float, kept: Sequence[Estimate], run: Run) -> LearntPatient:
    """What is known after the first window; the images win where what is stated about the patient contradicts them."""
    subject, config = run.room.recording.subject, run.config
    shape = next(estimate.shape for estimate in kept if estimate.shape)

    def learnt(stated: Subject) -> ShapeBelief:
        prior = likeliest(known_beliefs(stated, config), shape)
        return _learn(replace(prior, shape=shape), kept, config.learning.frame_count, REACHES_M, run)

    belief, why = learnt(subject), ""
    if subject != subject.unmeasured:
        seen = learnt(subject.unmeasured)
        why = contradiction(subject, seen, config)
        belief = seen if why else belief
    return LearntPatient(belief, belief, seconds, why)


def _learn(
    known: ShapeBelief, kept: Sequence[Estimate], count: int, reaches_m: Sequence[float], run: Run
) -> ShapeBelief:
    """The belief after the most different frames of a window, ``count`` of them."""
    beliefs = [estimate.belief for estimate in kept if estimate.belief]
    chosen = most_different(body_points(), [belief.pose for belief in beliefs], count)
    return learn_body(
        body_points(),
        known.shape,
        [beliefs[place].pose for place in chosen],
        [seen.evidence for place in chosen if (seen := kept[place].observation) is not None],
        known,
        run.config.registration,
        reaches_m,
    ).belief
