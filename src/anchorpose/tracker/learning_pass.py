"""Learn the patient's body on a first pass, from all that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from anchorpose.body.evidence import Evidence
from anchorpose.body.learning import REACHES_M, REFINING_M, learn_body, most_different
from anchorpose.body.pose import Pose
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.body.standing_off import standing_off
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet, Subject
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.observation import Start
from anchorpose.tracker.prior_shape import contradiction, known_beliefs, likeliest
from anchorpose.tracker.room import Run
from anchorpose.tracker.start import LEAST_EXPLAINED

CANDIDATES: Final = 2  # times as many frames are kept of a window as it is learnt from: those with different poses are


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What is kept of a frame until its window is learnt from: a whole estimate is three times as large."""

    time_s: float
    pose: Pose
    shape: FittedShape
    evidence: Evidence


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


class Stretch(NamedTuple):
    """A part of the recording that the body is learnt from: where the patient is in its first frame, and its frames.

    choice: None where nobody is to be looked for. start: the patient as already found in the first frame, if so.
    frames: in the order of time or against it.
    """

    choice: PatientChoice | None
    start: Start | None
    frames: Iterable[FrameSet]


def learn_patient(run: Run, stretches: Sequence[Stretch]) -> LearntPatient | None:
    """The patient's shape, or None where the patient is never found.

    Each stretch is followed for its share of ``learning.longest_s``, from the first frame in which the patient is
    found. Tracking goes on with what was learnt so far, and each window's frames add what they show. Only the frames of
    one window are kept.
    """
    learnt: LearntPatient | None = None
    for stretch in stretches:
        learnt = _learn_on(stretch, learnt, run.config.learning.longest_s / len(stretches), run)
    return learnt


def _learn_on(stretch: Stretch, before: LearntPatient | None, longest_s: float, run: Run) -> LearntPatient | None:
    """What is known after one more stretch; before: after those before it."""
    learning, learnt = run.config.learning, before
    interval_s = learning.window_s / learning.frame_count / CANDIDATES
    kept, began_s = list[_Seen](), None
    known, so_far_s = (None, 0.0) if before is None else (before.shape, before.seconds)
    begin = stretch.start if before is None else None  # with the body of the first pose, not with the learnt one
    for estimate, tracker in follow_openly(run, stretch.frames, stretch.choice, known, begin):
        time_s = estimate.frame_set.time_s
        began_s = time_s if began_s is None and before is not None else began_s  # who is not found is not waited for
        if began_s is not None and abs(time_s - began_s) > longest_s:
            break
        seen = _seen(estimate, run)
        if seen is None:
            continue
        if not learning.own_shape:
            return before or _fixed(seen.shape, run)
        began_s = time_s if began_s is None else began_s
        if kept and _apart_s(kept[0], seen) > learning.window_s:
            learnt, kept = _learn_more(learnt, kept, so_far_s + abs(kept[-1].time_s - began_s), run), []
            if tracker is not None:
                tracker.use_shape(learnt.shape)
        if not kept or _apart_s(kept[-1], seen) >= interval_s - 1e-6:
            kept.append(seen)
    if began_s is None or not kept:
        return learnt
    return _learn_more(learnt, kept, so_far_s + abs(kept[-1].time_s - began_s), run)


def _seen(estimate: Estimate, run: Run) -> _Seen | None:
    """None where no body explains the frame, or a reviewer has marked it as unusable."""
    if estimate.belief is None or estimate.shape is None or estimate.observation is None:
        return None
    if estimate.explained < LEAST_EXPLAINED or run.room.review.why_unusable(estimate.frame_set.frame) is not None:
        return None
    return _Seen(estimate.frame_set.time_s, estimate.belief.pose, estimate.shape, estimate.observation.evidence)


def _fixed(shape: FittedShape, run: Run) -> LearntPatient:
    """The body of the first pose, where nothing is to be learnt."""
    beliefs = known_beliefs(run.room.recording.subject, run.config)
    fixed = replace(likeliest(beliefs, shape), shape=shape)
    return LearntPatient(fixed, fixed, 0.0)


def _apart_s(one: _Seen, other: _Seen) -> float:
    """Time between two frames; the learning pass may go backward."""
    return abs(other.time_s - one.time_s)


def _learn_more(learnt: LearntPatient | None, kept: Sequence[_Seen], seconds: float, run: Run) -> LearntPatient:
    """What is known after one more window; seconds: how long the patient was followed for it, from the beginning."""
    with run.stage("body shape"):
        if learnt is None:
            return _learn_first(seconds, kept, run)
        belief = _learn(learnt.belief, kept, run.config.learning.frame_count // 2, REFINING_M, run)
        return replace(learnt, belief=belief, seconds=seconds)


def _learn_first(seconds: float, kept: Sequence[_Seen], run: Run) -> LearntPatient:
    """What is known after the first window; the images win where what is stated about the patient contradicts them."""
    subject, config = run.room.recording.subject, run.config
    shape = kept[0].shape

    def learnt(stated: Subject) -> ShapeBelief:
        prior = likeliest(known_beliefs(stated, config), shape)
        belief = _learn(replace(prior, shape=shape), kept, config.learning.frame_count, REACHES_M, run)
        worn = tuple(part for part in standing_off(body_points(), belief.shape) if part not in stated.covered)
        return learnt(replace(stated, covered=(*stated.covered, *worn))) if worn else belief

    belief, why = learnt(subject), ""
    if subject != subject.unmeasured:
        seen = learnt(subject.unmeasured)
        why = contradiction(subject, seen, config)
        belief = seen if why else belief
    return LearntPatient(belief, belief, seconds, why)


def _learn(known: ShapeBelief, kept: Sequence[_Seen], count: int, reaches_m: Sequence[float], run: Run) -> ShapeBelief:
    """The belief after the most different frames of a window, ``count`` of them."""
    chosen = most_different(body_points(), [seen.pose for seen in kept], count)
    return learn_body(
        body_points(),
        known.shape,
        [kept[place].pose for place in chosen],
        [kept[place].evidence for place in chosen],
        known,
        run.config.registration,
        reaches_m,
    ).belief
