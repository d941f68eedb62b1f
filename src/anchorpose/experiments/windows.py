"""Moments of a recording, look-ahead and all, in which every method is asked for its matches on the same meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anchorpose.association.matcher import Matcher
from anchorpose.body.pose import Pose
from anchorpose.experiments.framework import start_at
from anchorpose.experiments.method import Method
from anchorpose.experiments.reference import Reference
from anchorpose.recording.reader import read_frames
from anchorpose.tracker.association import GlobalHypothesis, global_hypothesis
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Room
from anchorpose.tracking.motion_database import MotionDatabase


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """frame: position of the first of the observations; poses: predicted, of those after the first."""

    frame: int
    tracker: PatientTracker
    observations: tuple[Observation, ...]
    poses: tuple[Pose, ...]
    config: TrackConfig


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """What a method says of the m nodes of a window's first frame: node of the second, -1 = no match.

    direct (m,) its hypothesis where it has but one, which nothing has to choose, -1 where it has several; links: the
    hypotheses level by level; tree: after the track tree, its ``node`` may be fewer: those on the body.
    """

    direct: np.ndarray
    links: tuple[Matcher, ...]
    tree: GlobalHypothesis


def take_window(
    frame: int, room: Room, reference: Reference, motions: MotionDatabase | None, config: TrackConfig
) -> Window | None:
    """The window from a frame on; None where the patient is not known in it or not seen in the next."""
    count = len(room.recording.streams[0].files)
    if not reference.found[frame] or frame + 1 >= count:
        return None
    frames = list(read_frames(room.recording, frame, min(frame + 1 + config.follow.look_ahead, count)))
    tracker = start_at(frame, frames[0], room, reference, motions, config)
    for frame_set in frames[1:]:
        tracker.take(frame_set)
    if tracker.next_hypothesis() is None:
        return None
    poses = tracker.predict(len(tracker.window) - 1)
    return Window(frame, tracker, tuple(tracker.window), tuple(poses), config)


def ask(method: Method, setting: object, window: Window) -> Matches:
    """The method's matches in a window, with and without the tree."""
    if method.associate is None:
        raise ValueError(f"{method.key} makes no pairs that could be asked for")
    config, associate = method.configure(window.config, setting), method.associate(setting)
    seen = window.observations[: config.follow.look_ahead + 1]
    links = tuple(associate(now, after, config) for now, after in pairwise(seen))
    hypotheses = links[0].all().match
    tracker = window.tracker
    tree = global_hypothesis(
        tracker.points, tracker.rest, tracker.belief.pose, window.poses[: len(links)], seen, links, config
    )
    direct = (
        hypotheses[:, 0] if not method.several and hypotheses.shape[1] == 1 else np.full(len(hypotheses), -1, np.int32)
    )
    return Matches(direct, links, tree)


def draw_some(frames: Sequence[int], wanted: int, seed: int) -> list[int]:
    """So many of the frames, drawn at random, in order; each method and size of hole is given the same."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(11,)))
    count = min(wanted, len(frames))
    return sorted(int(frame) for frame in rng.choice(np.asarray(frames), size=count, replace=False))
