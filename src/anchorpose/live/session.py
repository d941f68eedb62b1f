"""From cameras that run to joints at once: look around, learn the body, catch up, follow; a results folder at the end.

The first seconds are recorded, and everything that tracking needs to know beforehand is found in them as in any
recording. What the cameras see meanwhile is tracked at a few frames a second, so that the patient is never out of
sight; from then on every newest frame is tracked, and what comes while one is worked on is dropped.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from threading import Event
from typing import Final

import numpy as np

from anchorpose.body.skin_points import body_points, build_body
from anchorpose.errors import AnchorposeError
from anchorpose.live.backlog import Backlog
from anchorpose.live.follow import LiveFollower
from anchorpose.live.intake import Intake
from anchorpose.live.latency import LatencySummary
from anchorpose.live.output import Output, Outputs
from anchorpose.live.recorder import Recorder
from anchorpose.live.source import LiveSource
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import Recording, align_clocks
from anchorpose.results.unfinished import begin_journal, end_journal
from anchorpose.threads import camera_threads, one_thread
from anchorpose.track_inputs import TrackInputs, UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import Follower
from anchorpose.tracker.journal import Blocks, Journal
from anchorpose.tracker.learning import LearntPatient, learn_patient
from anchorpose.tracker.passes import TrackedFrame, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.room import InitialFrame
from anchorpose.tracker.run import Run
from anchorpose.tracking.motion_file import load_motions
from anchorpose.writing import write_results

PATIENCE_S: Final = 0.5
REPORT_S: Final = 10.0  # between two lines about latency
NEARLY_AS_GOOD: Final = 0.5  # of the best score: a later frame to begin with saves waiting
FIRST_WAIT_S: Final = 10.0  # for the first image of a source

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """config: of tracking; wait_frames: how many later frames are waited for before a frame is answered; start_s: how
    long is recorded before the body is learnt; calibration: a file of camera poses; record: a folder for all depth
    images; seconds: of tracking, None until ``stop``."""

    config: TrackConfig
    wait_frames: int = 0
    start_s: float = 6.0
    calibration: Path | None = None
    record: Path | None = None
    seconds: float | None = None

    @property
    def live_config(self) -> TrackConfig:
        """The settings with the look-ahead that live tracking waits for."""
        follow = replace(self.config.follow, look_ahead=1 + self.wait_frames)
        return replace(self.config, follow=follow)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """What the first seconds show: the room with the patient in it, and the patient's body."""

    inputs: TrackInputs
    run: Run
    learnt: LearntPatient


def track_live(
    sources: Sequence[LiveSource], results: Path, options: LiveOptions, outputs: Sequence[Output], say: Say, stop: Event
) -> LatencySummary:
    """Track the patient until the sources end or ``stop`` is set, then write everything into ``results``, which exists.

    say: is given sentences for the user while it runs. Raises AnchorposeError where no source gives images, or the
    patient is not found before it ends.
    """
    intake = Intake(sources)
    about = next((source.about.folder for source in sources if source.about is not None), None)
    recorder = None if options.record is None else Recorder(options.record, intake.cameras, about)
    if recorder is not None:
        intake.add(recorder.put)
    session = _Session(intake, about, Journal(begin_journal(results, f"live {time.time_ns()}", {})), options, say, stop)
    try:
        with one_thread(), camera_threads(min(len(intake.cameras), os.cpu_count() or 1)):
            prepared, backlog = session.prepare()
            follower = session.begin(prepared, Outputs(outputs), with_labels=recorder is not None)
            session.follow(follower, backlog)
            intake.stop()
            session.write(results, follower, prepared, None if recorder is None else recorder.finish())
    finally:
        intake.stop()
        if recorder is not None and not recorder.finished:
            recorder.finish()
        end_journal(results)
    return follower.latency.summary()


