"""Track back, against the direction of a pass, from a frame in which a limb or the patient was found again.

A limb or patient that is found again was often in view in earlier frames already, but not at the predicted place. So
the patient is tracked back from the frame in which the limb or patient was found again. Tracking back ends when both
directions agree, or when it shows no more of the body than the pass did. Each frame is then taken from the direction
that has more joints at places where cameras see the body. The two directions may, however, follow two people. This is
the case if the two trunks are at different places in most of the frames in which cameras see both trunks. The pass has
followed the patient from the initial frame, so the person who was found again is then not the patient, and no frame is
replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX, JointState
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.frame_record import Kept
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Run
from anchorpose.tracker.sighting import TWO_PEOPLE_M
from anchorpose.tracker.smoothing import APART_M, PassResult, cheapest_course, course_of, pass_result, seen_less
from anchorpose.tracker.start import turn_round

AGREEING: Final = 3  # tracking back stops after this many successive frames in which both directions agree
# tracking back stops after this many successive frames in which it shows no more of the body than the pass did
IN_VAIN: Final = 10
# m; a limb counts as found again if limbs were found in another place than expected (``Estimate.moved``) and a joint
# jumps farther than this between two frames
ELSEWHERE_M: Final = 0.15
TRUNK: Final = JOINT_INDEX["SpineMid"]
# number of frames between two attempts to track back: FIRST_PAUSE after an attempt that changed a frame; each attempt
# that changes no frame doubles the number, up to LONGEST_PAUSE
FIRST_PAUSE, LONGEST_PAUSE = 4, 64


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """A frame that a pass has tracked."""

    position: int  # position of the frame in the recording
    result: PassResult | None  # the result of the pass; None if no body is learnt
    kept: Kept  # the values to store for this frame


@dataclass(slots=True)
class Waiting:
    """The frames of a pass that are not stored yet, in order, since tracking back may still replace them."""

    frames: list[Passed] = field(default_factory=list)
    wait: int = 0  # number of frames until tracking back is allowed again
    # number of frames to wait after the last attempt to track back; the next attempt doubles or resets it
    pause: int = FIRST_PAUSE

    def add(
        self,
        estimate: Estimate,
        passed: Passed,
        frame: Callable[[int], FrameSet],
        run: Run,
        keep: Callable[[Estimate], Kept],
    ) -> None:
        """Add the next frame; if a limb or the patient is found again in this frame, track back from it
        (``look_back``).
        """
        self.wait -= 1
        if self.wait < 0 and self.frames and _is_found_again(estimate, passed.result, self.frames[-1].result):
            seen = look_back(estimate, self.frames, frame, run, keep)
            changed = any(one is not other for one, other in zip(seen, self.frames, strict=True))
            self.pause = FIRST_PAUSE if changed else min(2 * self.pause, LONGEST_PAUSE)
            self.frames, self.wait = seen, self.pause
        self.frames.append(passed)

    def take_but(self, left: int) -> list[Kept]:
        """Remove all frames but the last ``left``, and return their values to store."""
        count = max(0, len(self.frames) - left)
        taken, self.frames = self.frames[:count], self.frames[count:]
        return [one.kept for one in taken]


def _is_found_again(estimate: Estimate, now: PassResult | None, before: PassResult | None) -> bool:
    """Return whether the patient or a limb was found again in this frame."""
    if now is None or before is None or now.pose is None:
        return False
    if before.pose is None:
        return True
    return estimate.moved and bool(np.linalg.norm(now.joints_m - before.joints_m, axis=1).max() > ELSEWHERE_M)


def look_back(
    found: Estimate,
    before: Sequence[Passed],
    frame: Callable[[int], FrameSet],
    run: Run,
    keep: Callable[[Estimate], Kept],
) -> list[Passed]:
    """Return the frames ``before`` the frame in which the patient or a limb was ``found`` again, in order. Some of the
    returned frames are replaced by frames that were tracked back.

    frame: function that reads the frame at a position; keep: function that returns the values to store for an estimate.
    """
    start = turn_round(found, run.config)
    again = [] if start is None else _seen_again(PatientTracker(run, start), before, frame, run, keep)
    if not again or _are_two_people(before, again):
        return list(before)
    first = len(before) - len(again)
    there, back = (course_of([one.result for one in way if one.result], len(again)) for way in (before[first:], again))
    costs = np.array([[seen_less(one.result) for one in way if one.result] for way in (before[first:], again)])
    apart_m = np.linalg.norm(there.joints_m - back.joints_m, axis=2).max(axis=1)  # NaN where the patient was lost
    changed = (cheapest_course(costs, np.nan_to_num(apart_m)) == 1) & ~(apart_m < APART_M)
    chosen = [two if other else one for one, two, other in zip(before[first:], again, changed, strict=True)]
    return [*before[:first], *chosen]


def _are_two_people(before: Sequence[Passed], again: Sequence[Passed]) -> bool:
    """Return whether the pass and tracking back follow two people: in most frames in which cameras see the trunks of
    both, the two trunks are at different places. before, again: the frames of the pass, and the frames that were
    tracked back; both end at the same frame.
    """
    apart_m = [
        float(np.linalg.norm(there.joints_m[TRUNK] - back.joints_m[TRUNK]))
        for there, back in ((one.result, other.result) for one, other in zip(before[-len(again) :], again, strict=True))
        if there is not None and back is not None
        if there.states[TRUNK] is JointState.OBSERVED and back.states[TRUNK] is JointState.OBSERVED
    ]
    return bool(apart_m) and float(np.median(apart_m)) > TWO_PEOPLE_M


def _seen_again(
    tracker: PatientTracker,
    before: Sequence[Passed],
    frame: Callable[[int], FrameSet],
    run: Run,
    keep: Callable[[Estimate], Kept],
) -> list[Passed]:
    """Track back through the last frames of ``before`` until both directions agree, or until tracking back shows no
    more of the body than the pass did. Return the tracked frames in the order of the pass.
    """
    again, agreeing, in_vain = list[Passed](), 0, 0
    estimates = _tracked_back(tracker, (frame(one.position) for one in reversed(before)))
    for one, estimate in zip(reversed(before), estimates, strict=False):
        usable = run.room.review.why_unusable(estimate.frame_set.frame) is None
        result = pass_result(tracker.body, estimate, usable)
        if one.result is None or JointState.OBSERVED not in result.states:
            break
        again.append(Passed(one.position, result, keep(estimate)))
        apart_m = np.linalg.norm(result.joints_m - one.result.joints_m, axis=1).max()
        agreeing = agreeing + 1 if apart_m < APART_M else 0
        in_vain = in_vain + 1 if seen_less(result) >= seen_less(one.result) else 0
        if agreeing == AGREEING or in_vain == IN_VAIN:
            break
    return again[::-1]


def _tracked_back(tracker: PatientTracker, frames: Iterable[FrameSet]) -> Iterator[Estimate]:
    for frame_set in frames:
        if (estimate := tracker.step(frame_set)) is not None:
            yield estimate
        if tracker.has_left:
            return
    yield from tracker.finish()
