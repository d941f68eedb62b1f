"""Opening a recording folder and streaming its frames, one decoded set at a time.

Which files a recording consists of, so that a result can name what it was made from.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.depth_image import read_depth_picture, read_header_problem
from anchorpose.recording.document import read_document
from anchorpose.recording.equipment_file import equipment_files, read_equipment
from anchorpose.recording.pairing import pair_frames
from anchorpose.recording.recording import DepthStream, FrameSet, Recording
from anchorpose.recording.recording_file import RecordingDocument
from anchorpose.recording.timestamps import find_doubled, read_timestamps, times_from_rate


def open_recording(folder: Path) -> Recording:
    """A checked recording: everything but the inside of the pictures, of which one a camera is decoded.

    Times come from timestamps.csv, and only where that is absent from ``fps`` and the numbers of the pictures.
    Raises InputError naming the file and the remedy. A picture that is damaged while others of its camera are sound is
    no error here: ``read_frames`` reports it.
    """
    if not folder.exists():
        raise InputError(folder, "there is no such folder", "check the path of the recording")
    if not folder.is_dir():
        raise InputError(folder, "is a file", "give the folder that holds recording.json")
    path = folder / "recording.json"
    if not path.is_file():
        raise InputError(path, "there is no such file", "give the folder of a recording, the one with recording.json")
    document = read_document(path, RecordingDocument)
    cameras = tuple(entry.camera() for entry in document.cameras)
    streams = tuple(_open_stream(folder / entry.name, entry.fps or document.fps) for entry in document.cameras)
    for camera, stream in zip(cameras, streams, strict=True):
        _check_pictures(camera, stream)
    return Recording(
        folder=folder,
        cameras=cameras,
        streams=streams,
        backgrounds_m=tuple(_read_background(folder, camera) for camera in cameras),
        equipment=read_equipment(folder / document.equipment) if document.equipment else None,
        subject_height_m=document.subject.height_m if document.subject else None,
    )


def read_frames(
    recording: Recording,
    start: int = 0,
    stop: int | None = None,
    reference: int = 0,
    clock_offset_s: tuple[float, ...] | None = None,
) -> Iterator[FrameSet]:
    """The frame sets ``start`` to ``stop`` (positions in the reference camera's stream), decoded one at a time.

    ``clock_offset_s`` as in ``pair_frames``. Raises InputError at once where the cameras never overlap in time or the
    range is empty; a damaged picture is None with a sentence in the set's ``problems``.
    """
    positions = frame_range(recording, start, stop, reference)
    pairs = pair_frames(recording, reference, clock_offset_s)
    offsets_s = clock_offset_s if clock_offset_s is not None else (0.0,) * len(recording.cameras)
    return (_read_set(recording, reference, pairs[position], position, offsets_s) for position in positions)


def frame_range(recording: Recording, start: int = 0, stop: int | None = None, reference: int = 0) -> range:
    """The positions ``start`` to ``stop`` of the reference camera; raises InputError where there are none."""
    count = len(recording.streams[reference].files)
    stop = count if stop is None else min(stop, count)
    if not 0 <= start < stop:
        problem = f"has no frames {start} to {stop} (it has {count})"
        raise InputError(recording.folder, problem, "choose a start below the stop, both within the recording")
    return range(start, stop)


def _read_set(
    recording: Recording, reference: int, pair: np.ndarray, position: int, offsets_s: tuple[float, ...]
) -> FrameSet:
    depths, taken, problems = list[np.ndarray | None](), list[float | None](), list[str]()
    for camera, stream, index, offset_s in zip(recording.cameras, recording.streams, pair, offsets_s, strict=True):
        if index < 0:
            depths.append(None)
            taken.append(None)
            continue
        picture = read_depth_picture(stream.files[index], camera)
        depths.append(picture.depth_m)
        taken.append(None if picture.depth_m is None else float(stream.time_s[index]) + offset_s)
        if picture.problem:
            problems.append(f"{stream.files[index].relative_to(recording.folder).as_posix()} {picture.problem}")
    clock = recording.streams[reference]
    return FrameSet(
        frame=int(clock.frame[position]),
        time_s=float(clock.time_s[position]),
        depths_m=tuple(depths),
        taken_s=tuple(taken),
        problems=tuple(problems),
    )


def _open_stream(folder: Path, fps: float | None) -> DepthStream:
    files = _number_files(folder / "depth")
    numbers, repeated = np.array(sorted(files), dtype=np.int64), 0
    path = folder / "timestamps.csv"
    if path.exists():
        times = read_timestamps(path)
        _check_same_frames(folder, path, files, times)
        time_s = np.array([times[number] for number in numbers.tolist()])
        later = np.append(True, np.diff(time_s) > 0)
        repeated, numbers, time_s = int((~later).sum()), numbers[later], time_s[later]
    elif fps is not None:
        time_s = times_from_rate(numbers, fps)
    else:
        raise InputError(path, "there is no such file", 'add it, or write the camera\'s "fps" into recording.json')
    kept = tuple(files[number] for number in numbers.tolist())
    return DepthStream(files=kept, time_s=time_s, frame=numbers, doubled=find_doubled(kept), repeated=repeated)


def _number_files(folder: Path) -> dict[int, Path]:
    if not folder.is_dir():
        raise InputError(folder, "there is no such folder", "put the camera's depth pictures there")
    files: dict[int, Path] = {}
    for file in sorted(folder.glob("*.png")):
        if file.name.startswith("."):  # left behind by a file browser
            continue
        if not re.fullmatch(r"[0-9]{1,9}", file.stem):
            raise InputError(
                file, "is not named by its frame number", "name the pictures 000000.png, 000001.png and so on"
            )
        if int(file.stem) in files:
            raise InputError(file, f"has the same number as {files[int(file.stem)].name}", "remove one of the two")
        files[int(file.stem)] = file
    if not files:
        raise InputError(folder, "holds no pictures", "put the camera's depth pictures 000000.png and so on there")
    return files


def _check_same_frames(folder: Path, path: Path, files: dict[int, Path], times: dict[int, float]) -> None:
    for frame in times:
        if frame not in files:
            missing = folder / "depth" / f"{frame:06d}.png"
            raise InputError(missing, "there is no such file", f"add the picture or remove its row from {path.name}")
    for frame, file in files.items():
        if frame not in times:
            raise InputError(path, f"has no row for {file.name}", f"add the row {frame},<time> or remove the picture")


def _check_pictures(camera: Camera, stream: DepthStream) -> None:
    """Decodes pictures until one is sound: where none is, the camera, not a picture, is wrong."""
    first_problem = ""
    for file in stream.files:
        problem = read_header_problem(file, camera) or read_depth_picture(file, camera).problem
        if not problem:
            return
        first_problem = first_problem or problem
    remedy = (
        "no picture of this camera can be used: record or export them again as 16-bit grey PNG of the camera's size"
    )
    raise InputError(stream.files[0], first_problem, remedy)


def _read_background(folder: Path, camera: Camera) -> np.ndarray | None:
    path = folder / camera.name / "background.png"
    if not path.exists():
        return None
    picture = read_depth_picture(path, camera)
    if picture.depth_m is None:
        raise InputError(path, picture.problem, "record the empty room again, or remove the file to do without it")
    return picture.depth_m


def input_files(recording: Recording) -> tuple[Path, ...]:
    """Every file that was read for ``recording``, pictures included, in a fixed order."""
    document = recording.folder / "recording.json"
    files = [document]
    equipment = read_document(document, RecordingDocument).equipment
    if equipment:
        files += equipment_files(recording.folder / equipment)
    for camera, stream in zip(recording.cameras, recording.streams, strict=True):
        beside = (recording.folder / camera.name / name for name in ("timestamps.csv", "background.png"))
        files += [path for path in beside if path.exists()]
        files += stream.files
    return tuple(files)
