"""From cameras that run to joints at once: look around, learn the body, catch up, follow; a results folder at the end.

The first seconds are recorded, and everything that tracking needs to know beforehand is found in them as in any
recording. What the cameras see meanwhile is tracked at a few frames a second, so that the patient is never out of
sight; from then on every newest frame is tracked, and what comes while one is worked on is dropped. Where another
person is made the patient, the same begins again for that person, in the room that is known by now.
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
from anchorpose.errors import AnchorposeError
from anchorpose.live.backlog import Backlog
from anchorpose.live.first_seconds import FirstSeconds, LiveOptions, Prepared, User, in_room
from anchorpose.live.follow import LiveFollower
from anchorpose.live.intake import Intake
from anchorpose.live.latency import LatencyMeter, LatencySummary
from anchorpose.live.output import Output, Outputs
from anchorpose.live.people import people_in
from anchorpose.live.recorder import Recorder
from anchorpose.live.source import LiveSource
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.results.unfinished import begin_journal, end_journal
from anchorpose.threads import one_thread, worker_threads
from anchorpose.tracker.following import Follower
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.journal import Blocks, Journal
from anchorpose.tracker.room import InitialFrame
from anchorpose.writing import write_results

PATIENCE_S: Final = 0.5
REPORT_S: Final = 10.0  # between two lines about latency
MOST_THREADS: Final = 4  # more would wait for Python's lock
NEARLY_AS_GOOD: Final = 0.5  # of the best score: a later frame to begin with saves waiting


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A person who is or was the patient."""

    prepared: Prepared
    follower: LiveFollower


def track_live(
    sources: Sequence[LiveSource], results: Path, options: LiveOptions, outputs: Sequence[Output], user: User
) -> LatencySummary:
    """Track the patient until the sources end or the user stops it, then write everything into ``results``, which
    exists.

    Raises AnchorposeError where no source gives images, or the patient is not found before it ends.
    """
    intake = Intake(sources)
    about = next((source.about.folder for source in sources if source.about is not None), None)
    recorder = None if options.record is None else Recorder(options.record, intake.cameras, about)
    if recorder is not None:
        intake.add(recorder.put)
    journal = Journal(begin_journal(results, f"live {time.time_ns()}", {}))
    first_seconds = FirstSeconds(intake, about, journal.folder, options, user)
    session = _Session(intake, first_seconds, journal, options, Outputs(outputs), user)
    try:
        with one_thread(), worker_threads(min(MOST_THREADS, os.cpu_count() or 1)):
            prepared, backlog = session.prepare()
            patients = session.follow(session.begin(prepared), backlog)
            session.outputs.close()
            intake.stop()
            session.write(results, patients, None if recorder is None else recorder.finish())
    finally:
        intake.stop()
        if recorder is not None and not recorder.finished:
            recorder.finish()
        end_journal(results)
    return session.latency.summary()


