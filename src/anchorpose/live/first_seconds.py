"""Record a patient for some seconds, and compute from these first seconds everything that tracking needs.

For the first patient of a session, the room is learnt, too; for later patients, the room is already known.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import Final

import numpy as np

from anchorpose.camera import Camera, places_of
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.live.feed import Feed, Intake, LiveImage, LiveSet
from anchorpose.live.markers import TakeMarker
from anchorpose.live.recorder import Recorder
from anchorpose.motion.prediction import load_motions
from anchorpose.recording.depth_image import decode_grey_png
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import UNKNOWN, Recording, align_clocks
from anchorpose.sources.plan import encode_grey
from anchorpose.track_inputs import TrackInputs, UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.initial_frame import with_best_initial_frame
from anchorpose.tracker.learning_pass import LearntPatient, learn_patient
from anchorpose.tracker.passes import plan_route
from anchorpose.tracker.preparation import Settled, furnish_room, prepare_room, sample_recording
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.room import InitialFrame, Room, Run

FIRST_WAIT_S: Final = 10.0  # s, maximum waiting time for the first image of a source
# Minimum score of the initial frame, in which tracking begins, as a share of the best frame's score. With a lower
# minimum score, a later initial frame is permitted, so fewer recorded frames must be tracked before live tracking
# begins.
NEARLY_AS_GOOD: Final = 0.5

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """Options of a live session. config: settings of tracking; wait_frames: number of later frames that are awaited
    before the pose in a frame is reported; start_s: duration of the recording from which the body is learnt;
    calibration: a file of camera poses; record: a folder for all depth images; seconds: duration of tracking, None to
    track until the user stops it; markers: name of the stream of the Lab Streaming Layer whose markers are kept in
    ``record``.
    """

    config: TrackConfig
    wait_frames: int = 0
    start_s: float = 6.0
    calibration: Path | None = None
    record: Path | None = None
    seconds: float | None = None
    markers: str | None = None

    def live(self, config: TrackConfig) -> TrackConfig:
        """Return ``config``, changed so that tracking reports a frame only after ``wait_frames`` later frames."""
        return replace(config, follow=replace(config.follow, look_ahead=1 + self.wait_frames))


@dataclass(frozen=True, slots=True, eq=False)
class User:
    """The user's connections to a running session. say: function that shows a sentence to the user; stop: event that
    ends the session; asked: function that returns the number (``PersonInView``) of the person whom the user chose as
    the new patient, once per choice, else None; keep_markers: function that is called if the session is recorded; its
    argument is a function that stores a marker of the user in the recording.
    """

    say: Say
    stop: Event
    asked: Callable[[], int | None] = lambda: None
    keep_markers: Callable[[TakeMarker], object] = lambda take: None


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """The result of analysing the first seconds. run: the room in which the patient was found, and the settings of
    tracking; learnt: the patient's body.
    """

    inputs: TrackInputs
    run: Run
    learnt: LearntPatient


@dataclass(frozen=True, slots=True, eq=False)
class FirstSeconds:
    """Recorder of a patient's first seconds, from which the room and the patient's body are learnt. about: a recording
    folder whose equipment and empty room apply to these cameras, None without such a recording; folder: folder for the
    recordings of first seconds.
    """

    intake: Intake
    about: Path | None
    folder: Path
    options: LiveOptions
    user: User

    def record(self, name: str, whom: str) -> Recording:
        """Record the next ``start_s`` seconds (``LiveOptions``) into a new recording called ``name``. whom: words that
        stand for the recorded person in messages to the user.

        Raises AnchorposeError if the recording cannot be made.
        """
        folder = self.folder / name
        recorder = Recorder(folder, self.intake.cameras, self.about)
        self.intake.add(recorder.put)
        self.user.say(f"Looking at {whom} for {self.options.start_s:.0f} s.")
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
            if self.user.stop.wait(0.02):
                raise AnchorposeError("Stopped before a patient was found; nothing was written.")

    def learn(self, recording: Recording) -> Prepared | None:
        """Learn the room and the patient's body from the first seconds; None if no patient is found. Raises
        AnchorposeError if no patient is found and no further seconds can be recorded.
        """
        inputs, room = new_room(recording, self.options)
        found = self._learn_in(room, inputs)
        if found is None and (not self.intake.running or self.user.stop.is_set()):
            raise AnchorposeError(f"No patient was found ({room.why_nobody}); nothing was written.")
        return found

    def learn_named(
        self, recording: Recording, room: Room, place_xz_m: tuple[float, float], before_xz_m: np.ndarray | None
    ) -> Prepared | None:
        """Learn, in a known room, the body of the person who is nearest to ``place_xz_m`` in the first frame in which
        any person stands at this place.

        before_xz_m (2,): where the present patient stands, None if unknown. Return None if no person stands at
        ``place_xz_m``, if the person found at this place is nearer to ``before_xz_m`` than to the place (probably the
        present patient), or if the learnt body does not have a human's height.
        """
        inputs, furnished = known_room(recording, self.options, room, place_xz_m)
        if not furnished.initial_frames:
            return None
        found_xz_m = min(furnished.initial_frames, key=lambda one: one.frame).choice.ground_xz_m
        if before_xz_m is not None and np.linalg.norm(found_xz_m - before_xz_m) < np.linalg.norm(
            found_xz_m - place_xz_m
        ):
            return None
        return self._learn_in(furnished, inputs)

    def _learn_in(self, room: Room, inputs: TrackInputs) -> Prepared | None:
        """Learn the body of the room's patient, and report to the user which person was found. Return None if no
        patient is found, or if the learnt body does not have a human's height and the user gave no height.
        """
        found = learn_in(room, inputs)
        if found is not None:
            self.user.say(f"The patient was found: who {room.initial_frames[0].choice.reason}.")
        return found


def learn_in(room: Room, inputs: TrackInputs) -> Prepared | None:
    """Learn the body of a room's patient. Return None if no patient is found, or if the learnt body does not have a
    human's height and the user gave no height.
    """
    config = inputs.config
    run = Run(room, config, load_motions(config.motion_file, room.recording.rate_hz, config.motion))
    learnt = learn_patient(run, plan_route(room, config, lambda: None).stretches()) if room.initial_frames else None
    if learnt is None or not (room.recording.subject.height_m or is_human(learnt.shape)):
        return None
    return Prepared(inputs, run.with_learnt(learnt.belief), learnt)


def latest_good(frames: Sequence[InitialFrame]) -> InitialFrame:
    """Return the latest frame whose score is at least ``NEARLY_AS_GOOD`` times the best frame's score."""
    best = max(one.score for one in frames)
    return max((one for one in frames if one.score >= NEARLY_AS_GOOD * best), key=lambda one: one.frame)


