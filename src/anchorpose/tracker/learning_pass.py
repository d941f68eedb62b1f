"""Learn the shape of the patient's body on a first pass over the recording, before the frames are tracked for the
results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, dropwhile
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.evidence import Evidence
from anchorpose.body.expected_joints import expected_joints
from anchorpose.body.learning import REACHES_M, REFINING_M, learn_body, most_different
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.pose_probability import facing_nats
from anchorpose.body.rivals import DECIDED, OWN_BODY_ERROR, Rival, believed
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body
from anchorpose.body.standing_off import standing_off
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet, Subject
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.observation import Start
from anchorpose.tracker.other_statures import PosedFrame, frames_nats, with_other_statures
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.prior_shape import contradiction, known_beliefs, likeliest, shape_cost
from anchorpose.tracker.room import Room, Run
from anchorpose.tracker.start import LEAST_EXPLAINED, Facing, start_turned

# ratio of the number of frames kept from a window to the number of frames that learning uses; from the kept frames,
# learning selects the frames whose poses differ most
CANDIDATES: Final = 2


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The values of a frame that are needed to learn the body; they take a third of the memory of a whole estimate."""

    time_s: float
    belief: PoseBelief
    shape: FittedShape
    evidence: Evidence

    @property
    def pose(self) -> Pose:
        """Return the body's pose."""
        return self.belief.pose

    @property
    def body(self) -> Body:
        """Return the body with the shape that was known when the frame was tracked."""
        return build_body(body_points(), self.shape)


@dataclass(frozen=True, slots=True, eq=False)
class OtherFacing:
    """The less likely of two opposite facings in the first frame that learning used, with the pose and the body learnt
    for this facing.
    """

    pose: Pose
    shape: FittedShape
    behind: float  # number of nats by which this facing is less likely than the chosen facing


@dataclass(frozen=True, slots=True, eq=False)
class LearntPatient:
    """The learnt shape of the patient with its uncertainty, and the patient's pose in the first frame that learning
    used.
    """

    belief: ShapeBelief  # belief in the shape at the end of learning
    first: ShapeBelief  # belief in the shape after the first window of frames
    seconds: float  # s, duration of all parts of the recording that learning used
    pose: Pose  # the pose in the first frame that learning used
    frame: int  # number of the first frame that learning used
    contradiction: str = ""  # contradiction between the user's statements and the images; empty without it
    turned: OtherFacing | None = None  # the opposite facing in the first frame used; None if the images exclude it

    @property
    def shape(self) -> FittedShape:
        """Return the shape of the body to track with."""
        return self.belief.shape

    def facing(self) -> Facing:
        """Return the patient's facing in the first frame that learning used."""
        other = self.turned
        if other is None:
            return Facing(self.pose, None)
        own = build_body(body_points(), other.shape)
        return Facing(self.pose, Rival(vague_belief(other.pose), other.behind, body=own))

    def where_found(self, room: Room) -> Room:
        """Return the room with the first frame that learning used in place of its initial frame. The two frames differ
        if the patient could not be found in the initial frame.
        """
        initial, number = room.initial_frame, room.recording.streams[0].frame
        if initial is None or number[initial.frame] == self.frame:
            return room
        place = replace(initial.choice, ground_xz_m=self.pose.root_m[[0, 2]], frame=self.frame)
        found = replace(initial, frame=int(np.flatnonzero(number == self.frame)[0]), choice=place, start=None)
        return replace(room, initial_frames=(found, *room.initial_frames))


class Stretch(NamedTuple):
    """A part of the recording that serves to learn the body.

    choice: where the patient stands in the stretch's first frame; None if no patient is to be searched for. start: the
    patient as found in the first frame; None if not searched for yet. frames: function that yields the frames of the
    stretch, forward or backward in time; each call begins with the first frame.
    """

    choice: PatientChoice | None
    start: Start | None
    frames: Callable[[], Iterable[FrameSet]]