@dataclass(frozen=True, slots=True, eq=False)
class _Session:
    """The phases in their order."""

    intake: Intake
    first_seconds: FirstSeconds
    journal: Journal
    options: LiveOptions
    outputs: Outputs
    user: User
    latency: LatencyMeter = field(default_factory=LatencyMeter)

    def prepare(self) -> tuple[Prepared, Backlog]:
        """The first seconds in which a patient is found, and what the cameras see from then on."""
        self.intake.start()
        for attempt in count(1):
            recording = self.first_seconds.record(f"start-{attempt}", "the room and the patient")
            backlog = Backlog(self.intake.feed, recording.cameras)
            found = self.first_seconds.learn(recording)
            if found is not None:
                return found, backlog
            backlog.drop()
            self.user.say("No patient was found in these seconds; looking again.")
        raise AssertionError("counting does not end")

    def begin(self, prepared: Prepared, patient: int = 1) -> Followed:
        """Follows the patient from a good frame of the first seconds to their end; patient: number in the session."""
        room, learnt = prepared.run.room, prepared.learnt
        initial = _latest_good(room.initial_frames)
        body = build_body(body_points(), learnt.shape)
        config = replace(prepared.run.config, follow=self.options.live_config.follow)
        run = replace(prepared.run, config=config)
        blocks: Blocks[TrackedFrame] = Blocks(self.journal.inside(f"frames-{patient}"), TrackedFrame)
        labels, found = self.options.record is not None, Follower(run, initial.choice, learnt.shape)
        follower = LiveFollower(run, body, found, self.outputs, blocks, labels, self.latency, patient)
        _take_recorded(follower, room.recording, initial.frame)
        return Followed(prepared, follower)

    def follow(self, first: Followed, backlog: Backlog) -> list[Followed]:
        """Tracks every newest frame until the end; returns everybody who was the patient, in order."""
        patients = [first]
        self._catch_up(first.follower, backlog)
        began_s = reported_s = time.monotonic()
        until_s = np.inf if self.options.seconds is None else began_s + self.options.seconds
        while not self.user.stop.is_set() and time.monotonic() < until_s:
            if (number := self.user.asked()) is not None and (new := self._change_patient(patients[-1], number)):
                patients.append(new)
            follower = patients[-1].follower
            found = self.intake.feed.take(PATIENCE_S)
            if found is not None:
                follower.take(found, live=True)
            elif not self.intake.running:
                break
            if time.monotonic() - reported_s > REPORT_S:
                reported_s = time.monotonic()
                self._report()
        patients[-1].follower.finish()
        return patients

    def write(self, results: Path, patients: Sequence[Followed], recorded: Path | None) -> None:
        """The last patient's results, and those of each earlier one in a folder of their own inside."""
        self.user.say("Writing the results.")
        *earlier, last = patients
        notes = list[str]()
        for one, following in zip(earlier, patients[1:], strict=True):
            folder, frame = f"earlier-patient-{one.follower.patient}", following.follower.first_frame
            (results / folder).mkdir()
            self._write(results / folder, one, recorded, [f"from frame {frame} on, another person was the patient"])
            notes.append(f"until frame {frame}, another person was the patient: the results are in {folder}")
        if earlier:
            notes.append("who is the patient now was chosen on the page; nothing was stated of this person")
        self._write(results, last, recorded, notes)

    def _write(self, results: Path, patient: Followed, recorded: Path | None, notes: Sequence[str]) -> None:
        """Pictures show the frames that were recorded."""
        run = patient.follower.run
        room = run.room if recorded is None else replace(run.room, recording=in_room(recorded, run.room))
        session = (f"tracked live: {self.latency.summary().sentence}", *self.outputs.failed, *self.intake.failed)
        run = replace(run, room=replace(room, notes=(*room.notes, *notes, *session)))
        write_results(results, patient.follower.blocks.read(), run, patient.prepared.learnt, patient.prepared.inputs)

    def _catch_up(self, follower: LiveFollower, backlog: Backlog) -> None:
        """Tracks what was seen meanwhile."""
        while not self.user.stop.is_set() and (waiting := backlog.take()) is not None:
            follower.take(waiting, live=False)
        backlog.drop()
        self.user.say("Tracking live.")

    def _change_patient(self, now: Followed, number: int) -> Followed | None:
        """The person with a number, learnt in new first seconds; None where that fails: all is as before then."""
        before, patient = now.follower, now.follower.patient + 1
        places = {one.number: one.place_xz_m for one in people_in(before.follower.memory)}
        try:
            if number not in places:
                raise AnchorposeError(f"Person {number} is not in view now.")
            recording = self.first_seconds.record(f"patient-{patient}-{time.time_ns()}", "the new patient")
        except AnchorposeError:
            self.user.say("The new patient could not be looked at; the patient is as before.")
            return None
        backlog = Backlog(self.intake.feed, recording.cameras)
        prepared = self._learn(recording, now, places[number])
        if prepared is None:
            self.user.say(
                "That person cannot be told from the patient, or no body fits them; the patient is as before."
            )
            _take_recorded(before, in_room(recording.folder, now.prepared.run.room), 0)
            self._catch_up(before, backlog)
            return None
        before.finish()
        new = self.begin(prepared, patient)
        self._catch_up(new.follower, backlog)
        return new

    def _learn(self, recording: Recording, now: Followed, place_xz_m: tuple[float, float]) -> Prepared | None:
        """Who is at a place; None also where looking there fails, so that the session goes on."""
        room, before_xz_m = now.prepared.run.room, now.follower.patient_xz_m
        try:
            return self.first_seconds.learn_named(recording, room, place_xz_m, before_xz_m)
        except AnchorposeError as error:
            self.user.say(str(error))
            return None

    def _report(self) -> None:
        silent = [self.intake.cameras[k].camera.name for k in self.intake.feed.silent()]
        self.user.say(f"{self.latency.summary().sentence}.")
        if silent:
            self.user.say(f"No images come from {' and '.join(silent)}: check the cable.")


def _take_recorded(follower: LiveFollower, recording: Recording, first: int) -> None:
    """The frames of first seconds, from one on (a position)."""
    for position in range(first, len(recording.streams[0].files)):
        follower.take_recorded(read_frame(recording, position))


def _latest_good(frames: Sequence[InitialFrame]) -> InitialFrame:
    """The latest of those that show the patient nearly as well as the best."""
    best = max(one.score for one in frames)
    return max((one for one in frames if one.score >= NEARLY_AS_GOOD * best), key=lambda one: one.frame)
