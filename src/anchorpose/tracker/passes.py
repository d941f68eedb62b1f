"""Track the whole recording from the best initial frame: backward to the start, forward to the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, Final

import numpy as np

from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body
from anchorpose.isolation.other_place import without_other_places
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import Follower
from anchorpose.tracker.frame_record import Kept, TrackedFrame, label_pictures, record_of, smoothed_record
from anchorpose.tracker.journal import Blocks, Journal
from anchorpose.tracker.learning_pass import LearntPatient, Stretch, learn_patient
from anchorpose.tracker.looking_back import Passed, Waiting
from anchorpose.tracker.observation import Start
from anchorpose.tracker.room import Room, Run, held_joints
from anchorpose.tracker.search import Search
from anchorpose.tracker.smoothing import (
    PassResult,
    Smoothing,
    course_of,
    explain_smoothed,
    pass_result,
    smooth,
    smoothed_result,
    trunk_of_back,
)
from anchorpose.tracker.start import start_as_learnt, turn_round

BLOCK: Final = 48
"""Number of frames per stored block. Tracking so many frames takes two to six seconds, and the state stored with each
block has 10 to 50 MB.
"""

# maximum number of parts of the recording to learn from; each part costs a search for a first pose
STRETCHES: Final = 3
# s, minimum time between the initial frames of two stretches; patients often sit or stand still for a minute, so a
# nearer frame shows little that is new
STRETCHES_APART_S: Final = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The positions of the frames to track, forward and backward; both series begin with the initial frame."""

    room: Room
    forward: Sequence[int]
    backward: Sequence[int]
    tick: Callable[[], None]  # called for every frame that is read

    def frames(self, positions: Sequence[int]) -> Iterator[FrameSet]:
        """Yield the frames, decoded one at a time."""
        for position in positions:
            yield self.frame(position)
            self.tick()

    def frame(self, position: int) -> FrameSet:
        """Return one frame, without the depth images of cameras that do not show the room that was learnt for them."""
        return without_other_places(read_frame(self.room.recording, position), self.room.scenes)

    def stretches(self) -> tuple[Stretch, ...]:
        """Return the stretches (parts of the recording) from which the body is learnt. The first stretch begins at the
        initial frame. Up to two further stretches begin at the frames that show the patient best. These frames are more
        than a minute away from the initial frame and from each other. A body part that is hidden in one stretch may be
        in view in another.
        """
        chosen = list(self.room.initial_frames[:1])
        for other in self.room.initial_frames[1:]:
            away_s = [abs(self._time_s(other.frame) - self._time_s(one.frame)) for one in chosen]
            tracked = self.backward[-1] <= other.frame <= self.forward[-1]
            if tracked and len(chosen) < STRETCHES and min(away_s) > STRETCHES_APART_S:
                chosen.append(other)
        if not chosen:
            return (Stretch(None, None, partial(self.frames, max(self.forward, self.backward, key=len))),)
        sides = [partial(self.frames, self._longer_side(one.frame)) for one in chosen]
        return tuple(Stretch(one.choice, one.start, frames) for one, frames in zip(chosen, sides, strict=True))

    def _longer_side(self, position: int) -> Sequence[int]:
        """Return all positions from a given position to the farther end of the tracked range."""
        last, first = self.forward[-1], self.backward[-1]
        forward, backward = range(position, last + 1), range(position, first - 1, -1)
        return max(forward, backward, key=len)

    def _time_s(self, position: int) -> float:
        return float(self.room.recording.streams[0].time_s[position])

    def skip(self, count: int) -> None:
        """Call ``tick`` once for each of ``count`` frames that were tracked before the run was interrupted."""
        for _ in range(count):
            self.tick()


def plan_route(room: Room, config: TrackConfig, tick: Callable[[], None]) -> Route:
    """Plan the route from the initial frame to both ends of the tracked range. Without an initial frame, the route
    begins at the start of the range.
    """
    recording = room.recording
    positions = range(*slice(config.start, config.stop).indices(len(recording.streams[0].files)))
    initial = room.initial_frame.frame if room.initial_frame else positions.start
    return Route(room, range(initial, positions.stop), range(initial, positions.start - 1, -1), tick)


def learn_on(route: Route, run: Run) -> LearntPatient | None:
    """Learn the patient's shape from stretches spread over the recording.

    The shape is learnt before tracking, so that all frames have the same body and bone lengths.
    """
    return learn_patient(run, route.stretches())


def track_on(route: Route, run: Run, learnt: LearntPatient | None, journal: Journal) -> Iterator[TrackedFrame]:
    """Track all frames as soon as the first result is requested, then yield the results in the order of time.

    The tracked frames are stored in the journal in blocks; if the journal has frames already, tracking continues after
    them. If tracking cannot continue, InputError is raised before the first result is requested.
    """
    passes = _Passes(route, run, learnt, None if learnt is None else build_body(body_points(), learnt.shape), journal)
    passes.require_readable()
    return passes.frames()


