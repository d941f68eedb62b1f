"""Learning the patient's body from the first seconds in which he is followed."""

from __future__ import annotations

from collections.abc import Iterable

from anchorpose.body.learning import learn_body
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.patient import follow_patient
from anchorpose.tracker.room import Room
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.motion_database import MotionDatabase


def learn_patient(
    room: Room, frames: Iterable[FrameSet], motions: MotionDatabase | None, config: TrackConfig, watch: Stopwatch
) -> FittedShape | None:
    """The patient's shape from frames spread over the learning window, or None where he is never found.

    The window opens with the first frame in which he is found. Only frames that take part in learning are kept.
    """
    kept: list[Estimate] = []
    spacing_s = config.learning.window_s / config.learning.frame_count
    for estimate in follow_patient(room, frames, motions, None, config, watch):
        if estimate.belief is None or estimate.explained < config.follow.least_explained:
            continue
        time_s = estimate.frame_set.time_s
        if kept and time_s - kept[0].frame_set.time_s > config.learning.window_s:
            break
        if not config.learning.own_shape:
            return estimate.shape
        if not kept or time_s - kept[-1].frame_set.time_s >= spacing_s - 1e-6:
            kept.append(estimate)
    if not kept or kept[0].shape is None:
        return None
    with watch.stage("body shape"):
        learned = learn_body(
            body_points(),
            kept[0].shape,
            [estimate.belief.pose for estimate in kept if estimate.belief],
            [estimate.observation.evidence for estimate in kept if estimate.observation],
            config.learning,
            config.registration,
        )
    return learned.shape
