"""Record all cameras: the empty room first, then every image until the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.live.feed import REPORT_S, Intake, LiveImage, LiveSource, about_folder
from anchorpose.live.markers import MarkerInlet
from anchorpose.live.recorder import Recorder
from anchorpose.recording.writable import check_place

ROOM_IMAGES: Final = 60  # number of images of the empty room per camera; more images do not improve the median


def record_live(
    sources: Sequence[LiveSource],
    out: Path,
    seconds: float | None,
    empty_room_s: float,
    say: Callable[[str], None],
    stop: Event,
    markers: str | None = None,
) -> Path:
    """Record all sources into ``out`` until they end, ``stop`` is set or ``seconds`` have passed.

    empty_room_s: seconds for which the empty room is recorded first; 0: it is not recorded. markers: name of the Lab
    Streaming Layer stream whose markers are recorded, None for no stream. Failures of cameras become notes of the
    recording. Raises AnchorposeError if no camera gives an image, or if the marker stream is not found.
    """
    about = about_folder(sources)
    check_place(out, about)
    inlet = None if markers is None else MarkerInlet(markers)
    intake = Intake(sources)
    recorder = Recorder(out, intake.cameras, about)
    try:
        if inlet is not None:
            inlet.start(recorder.mark)
        if empty_room_s > 0.0:
            intake.start()
            _record_empty_room(intake, recorder, empty_room_s, say, stop)
        intake.add(recorder.put)
        intake.start()
        say("Recording. Stop with Ctrl+C.")
        said = _wait(intake, recorder, seconds, say, stop)
    finally:
        intake.stop()
        if inlet is not None:
            inlet.stop()
        recorder.abandon()
    for sentence in intake.failed[said:]:
        say(sentence)
    if recorder.images == 0:
        raise AnchorposeError("No camera gave a depth image; check the cables.")
    return recorder.finish(intake.failed)


def _wait(intake: Intake, recorder: Recorder, seconds: float | None, say: Callable[[str], None], stop: Event) -> int:
    """Wait for the end of the recording, and report its progress and failures to the user. The recording also ends when
    ``recorder`` gets no more images, because it refused an image, for example on a nearly full disk. Return the number
    of failures that were reported.
    """
    said = 0
    began_s = reported_s = time.monotonic()
    until_s = np.inf if seconds is None else began_s + seconds
    while intake.running and intake.has(recorder.put) and time.monotonic() < until_s and not stop.wait(0.05):
        for sentence in intake.failures[said:]:
            say(sentence)
            said += 1
        if time.monotonic() - reported_s > REPORT_S:
            reported_s = time.monotonic()
            say(f"{recorder.images} depth images in {reported_s - began_s:.0f} s.")
            for camera in intake.feed.silent():
                say(f"No images come from {intake.cameras[camera].camera.name}: check the cable.")
    return said


def _record_empty_room(
    intake: Intake, recorder: Recorder, seconds: float, say: Callable[[str], None], stop: Event
) -> None:
    """Record the empty room as each camera's median depth image. A pixel of the median has no reading if most images
    have no reading there.
    """
    seen: list[list[np.ndarray]] = [[] for _ in intake.cameras]

    def keep(image: LiveImage) -> None:
        if len(seen[image.camera]) < ROOM_IMAGES:
            seen[image.camera].append(image.grey)

    say(f"Leave the room: it is recorded for {seconds:.0f} s.")
    intake.add(keep)
    end_s = time.monotonic() + seconds
    while intake.running and time.monotonic() < end_s and not stop.wait(0.05):
        pass
    intake.remove(keep)
    for camera, images in enumerate(seen):
        if images:
            recorder.write_empty_room(camera, median_reading(np.stack(images)))
    say("The empty room is recorded; come in.")


def median_reading(grey: np.ndarray) -> np.ndarray:
    """Return the median (height, width) uint16 of images (n, height, width) uint16. Each pixel has the median of its
    readings, or 0 if most of the images have no reading there.
    """
    ordered = np.sort(grey, axis=0)  # a missing reading is 0, so it comes first
    empty = (grey == 0).sum(axis=0)
    middle = np.minimum((empty + len(grey)) // 2, len(grey) - 1)
    found = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(2 * empty <= len(grey), found, 0).astype(np.uint16)
