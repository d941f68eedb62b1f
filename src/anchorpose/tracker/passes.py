"""The whole recording from the frame in which the patient is seen best: backwards to the start, forwards to the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.body.contact_regions import Nearness, find_nearness
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body, pose_points
from anchorpose.joints import JointState
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.results.anchors_table import AnchorFrame
from anchorpose.results.joint_frame import JointFrame
from anchorpose.results.people_labels import LabelPicture
from anchorpose.results.poses import BodyPose
from anchorpose.tracker.association import Associate, link
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.learning import LearntPatient, learn_patient
from anchorpose.tracker.room import Room, held_joints
from anchorpose.tracker.smoothing import Passed, passed, smooth
from anchorpose.tracker.start import Start, turn_round
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracker.witnesses import anchor_frame, axial_sigma, body_pose, label_pictures
from anchorpose.tracking.motion_database import MotionDatabase


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """What is kept of one frame: the joints, the body's pose, anchors, share of nodes matched, how near others are to
    the patient (None where he is lost), and what was wrong with its pictures."""

    joints: JointFrame
    body: BodyPose
    anchors: AnchorFrame
    matched_share: float | None
    near: Nearness | None
    problems: tuple[str, ...]


def _set_aside(record: FrameRecord, why: str | None) -> FrameRecord:
    """The record of a frame of no use: nothing is known of the patient, and its problems say why; None keeps it."""
    if why is None:
        return record
    joints, body = record.joints, record.body
    return replace(
        record,
        joints=replace(
            joints,
            position_m=np.full_like(joints.position_m, np.nan),
            state=(JointState.LOST,) * len(joints.state),
            sigma_m=np.full_like(joints.sigma_m, np.nan),
        ),
        body=body_pose(None, body.frame, body.time_s, None, None),
        near=None,
        problems=(*record.problems, why),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Positions of the frames to track; forth and back both begin with the opening frame."""

    recording: Recording
    forth: Sequence[int]
    back: Sequence[int]
    tick: Callable[[], None]  # called for every frame that is read

    def frames(self, positions: Sequence[int]) -> Iterator[FrameSet]:
        """The frames, decoded one at a time."""
        for position in positions:
            yield next(iter(read_frames(self.recording, position, position + 1)))
            self.tick()


def plan_route(room: Room, config: TrackConfig, tick: Callable[[], None]) -> Route:
    """From the opening frame to both ends of what is to be tracked; forwards from the start where nobody was seen."""
    recording = room.recording
    positions = range(*slice(config.start, config.stop).indices(len(recording.streams[0].files)))
    opening = room.opening.frame if room.opening else positions.start
    return Route(recording, range(opening, positions.stop), range(opening, positions.start - 1, -1), tick)


def learn_on(
    route: Route, room: Room, motions: MotionDatabase | None, config: TrackConfig, watch: Stopwatch
) -> LearntPatient | None:
    """The patient's shape from the frames on the longer side of the opening.

    It is learnt before anything is tracked: both sides then have one body, whose bones keep their length.
    """
    side = max(route.forth, route.back, key=len)
    return learn_patient(room, route.frames(side), motions, config, watch)