def learn_patient(run: Run, stretches: Sequence[Stretch]) -> LearntPatient | None:
    """Learn the patient's shape; return None if the patient is never found.

    Each stretch is followed for an equal share of ``learning.longest_s``; in the first stretch, this time begins when
    the patient is found. Tracking uses the shape learnt so far, and each window (a group of successive frames) refines
    this shape. To save memory, only two windows of a stretch are kept (in the first stretch, for each of two opposite
    facings): the latest window, and the window with most frames. At the end, bodies of other heights are fitted to the
    windows with most frames, except if the user stated a height and the images agree with it.
    """
    learnt, longest = None, list[_Seen]()
    for stretch in stretches:
        step = _learn_on(stretch, learnt, run.config.learning.longest_s / len(stretches), run)
        if step is not None:
            learnt, longest = step[0], longest + step[1].kept
    return learnt if learnt is None else replace(learnt, belief=_of_all_statures(learnt, longest, run))


def _of_all_statures(learnt: LearntPatient, kept: Sequence[_Seen], run: Run) -> ShapeBelief:
    """Return the belief in the learnt shape, with an uncertainty that includes other statures. The belief is unchanged
    if the user stated a height that the images do not contradict, or if the settings leave learning out.
    """
    subject = run.room.recording.subject.unmeasured if learnt.contradiction else run.room.recording.subject
    if subject.height_m is not None or not run.config.learning.own_shape:
        return learnt.belief
    with run.stage("body shape"):
        return _with_other_statures(learnt.belief, kept, subject, run)


def _with_other_statures(belief: ShapeBelief, kept: Sequence[_Seen], stated: Subject, run: Run) -> ShapeBelief:
    covered = (*stated.covered, *standing_off(body_points(), belief.shape))
    known = likeliest(known_beliefs(replace(stated, covered=covered), run.config), belief.shape)
    return with_other_statures(belief, known, _posed(kept), stated, run.config)


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """A window: successive frames that are used together to learn the body."""

    kept: list[_Seen]
    seconds: float  # s, time from the start of this stretch (see ``_windows``) to the end of this window
    # nats, cost of the movements by which the body turned round in this window; the less probable a movement, the
    # larger its cost
    moved: float
    tracker: PatientTracker | None  # the tracker after this window; None if tracking ended
    # the patient with the opposite facing, as found in frame number ``frame``; None if this frame excludes the opposite
    # facing
    turned: Start | None
    frame: int  # number of the first frame with the patient; 0 in stretches after the first


def _learn_on(stretch: Stretch, before: LearntPatient | None, longest_s: float, run: Run) -> _Step | None:
    """Learn from one more stretch; return the learnt patient and the window with most frames, None if the patient is
    not found in this stretch. before: the result of earlier stretches; None for the first stretch.
    """
    windows = _windows(run, stretch, before, longest_s)
    first = next(windows, None)
    if first is None:
        return None
    if not run.config.learning.own_shape:
        return before or _fixed(first, run), first
    learning = _window_by_window(chain([first], windows), before, run)
    if before is None and first.turned is not None:
        others = _windows(run, _from_frame(stretch, first.frame, first.turned), None, longest_s, one_facing=True)
        return likelier(learning, _window_by_window(others, None, run), run)
    return _last(learning)


def _from_frame(stretch: Stretch, frame: int, start: Start) -> Stretch:
    """Return a stretch without the frames before ``frame``. start: the patient as found in this frame."""

    def frames() -> Iterator[FrameSet]:
        return dropwhile(lambda frame_set: frame_set.frame != frame, stretch.frames())

    return Stretch(stretch.choice, start, frames)


_Step = tuple[LearntPatient, _Window]
_Learning = Iterator[_Step]


def _window_by_window(windows: Iterator[_Window], before: LearntPatient | None, run: Run) -> _Learning:
    """Learn from one window after another; yield, after each window, the patient as learnt so far and the window."""
    learnt, so_far_s = before, 0.0 if before is None else before.seconds
    for window in windows:
        learnt = _learn_more(learnt, window, so_far_s + window.seconds, run)
        yield learnt, window
        if window.tracker is not None:
            window.tracker.use_shape(learnt.shape)


def _last(learning: _Learning) -> _Step:
    """Return the learnt patient after the last window, and the window with most frames."""
    learnt, window = next(learning)
    for step in learning:
        learnt, window = step[0], max(window, step[1], key=lambda one: len(one.kept))
    return learnt, window


