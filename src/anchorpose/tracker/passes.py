"""The whole recording, from the frame in which the patient is seen best: backward to the start, forward to the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.results.people_labels import LabelImage
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.frame_record import FrameRecord, label_pictures, record_of, smoothed_record
from anchorpose.tracker.learning import LearntPatient, learn_patient
from anchorpose.tracker.room import Room, held_joints
from anchorpose.tracker.run import Run
from anchorpose.tracker.smoothed_explanation import explain_smoothed
from anchorpose.tracker.smoothing import PassResult, pass_result, smooth
from anchorpose.tracker.start import Start, find_start, turn_round


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Positions of the frames to track; forward and backward both begin with the initial frame."""

    recording: Recording
    forward: Sequence[int]
    backward: Sequence[int]
    tick: Callable[[], None]  # called for every frame that is read

    def frames(self, positions: Sequence[int]) -> Iterator[FrameSet]:
        """The frames, decoded one at a time."""
        for position in positions:
            yield read_frame(self.recording, position)
            self.tick()


def plan_route(room: Room, config: TrackConfig, tick: Callable[[], None]) -> Route:
    """From the initial frame to both ends of what is to be tracked; forward from the start where nobody was seen."""
    recording = room.recording
    positions = range(*slice(config.start, config.stop).indices(len(recording.streams[0].files)))
    initial = room.initial_frame.frame if room.initial_frame else positions.start
    return Route(recording, range(initial, positions.stop), range(initial, positions.start - 1, -1), tick)


def learn_on(route: Route, run: Run) -> LearntPatient | None:
    """The patient's shape from the frames on the longer side of the initial frame.

    It is learnt before anything is tracked: both sides then have one body, whose bones keep their length.
    """
    return learn_patient(run, route.frames(max(route.forward, route.backward, key=len)))


def track_on(
    route: Route, run: Run, shape: FittedShape | None, keep_labels: Callable[[LabelImage], None]
) -> Iterator[FrameRecord]:
    """A record of every frame in the order of time.

    keep_labels: receives the person label of each pixel as soon as it is known, those before the initial frame first.
    """
    kept = set[tuple[int, str]]()

    def keep_once(picture: LabelImage) -> None:  # the initial frame stands on both sides
        if (picture.frame, picture.camera) not in kept:
            kept.add((picture.frame, picture.camera))
            keep_labels(picture)

    body = None if shape is None else build_body(body_points(), shape)
    passes = _Passes(route, run, shape, body, keep_once, _start_of(route, run, shape))
    before = list(passes.side(route.backward))[1:] if len(route.backward) > 1 else []
    yield from reversed(before)
    yield from passes.side(route.forward)


def _start_of(route: Route, run: Run, shape: FittedShape | None) -> Start | None:
    """The patient in the initial frame, where both sides begin; None where nobody is found in it."""
    initial = run.room.initial_frame
    if initial is None or not len(route.forward):
        return None
    found = find_start(read_frame(route.recording, route.forward[0]), run, initial.choice, shape)
    return found if isinstance(found, Start) else None


@dataclass(frozen=True, slots=True, eq=False)
class _Passes:
    """What the passes over both sides of the initial frame share."""

    route: Route
    run: Run
    shape: FittedShape | None
    body: Body | None
    keep_labels: Callable[[LabelImage], None]
    start: Start | None

    def side(self, positions: Sequence[int]) -> Iterator[FrameRecord]:
        """All frames from the initial frame to one end, in this order."""
        if self.run.config.smooth and self.body is not None:
            return self._both_ways(positions, self.body)
        return (
            self._record(estimate, label_pictures(estimate.frame_set, estimate.observation))
            for estimate in self._follow(positions, self.start)
        )

    def _both_ways(self, positions: Sequence[int], body: Body) -> Iterator[FrameRecord]:
        """To one end and back to the initial frame, both passes combined.

        Until the two have met, joints, pose, person labels and contacts of every frame are kept, some kilobytes each.
        The frames are then read again, to state how well the smoothed poses explain them.
        """
        there, records, last = list[PassResult](), list[FrameRecord](), None
        for estimate in self._follow(positions, self.start):
            labels = label_pictures(estimate.frame_set, estimate.observation)
            there.append(self._passed(body, estimate, labels))
            records.append(self._record(estimate, labels))
            last = estimate
        begin = None if last is None else turn_round(last, self.run.config)
        back = [
            self._passed(body, estimate, label_pictures(estimate.frame_set, estimate.observation))
            for estimate in self._follow(positions[::-1], begin)
        ][::-1]
        with self.run.stage("smoothing"):
            smoothed = smooth(
                body,
                np.array([record.joints.time_s for record in records]),
                there,
                back,
                held_joints(self.run.room.review, [record.joints.frame for record in records]),
                self.run.config.follow.lost_sigma_m,
            )
        for record, answer, frame_set in zip(records, smoothed, self.route.frames(positions), strict=True):
            with self.run.stage("smoothing"):
                explanation = explain_smoothed(frame_set, answer, body, self.run)
            yield smoothed_record(record, answer, body, explanation)

    def _follow(self, positions: Sequence[int], begin: Start | None) -> Iterator[Estimate]:
        return follow_patient(self.run, self.route.frames(positions), self.shape, begin)

    def _passed(self, body: Body, estimate: Estimate, labels: tuple[LabelImage, ...]) -> PassResult:
        usable = self.run.room.review.why_unusable(estimate.frame_set.frame) is None
        return pass_result(body, estimate, labels, usable)

    def _record(self, estimate: Estimate, labels: tuple[LabelImage, ...]) -> FrameRecord:
        for picture in labels:
            self.keep_labels(picture)
        return record_of(estimate, self.body, self.run)
