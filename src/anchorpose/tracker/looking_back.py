"""The frames before a limb or the patient was found again, seen once more from there, against the order of the pass.

Who was lost and is found again was somewhere in between, often in view, while the prediction was elsewhere. From the
frame that shows it the patient is tracked back until both ways agree, or nothing is seen. Each frame is then that of
the way in which more of the body is seen at its place, so that images decide and no prediction does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from anchorpose.joints import JointState
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.run import Run
from anchorpose.tracker.smoothing import APART_M, PassResult, cheapest_course, course_of, pass_result, seen_less
from anchorpose.tracker.start import turn_round

AGREEING: Final = 3  # frames in a row in which both ways have all joints in one place: they will not part again
IN_VAIN: Final = 15  # frames in a row in which the way back sees no more of the body


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """A frame of a pass: its position in the recording, what the pass answers (None where no body is learnt), and what
    is to be stored of it."""

    position: int
    result: PassResult | None
    kept: Any


def is_found_again(estimate: Estimate, before: Sequence[Passed]) -> bool:
    """Whether an estimate has the patient or a limb where the frames before it had them not."""
    lost = bool(before) and before[-1].result is not None and before[-1].result.pose is None
    return estimate.moved or (lost and estimate.belief is not None)


def look_back(
    found: Estimate,
    before: Sequence[Passed],
    frame: Callable[[int], FrameSet],
    run: Run,
    keep: Callable[[Estimate], Any],
) -> list[Passed]:
    """The frames before one in which something was found again, in the order of the pass, some of them seen from there.

    frame: reads the frame at a position.
    """
    start = turn_round(found, run.config)
    again = [] if start is None else _seen_again(PatientTracker(run, start), before, frame, run, keep)
    if not again:
        return list(before)
    first = len(before) - len(again)
    there, back = (course_of([one.result for one in way if one.result], len(again)) for way in (before[first:], again))
    costs = np.array([[seen_less(one.result) for one in way if one.result] for way in (before[first:], again)])
    apart_m = np.linalg.norm(there.joints_m - back.joints_m, axis=2).max(axis=1)  # NaN where the patient was lost
    changed = (cheapest_course(costs, np.nan_to_num(apart_m)) == 1) & ~(apart_m < APART_M)
    chosen = [two if other else one for one, two, other in zip(before[first:], again, changed, strict=True)]
    return [*before[:first], *chosen]


def _seen_again(
    tracker: PatientTracker,
    before: Sequence[Passed],
    frame: Callable[[int], FrameSet],
    run: Run,
    keep: Callable[[Estimate], Any],
) -> list[Passed]:
    """The last frames of ``before`` by the other way, in the order of the pass, as far back as they show more."""
    again, agreeing, in_vain = list[Passed](), 0, 0
    estimates = _tracked_back(tracker, (frame(one.position) for one in reversed(before)))
    for one, estimate in zip(reversed(before), estimates, strict=False):
        usable = run.room.review.why_unusable(estimate.frame_set.frame) is None
        result = pass_result(tracker.body, estimate, (), usable)
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
