"""Recording what cameras see, after a picture of the empty room if asked."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.live.intake import Intake
from anchorpose.live.recorder import Recorder
from anchorpose.live.source import LiveImage, LiveSource, about_folder
from anchorpose.recording.writable import check_place

ROOM_IMAGES: Final = 60  # of each camera: the median of more is no better
REPORT_S: Final = 10.0


def record_live(
    sources: Sequence[LiveSource],
    out: Path,
    seconds: float | None,
    empty_room_s: float,
    say: Callable[[str], None],
    stop: Event,
) -> Path:
    """The finished recording ``out`` of all sources, until they end, ``stop`` is set or ``seconds`` have passed.

    empty_room_s: first the empty room is looked at for so long; 0: it is not. Raises AnchorposeError where no camera
    gives an image.
    """
    about = about_folder(sources)
    check_place(out, about)
    intake = Intake(sources)
    recorder = Recorder(out, intake.cameras, about)
    try:
        if empty_room_s > 0.0:
            intake.start()
            _record_empty_room(intake, recorder, empty_room_s, say, stop)
        intake.add(recorder.put)
        intake.start()
        say("Recording. Stop with Ctrl+C.")
        _wait(intake, recorder, seconds, say, stop)
    finally:
        intake.stop()
        recorder.abandon()
    for sentence in intake.failed:
        say(sentence)
    if recorder.images == 0:
        raise AnchorposeError("No camera gave a depth image; check the cables.")
    return recorder.finish()


def _wait(intake: Intake, recorder: Recorder, seconds: float | None, say: Callable[[str], None], stop: Event) -> None:
    began_s = reported_s = time.monotonic()
    until_s = np.inf if seconds is None else began_s + seconds
    while intake.running and time.monotonic() < until_s and not stop.wait(0.05):
        if time.monotonic() - reported_s > REPORT_S:
            reported_s = time.monotonic()
            say(f"{recorder.images} depth images in {reported_s - began_s:.0f} s.")
            for camera in intake.feed.silent():
                say(f"No images come from {intake.cameras[camera].camera.name}: check the cable.")


def _record_empty_room(
    intake: Intake, recorder: Recorder, seconds: float, say: Callable[[str], None], stop: Event
) -> None:
    """Each camera's median depth image, without pixels that have a reading in less than half of the images."""
    seen: list[list[np.ndarray]] = [[] for _ in intake.cameras]

    def keep(image: LiveImage) -> None:
        if len(seen[image.camera]) < ROOM_IMAGES:
            seen[image.camera].append(image.grey)

    say(f"Leave the room: it is looked at for {seconds:.0f} s.")
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
    """(height, width) uint16 of images (n, height, width) uint16: the median of the readings; 0 where less than half of
    the images have one."""
    ordered = np.sort(grey, axis=0)  # without a reading: 0, first
    empty = (grey == 0).sum(axis=0)
    middle = np.minimum((empty + len(grey)) // 2, len(grey) - 1)
    found = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(2 * empty <= len(grey), found, 0).astype(np.uint16)
