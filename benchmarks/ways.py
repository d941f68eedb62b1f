"""Ways through a simulated recording as tracking goes them, one frame at a time, with the tracker at hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body
from anchorpose.motion.database_file import load_motions
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run
from anchorpose.tracker.start import NoStart, find_start


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Through a recording in one direction of time: positions of its frames, and the body as learnt from it."""

    direction: str
    run: Run
    shape: FittedShape
    positions: Sequence[int]

    @property
    def body(self) -> Body:
        """The patient's body."""
        return build_body(body_points(), self.shape)

    def read(self, place: int) -> FrameSet:
        """The frame at a place of ``positions``; the last ones are kept."""
        return _read(self.run, self.positions[place])

    def trackers(self) -> Iterator[tuple[int, PatientTracker, Estimate]]:
        """After each estimate how many frames were read, the tracker, which is not to be changed, and the estimate.

        Ends where the patient is not found or lost.
        """
        initial = self.run.room.initial_frame
        start = None if initial is None else find_start(self.read(0), self.run, initial.choice, self.shape)
        if start is None or isinstance(start, NoStart):
            return
        tracker = PatientTracker(self.run, start)
        yield 1, tracker, tracker.first
        for place in range(1, len(self.positions)):
            estimate = tracker.step(self.read(place))
            if estimate is not None:
                yield place + 1, tracker, estimate
            if tracker.last.gone_s > self.run.config.follow.lost_after_s:
                return


@lru_cache(maxsize=64)
def _read(run: Run, position: int) -> FrameSet:
    return read_frame(run.room.recording, position)


def ways_through(recording: Path, config: TrackConfig) -> tuple[Way, ...]:
    """From the initial frame to the farther end of a recording, and from there back; none where nobody is found."""
    opened = open_recording(recording)
    room = prepare_room(opened, config)
    run = Run(room, config, load_motions(config.motion_file, opened.rate_hz, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    if learnt is None:
        return ()
    longer = max(route.forward, route.backward, key=len)
    both = (longer, longer[::-1])
    return tuple(Way("forward" if p[0] < p[-1] else "backward", run, learnt.shape, p) for p in both if len(p) > 1)


@dataclass(frozen=True, slots=True, eq=False)
class Undisturbed:
    """How tracking goes on a way if it is left alone, by frame in the order of tracking.

    joints_m (21, 3) of the poses, also where a joint's state is lost.
    """

    joints_m: dict[int, np.ndarray]
    poses: dict[int, Pose]


def undisturbed(way: Way) -> Undisturbed:
    """Track the way once."""
    found = Undisturbed({}, {})
    for _, tracker, estimate in way.trackers():
        found.joints_m[estimate.frame_set.frame] = tracker.body.joints(tracker.belief.pose)
        found.poses[estimate.frame_set.frame] = tracker.belief.pose
    return found