def track_on(
    route: Route, room: Room, motions: MotionDatabase | None, shape: FittedShape | None,
    config: TrackConfig, watch: Stopwatch, keep_labels: Callable[[LabelPicture], None], associate: Associate = link,
) -> Iterator[FrameRecord]:  # fmt: skip
    """A record of every frame in the order of time.

    keep_labels: is given whose each pixel is, as soon as it is known: from the opening back to the start first.
    """
    body = None if shape is None else build_body(body_points(), shape)
    kept = set[tuple[int, str]]()

    def keep_once(picture: LabelPicture) -> None:  # the opening stands on both sides
        if (picture.frame, picture.camera) not in kept:
            kept.add((picture.frame, picture.camera))
            keep_labels(picture)

    work = _Work(route, room, motions, shape, body, config, watch, keep_once, associate)
    before = list(work.side(route.back))[1:] if len(route.back) > 1 else []
    yield from reversed(before)
    yield from work.side(route.forth)


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the passes over both sides of the opening share."""

    route: Route
    room: Room
    motions: MotionDatabase | None
    shape: FittedShape | None
    body: Body | None
    config: TrackConfig
    watch: Stopwatch
    keep_labels: Callable[[LabelPicture], None]
    associate: Associate

    def side(self, positions: Sequence[int]) -> Iterator[FrameRecord]:
        """All frames from the opening to one end, in this order."""
        if self.config.smooth and self.body is not None:
            return self._there_and_back(positions, self.body)
        return self._there(positions)

    def _there(self, positions: Sequence[int]) -> Iterator[FrameRecord]:
        for estimate in self._follow(positions):
            yield self._record(estimate)

    def _there_and_back(self, positions: Sequence[int], body: Body) -> Iterator[FrameRecord]:
        """To one end and back to the opening, both passes put together.

        Until the two have met, joints, pose and contacts are kept of every frame, some kilobytes.
        """
        there, records, last = list[Passed](), list[FrameRecord](), None
        for estimate in self._follow(positions):
            there.append(self._passed(body, estimate))
            records.append(self._record(estimate))
            last = estimate
        begin = None if last is None else turn_round(last, self.config)
        back = [self._passed(body, estimate) for estimate in self._follow(positions[::-1], begin)][::-1]
        with self.watch.stage("smoothing"):
            smoothed = smooth(
                body,
                np.array([record.joints.time_s for record in records]),
                there,
                back,
                held_joints(self.room.review, [record.joints.frame for record in records]),
                self.config.smoothing,
                self.config.registration.fit,
            )
        for record, answer in zip(records, smoothed, strict=True):
            yield self._smoothed(record, answer)

    def _follow(self, positions: Sequence[int], begin: Start | None = None) -> Iterator[Estimate]:
        frames = self.route.frames(positions)
        return follow_patient(
            self.room, frames, self.motions, self.shape, self.config, self.watch, begin, self.associate
        )

    def _passed(self, body: Body, estimate: Estimate) -> Passed:
        return passed(body, estimate, self.room.review.why_unusable(estimate.frame_set.frame) is None)

    def _record(self, estimate: Estimate) -> FrameRecord:
        frame_set = estimate.frame_set
        for labels in label_pictures(frame_set, estimate.observation):
            self.keep_labels(labels)
        joints = JointFrame(
            frame=frame_set.frame,
            time_s=frame_set.time_s,
            position_m=estimate.joints_m,
            state=estimate.states,
            sigma_m=estimate.sigma_m,
        )
        record = FrameRecord(
            joints,
            self._body(estimate),
            anchor_frame(estimate),
            estimate.matched_share,
            self._near(estimate),
            frame_set.problems,
        )
        return _set_aside(record, self.room.review.why_unusable(frame_set.frame))

    def _body(self, estimate: Estimate) -> BodyPose:
        belief = estimate.belief
        frame, time_s = estimate.frame_set.frame, estimate.frame_set.time_s
        if self.body is None or belief is None:
            return body_pose(None, frame, time_s, None, None)
        sigma = axial_sigma(self.body, belief.pose, belief.covariance, self.config.uncertainty.inflation)
        return body_pose(self.body, frame, time_s, belief.pose, sigma)

    def _near(self, estimate: Estimate) -> Nearness | None:
        """How near others are to the patient of the learnt body; None where he is lost."""
        seen, belief = estimate.observation, estimate.belief
        if self.body is None or seen is None or belief is None:
            return None
        with self.watch.stage("contacts"):
            posed = pose_points(self.body, belief.pose)
            return find_nearness(posed, seen.memory, seen.evidence.views, seen.evidence.cameras, self.config.visibility)

    def _smoothed(self, record: FrameRecord, answer: Passed) -> FrameRecord:
        """The record with both passes' answer."""
        lost = np.array([state is JointState.LOST for state in answer.states])
        position = np.where(lost[:, None], np.nan, answer.joints_m)
        joints = replace(record.joints, position_m=position, sigma_m=answer.sigma_m, state=answer.states)
        frame, time_s = record.joints.frame, record.joints.time_s
        body = body_pose(self.body, frame, time_s, answer.pose, None)
        return replace(record, joints=joints, body=body)
