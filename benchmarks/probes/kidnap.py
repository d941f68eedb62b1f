"""Give a tracker a wrong pose in the middle of a recording, with the confidence of the right pose.

The tracker's pose and the poses before it are made wrong, but keep the covariance of the right pose. The frames that
the tracker has already observed are observed again, as the tracker would have done after predicting the wrong pose.
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
"""Number of frames before the last estimated frame that are observed again, so that the memory of other people also
comes from a wrong pose of the patient."""


@dataclass(slots=True, eq=False)
class Past:
    """Poses and observations of the last frames, oldest first, which the tracker's own state does not keep."""

    poses: deque[Pose]
    seen: deque[Observation]

    @classmethod
    def of(cls, tracker: PatientTracker) -> Past:
        """Return the past of a tracker that has only started."""
        past = cls(deque(maxlen=tracker.config.follow.history), deque(maxlen=SEEN_AGAIN + 2))
        past.note(tracker)
        return past

    def note(self, tracker: PatientTracker) -> None:
        """Add pose and observation of the frame that the tracker estimated last."""
        self.poses.append(tracker.belief.pose)
        self.seen.append(tracker.window[0])

    @property
    def full(self) -> bool:
        """Return whether enough frames have been noted to make all poses of a tracker wrong."""
        return len(self.poses) == self.poses.maxlen and len(self.seen) == self.seen.maxlen


def fork(tracker: PatientTracker) -> PatientTracker:
    """Return a copy of a tracker in its state; parts that no tracker changes (run, body, observations) are shared."""
    shared = [tracker.run, tracker.config, tracker.points, tracker.shape, tracker.body, tracker.map]
    shared += [tracker.belief, tracker.last.seen, tracker.first, *tracker.window.seen, *tracker.window.frames]
    return copy.deepcopy(tracker, {id(value): value for value in shared})


def kidnap(tracker: PatientTracker, past: Past, spoil: Spoil) -> PatientTracker:
    """Return a copy with wrong poses now and in the past, as confident of them as the tracker is of the right poses."""
    kidnapped, body = fork(tracker), tracker.body
    poses = [spoilt(body, pose, spoil) for pose in past.poses]
    kidnapped.belief = replace(tracker.belief, pose=poses[-1])
    remembered = poses[len(poses) - len(tracker.history) :]  # fewer if the tracker has cleared its history
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
    """Return where the feet would have been seen standing in the kept frames, according to the wrong poses."""
    feet, body = StandingFeet(tracker.points), tracker.body
    for seen, pose in zip(past.seen, poses[-len(past.seen) :], strict=True):
        confident = Registration(replace(tracker.belief, pose=pose), 1.0, True)
        estimate = estimate_of(body, confident, seen, None, tracker.config)
        skin_m, floor_m = pose_points(body, pose).points_m, seen.evidence.floor_m
        feet.note(skin_m, body.joints(pose), estimate.states, seen.frame_set.time_s, floor_m)
    return feet
