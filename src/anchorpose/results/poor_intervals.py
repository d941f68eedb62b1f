"""Frames in which depth is too poor for joints, as intervals with a sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from anchorpose.body.visibility import PoorDepth, PoorKind

_WHERE_ONLY: Final = "joints show where the patient is, not the posture"


@dataclass(frozen=True, slots=True)
class PoorInterval:
    """Frames in a row, both ends included, in which one camera's depth is too poor for joints for the same reason.

    worst: the largest ``PoorDepth.amount`` of them; why: a sentence without its full stop.
    """

    camera: str
    kind: PoorKind
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    worst: float
    why: str


def note_poor(intervals: list[PoorInterval], frame: int, time_s: float, poor: Sequence[PoorDepth]) -> None:
    """Take in one more frame: of each camera that is poor in it, the last interval goes on, or a new one begins."""
    for one in poor:
        at = next((k for k in range(len(intervals) - 1, -1, -1) if _goes_on(intervals[k], frame, one)), None)
        before = None if at is None else intervals[at]
        worst = one.amount if before is None else max(one.amount, before.worst)
        first, start_s = (frame, time_s) if before is None else (before.first_frame, before.start_s)
        why = sentence(PoorDepth(one.camera, one.kind, worst))
        found = PoorInterval(one.camera, one.kind, first, frame, start_s, time_s, worst, why)
        if at is None:
            intervals.append(found)
        else:
            intervals[at] = found


def _goes_on(interval: PoorInterval, frame: int, poor: PoorDepth) -> bool:
    return (interval.camera, interval.kind, interval.last_frame) == (poor.camera, poor.kind, frame - 1)


def sentence(poor: PoorDepth) -> str:
    """For people, without a full stop."""
    if poor.kind is PoorKind.EDGES:
        return (
            f"camera {poor.camera}: edges are drawn out over {1000 * poor.amount:.0f} mm at the patient, "
            f"more than an arm is thick: {_WHERE_ONLY}"
        )
    if poor.kind is PoorKind.STEPS:
        return (
            f"camera {poor.camera}: depth has steps of {1000 * poor.amount:.0f} mm at the patient, "
            f"more than an arm is thick: {_WHERE_ONLY}"
        )
    return (
        f"camera {poor.camera}: {100 * poor.amount:.0f} % of the patient's skin towards it has no usable reading: "
        f"joints are known by the rest"
    )