def likelier(one: _Learning, other: _Learning, run: Run) -> _Step:
    """Learn with both facings of the patient until one is clearly more probable; return the patient learnt with this
    facing, and the window with most frames. If the stretch does not decide between the facings, the result also
    contains the other facing.

    A single frame may show too little to decide which way the patient faces. Over several windows of frames, a wrong
    facing becomes evident: no body of human shape fits all windows, or the person seems to turn round at some time.
    """
    lead, mine, theirs = _compared(one, other, run)
    if theirs is None:
        return _last(chain([mine], one))
    won, lost, rest = (mine, theirs, one) if lead >= 0.0 else (theirs, mine, other)
    (learnt, window), turned = _last(chain([won], rest)), lost[0]
    if abs(lead) >= DECIDED:
        return learnt, window
    return replace(learnt, turned=OtherFacing(turned.pose, turned.shape, abs(lead))), window


def _compared(one: _Learning, other: _Learning, run: Run) -> tuple[float, _Step, _Step | None]:
    """Compare two facings window by window until one is clearly more probable or a facing has no more windows. Return
    by how many nats the first facing is more probable. Also return, for each facing, the learnt patient and the last
    compared window; for the second facing None if no person with this facing can be followed.

    Errors of the body shape affect all windows alike, so the log probabilities are averaged over the windows, not
    summed.
    """
    nats, moved, mine, theirs = list[float](), 0.0, next(one), next(other, None)
    while theirs is not None:
        nats.append(window_nats(*mine, run) - window_nats(*theirs, run))
        moved += theirs[1].moved - mine[1].moved
        known = known_nats(*mine, run) - known_nats(*theirs, run)
        lead = believed(float(np.mean(nats)), PARTS, OWN_BODY_ERROR) + moved + known
        later = None if abs(lead) >= DECIDED else next(one, None)
        if later is None:
            return lead, mine, theirs
        mine, theirs = later, next(other, None)
    return 0.0, mine, None


def window_nats(learnt: LearntPatient, window: _Window, run: Run) -> float:
    """Return the log probability, in nats, of the body learnt so far. It is the sum of the mean log probability of a
    window's frames and the log probability of the shape among people. Clothes and misplaced limbs cause errors of both
    log probabilities.
    """
    chosen = most_different(body_points(), [seen.pose for seen in window.kept], run.config.learning.frame_count)
    nats = frames_nats(learnt.shape, _posed([window.kept[place] for place in chosen]), run.config)
    return nats - 0.5 * shape_cost(learnt.shape, run.room.recording.subject.unmeasured, run.config)


def _posed(kept: Sequence[_Seen]) -> list[PosedFrame]:
    return [PosedFrame(seen.pose, seen.evidence) for seen in kept]


def known_nats(learnt: LearntPatient, window: _Window, run: Run) -> float:
    """Return the sum of two log probabilities, in nats, that follow from prior knowledge: of the way in which the body
    faces a single camera (``facing_nats``, mean over the window's frames; 0 with several cameras), and of the learnt
    shape given the stated height, age and sex, relative to the same shape without these statements. Differences of this
    sum between two facings count in full; ``believed`` reduces only the differences of ``window_nats``, which errors of
    the body affect.
    """
    body, cameras = build_body(body_points(), learnt.shape), run.room.cameras
    facing = float(np.mean([facing_nats(body, seen.pose, cameras) for seen in window.kept]))
    subject = run.room.recording.subject
    costs = [shape_cost(learnt.shape, one, run.config) for one in (subject, subject.unmeasured)]
    return facing - 0.5 * (costs[0] - costs[1])