def new_room(recording: Recording, options: LiveOptions) -> tuple[TrackInputs, Room]:
    """Learn the room from the recording of the first patient's first seconds, and find this patient in it."""
    inputs = read_inputs(recording.folder, options.config, UserInputs(options.calibration))
    return inputs, prepare_room(inputs.recording, options.config, inputs.review)


def known_room(
    recording: Recording, options: LiveOptions, room: Room, place_xz_m: tuple[float, float]
) -> tuple[TrackInputs, Room]:
    """In a known room, find another patient, who stands at ``place_xz_m`` in the recording of their first seconds. If
    no person is found at this place, the returned room has no initial frames.
    """
    config = replace(options.config, patient_xz_m=place_xz_m, height_m=None)
    inputs = read_inputs(recording.folder, config, UserInputs(options.calibration))
    # ``subject`` of the room's recording describes the previous patient, so nothing is known about this patient
    theirs = replace(in_room(recording.folder, room), subject=UNKNOWN)
    chosen, samples = sample_recording(theirs, config)
    settled = Settled(theirs, room.clocks, room.calibration, tuple(chosen), tuple(samples))
    return inputs, with_best_initial_frame(furnish_room(settled, config, inputs.review, room.scenes), config)


def in_room(folder: Path, room: Room) -> Recording:
    """Open the recording in ``folder``. Its cameras with their poses, its clocks and its data about the patient are
    taken from ``room``. Raises InputError if the recording lacks a camera of the room.
    """
    found, known = open_recording(folder), room.recording
    names = [camera.name for camera in found.cameras]
    if missing := [camera.name for camera in known.cameras if camera.name not in names]:
        raise InputError(folder, f"has no usable image of camera {missing[0]}", "check its cable, and uncover its lens")
    recording = align_clocks(found.of_cameras(places_of(known.cameras, found.cameras)), room.clocks.clocks)
    notes = tuple(dict.fromkeys((*known.notes, *found.notes)))
    return replace(recording, cameras=known.cameras, subject=known.subject, notes=notes)


