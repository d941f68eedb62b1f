"""Record the cameras' images so that a power cut loses at most the last second."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections import defaultdict, deque
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.live.feed import LiveImage
from anchorpose.live.markers import HEAD, MARKERS_FILE, MISSING, plain_text, write_events
from anchorpose.recording.document import read_document, read_json, read_text
from anchorpose.recording.equipment import equipment_files
from anchorpose.recording.recording import LEFT_OUT
from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument, read_timestamps
from anchorpose.recording.regular_file import LARGEST_IMAGE, open_regular, require_regular
from anchorpose.recording.writable import new_folder
from anchorpose.results.folder import naming_place, write_text_whole
from anchorpose.sources.plan import CameraPlan, CameraWriter, encode_grey

UNFINISHED_FILE: Final = "recording.unfinished.json"
"""Name of recording.json until the recording is finished."""

EMPTY_ROOM_FILE: Final = "background.png"
IMAGE_NAME: Final = re.compile(r"\d{6,}\.png")
# s, time between two flushes of new images and their times to the disk; a power cut can erase about this duration
SYNC_S: Final = 1.0
ROOM_EVERY: Final = 100  # number of images between two checks of the free disk space
# s, minimum change of a camera clock's offset between two images that is noted as a setting of this clock; images come
# 0.03 s apart
CLOCK_STEP_S: Final = 0.1
# number of newest images from which a camera clock's offset is computed; the disk may stall for 3 s, and up to this
# many successive images then come late
LATE_IMAGES: Final = 100
LEAST_FREE_BYTES: Final = 500_000_000  # minimum free disk space; the system and the results also need space


class Recorder:
    """A recorder that writes every image it gets; ``finish`` turns the folder into a recording."""

    def __init__(self, folder: Path, cameras: Sequence[CameraPlan], about: Path | None = None) -> None:
        """Prepare ``folder``, which must be absent or empty. about: a recording folder whose equipment, images of the
        empty room and patient are also valid for the new recording. Raises InputError if ``folder`` cannot be written.
        """
        self.folder, self._stack = folder, ExitStack()
        with new_folder(folder.resolve(), folder):
            if any(folder.iterdir()):
                remedy = "choose another name, or finish a recording that was cut off with 'anchorpose record --finish'"
                raise InputError(folder, "exists and is not empty", remedy)
        document = {"format": "rgbd-recording", "version": 1, "cameras": [camera.document() for camera in cameras]}
        self._writers = [self._stack.enter_context(CameraWriter(folder / one.camera.name, one)) for one in cameras]
        if about is not None:
            document |= _copy_about(about, folder)
        self._document: dict[str, Any] = document
        self._first_s: dict[int, tuple[float, float]] = {}  # time_s and taken_s of each camera's first image
        self._offset_s: dict[int, float] = {}  # time_s minus taken_s of each camera (``_follow_clock``)
        self._offsets_s: defaultdict[int, deque[float]] = defaultdict(lambda: deque(maxlen=LATE_IMAGES))
        self._step_s: dict[int, float] = {}  # largest step of each camera's clock that a note states
        # the camera whose first image begins the recording, and the time of this image; None until known
        self._began: tuple[int, float] | None = None
        self._waiting: list[tuple[str, float]] = []  # markers that came before the first image
        self._marking, self._describing = Lock(), Lock()
        self._write_document()
        self.images, self.finished = 0, False  # number of images written; whether ``finish`` has succeeded
        self._unsynced: list[Path] = []
        # a lock per camera, since each camera's thread writes images while another thread may end the recording
        self._writing = [Lock() for _ in cameras]
        self._done = Event()
        self._syncing = Thread(target=self._sync_often, daemon=True)
        self._syncing.start()

    def put(self, image: LiveImage) -> str | None:
        """Write an image; an image that comes after the end is ignored. Return the reason if the image cannot be
        written because of its time, else None. Raises AnchorposeError if less than half a gigabyte is free on the disk.
        """
        with naming_place(self.folder), self._writing[image.camera]:
            if self._done.is_set():
                return None
            self._first_s.setdefault(image.camera, (image.time_s, image.taken_s))
            step_s = self._follow_clock(image)
            if image.camera == 0 and self._began is None:
                self._begin(0)
            path = self._write(image, step_s)
        if path is None:
            return "their times are not later than those of the images before"
        self.images += 1
        self._unsynced.append(path)
        if self.images % ROOM_EVERY == 0 and shutil.disk_usage(self.folder).free < LEAST_FREE_BYTES:
            raise AnchorposeError(f"{self.folder}: the disk is nearly full; what was recorded is kept. Make room.")
        return None

    def _follow_clock(self, image: LiveImage) -> float:
        """Store the offset between a camera's clock and ``time.monotonic``; return its change since the previous image.

        If a busy computer receives an image late, this image gives too small an offset. So the camera's offset is the
        largest offset of its last ``LATE_IMAGES`` images.
        """
        offsets_s = self._offsets_s[image.camera]
        offsets_s.append(image.time_s - image.taken_s)
        offset_s = max(offsets_s)
        step_s = offset_s - self._offset_s.get(image.camera, offset_s)
        self._offset_s[image.camera] = offset_s
        return step_s

    def _write(self, image: LiveImage, step_s: float) -> Path | None:
        """Write an image into its camera's folder; if the camera restarted, or if the camera's clock was set by
        ``step_s``, also write a note. A step is noted only if it is larger than ``CLOCK_STEP_S`` and than all steps of
        this clock noted before.
        """
        writer = self._writers[image.camera]
        restarts = writer.restarts
        path = writer.write(image.time_s, image.grey, image.number)
        which = f"camera {writer.folder.name}"
        if writer.restarts > restarts:
            self._note(f"{which} restarted before image {writer.given - 1}: check its cable")
        if abs(step_s) > self._step_s.get(image.camera, CLOCK_STEP_S):
            self._step_s[image.camera] = abs(step_s)
            self._note(f"{which}: its clock was set by {step_s:+.1f} s before image {writer.given - 1}")
        return path

    def _note(self, sentence: str) -> None:
        """Add a note to the document of the recording; a sentence that the notes already contain is not repeated."""
        with self._describing:
            before = self._document.get("notes", [])
            self._document["notes"] = [*(note for note in before if note != sentence), sentence]
            self._write_document()

    def mark(self, text: str, at_s: float) -> None:
        """Write a marker that was sent at ``at_s``, by ``time.monotonic``. A marker that comes before the first image
        is written with this image, any other marker at once.
        """
        with naming_place(self.folder), self._marking:
            self._waiting.append((plain_text(text), at_s))
            self._write_markers()

    def _begin(self, camera: int) -> None:
        """Store when the first image of ``camera`` was taken, as the start of the recording, and write the markers that
        came before.
        """
        time_s, taken_s = self._first_s[camera]
        with self._describing:
            self._document["start"] = start_of(taken_s)
            self._write_document()
        with self._marking:
            self._began = camera, time_s
            self._write_markers()

    def _write_markers(self) -> None:
        """Write the waiting markers, with their times since the first image on the clock of the camera that began the
        recording. The clock's offset is taken from this camera's newest images, since the camera may use the computer's
        clock, which may be set during the recording.
        """
        if self._began is None or not self._waiting:
            return
        path = self.folder / MARKERS_FILE
        camera, first_s = self._began
        shift_s = self._offset_s[camera] - first_s
        rows = "".join(f"{at_s + shift_s:.4f}\t{MISSING}\t{text}\n" for text, at_s in self._waiting)
        self._waiting = []
        begun = path.exists()
        with path.open("a", encoding="utf-8", newline="\n") as file:
            file.write(rows if begun else f"{HEAD}\n{rows}")

    def write_empty_room(self, camera: int, grey: np.ndarray) -> None:
        """Write one camera's image of the empty room (height, width) uint16."""
        folder = self._writers[camera].folder
        partial = folder / ".background.partial"
        partial.write_bytes(encode_grey(grey))
        partial.replace(folder / EMPTY_ROOM_FILE)

    def finish(self, notes: Sequence[str] = ()) -> Path:
        """Complete the recording on disk, with these notes, and return its folder; may be called twice."""
        if self.finished:
            return self.folder
        self.abandon()
        with suppress(OSError):  # a full disk must not keep the images from becoming a recording
            for note in notes:
                self._note(note.removesuffix("."))
        if self._began is None and self._first_s:  # the first camera gave no image
            self._begin(min(self._first_s))
        self._sync()
        finish_recording(self.folder)
        self.finished = True
        return self.folder

    def abandon(self) -> None:
        """Stop writing after the images that are being written; the folder stays unfinished."""
        self._done.set()
        self._syncing.join()
        for camera in self._writing:
            with camera:
                pass
        self._stack.close()

    def _write_document(self) -> None:
        write_text_whole(self.folder / UNFINISHED_FILE, json.dumps(self._document, indent=1) + "\n")

    def _sync_often(self) -> None:
        while not self._done.wait(SYNC_S):
            with suppress(OSError):  # failed syncing is tried again after ``SYNC_S``, or at the end
                self._sync()

    def _sync(self) -> None:
        count = len(self._unsynced)
        for path in (*self._unsynced[:count], *(writer.folder / "timestamps.csv" for writer in self._writers)):
            with open_regular(path) as file:
                os.fsync(file.fileno())
        del self._unsynced[:count]  # images that were written during this sync are synced the next time


