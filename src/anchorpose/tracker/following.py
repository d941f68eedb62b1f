"""Follow a patient through all frames: find the patient, track, and search again after a loss."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from anchorpose.body.inverse_kinematics import CorrectedJoints
from anchorpose.body.skin_points import FittedShape, body_points, build_body
from anchorpose.body.visibility import PoorDepth, too_coarse
from anchorpose.isolation.bystander_memory import BystanderMemory, empty_memory
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import Estimate, nobody_found
from anchorpose.tracker.observation import Start
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Run
from anchorpose.tracker.search import NEAR_M, Search
from anchorpose.tracker.start import NoStart, find_start

# number of frames from a failed search for the patient's body to the next search. Each failed search doubles the number
# of frames to wait, up to LONGEST_PAUSE, since a search takes as long as tracking thirty frames
FIRST_PAUSE, LONGEST_PAUSE = 5, 15


def follow_patient(run: Run, frames: Iterable[FrameSet], known: FittedShape | None) -> Iterator[Estimate]:
    """Yield an estimate for every frame, in order. All joints are lost until the patient is found; after a loss, the
    patient is searched for again.

    frames: all frames, forward or backward in time; the first of these frames should be the recording's initial frame
    (``Room.initial_frame``). known: the learnt shape of the patient's body; None before learning.
    """
    choice = run.room.initial_frame.choice if run.room.initial_frame else None
    for estimate, _ in follow_openly(run, frames, choice, known):
        yield estimate


def follow_openly(
    run: Run,
    frames: Iterable[FrameSet],
    choice: PatientChoice | None,
    known: FittedShape | None,
    begin: Start | None = None,
) -> Iterator[tuple[Estimate, PatientTracker | None]]:
    """Follow the patient as ``follow_patient`` does, but from any frame. Yield each estimate together with the tracker,
    which is None while no patient is followed.

    choice: place of the patient in the first frame, None if no patient is to be searched for. begin: the patient as
    found in the first frame; None if the patient must still be searched for there.
    """
    follower = Follower(run, choice, known, begin)
    for frame_set in frames:
        yield from ((estimate, follower.tracker) for estimate in follower.step(frame_set))
    yield from ((estimate, follower.tracker) for estimate in follower.finish())


class Follower:
    """The object that follows one patient, frame by frame. Its state can be stored between two frames
    (``tracker.journal``), so that an interrupted run can continue. The arguments have the same meaning as in
    ``follow_openly``; search: a search for a lost patient that this follower continues; None if the patient was not
    followed before.
    """

    run: Run
    tracker: PatientTracker | None  # None while no patient is followed
    _choice: PatientChoice | None
    _known: FittedShape | None
    _begin: Start | None
    # the search for a lost patient; None before the first loss and while the patient is followed
    _search: Search | None
    _wait: int
    _pause: int
    _found: str

    def __init__(
        self,
        run: Run,
        choice: PatientChoice | None,
        known: FittedShape | None,
        begin: Start | None = None,
        search: Search | None = None,
    ) -> None:
        self.run = run
        self.tracker = None
        self._choice, self._known, self._begin = choice, known, begin
        self._search = search
        self._wait, self._pause, self._found = 0, FIRST_PAUSE, run.room.why_nobody

    def step(self, frame_set: FrameSet) -> Iterator[Estimate]:
        """Add a frame; yield the estimates of all frames whose look-ahead (the next few frames) is now complete."""
        if self.tracker is not None:
            yield from self._follow(self.tracker, frame_set)
        else:
            yield self._look(frame_set)

    @property
    def memory(self) -> BystanderMemory:
        """Return the remembered skin of all people after the last frame; empty until the patient is first found."""
        if self.tracker is not None:
            return self.tracker.window.seen[-1].memory
        return empty_memory() if self._search is None else self._search.memory

    @property
    def search(self) -> Search | None:
        """Return a search that looks for the patient in the frames after the last frame; None if the patient was never
        found.
        """
        return self._search if self.tracker is None else self.tracker.search()

    def finish(self) -> Iterator[Estimate]:
        """Yield the estimates of the last frames. The look-ahead of these frames is shorter, since fewer later frames
        exist.
        """
        if self.tracker is not None:
            yield from self.tracker.finish()

    def _follow(self, tracker: PatientTracker, frame_set: FrameSet) -> Iterator[Estimate]:
        if (estimate := tracker.step(frame_set)) is not None:
            yield estimate
        if tracker.has_left or tracker.last.gone_s > self.run.config.follow.lost_after_s:
            self._search, self._known, self.tracker = tracker.search(), tracker.shape, None
            for waiting in list(tracker.window.frames)[1:]:
                yield from self.step(waiting)

    def _look(self, frame_set: FrameSet) -> Estimate:
        """Search this frame for the patient. Return the first estimate of the patient, or an estimate with all joints
        lost. If a reviewer placed joints in this frame, the patient is the person at these joints.
        """
        self._wait -= 1
        if self._search is not None:
            with self.run.stage("isolation"):
                looked = self._search.look(frame_set, self.run)
            if isinstance(looked, NoStart):
                self._choice, self._found = None, looked.value
            else:
                self._choice = looked
        start: Start | NoStart | None = self._begin
        marked = self.run.room.review.corrected(frame_set.frame)
        if start is None and marked is not None:
            start = self._start_at(marked, frame_set)
        elif start is None and self._choice is not None and self._wait < 0:
            expected = None if self._search is None else self._search.expected(frame_set.time_s)
            start = find_start(frame_set, self.run, self._choice, self._known, expected=expected)
        self._begin = None
        if isinstance(start, Start):
            self.tracker, self._search = PatientTracker(self.run, start), None
            self._wait, self._pause = 0, FIRST_PAUSE
            return self.tracker.first
        if start is not None:
            self._found = start.value
            if start is NoStart.NO_BODY_FITS:
                self._wait, self._pause = self._pause, min(2 * self._pause, LONGEST_PAUSE)
        return nobody_found(frame_set, self._found, poor=_poor_at(self._choice, frame_set, self.run))

    def _start_at(self, marked: CorrectedJoints, frame_set: FrameSet) -> Start | NoStart:
        """Find the person at the joints that a reviewer placed, whatever is expected; return ``NOBODY_THERE`` if the
        nearest person is somewhere else.
        """
        choice = PatientChoice(marked.position_m.mean(axis=0)[[0, 2]], "was marked by a reviewer", sure=True)
        start = find_start(frame_set, self.run, choice, self._known)
        if isinstance(start, NoStart):
            return start
        joints_m = build_body(body_points(), start.shape).joints(start.belief.pose)[marked.joint]
        away_m = float(np.linalg.norm(joints_m - marked.position_m, axis=1).mean())
        return start if away_m <= NEAR_M else NoStart.NOBODY_THERE


def _poor_at(choice: PatientChoice | None, frame_set: FrameSet, run: Run) -> tuple[PoorDepth, ...]:
    """Return the defects that make depth at the patient's place too coarse for joints; empty if no place is known."""
    if choice is None:
        return ()
    place = np.array([choice.ground_xz_m[0], 0.0, choice.ground_xz_m[1]])
    poor = []
    for scene, depth_m in zip(run.room.scenes, frame_set.depths_m, strict=True):
        away = place - scene.camera.position_m
        distance_m = float(np.linalg.norm(away[[0, 2]]))
        if depth_m is not None and (found := too_coarse(scene.camera.name, scene.background.sensor, distance_m)):
            poor.append(found)
    return tuple(poor)
