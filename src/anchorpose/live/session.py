"""Track live cameras: analyse the first seconds, learn the body, catch up with the images taken meanwhile, follow every
newest frame, and write results.

The first seconds are recorded and analysed like any recording. Images that arrived during this analysis are then
tracked at a few frames per second, so that the patient is followed without a break. From then on every newest frame is
tracked, and images that arrive during its processing are dropped. If the user chooses another person as the patient,
the same phases follow for this person; only the room is known already.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.skin_points import body_points, build_body
from anchorpose.camera import places_of
from anchorpose.errors import AnchorposeError
from anchorpose.live.feed import REPORT_S, Intake, LiveSource, about_folder
from anchorpose.live.first_seconds import (
    PATIENCE_S,
    Backlog,
    FirstSeconds,
    LiveOptions,
    Prepared,
    User,
    in_room,
    latest_good,
)
from anchorpose.live.follow import LatencyMeter, LiveFollower
from anchorpose.live.markers import MarkerInlet
from anchorpose.live.output import Output, Outputs, people_in
from anchorpose.live.recorder import Recorder
from anchorpose.live.stored import SessionStore, write_patients
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.results.unfinished import end_journal
from anchorpose.threads import one_thread, worker_threads
from anchorpose.tracker.following import Follower

MOST_THREADS: Final = 4  # maximum number of threads that track; more threads would wait for Python's global lock


def track_live(
    sources: Sequence[LiveSource], results: Path, options: LiveOptions, outputs: Sequence[Output], user: User
) -> LatencyMeter:
    """Track the patient until the sources end or the user stops the session, then write everything into the existing
    folder ``results``.

    Raises AnchorposeError if no source delivers images, or the patient is not found before the end.
    """
    intake = Intake(sources)
    about = about_folder(sources)
    inlet = None if options.markers is None else MarkerInlet(options.markers)
    recorder = None if options.record is None else Recorder(options.record, intake.cameras, about)
    if recorder is not None:
        intake.add(recorder.put)
        user.keep_markers(recorder.mark)
        if inlet is not None:
            inlet.start(recorder.mark)
    store = SessionStore(results, options)
    first_seconds = FirstSeconds(intake, about, store.first_seconds, options, user)
    session = _Session(intake, first_seconds, store, options, Outputs(outputs), user)
    try:
        with one_thread(), worker_threads(min(MOST_THREADS, os.cpu_count() or 1)):
            prepared, backlog = session.prepare()
            followers = session.follow(session.begin(prepared), backlog)
            session.outputs.close()
            intake.stop()
            _stop(inlet)
            session.write(results, followers, recorder)
    except BaseException as error:
        store.end_early(str(error) if isinstance(error, Exception) else "it was stopped")
        raise
    finally:
        intake.stop()
        _stop(inlet)
        _finish(recorder, intake)
    end_journal(results)
    return session.latency


def _stop(inlet: MarkerInlet | None) -> None:
    if inlet is not None:
        inlet.stop()


def _finish(recorder: Recorder | None, intake: Intake) -> Path | None:
    """Finish the recording, with notes on failures, and return its folder. Return None without a recording, or if the
    recording cannot be finished; then ``intake.failures`` gets a sentence with the reason.
    """
    try:
        return None if recorder is None else recorder.finish(intake.failed)
    except (AnchorposeError, OSError) as error:
        remedy = "'anchorpose record --finish' completes it"
        intake.failures.append(f"the recording of the depth images is not finished ({error}): {remedy}")
        return None


@dataclass(frozen=True, slots=True, eq=False)
class _Session:
    """A live session; its methods are the phases of the session in their order."""

    intake: Intake
    first_seconds: FirstSeconds
    store: SessionStore
    options: LiveOptions
    outputs: Outputs
    user: User
    latency: LatencyMeter = field(default_factory=LatencyMeter)

    def prepare(self) -> tuple[Prepared, Backlog]:
        """Record first seconds, and repeat this until a patient is found in them. Return the room and the patient's
        body as learnt from these seconds, and the images that came after them.
        """
        self.intake.start()
        for attempt in count(1):
            recording = self.first_seconds.record(f"start-{attempt}", "the room and the patient")
            # a camera that was covered during the first seconds is not used later, since the learnt room does not
            # include this camera
            self.intake.feed.use(places_of(recording.cameras, [one.camera for one in self.intake.cameras]))
            backlog = Backlog(self.intake.feed, recording.cameras)
            found = self.first_seconds.learn(recording)
            if found is not None:
                return found, backlog
            backlog.drop()
            self.user.say("No patient was found in these seconds; looking again.")
        raise AssertionError("counting does not end")

    def begin(self, prepared: Prepared) -> LiveFollower:
        """Begin to follow a patient: track the first seconds, beginning with a frame that shows the patient well."""
        room, learnt = prepared.run.room, prepared.learnt
        initial = latest_good(room.initial_frames)
        body = build_body(body_points(), learnt.shape)
        run = replace(prepared.run, config=self.options.live(prepared.run.config))
        patient = self.store.add(replace(prepared, run=run))
        labels, found = self.options.record is not None, Follower(run, initial.choice, learnt.shape)
        follower = LiveFollower(patient, body, found, self.outputs, labels, self.latency)
        _take_recorded(follower, room.recording, initial.frame)
        follower.store()
        return follower

    def follow(self, first: LiveFollower, backlog: Backlog) -> list[LiveFollower]:
        """Track every newest frame until the end; return the followers of all patients, in order."""
        followers = [first]
        self._catch_up(first, backlog)
        began_s = reported_s = time.monotonic()
        until_s = np.inf if self.options.seconds is None else began_s + self.options.seconds
        while not self.user.stop.is_set() and time.monotonic() < until_s:
            if (number := self.user.asked()) is not None and (new := self._change_patient(followers[-1], number)):
                followers.append(new)
            found = self.intake.feed.take(PATIENCE_S)
            if found is not None:
                followers[-1].take(found, live=True)
            elif not self.intake.running:
                break
            if time.monotonic() - reported_s > REPORT_S:
                reported_s = time.monotonic()
                self._report()
        followers[-1].finish()
        return followers

    def write(self, results: Path, followers: Sequence[LiveFollower], recorder: Recorder | None) -> None:
        """Write the results of all patients, with notes on the session's latency and failures."""
        self.user.say("Writing the results.")
        recorded = _finish(recorder, self.intake)
        notes = (f"tracked live: {self.latency.sentence}", *self.outputs.failed, *self.intake.failed)
        write_patients(results, [one.patient for one in followers], recorded, notes)

    def _catch_up(self, follower: LiveFollower, backlog: Backlog) -> None:
        """Track the images that arrived while the first seconds were analysed."""
        while not self.user.stop.is_set() and (waiting := backlog.take()) is not None:
            follower.take(waiting, live=False)
        backlog.drop()
        self.user.say("Tracking live.")

    def _change_patient(self, before: LiveFollower, number: int) -> LiveFollower | None:
        """Make the person with this number the new patient: record this person's first seconds, learn the person's body
        from them, and return the follower of the new patient. If this fails, return None; the present patient is then
        still followed.
        """
        room, patient = before.patient.run.room, before.patient.number + 1
        places = {one.number: one.place_xz_m for one in people_in(before.follower.memory)}
        try:
            if number not in places:
                raise AnchorposeError(f"Person {number} is not in view now.")
            recording = self.first_seconds.record(f"patient-{patient}-{time.time_ns()}", "the new patient")
            recorded = in_room(recording.folder, room)
        except AnchorposeError:
            self.user.say("The new patient could not be looked at; the patient is as before.")
            return None
        backlog = Backlog(self.intake.feed, recorded.cameras)
        prepared = None
        try:
            prepared = self.first_seconds.learn_named(recording, room, places[number], before.patient_xz_m)
        except AnchorposeError as error:  # the session continues
            self.user.say(str(error))
        if prepared is None:
            self.user.say(
                "That person cannot be distinguished from the patient, or no body fits them; the patient is as before."
            )
            _take_recorded(before, recorded, 0)
            self._catch_up(before, backlog)
            return None
        before.finish()
        new = self.begin(prepared)
        self._catch_up(new, backlog)
        return new

    def _report(self) -> None:
        silent = [self.intake.cameras[k].camera.name for k in self.intake.feed.silent()]
        self.user.say(f"{self.latency.sentence}.")
        for sentence in self.intake.failed:
            self.user.say(f"{sentence.removesuffix('.')}.")
        if silent:
            self.user.say(f"No images come from {' and '.join(silent)}: check the cable.")


def _take_recorded(follower: LiveFollower, recording: Recording, first: int) -> None:
    """Track the recorded first seconds from the frame at position ``first`` on."""
    for position in range(first, len(recording.streams[0].files)):
        follower.take_recorded(read_frame(recording, position))