def _windows(
    run: Run, stretch: Stretch, before: LearntPatient | None, longest_s: float, one_facing: bool = False
) -> Iterator[_Window]:
    """Track a stretch, and yield its frames in windows. Tracking continues only when the next window is requested.

    one_facing: whether to end in the frame in which the tracked body turns round; another pass, with the opposite
    facing, tracks the frames from there on.
    """
    learning = run.config.learning
    interval_s = learning.window_s / learning.frame_count / CANDIDATES
    known = None if before is None else before.shape
    begin = stretch.start if before is None else None  # in later stretches, the learnt body is searched for
    kept, began_s, frame, turned = list[_Seen](), None, 0, None
    moved, last = 0.0, None
    for estimate, tracker in follow_openly(run, stretch.frames(), stretch.choice, known, begin):
        time_s = estimate.frame_set.time_s
        # time is counted from the first frame of the stretch; in the first stretch, from the frame in which the patient
        # is found
        began_s = time_s if began_s is None and before is not None else began_s
        if began_s is not None and abs(time_s - began_s) > longest_s:
            break
        seen = _seen(estimate, run)
        if seen is None:
            continue
        if began_s is None:
            began_s, frame = time_s, estimate.frame_set.frame
            turned = None if tracker is None else start_turned(estimate.observation, tracker.turned, run.config)
        if kept and _apart_s(kept[0], seen) > learning.window_s:
            yield _Window(kept, abs(kept[-1].time_s - began_s), moved, tracker, turned, frame)
            kept, moved = [], 0.0
        if last is not None and last.pose.faces_away(seen.pose):
            if one_facing:
                return
            moved += _moved(last, seen)
        last = seen
        if not kept or _apart_s(kept[-1], seen) >= interval_s - 1e-6:
            kept.append(seen)
        if not learning.own_shape:
            break
    if kept and began_s is not None:
        yield _Window(kept, abs(kept[-1].time_s - began_s), moved, None, turned, frame)


def _moved(before: _Seen, after: _Seen) -> float:
    """Return the cost (improbability), in nats, of the body's movement from one frame to the next."""
    expected = expected_joints(before.body, before.belief.later(before.pose, _apart_s(before, after)))
    return expected.moved(after.body.joints(after.pose))


def _seen(estimate: Estimate, run: Run) -> _Seen | None:
    """Return the values of a frame that learning needs; None if no body fits the frame or a reviewer marked it as
    unusable.
    """
    if estimate.belief is None or estimate.shape is None or estimate.observation is None:
        return None
    if estimate.explained < LEAST_EXPLAINED or run.room.review.why_unusable(estimate.frame_set.frame) is not None:
        return None
    return _Seen(estimate.frame_set.time_s, estimate.belief, estimate.shape, estimate.observation.evidence)


def _fixed(window: _Window, run: Run) -> LearntPatient:
    """Return the patient with the body that was fitted in the first frame, unchanged; it is used if the settings switch
    off learning (``learning.own_shape``).
    """
    shape = window.kept[0].shape
    beliefs = known_beliefs(run.room.recording.subject, run.config)
    fixed = replace(likeliest(beliefs, shape), shape=shape)
    return LearntPatient(fixed, fixed, 0.0, window.kept[0].pose, window.frame)


def _apart_s(one: _Seen, other: _Seen) -> float:
    """Return the time between two frames; it is never negative, although the learning pass may go backward."""
    return abs(other.time_s - one.time_s)


def _learn_more(learnt: LearntPatient | None, window: _Window, seconds: float, run: Run) -> LearntPatient:
    """Return the patient after learning from one more window. seconds: time for which the patient was followed in all
    stretches so far.
    """
    with run.stage("body shape"):
        if learnt is None:
            return _learn_first(seconds, window, run)
        belief = _learn(learnt.belief, window.kept, run.config.learning.frame_count // 2, REFINING_M, run)
        return replace(learnt, belief=belief, seconds=seconds)


def _learn_first(seconds: float, window: _Window, run: Run) -> LearntPatient:
    """Learn the patient's shape from the first window of frames. The user's statements on the patient are ignored if
    the images contradict them.
    """
    subject, config, kept = run.room.recording.subject, run.config, window.kept
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
        # the contradiction may concern only the learnt height, which images show poorly, so it counts only if it
        # remains after bodies of other statures were included in the belief
        if why:
            why = contradiction(subject, _with_other_statures(seen, kept, subject.unmeasured, run), config)
        belief = seen if why else belief
    return LearntPatient(belief, belief, seconds, kept[0].pose, window.frame, why)


def _learn(known: ShapeBelief, kept: Sequence[_Seen], count: int, reaches_m: Sequence[float], run: Run) -> ShapeBelief:
    """Return the belief ``known`` after learning from the ``count`` frames of ``kept`` that differ most in pose.
    reaches_m: for each learning step, the maximum distance at which a surface node pulls the skin.
    """
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
