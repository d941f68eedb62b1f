"""Open a recording folder, read its frame sets (all cameras' depth images at one time), and list its files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.depth_image import largest_png, read_depth_image, read_stream_image
from anchorpose.recording.document import read_document
from anchorpose.recording.equipment import equipment_files, read_equipment
from anchorpose.recording.events import events_files
from anchorpose.recording.recording import LEFT_OUT, UNKNOWN, DepthStream, FolderFiles, FrameSet, Recording, pair_frames
from anchorpose.recording.recording_file import SHORTEST_STEP_S, RecordingDocument, find_duplicates, read_timestamps
from anchorpose.recording.regular_file import STAMP, is_there, list_file, reason

# maximum number of depth images per camera, spread over the recording, by which the reader tests whether the camera
# measured anything
LOOKED_AT: Final = 40


def open_recording(folder: Path) -> Recording:
    """Open and check a recording; only a few depth images per camera are decoded. A camera that measured nothing is
    left out, and the recording gets a note on it.

    Times come from timestamps.csv; where this file is absent, they are computed from ``fps`` and the numbers of the
    depth images. Raises InputError naming the file and the remedy. A damaged depth image is not an error here if the
    camera has usable images; ``read_frames`` reports it later.
    """
    if not folder.exists():
        raise InputError(folder, "there is no such folder", "check the path of the recording")
    if not folder.is_dir():
        raise InputError(folder, "is a file", "make a recording of it with 'anchorpose convert'")
    path = folder / "recording.json"
    if not is_there(path):
        raise InputError(path, "there is no such file", "give the folder of a recording, the one with recording.json")
    document = read_document(path, RecordingDocument)
    cameras = tuple(entry.camera() for entry in document.cameras)
    streams = tuple(
        _open_stream(folder / camera.name, entry.fps or document.fps, largest_png(camera.width, camera.height))
        for entry, camera in zip(document.cameras, cameras, strict=True)
    )
    for camera, stream in zip(cameras, streams, strict=True):
        _require_usable(camera, stream)
    recording = Recording(
        folder=folder,
        cameras=cameras,
        streams=streams,
        backgrounds_m=tuple(_read_background(folder, camera) for camera in cameras),
        equipment=read_equipment(folder / document.equipment) if document.equipment else None,
        subject=document.subject or UNKNOWN,
        notes=document.notes,
    )
    return _without_dead_cameras(recording)


def _without_dead_cameras(recording: Recording) -> Recording:
    """Return the recording without the cameras that never measured anything, and with a note on each of these cameras.

    A camera that never measured anything was blinded, covered or broken: its files are complete but hold no measurement
    (``content_problem``). Raises InputError if no camera is left.
    """
    dead = {number: why for number in range(len(recording.cameras)) if (why := _why_dead(recording, number))}
    if not dead:
        return recording
    alive = [number for number in range(len(recording.cameras)) if number not in dead]
    if not alive:
        remedy = "nothing was measured: uncover the lens, keep the sun out, and record again"
        raise InputError(recording.folder / recording.cameras[0].name / "depth", dead[0], remedy)
    notes = [f"camera {recording.cameras[number].name} {LEFT_OUT}{why}" for number, why in dead.items()]
    left_out_s = None
    if 0 in dead:
        gone, first = (recording.cameras[number].name for number in (0, alive[0]))
        notes.append(
            f"frames and times are those of camera {first}, the first that measured; onsets of trials count from the "
            f"first frame of camera {gone} by its recorded times, since its clock cannot be compared with other clocks"
        )
        left_out_s = (float(recording.streams[0].time_s[0]), float(recording.streams[0].time_s[-1]))
    return replace(recording.of_cameras(alive), notes=(*recording.notes, *notes), left_out_s=left_out_s)


def _why_dead(recording: Recording, camera: int) -> str:
    """Return why none of ``LOOKED_AT`` depth images of a camera can be used; empty if any image can be used."""
    count = len(recording.streams[camera].files)
    problem = ""
    for position in np.unique(np.linspace(0, count - 1, LOOKED_AT).astype(int)).tolist():
        image = read_stream_image(recording, camera, position)
        if not image.problem:
            return ""
        problem = problem or f"{recording.streams[camera].files[position].name} {image.problem}"
    return f"it measured nothing from first to last ({problem})"


def read_frames(recording: Recording, start: int = 0, stop: int | None = None) -> Iterator[FrameSet]:
    """Yield the frame sets ``start`` to ``stop`` (positions in the first camera's stream), decoded one at a time.

    Raises InputError, before the first set, if the recorded times of the cameras do not overlap or the range is empty.
    A damaged depth image becomes None, with a sentence in the set's ``problems``.
    """
    positions = frame_range(recording, start, stop)
    pairs = pair_frames(recording)
    return (_read_set(recording, pairs[position], position) for position in positions)


def read_frame(recording: Recording, position: int) -> FrameSet:
    """Read the frame set at one position in the first camera's stream; raises InputError if the cameras' recorded times
    do not overlap, or if the stream does not have this position.
    """
    return next(read_frames(recording, position, position + 1))


def frame_range(recording: Recording, start: int = 0, stop: int | None = None) -> range:
    """Return the positions ``start`` to ``stop`` in the first camera's stream; raises InputError for an empty range."""
    count = len(recording.streams[0].files)
    stop = count if stop is None else min(stop, count)
    if not 0 <= start < stop:
        problem = f"has no frames {start} to {stop} (it has {count})"
        raise InputError(recording.folder, problem, "choose a start below the stop, both within the recording")
    return range(start, stop)


def _read_set(recording: Recording, pair: np.ndarray, position: int) -> FrameSet:
    depths, taken, problems = list[np.ndarray | None](), list[float | None](), list[str]()
    for number, (stream, index) in enumerate(zip(recording.streams, pair, strict=True)):
        if index < 0:
            depths.append(None)
            taken.append(None)
            continue
        image = read_stream_image(recording, number, int(index))
        depths.append(image.depth_m)
        taken.append(None if image.depth_m is None else float(stream.time_s[index]))
        if image.problem:
            problems.append(f"{stream.files[index].relative_to(recording.folder).as_posix()} {image.problem}")
    clock = recording.streams[0]
    return FrameSet(
        frame=int(clock.frame[position]),
        time_s=float(clock.time_s[position]),
        depths_m=tuple(depths),
        taken_s=tuple(taken),
        problems=tuple(problems),
        position=position,
    )


def _open_stream(folder: Path, fps: float | None, most_bytes: int) -> DepthStream:
    """List the depth images of a camera's folder. fps: frame rate stated in recording.json, needed without a
    timestamps.csv; most_bytes: size above which a file is not compared with the previous file to find duplicates.
    """
    files = _number_files(folder / "depth")
    numbers, repeated = np.array(sorted(files), dtype=np.int64), 0
    path = folder / "timestamps.csv"
    if is_there(path):
        times = read_timestamps(path)
        _check_same_frames(folder, path, files, times)
        time_s = np.array([times[number] for number in numbers.tolist()])
        later = np.append(True, np.diff(time_s) > SHORTEST_STEP_S)
        repeated, numbers, time_s = int((~later).sum()), numbers[later], time_s[later]
    elif fps is not None:
        time_s = numbers / fps  # a frame number that is missing means a dropped frame
    else:
        raise InputError(path, "there is no such file", 'add it, or write the camera\'s "fps" into recording.json')
    kept = FolderFiles(folder / "depth", tuple(files[number] for number in numbers.tolist()))
    listed = np.fromiter((list_file(file) for file in kept), STAMP, len(kept))
    return DepthStream(
        files=kept,
        time_s=time_s,
        frame=numbers,
        duplicate=find_duplicates(kept, listed["size"].tolist(), most_bytes),
        repeated=repeated,
        fps=fps,
        listed=listed,
    )


def _number_files(folder: Path) -> dict[int, str]:
    """Return the file names of a camera's depth images by their frame numbers."""
    if not folder.is_dir():
        raise InputError(folder, "there is no such folder", "put the camera's depth images there")
    files: dict[int, str] = {}
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputError(folder, f"cannot be read ({reason(error)})", "check its permissions") from None
    for name in names:
        stem, dot, ending = name.rpartition(".")
        if ending != "png" or not dot or name.startswith("."):  # file browsers leave hidden files (.name) in folders
            continue
        if not re.fullmatch(r"[0-9]{1,9}", stem):
            remedy = "name the depth images 000000.png, 000001.png and so on"
            raise InputError(folder / name, "is not named by its frame number", remedy)
        if int(stem) in files:
            raise InputError(folder / name, f"has the same number as {files[int(stem)]}", "remove one of the two")
        files[int(stem)] = name
    if not files:
        raise InputError(folder, "holds no depth images", "put the camera's depth images 000000.png and so on there")
    return files


def _check_same_frames(folder: Path, path: Path, files: dict[int, str], times: dict[int, float]) -> None:
    for frame in times:
        if frame not in files:
            missing = folder / "depth" / f"{frame:06d}.png"
            raise InputError(missing, "there is no such file", f"add it or remove its row from {path.name}")
    for frame, name in files.items():
        if frame not in times:
            raise InputError(path, f"has no row for {name}", f"add the row {frame},<time> or remove the image")


def _require_usable(camera: Camera, stream: DepthStream) -> None:
    """Raise InputError if no depth image of the camera can be used. The cause is then probably a wrong description of
    the camera, not a damaged image.
    """
    first_problem = ""
    for file in stream.files:
        problem = read_depth_image(file, camera).problem
        if not problem:
            return
        first_problem = first_problem or problem
    remedy = "no depth image of this camera can be used: export them again as 16-bit grey PNG of the camera's size"
    raise InputError(stream.files[0], first_problem, remedy)


def _read_background(folder: Path, camera: Camera) -> np.ndarray | None:
    path = folder / camera.name / "background.png"
    if not is_there(path):
        return None
    image = read_depth_image(path, camera, judged=True)
    if image.depth_m is None:
        raise InputError(path, image.problem, "record the empty room again, or remove the file to do without it")
    return image.depth_m


def input_files(recording: Recording) -> Iterator[Path]:
    """Yield the path of every file that was read for ``recording``, depth images included, in a fixed order."""
    document = recording.folder / "recording.json"
    yield document
    yield from events_files(recording.folder)
    equipment = read_document(document, RecordingDocument).equipment
    if equipment:
        yield from equipment_files(recording.folder / equipment)
    for camera, stream in zip(recording.cameras, recording.streams, strict=True):
        beside = (recording.folder / camera.name / name for name in ("timestamps.csv", "background.png"))
        yield from (path for path in beside if is_there(path))
        yield from stream.files
