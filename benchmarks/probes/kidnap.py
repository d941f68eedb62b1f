"""A tracker made wrong and confident in the middle of a recording.

The pose and the poses before it are spoilt, with the covariance that the right pose had; and the frames that the
tracker has already observed are observed again as it would have done with the wrong pose in mind.
"""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

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
"""Frames before the last estimated one that are observed again: what isolation remembers of other people then comes
from a wrong patient as well."""


@dataclass(slots=True, eq=False)
class Past:
    """What the tracker's own state no longer holds of the last frames: poses and observations, the last one last."""

    poses: deque[Pose]
    seen: deque[Observation]

    @classmethod
    def of(cls, tracker: PatientTracker) -> Past:
        """Return the past of a tracker that has only started."""
        past = cls(deque(maxlen=tracker.config.follow.history), deque(maxlen=SEEN_AGAIN + 2))
        past.note(tracker)
        return past

    def note(self, tracker: PatientTracker) -> None:
        """Add the frame that was estimated last."""
        self.poses.append(tracker.belief.pose)
        self.seen.append(tracker.window[0])

    @property
    def full(self) -> bool:
        """Whether enough frames have gone by to spoil the tracker as a whole."""
        return len(self.poses) == self.poses.maxlen and len(self.seen) == self.seen.maxlen


def fork(tracker: PatientTracker) -> PatientTracker:
    """Return a tracker in the same state; what no tracker changes (run, body, observations) is shared."""
    shared = [tracker.run, tracker.config, tracker.points, tracker.shape, tracker.body, tracker.map]
    shared += [tracker.belief, tracker.last.seen, tracker.first, *tracker.window.seen, *tracker.window.frames]
    return copy.deepcopy(tracker, {id(value): value for value in shared})


def kidnap(tracker: PatientTracker, past: Past, spoil: Spoil) -> PatientTracker:
    """Return a fork whose limbs are and were elsewhere, and which is as confident of it as the tracker was."""
    kidnapped, body = fork(tracker), tracker.body
    poses = [spoilt(body, pose, spoil) for pose in past.poses]
    kidnapped.belief = replace(tracker.belief, pose=poses[-1])
    remembered = poses[len(poses) - len(tracker.history) :]  # fewer where the tracker has forgotten its movement
    kidnapped.history = deque([body.joints(pose) for pose in remembered], maxlen=tracker.history.maxlen)
    posed = pose_points(body, poses[-1])
    kidnapped.skin_sigma_m = skin_sigma(body, posed, kidnapped.belief.covariance, tracker.config.uncertainty)
    kidnapped.ahead, kidnapped.rivals = [], ()
    kidnapped.feet = _feet(tracker, past, poses)
    _observe_again(kidnapped, past, poses)
    return kidnapped


def _observe_again(kidnapped: PatientTracker, past: Past, poses: list[Pose]) -> None:
    before = past.seen[0]
    for seen, pose in zip(list(past.seen)[1:], poses[1 - len(past.seen) :], strict=True):
        before = _observed_with(kidnapped, seen.frame_set, pose, before)
    if kidnapped.last.seen is kidnapped.window[0]:
        kidnapped.last = replace(kidnapped.last, seen=before)
    window = Window(before, kidnapped.run)
    for frame_set in list(kidnapped.window.frames)[1:]:
        window.append(frame_set)
    kidnapped.window = window


def _observed_with(tracker: PatientTracker, frame_set: FrameSet, pose: Pose, before: Observation) -> Observation:
    expected = tracker.expect(pose)
    isolated, _ = isolate(frame_set, expected, before, tracker.run)
    return observe(frame_set, isolated, expected, tracker.height_m, tracker.run)


def _feet(tracker: PatientTracker, past: Past, poses: list[Pose]) -> StandingFeet:
    """Return where the feet would have been seen standing: in the frames that are kept, by the spoilt poses."""
    feet, body = StandingFeet(tracker.points), tracker.body
    for seen, pose in zip(past.seen, poses[-len(past.seen) :], strict=True):
        confident = Registration(replace(tracker.belief, pose=pose), 1.0, True)
        estimate = estimate_of(body, confident, seen, None, tracker.config)
        skin_m, floor_m = pose_points(body, pose).points_m, seen.evidence.floor_m
        feet.note(skin_m, body.joints(pose), estimate.states, seen.frame_set.time_s, floor_m)
    return feet