def start_of(taken_s: float) -> dict[str, Any]:
    """Return the entry of recording.json about the recording's start. taken_s: time of the first image, by
    ``time.monotonic``.

    The time on the clock of the Lab Streaming Layer is left out if pylsl is not installed.
    """
    ago_s = time.monotonic() - taken_s
    utc = datetime.now(UTC) - timedelta(seconds=ago_s)
    found: dict[str, Any] = {"utc": utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")}
    with suppress(ImportError, RuntimeError):  # RuntimeError: pylsl's library does not load on this system
        import pylsl

        found["lsl_s"] = round(pylsl.local_clock() - ago_s, 6)
    return found


def finish_recording(folder: Path) -> Path:
    """Turn a folder that ``Recorder`` has written into a recording; if the recorder was cut off, the recording has all
    complete images. A camera without an image is left out, with a note in recording.json.

    Raises InputError if ``folder`` was not written by ``Recorder``, or if no camera has an image.
    """
    path = folder / UNFINISHED_FILE
    if not path.is_file():
        problem = "is a finished recording" if (folder / RECORDING_FILE).is_file() else "holds no unfinished recording"
        raise InputError(folder, problem, "give a folder that 'anchorpose record' was writing when it was cut off")
    cameras = [entry.camera() for entry in read_document(path, RecordingDocument).cameras]
    kept = [camera.name for camera in cameras if _finish_camera(folder / camera.name, camera)]
    if not kept:
        raise InputError(folder / cameras[0].name, "holds no depth image", "record again with this camera")
    times_s = list(read_timestamps(folder / kept[0] / "timestamps.csv").values())
    write_events(folder, times_s[-1] - times_s[0])
    leave_out_cameras(path, kept)
    path.replace(folder / RECORDING_FILE)
    return folder


def _finish_camera(folder: Path, camera: Camera) -> bool:
    """Remove the images of a camera that are not complete because the recorder was cut off: images without a row in
    timestamps.csv, and damaged images at the end of its rows. Return whether the camera has complete images. Files that
    are not named like images belong to the user and stay.
    """
    if link := next((one for one in (folder, folder / "depth", folder / "timestamps.csv") if one.is_symlink()), None):
        raise InputError(link, "is a link", "put the target of the link there")
    with CameraWriter(folder, CameraPlan(camera=camera)) as writer:
        written = writer.written
    lines = read_text(folder / "timestamps.csv").split()[1:]
    known = {f"{int(line.partition(',')[0]):06d}.png" for line in lines}
    for file in (folder / "depth").iterdir():
        if file.name not in known and IMAGE_NAME.fullmatch(file.name):
            file.unlink()
    return written > 0


def leave_out_cameras(document: Path, kept: Sequence[str]) -> None:
    """Remove all cameras that ``kept`` does not name from a recording's document, and add a note on each removed
    camera.
    """
    found = read_json(document)
    gone = [camera["name"] for camera in found["cameras"] if camera["name"] not in kept]
    if not gone:
        return
    found["cameras"] = [camera for camera in found["cameras"] if camera["name"] in kept]
    notes = [f"camera {name} {LEFT_OUT}it gave no depth image" for name in gone]
    found["notes"] = [*found.get("notes", []), *notes]
    write_text_whole(document, json.dumps(found, indent=1) + "\n")


def _copy_about(about: Path, folder: Path) -> dict[str, Any]:
    """Copy equipment and empty rooms of a recording; return the entries of recording.json on equipment and patient."""
    found = read_json(about / RECORDING_FILE)
    if equipment := found.get("equipment"):
        copy_equipment(about / equipment, about, folder)
    for room in about.glob(f"*/{EMPTY_ROOM_FILE}"):
        if (folder / room.parent.name).is_dir():
            require_regular(room, LARGEST_IMAGE)
            shutil.copyfile(room, folder / room.parent.name / EMPTY_ROOM_FILE)
    return {key: found[key] for key in ("equipment", "subject") if found.get(key)}


def copy_equipment(file: Path, about: Path, folder: Path) -> None:
    """Copy an equipment.json that lies somewhere in ``about``, and its meshes, to the same relative paths in
    ``folder``.
    """
    for path in equipment_files(file):
        require_regular(path)
        target = folder / path.relative_to(about)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
