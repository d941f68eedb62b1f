"""The whole recording from the frame in which the patient is seen best: backwards to the start, forwards to the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from anchorpose.body.skin_points import FittedShape
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.results.joint_frame import JointFrame
from anchorpose.results.pictures import FramePicture
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.learning import learn_patient
from anchorpose.tracker.patient import follow_patient
from anchorpose.tracker.pictures import draw_estimate
from anchorpose.tracker.room import Room
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.motion_database import MotionDatabase


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """What is kept of a frame: joints, share of nodes matched, what was wrong with its pictures, some for people."""

    joints: JointFrame
    matched_share: float | None
    problems: tuple[str, ...]
    pictures: tuple[FramePicture, ...]


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
) -> FittedShape | None:
    """The patient's shape from the frames on the longer side of the opening."""
    side = max(route.forth, route.back, key=len)
    return learn_patient(room, route.frames(side), motions, config, watch)


def track_on(
    route: Route, room: Room, motions: MotionDatabase | None, shape: FittedShape | None, shown: set[int],
    config: TrackConfig, watch: Stopwatch,
) -> Iterator[FrameRecord]:  # fmt: skip
    """A record of every frame in the order of time; shown: positions of the frames that pictures are made of."""

    def recorded(positions: Sequence[int]) -> Iterator[FrameRecord]:
        estimates = follow_patient(room, route.frames(positions), motions, shape, config, watch)
        for position, estimate in zip(positions, estimates, strict=True):
            yield _record(estimate, shape if position in shown else None)

    before = list(recorded(route.back))[1:] if len(route.back) > 1 else []
    yield from reversed(before)
    yield from recorded(route.forth)


def _record(estimate: Estimate, shape: FittedShape | None) -> FrameRecord:
    frame_set = estimate.frame_set
    joints = JointFrame(
        frame=frame_set.frame,
        time_s=frame_set.time_s,
        position_m=estimate.joints_m,
        state=estimate.states,
        sigma_m=estimate.sigma_m,
    )
    pictures = tuple(draw_estimate(estimate, shape)) if shape is not None else ()
    return FrameRecord(joints, estimate.matched_share, frame_set.problems, pictures)