@dataclass(frozen=True, slots=True, eq=False)
class _PassState:
    """The state of a pass, stored after each block so that an interrupted run can continue."""

    frames: int  # number of frames read
    blocks: int  # number of blocks stored
    stored: int  # number of frames stored
    waiting: Waiting  # frames that are not stored yet, since tracking back from later frames may replace them
    follower: Follower | None  # the tracker to continue with; None after the pass has ended
    # the start of a pass back through the same frames: the patient in the last frame, or the search for a patient who
    # is lost there; None until this pass has ended, or if the patient was never found
    turned: Start | Search | None
    seconds: dict[str, float]  # time spent in each stage so far


@dataclass(frozen=True, slots=True, eq=False)
class _Passes:
    """The passes over both sides of the initial frame (earlier and later frames); each pass has a folder in the
    journal.
    """

    route: Route
    run: Run
    learnt: LearntPatient | None
    body: Body | None
    journal: Journal

    def require_readable(self) -> None:
        """Raise InputError if a stored pass cannot be continued because a file is damaged or a block is missing."""
        with suppress(KeyError):
            self.journal.read("start", Start | None)
        for folder in sorted(path.parent.name for path in self.journal.folder.glob("*/state")):
            self._blocks(folder).require(self.journal.inside(folder).read("state", _PassState).blocks)

    def frames(self) -> Iterator[TrackedFrame]:
        """Track backward and forward from the initial frame; then yield all frames in the order of time."""
        both = len(self.route.backward) > 1
        if both:
            self.side("backward", self.route.backward)
        self.side("forward", self.route.forward)
        if both:  # the initial frame of the backward side is left out, since the forward side has this frame, too
            yield from islice(self.stored("backward", backward=True), len(self.route.backward) - 1)
        yield from self.stored("forward")

    def side(self, name: str, positions: Sequence[int]) -> None:
        """Track all frames of one side, from the initial frame to one end. name: the journal's folder for this side."""
        if self.run.config.smooth and self.body is not None:
            self._both_ways(name, positions, self.body)
        else:
            self._follow(name, positions, self._first_follower, self._tracked, 0 if self.body is None else BLOCK)

    def stored(self, name: str, backward: bool = False) -> Iterator[TrackedFrame]:
        """Yield the frames of a finished side, in the order of the pass or in reverse order."""
        yield from self._blocks(name).read(backward=backward)

    def _both_ways(self, name: str, positions: Sequence[int], body: Body) -> None:
        """Track from the initial frame to one end and back, and combine both passes.

        After both passes, the frames are read a third time, to compute how well the smoothed poses fit them.
        """
        usable = self.run.room.review.why_unusable

        def both(estimate: Estimate) -> tuple[TrackedFrame, PassResult]:
            return self._tracked(estimate), pass_result(body, estimate, usable(estimate.frame_set.frame) is None)

        there, back = f"{name}-there", f"{name}-back"
        turned = self._follow(there, positions, self._first_follower, both)
        self._follow(back, positions[::-1], lambda: self._follower_back(turned), both)
        with self.run.stage("smoothing"):
            smoothing = self._smoothing(there, back, len(positions))
        pairs = zip(self._blocks(there).read(), self._blocks(back).read(backward=True), strict=True)
        smoothed = self._blocks(name)
        for number, first in enumerate(range(0, len(positions), BLOCK)):
            frames, some = self.route.frames(positions[first : first + BLOCK]), list(islice(pairs, BLOCK))
            if smoothed.has(number):
                self.route.skip(len(some))
                continue
            rows = enumerate(zip(some, frames, strict=True), first)
            smoothed.write(number, [self._smoothed(row, *pair, frame, smoothing) for row, (pair, frame) in rows])

    def _smoothing(self, there: str, back: str, count: int) -> Smoothing:
        """Compute how both passes are combined in all frames; only a few frames are held in memory at a time."""
        time_s, frame = np.zeros(count), np.zeros(count, np.int64)
        for row, (tracked, _) in enumerate(self._blocks(there).read()):
            time_s[row], frame[row] = tracked.record.joints.time_s, tracked.record.joints.frame
        return smooth(
            time_s,
            course_of((passed for _, passed in self._blocks(there).read()), count),
            course_of((passed for _, passed in self._blocks(back).read(backward=True)), count),
            held_joints(self.run.room.review, frame.tolist()),
            self.run.config.follow.lost_sigma_m,
        )

    def _smoothed(
        self,
        row: int,
        forth: tuple[TrackedFrame, PassResult],
        back: tuple[TrackedFrame, PassResult],
        frame_set: FrameSet,
        smoothing: Smoothing,
    ) -> TrackedFrame:
        """Return a frame with the combined result of both passes. Labels, contacts and anchors depend on the place of
        the body, so they are taken from the pass with more weight for the trunk (``trunk_of_back``).
        """
        if self.body is None:
            raise ValueError("passes can only be combined if a body was learnt")
        with self.run.stage("smoothing"):
            answer = smoothed_result(self.body, forth[1], back[1], smoothing, row)
            tracked, _ = back if trunk_of_back(forth[1], back[1], smoothing, row) else forth
            explanation = explain_smoothed(frame_set, answer, tracked.labels, self.body, self.run)
            return replace(tracked, record=smoothed_record(tracked.record, answer, self.body, explanation))

    def _follow(
        self,
        name: str,
        positions: Sequence[int],
        begin: Callable[[], Follower],
        keep: Callable[[Estimate], Kept],
        wait: int = 0,
    ) -> Start | Search | None:
        """Run one pass to its end, after the frames that the journal has already; return the start of a pass back
        through the same frames (``_PassState.turned``).

        begin: function that makes this pass's follower; keep: function that returns the values to store for an
        estimate; wait: number of latest frames that are not stored yet, since they may be replaced if a lost limb is
        found again.
        """
        journal, blocks = self.journal.inside(name), self._blocks(name)
        try:
            state: _PassState = journal.read("state", _PassState)
            self.run.stopwatch.seconds.update(state.seconds)
            self.route.skip(state.frames)
        except KeyError:
            state = _PassState(0, 0, 0, Waiting(), begin(), None, {})
        while state.follower is not None:
            some = positions[state.frames : state.frames + BLOCK]
            frames, ends = state.frames + len(some), state.frames + len(some) == len(positions)
            waiting, last = state.waiting, None
            for last in self._estimates(state.follower, some, ends):
                passed = self._passed(positions[state.stored + len(waiting.frames)], last, keep, wait)
                waiting.add(last, passed, self.route.frame, self.run, keep)
            turned = self._turned(last, state.follower) if ends else None
            done = waiting.take_but(0 if ends else wait)
            blocks.write(state.blocks, done)
            follower, seconds = None if ends else state.follower, self.run.stopwatch.seconds
            stored = state.stored + len(done)
            journal.write("state", _PassState(frames, state.blocks + 1, stored, waiting, follower, turned, seconds))
            state = journal.read("state", _PassState)
        return state.turned

    def _turned(self, last: Estimate | None, follower: Follower) -> Start | Search | None:
        begin = None if last is None else turn_round(last, self.run.config)
        return begin or follower.search

    def _passed(self, position: int, estimate: Estimate, keep: Callable[[Estimate], Kept], wait: int) -> Passed:
        usable = self.run.room.review.why_unusable(estimate.frame_set.frame) is None
        result = None if self.body is None or not wait else pass_result(self.body, estimate, usable)
        return Passed(position, result, keep(estimate))

    def _estimates(self, follower: Follower, positions: Sequence[int], ends: bool) -> Iterator[Estimate]:
        for frame_set in self.route.frames(positions):
            yield from follower.step(frame_set)
        if ends:
            yield from follower.finish()

    def _first_follower(self) -> Follower:
        """Return the follower of a pass from the initial frame; both sides (earlier and later frames) begin with the
        same start.
        """
        initial = self.run.room.initial_frame
        start = self.journal.once("start", Start | None, lambda: start_of(self.route, self.run, self.learnt))
        return Follower(self.run, None if initial is None else initial.choice, self._shape, start)

    def _follower_back(self, turned: Start | Search | None) -> Follower:
        """Return the follower of a pass back. If the patient is lost in the frame in which the pass back begins, the
        patient is searched for as after any loss, so that no other person is mistaken for the patient.
        """
        if isinstance(turned, Start):
            return Follower(self.run, None, self._shape, turned)
        return Follower(self.run, None, self._shape, search=turned)

    @property
    def _shape(self) -> FittedShape | None:
        return None if self.learnt is None else self.learnt.shape

    def _blocks(self, name: str) -> Blocks[Any]:
        return Blocks(self.journal.inside(name), Kept)

    def _tracked(self, estimate: Estimate) -> TrackedFrame:
        labels = label_pictures(estimate.frame_set, estimate.observation)
        return TrackedFrame(record_of(estimate, self.body, self.run), labels)


def start_of(route: Route, run: Run, learnt: LearntPatient | None) -> Start | None:
    """Find the patient in the initial frame, from which the body was learnt. Return None if no body was learnt, or if
    the learnt body does not fit this frame.
    """
    initial = run.room.initial_frame
    if initial is None or learnt is None:
        return None
    frame_set = route.frame(initial.frame)
    found = start_as_learnt(frame_set, run, initial.choice, learnt.shape, learnt.facing())
    return found if isinstance(found, Start) else None
