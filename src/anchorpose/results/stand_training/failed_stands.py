"""Find stands that fail: the patient leaves the seat and sinks back onto it before being upright."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from anchorpose.results.frame_time import unbroken_runs
from anchorpose.results.records import FAILED_STAND
from anchorpose.results.stand_training.event import Event, EventConfig, fast_enough, onset_row
from anchorpose.results.stand_training.stance import Session
from anchorpose.results.stand_training.upright import (
    LOW_PERCENTILE,
    TransitionConfig,
    posture_stretches,
    settled_postures,
)
from anchorpose.results.uncertainty import JOINT_SHARE, sigma_of_difference


def find_failed_stands(session: Session, config: TransitionConfig, events: EventConfig) -> list[Event]:
    """Return the failed stands, in the order of time: rises from the seat after which the patient sinks back onto it.

    The height of the pelvis measures a rise, from 0 on the seat to 1 above straight legs. The event ends in the frame
    in which the pelvis is highest. If the patient was upright even for a moment, the stand did not fail.
    """
    time_s, height = session.joints.time_s, session.stance.height
    if not fast_enough(time_s):
        return []
    settled = settled_postures(session.joints, session.stance, session.posture.upright, config)
    found = list[Event]()
    for run in posture_stretches(session.stance, time_s):
        for block in _seated_blocks(run, settled.sitting, session.upright):
            seated = np.zeros(len(height), dtype=bool)
            for sitting in settled.sitting:
                seated[max(sitting.start, block.start) : min(sitting.stop, block.stop)] = True
            seat = float(np.percentile(height[seated & np.isfinite(height)], LOW_PERCENTILE))
            found += _rises(session, block, seat, config, events)
    return found


def _seated_blocks(run: slice, sitting: list[slice], upright: np.ndarray) -> Iterator[slice]:
    """Yield the blocks of frames, within a run, in which the patient never stands: each from the beginning of sitting
    to the end of the last sitting before the patient is upright. sitting: rows in which the patient sits.
    """
    inside = [slice(max(s.start, run.start), min(s.stop, run.stop)) for s in sitting]
    inside = [s for s in inside if s.start < s.stop]
    while inside:
        block = inside.pop(0)
        while inside and not upright[block.stop : inside[0].start].any():
            block = slice(block.start, inside.pop(0).stop)
        yield block


BACK: Final = 0.5
"""Height at which a rise ends, as a share of ``failed_rise`` (the minimum rise of a failed stand). Below this height,
the patient sits again.
"""

BEFORE_S: Final = 1.5
"""Time in s before the pelvis leaves the seat; the rise is measured from the median height in this time. The rise
itself takes less than a third of this time.
"""


def _rises(
    session: Session, block: slice, seat: float, config: TransitionConfig, events: EventConfig
) -> Iterator[Event]:
    """Yield the rises, in a block of frames without standing (``_seated_blocks``), in which the pelvis leaves the seat
    and comes back to it.
    """
    time_s, stance = session.joints.time_s[block], session.stance
    way = (stance.height[block] - seat) / (1.0 - seat)
    for run in unbroken_runs(way > BACK * events.failed_rise, time_s):
        if run.start == 0 or run.stop == len(way):
            continue  # the block does not contain the beginning or the end of this rise
        highest = run.start + int(np.argmax(way[run]))
        settled = int(np.searchsorted(time_s, time_s[run.start] - BEFORE_S))
        base = float(np.median(way[settled : run.start]))
        onset, depth = onset_row(time_s, way, base, slice(settled, highest + 1)), float(way[highest]) - base
        frames = slice(block.start + onset, block.start + highest + 1)
        seated, raised = stance.height_sigma[[frames.start, frames.stop - 1]].tolist()
        sigma = sigma_of_difference(seated, raised, JOINT_SHARE) / (1.0 - seat)
        brief = time_s[run.stop - 1] - time_s[run.start] <= config.longest_s
        if brief and depth >= max(events.failed_rise, events.times_sigma * sigma):
            yield Event(FAILED_STAND, frames, depth, sigma, "1", int(stance.state_code[frames].max()))
