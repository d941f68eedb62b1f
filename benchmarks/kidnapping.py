"""A tracker made wrong and sure of it in the middle of a recording, and how it gets on from there.

The pose and the poses before it are spoilt, with the covariance that the right pose had; and the frames that the
tracker has already looked at are looked at again as it would have done with the wrong pose in mind.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from spoilt_poses import Spoil, spoilt

from anchorpose.body.contact_regions import StandingFeet
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import skin_sigma
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import estimate_of
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Window, isolate, observe
from anchorpose.tracker.patient import PatientTracker

SEEN_AGAIN: Final = 3
"""Frames before the last estimated one that are looked at again: what isolation remembers of other people then comes
from a wrong patient as well."""

EPSILON_S: Final = 1e-6  # times are sums of frame periods


@dataclass(slots=True, eq=False)
class Past:
    """What the tracker's own state no longer holds of the last frames: their poses and what was seen, the last last."""

    poses: deque[Pose]
    seen: deque[Observation]

    @classmethod
    def of(cls, tracker: PatientTracker) -> Past:
        """The past of a tracker that has only started."""
        past = cls(deque(maxlen=tracker.config.follow.history), deque(maxlen=SEEN_AGAIN + 2))
        past.note(tracker)
        return past

    def note(self, tracker: PatientTracker) -> None:
        """One more estimated frame."""
        self.poses.append(tracker.belief.pose)
        self.seen.append(tracker.window[0])

    @property
    def full(self) -> bool:
        """Whether enough frames have gone by to spoil the tracker as a whole."""
        return len(self.poses) == self.poses.maxlen and len(self.seen) == self.seen.maxlen


def fork(tracker: PatientTracker) -> PatientTracker:
    """A tracker in the same state; what no tracker changes (run, body, observations) is shared."""
    shared = [tracker.run, tracker.config, tracker.points, tracker.shape, tracker.body, tracker.map]
    shared += [tracker.belief, tracker.last.seen, tracker.first, *tracker.window.seen, *tracker.window.frames]
    return copy.deepcopy(tracker, {id(value): value for value in shared})


def kidnap(tracker: PatientTracker, past: Past, spoil: Spoil) -> PatientTracker:
    """A fork whose limbs are elsewhere, and were so before, and which is as sure of it as the tracker was."""
    kidnapped, body = fork(tracker), tracker.body
    poses = [spoilt(body, pose, spoil) for pose in past.poses]
    kidnapped.belief = replace(tracker.belief, pose=poses[-1])
    remembered = poses[len(poses) - len(tracker.history) :]  # fewer where the tracker has forgotten its movement
    kidnapped.history = deque([body.joints(pose) for pose in remembered], maxlen=tracker.history.maxlen)
    posed = pose_points(body, poses[-1])
    kidnapped.skin_sigma_m = skin_sigma(body, posed, kidnapped.belief.covariance, tracker.config.uncertainty)
    kidnapped.ahead, kidnapped.rivals = [], ()
    kidnapped.feet = _feet(tracker, past, poses)
    _look_again(kidnapped, past, poses)
    return kidnapped


def _look_again(kidnapped: PatientTracker, past: Past, poses: list[Pose]) -> None:
    """What the last frames show with the wrong pose in mind."""
    before = past.seen[0]
    for seen, pose in zip(list(past.seen)[1:], poses[1 - len(past.seen) :], strict=True):
        before = _seen_with(kidnapped, seen.frame_set, pose, before)
    if kidnapped.last.seen is kidnapped.window[0]:
        kidnapped.last = replace(kidnapped.last, seen=before)
    window = Window(before, kidnapped.run)
    for frame_set in list(kidnapped.window.frames)[1:]:
        window.append(frame_set)
    kidnapped.window = window


def _seen_with(tracker: PatientTracker, frame_set: FrameSet, pose: Pose, before: Observation) -> Observation:
    expected = tracker.expect(pose)
    isolated, _ = isolate(frame_set, expected, before, tracker.run)
    return observe(frame_set, isolated, expected, tracker.height_m, tracker.run)


def _feet(tracker: PatientTracker, past: Past, poses: list[Pose]) -> StandingFeet:
    """Where the feet would have been seen standing: in the frames that are kept, by the spoilt poses."""
    feet, body = StandingFeet(tracker.points), tracker.body
    for seen, pose in zip(past.seen, poses[-len(past.seen) :], strict=True):
        sure = Registration(replace(tracker.belief, pose=pose), 1.0, True)
        estimate = estimate_of(body, sure, seen, None, tracker.config)
        skin_m = pose_points(body, pose).points_m
        feet.note(skin_m, estimate.joints_m, estimate.states, seen.frame_set.time_s)
    return feet


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """When a limb is right: each joint within ``absolute_m`` of the truth, or within ``excess_m`` more than the error
    of the tracker that was left alone; by ``within_s`` after the spoiling, and from then on until ``until_s``."""

    absolute_m: float = 0.10
    excess_m: float = 0.05
    within_s: float = 0.5
    until_s: float = 1.0

    def are_right(self, error_m: np.ndarray, undisturbed_m: np.ndarray) -> bool:
        """Errors (k,) of the limbs' joints."""
        return bool((error_m <= np.maximum(self.absolute_m, undisturbed_m + self.excess_m)).all())


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """right: by the limits' time and to their end. recovered_s: from when on; None where it was not. worst_m: the
    largest error of a joint in the last frame judged."""

    right: bool
    recovered_s: float | None
    worst_m: float


@dataclass(slots=True)
class Judge:
    """Judges poses as they come, whatever state their joints are given; ``done`` as soon as the outcome is certain.

    began_s: time of the spoilt frame. truth_m, undisturbed_m: joints (21, 3) by frame number, of the truth and of the
    tracker that was left alone. joints (k,): those that count.
    """

    began_s: float
    joints: np.ndarray
    truth_m: Callable[[int], np.ndarray]
    undisturbed_m: Callable[[int], np.ndarray]
    limits: Limits = field(default_factory=Limits)
    done: bool = False
    right_since_s: float | None = None
    worst_m: float = float("nan")

    def take(self, frame: int, time_s: float, joints_m: np.ndarray) -> None:
        """One more frame, in the order of tracking: its number, time, and joints (21, 3) by the tracker's pose."""
        after_s = abs(time_s - self.began_s)
        if after_s > self.limits.until_s + EPSILON_S:
            self.done = True
            return
        truth_m = self.truth_m(frame)[self.joints]
        error_m = np.linalg.norm(joints_m[self.joints] - truth_m, axis=1)
        usual_m = np.linalg.norm(self.undisturbed_m(frame)[self.joints] - truth_m, axis=1)
        self.worst_m = float(error_m.max())
        if not self.limits.are_right(error_m, usual_m):
            self.right_since_s = None
        elif self.right_since_s is None:
            self.right_since_s = after_s
        since_s = after_s if self.right_since_s is None else self.right_since_s
        self.done = since_s > self.limits.within_s + EPSILON_S

    def outcome(self) -> Outcome:
        """What became of it."""
        right = self.right_since_s is not None and self.right_since_s <= self.limits.within_s + EPSILON_S
        return Outcome(right=right, recovered_s=self.right_since_s if right else None, worst_m=self.worst_m)