@dataclass(frozen=True, slots=True, eq=False)
class _Session:
    """The phases in their order; about: a recording folder whose equipment and empty room hold, None without one."""

    intake: Intake
    about: Path | None
    journal: Journal
    options: LiveOptions
    say: Say
    stop: Event

    def prepare(self) -> tuple[Prepared, Backlog]:
        """The first seconds in which a patient is found, and what the cameras see from then on."""
        self.intake.start()
        for attempt in count(1):
            recording = self._record(attempt)
            backlog = Backlog(self.intake.feed, recording.cameras)
            found = self._learn(recording)
            if found is not None:
                return found, backlog
            backlog.drop()
            self.say("No patient was found in these seconds; looking again.")
        raise AssertionError("counting does not end")

    def begin(self, prepared: Prepared, outputs: Outputs, with_labels: bool) -> LiveFollower:
        """Follows the patient from a good frame of the first seconds to their end."""
        room, learnt = prepared.run.room, prepared.learnt
        initial = _latest_good(room.initial_frames)
        body = build_body(body_points(), learnt.shape)
        run = replace(prepared.run, config=self.options.live_config)
        blocks: Blocks[TrackedFrame] = Blocks(self.journal.inside("frames"))
        follower = LiveFollower(run, body, Follower(run, initial.choice, learnt.shape), outputs, blocks, with_labels)
        for position in range(initial.frame, len(room.recording.streams[0].files)):
            follower.take_recorded(read_frame(room.recording, position))
        return follower

    def follow(self, follower: LiveFollower, backlog: Backlog) -> None:
        """Catches up with what was seen meanwhile, then tracks every newest frame until the end."""
        while not self.stop.is_set() and (waiting := backlog.take()) is not None:
            follower.take(waiting, live=False)
        self.say("Tracking live.")
        began_s = reported_s = time.monotonic()
        until_s = np.inf if self.options.seconds is None else began_s + self.options.seconds
        while not self.stop.is_set() and time.monotonic() < until_s:
            found = self.intake.feed.take(PATIENCE_S)
            if found is not None:
                follower.take(found, live=True)
            elif not self.intake.running:
                break
            if time.monotonic() - reported_s > REPORT_S:
                reported_s = time.monotonic()
                self._report(follower)
        follower.finish()

    def write(self, results: Path, follower: LiveFollower, prepared: Prepared, recorded: Path | None) -> None:
        """The results folder; pictures show the frames that were recorded."""
        room = prepared.run.room
        if recorded is not None:
            whole = align_clocks(open_recording(recorded), room.clocks.clocks)
            room = replace(room, recording=replace(whole, cameras=room.recording.cameras))
        notes = (f"tracked live: {follower.latency.summary().sentence}", *follower.outputs.failed, *self.intake.failed)
        run = replace(follower.run, room=replace(room, notes=(*room.notes, *notes)))
        self.say("Writing the results.")
        write_results(results, follower.blocks.read(), run, prepared.learnt, prepared.inputs)

    def _record(self, attempt: int) -> Recording:
        """The first seconds as a recording."""
        folder = self.journal.folder / f"start-{attempt}"
        recorder = Recorder(folder, self.intake.cameras, self.about)
        self.intake.add(recorder.put)
        self.say(f"Looking at the room and the patient for {self.options.start_s:.0f} s.")
        try:
            self._wait(FIRST_WAIT_S, until=lambda: recorder.images > 0)
            self._wait(self.options.start_s, until=lambda: False)
        finally:
            self.intake.remove(recorder.put)
            recorder.abandon()
        if recorder.images == 0:
            why = " ".join(self.intake.failed) or "no camera gives depth images."
            raise AnchorposeError(f"Nothing can be tracked: {why}")
        return open_recording(recorder.finish())

    def _wait(self, seconds: float, until: Callable[[], bool]) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and self.intake.running and not until():
            if self.stop.wait(0.02):
                raise AnchorposeError("Stopped before a patient was found; nothing was written.")

    def _learn(self, recording: Recording) -> Prepared | None:
        """What the first seconds show; None where nobody is found in them. Raises where no more images come."""
        config = self.options.config
        inputs = read_inputs(recording.folder, config, UserInputs(self.options.calibration))
        room = prepare_room(inputs.recording, config, inputs.review)
        motions = load_motions(config.motion_file, room.recording.rate_hz, config.motion)
        run = Run(room, config, motions)
        learnt = learn_patient(run, plan_route(room, config, lambda: None).stretches()) if room.initial_frames else None
        if learnt is not None and (room.recording.subject.height_m or is_human(learnt.shape)):
            self.say(f"The patient was found: who {room.initial_frames[0].choice.reason}.")
            return Prepared(inputs, run, learnt)
        if not self.intake.running or self.stop.is_set():
            raise AnchorposeError(f"No patient was found ({room.why_nobody}); nothing was written.")
        return None

    def _report(self, follower: LiveFollower) -> None:
        silent = [self.intake.cameras[k].camera.name for k in self.intake.feed.silent()]
        self.say(f"{follower.latency.summary().sentence}.")
        if silent:
            self.say(f"No images come from {' and '.join(silent)}: check the cable.")


def _latest_good(frames: Sequence[InitialFrame]) -> InitialFrame:
    """The latest of those that show the patient nearly as well as the best."""
    best = max(one.score for one in frames)
    return max((one for one in frames if one.score >= NEARLY_AS_GOOD * best), key=lambda one: one.frame)
