"""One method on one recording: every segment in the paper's framework, or a tracker of its own from end to end."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.experiments.framework import follow_segment, start_at
from anchorpose.experiments.method import Method
from anchorpose.experiments.reference import NoReference, Reference, make_reference
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import Room
from anchorpose.tracking.motion_database import MotionDatabase


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """frame (f,) positions in the recording; joints_m (f, 21, 3) world, NaN where lost; seconds of one core."""

    frame: np.ndarray
    joints_m: np.ndarray
    seconds: float


def segment_starts(frames: int, length: int, found: np.ndarray) -> list[int]:
    """The first frame of each whole segment in which the patient's pose is known."""
    return [start for start in range(0, frames - length + 1, length) if found[start]]


def track_segments(
    method: Method, setting: object, room: Room, reference: Reference, motions: MotionDatabase | None,
    config: TrackConfig, starts: Sequence[int], length: int,
) -> Track:  # fmt: skip
    """The method in the framework, anew from each start; the frames that are started in are left out."""
    if method.associate is None:
        raise ValueError(f"{method.key} makes no pairs that the framework could use")
    began, frames, joints = time.process_time(), list[np.ndarray](), list[np.ndarray]()
    own = method.configure(config, setting)
    for start in starts:
        sets = list(read_frames(room.recording, start, start + length))
        tracker = start_at(start, sets[0], room, reference, motions, own, method.associate(setting))
        joints.append(follow_segment(tracker, sets[1:]))
        frames.append(np.arange(start + 1, start + len(sets)))
    if not frames:
        return Track(np.zeros(0, np.int64), np.zeros((0, 21, 3)), 0.0)
    return Track(np.concatenate(frames), np.concatenate(joints), time.process_time() - began)


def track_whole(method: Method, setting: object, recording: Recording) -> Track:
    """A tracker of its own: it finds the patient, learns his body and follows him without being told anything.

    Its joints are those of the pose that it holds, also where it would call them lost: what a method says, counts.
    """
    began, frames = time.process_time(), np.arange(len(recording.streams[0].files))
    try:
        joints = make_reference(recording, method.configure(TrackConfig(), setting)).joints_m
    except NoReference:
        joints = np.full((len(frames), 21, 3), np.nan)
    return Track(frames, joints, time.process_time() - began)