# s, minimum time between two image sets that ``Backlog`` collects; patients in a standing frame (a device that holds
# them upright) move little in this time
STEP_S: Final = 0.2
# s, maximum gap between tracked frames, since after a longer gap, another person may stand in the patient's place
MOST_STEP_S: Final = 1.0
# minimum speed at which collected sets are tracked, as a multiple of real time; above 1, the backlog shrinks
PACE: Final = 2.0
PATIENCE_S: Final = 0.5


class Backlog:
    """A thread that collects the image sets that arrive while the first seconds are analysed. The thread ends when
    every collected set has been taken, when ``drop`` is called, or when the feed ends.
    """

    def __init__(self, feed: Feed, cameras: Sequence[Camera]) -> None:
        self._feed, self._cameras = feed, cameras
        self._packed: deque[LiveSet] = deque()
        # for the last set: when its images were taken, and when ``take`` returned it
        self._last_s, self._taken_at_s = -np.inf, -np.inf
        self._done = Event()
        self._thread = Thread(target=self._collect, daemon=True)
        self._thread.start()

    def take(self) -> LiveSet | None:
        """Return the oldest waiting set. When no set waits, return None and stop collecting.

        If tracking is slow, some sets are left out so that the backlog shrinks: the next set is the first that is later
        than the previous set by at least a certain step, or the newest set if no set is so late. The step is ``PACE``
        times the time since the previous set was returned (in which it was tracked), but at most ``MOST_STEP_S``.
        """
        now_s = time.monotonic()
        spent_s = now_s - self._taken_at_s if np.isfinite(self._last_s) else 0.0
        next_s = self._last_s + min(PACE * spent_s, MOST_STEP_S)
        while len(self._packed) > 1 and self._packed[0].taken_s < next_s:
            self._packed.popleft()
        if not self._packed:
            self._done.set()
            self._thread.join()
        if not self._packed:
            return None
        packed = self._packed.popleft()
        self._last_s, self._taken_at_s = packed.taken_s, now_s
        return self._unpack(packed)

    def drop(self) -> None:
        """Stop collecting image sets, and discard those that ``take`` has not yet returned."""
        self._done.set()
        self._thread.join()
        self._packed.clear()

    def _collect(self) -> None:
        last_s = -np.inf
        while not self._done.is_set() and self._feed.is_open:
            found = self._feed.take(PATIENCE_S)
            if found is not None and found.taken_s - last_s >= STEP_S:
                self._packed.append(_pack(found))
                last_s = found.taken_s

    def _unpack(self, packed: LiveSet) -> LiveSet:
        images = (
            None if image is None else _with_grey(image, camera)
            for image, camera in zip(packed.images, self._cameras, strict=True)
        )
        return replace(packed, images=tuple(images))


def _with_grey(packed: LiveImage, camera: Camera) -> LiveImage | None:
    grey, _ = decode_grey_png(packed.grey.tobytes(), camera.width, camera.height)
    return None if grey is None else replace(packed, grey=grey)


def _pack(found: LiveSet) -> LiveSet:
    """Return the set with its images packed as PNG files."""
    packed = (
        None if image is None else replace(image, grey=np.frombuffer(encode_grey(image.grey), np.uint8))
        for image in found.images
    )
    return replace(found, images=tuple(packed))
