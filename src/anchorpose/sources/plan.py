"""Plan the output of a conversion (the cameras of all inputs with the user's additions), and write a camera's folder.

Each image is written before its row in timestamps.csv, so that every image with a row is complete.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.lens import Intrinsics, LensModel
from anchorpose.options import ConvertOptions
from anchorpose.recording.depth_image import decode_grey_png
from anchorpose.recording.document import validate
from anchorpose.recording.recording_file import MOST_REPEATED, RecordingDocument, camera_document, read_timestamps
from anchorpose.recording.regular_file import LARGEST_IMAGE, LARGEST_TABLE, read_whole
from anchorpose.sources.source import Source, SourceCamera, require_counted

QUARTERS: Final = {0: 0, 90: 1, 180: 2, 270: 3}
"""Number of clockwise quarter turns of the image, by the angle in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPlan:
    """A camera of the recording to be written. camera: describes the images as written, upright after the turn that
    the user gave, if any; model and serial: empty if unknown; fps: images per second, None if the images have times;
    count: number of images, None if unknown.
    """

    camera: Camera
    model: str = ""
    serial: str = ""
    fps: float | None = None
    count: int | None = None

    def document(self) -> dict[str, Any]:
        """Return the camera's entry in recording.json."""
        known = {key: value for key, value in (("model", self.model), ("serial", self.serial)) if value}
        return {**camera_document(self.camera), **known}


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The plan of a conversion. cameras: the cameras of each source; notes: sentences on poses that were left out or
    are missing.
    """

    cameras: tuple[tuple[CameraPlan, ...], ...]
    notes: tuple[str, ...]


def make_plan(sources: Sequence[Source], options: ConvertOptions) -> Plan:
    """Plan a conversion; raises InputError if information is missing that only the user can give, or if an option gives
    information that the files have.
    """
    all_cameras = [camera for source in sources for camera in source.cameras]
    if options.intrinsics is not None and all(camera.intrinsics is not None for camera in all_cameras):
        raise InputError(sources[0].path, "has its own lens", "leave --intrinsics out")
    if options.fps is not None and all(camera.has_times for camera in all_cameras):
        raise InputError(sources[0].path, "has its own times", "leave --fps out")
    names = _names(sources)
    cameras = tuple(
        tuple(_plan_camera(source, k, names.pop(0), options) for k in range(len(source.cameras))) for source in sources
    )
    cameras, notes = _poses_of_one_world(cameras, options)
    _require_valid(sources, cameras)
    unplaced = [plan.camera.name for own in cameras for plan in own if plan.camera.T_world_camera is None]
    if unplaced:
        notes = (*notes, f"No pose is known of {', '.join(unplaced)}: 'anchorpose track' estimates it.")
    return Plan(cameras, notes)


def _plan_camera(source: Source, index: int, name: str, options: ConvertOptions) -> CameraPlan:
    found = source.cameras[index]
    scale = options.depth_scale if options.depth_scale is not None else found.depth_scale
    lens, pose = _lens(found, options), found.T_world_camera
    if scale is None or lens is None or (not found.has_times and options.fps is None):
        raise _incomplete(source, found, options)
    if not found.has_times:
        require_counted(source.path, found.number_step)
    if not can_turn(lens, options.rotate):
        remedy = "give --rotate 180 or leave it out, and turn the camera"
        raise InputError(source.path, "has a lens with a tilted sensor, which a quarter turn cannot keep", remedy)
    swapped = QUARTERS[options.rotate] % 2 == 1
    camera = Camera(
        name=name,
        width=found.height if swapped else found.width,
        height=found.width if swapped else found.height,
        depth_scale=scale,
        intrinsics=turn_lens(lens, (found.width, found.height), options.rotate, options.mirror),
        T_world_camera=None if pose is None else turn_pose(pose, options.rotate),
    )
    fps = None if found.has_times else options.fps
    return CameraPlan(camera=camera, model=_text(found.model), serial=_text(found.serial), fps=fps, count=found.count)


def _text(value: str) -> str:
    """Return a device's name or number up to the first null character, which ends texts in the vendors' programs."""
    return value.partition("\0")[0]


def _lens(camera: SourceCamera, options: ConvertOptions) -> Intrinsics | None:
    if camera.intrinsics is not None or options.intrinsics is None:
        return camera.intrinsics
    fx, fy, cx, cy = options.intrinsics
    return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy)


def _incomplete(source: Source, camera: SourceCamera, options: ConvertOptions) -> InputError:
    """Return an error that names each piece of missing information, with the option by which the user can give it."""
    missing = list[tuple[str, str]]()
    if _lens(camera, options) is None:
        missing.append(("the lens", "--intrinsics fx,fy,cx,cy in pixels"))
    if camera.depth_scale is None and options.depth_scale is None:
        missing.append(("the unit of depth", "--depth-scale in metres per grey value (0.001 for millimetres)"))
    if not camera.has_times and options.fps is None:
        missing.append(("times", "--fps in images per second"))
    whats, hows = (", ".join(words) for words in zip(*missing, strict=True))
    which = f" for camera {camera.name}" if len(source.cameras) > 1 else ""
    problem = f"does not state{which} ({camera.width} x {camera.height} pixels): {whats}"
    return InputError(source.path, problem, f"give 'anchorpose convert' {hows}")


def _names(sources: Sequence[Source]) -> list[str]:
    """Return one folder name per camera: the name of the camera or, if this name is not unique, the name of the input
    followed by the name of the camera. The names are unique even if upper and lower case are not distinguished.
    """
    own = [(folder_name(source.path.stem), folder_name(camera.name)) for source in sources for camera in source.cameras]
    cameras = [camera.casefold() for _, camera in own]
    wanted = [f"{i}-{c}" if cameras.count(c.casefold()) > 1 and i != c else c for i, c in own]
    names, taken = list[str](), set[str]()
    for name in wanted:
        unique, number = name, 2
        while unique.casefold() in taken:
            unique, number = f"{name}-{number}", number + 1
        taken.add(unique.casefold())
        names.append(unique)
    return names


def folder_name(text: str) -> str:
    """Return ``text`` in the form that recording.json allows for a camera name."""
    return re.sub(r"^[^\w]+|[ .]+$", "", re.sub(r"[^\w .+-]", "-", text))[:60].rstrip(" .") or "camera"


def _poses_of_one_world(
    cameras: tuple[tuple[CameraPlan, ...], ...], options: ConvertOptions
) -> tuple[tuple[tuple[CameraPlan, ...], ...], tuple[str, ...]]:
    """Return the cameras, and notes. The cameras' poses are left out if they do not place all cameras in one world
    (different inputs have different worlds), or if the images are mirrored.
    """
    placed = [any(plan.camera.T_world_camera is not None for plan in own) for own in cameras]
    whole = all(plan.camera.T_world_camera is not None for own in cameras for plan in own)
    if not any(placed) or (whole and len(cameras) == 1 and not options.mirror):
        return cameras, ()
    why = "they are of mirrored images" if options.mirror else "they do not place all cameras in one world"
    bare = tuple(
        tuple(replace(plan, camera=replace(plan.camera, T_world_camera=None)) for plan in own) for own in cameras
    )
    return bare, (f"The poses in the file were left out: {why}.",)


def _require_valid(sources: Sequence[Source], cameras: Sequence[Sequence[CameraPlan]]) -> None:
    """Raise InputError if the description of a camera in an input is invalid for a recording."""
    for source, own in zip(sources, cameras, strict=True):
        document = {"format": "rgbd-recording", "version": 1, "cameras": [plan.document() for plan in own]}
        validate(source.path, RecordingDocument, document)


def turn_image(grey: np.ndarray, degrees: int, mirror: bool) -> np.ndarray:
    """Return a contiguous copy of the image, turned clockwise by ``degrees``, then mirrored left to right if
    ``mirror``.
    """
    turned = np.rot90(grey, -QUARTERS[degrees])
    return np.ascontiguousarray(turned[:, ::-1] if mirror else turned)


def can_turn(lens: Intrinsics, degrees: int) -> bool:
    """Return whether OpenCV's model can describe the lens of the turned image. A quarter turn exchanges the order of
    the two axes about which the sensor is tilted, so the model can describe the turned lens only if the sensor is not
    tilted.
    """
    return QUARTERS[degrees] % 2 == 0 or not any(lens.distortion[12:14])


def turn_lens(lens: Intrinsics, size: tuple[int, int], degrees: int, mirror: bool) -> Intrinsics:
    """Return the lens of the image that ``turn_image`` makes. size: width and height before the turn, which must be
    possible (see ``can_turn``).
    """
    width, height = size
    for _ in range(QUARTERS[degrees] % 2):
        lens = _quarter(lens, height)
        width, height = height, width
    if QUARTERS[degrees] >= 2:
        lens = _mirror_down(_mirror_across(lens, width), height)
    return _mirror_across(lens, width) if mirror else lens


def turn_pose(T_world_camera: np.ndarray, degrees: int) -> np.ndarray:
    """Return T_world_camera of a camera whose image was turned clockwise: the camera is rotated about its optical axis
    in the opposite sense.
    """
    angle = np.deg2rad(degrees)
    cos, sin = np.rint(np.cos(angle)), np.rint(np.sin(angle))
    T_turned_camera = np.eye(4)
    T_turned_camera[:2, :2] = [[cos, -sin], [sin, cos]]
    return np.asarray(T_world_camera @ T_turned_camera.T)


def _quarter(lens: Intrinsics, height: int) -> Intrinsics:
    """Turn a lens clockwise by 90 degrees: x becomes y, and y becomes -x. height: image height before the turn."""
    d = list(lens.distortion)
    if lens.model is not LensModel.KANNALA_BRANDT:
        d[2], d[3] = d[3], -d[2]
        if len(d) >= 12:
            d[8:12] = [-d[10], -d[11], d[8], d[9]]
    return replace(lens, fx=lens.fy, fy=lens.fx, cx=height - 1 - lens.cy, cy=lens.cx, distortion=tuple(d))


def _mirror_across(lens: Intrinsics, width: int) -> Intrinsics:
    """Mirror a lens left to right: x becomes -x."""
    d = _negated(lens, (3, 8, 9, 13))  # coefficients that change sign: p2, s1, s2 and the tilt about y
    return replace(lens, cx=width - 1 - lens.cx, distortion=d)


def _mirror_down(lens: Intrinsics, height: int) -> Intrinsics:
    """Mirror a lens top to bottom: y becomes -y."""
    d = _negated(lens, (2, 10, 11, 12))  # coefficients that change sign: p1, s3, s4 and the tilt about x
    return replace(lens, cy=height - 1 - lens.cy, distortion=d)


def _negated(lens: Intrinsics, places: tuple[int, ...]) -> tuple[float, ...]:
    if lens.model is LensModel.KANNALA_BRANDT:
        return lens.distortion
    return tuple(-value if place in places and value else value for place, value in enumerate(lens.distortion))


_HEADER: Final = "frame,time_s"
BEGIN_AGAIN: Final = "remove the unfinished recording and begin again"


class CameraWriter(AbstractContextManager["CameraWriter"]):
    """A writer of a camera's folder, which continues after the complete images of an earlier run that was stopped.

    given: the number that the next image gets. Unless ``write`` is called with numbers, it equals the number of images
    received so far, including the earlier run. written: number of images that were written, including the earlier run;
    restarts: how often the numbers given to ``write`` began again. The number in an image's file name is its position
    in the source, unless ``write`` gets another number.
    """

    def __init__(self, folder: Path, plan: CameraPlan) -> None:
        self.folder, self._plan = folder, plan
        (folder / "depth").mkdir(parents=True, exist_ok=True)
        rows = _complete_rows(folder, plan)
        self.given = rows[-1][0] + 1 if rows else 0
        self.written = len(rows)
        self.restarts = self._shift = 0
        self._last = rows[-1][1] if rows else ""
        self._rows = (folder / "timestamps.csv").open("w", encoding="utf-8")
        self._rows.write("".join(f"{line}\n" for line in (_HEADER, *(f"{k},{time}" for k, time in rows))))
        self._rows.flush()

    def __exit__(self, *error: object) -> None:
        self._rows.close()

    def write(self, time_s: float, grey: np.ndarray, number: int | None = None) -> Path | None:
        """Write an image and return the path of its file. An image whose time is not later than the time of the
        previous image is left out, and None is returned.

        time_s: time on the device's clock, or the image's number if times are unknown; number: the number for the
        image's file name, given only by sources that state which images were lost. If a number is not larger than the
        previous number, because a camera restarted, the numbers continue at the next free number: no image is ever
        written over another image.
        """
        number = self.given if number is None else number + self._shift
        if number < self.given:
            self.restarts += 1
            self._shift += self.given - number
            number = self.given
        self.given = number + 1
        stamp = f"{time_s if self._plan.fps is None else time_s / self._plan.fps:.6f}"
        if not math.isfinite(float(stamp)) or (self._last and float(stamp) <= float(self._last)):
            return None
        path = self.folder / "depth" / f"{number:06d}.png"
        path.write_bytes(encode_grey(grey))
        self._rows.write(f"{number},{stamp}\n")
        self._rows.flush()
        self._last, self.written = stamp, self.written + 1
        return path

    def note(self, source: Path) -> str:
        """Return a sentence on images that were left out because of their times; empty without such images. Raises
        InputError, naming ``source``, if too many were left out, or if the remaining times cannot be seconds.
        """
        if self.written:
            self._require_times(source)
        left_out = self.given - self.written
        if left_out == 0:
            return ""
        sentence = f"{left_out} of {self.given} times are not later than the previous one"
        if left_out > MOST_REPEATED * self.given:
            remedy = "the device's clock was set back or is too coarse: record again"
            raise InputError(source, sentence, remedy)
        return f"{self.folder.name}: {sentence}; their images were left out."

    def _require_times(self, source: Path) -> None:
        try:
            read_timestamps(self.folder / "timestamps.csv")
        except InputError as error:
            remedy = "the file is damaged, or its clock has another unit: record or export it again"
            raise InputError(source, f"the clock of {self.folder.name} {error.problem}", remedy) from None


def encode_grey(grey: np.ndarray) -> bytes:
    """Return a PNG file of grey values (height, width) uint16.

    The compression uses only Huffman coding and runs of equal bytes. Noisy depth images have no other repeated
    sequences, and a search for them would double the time of encoding.
    """
    import cv2

    how = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
    encoded = cv2.imencode(".png", grey, (*how, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP))[1]
    return bytes(encoded.tobytes())


def _complete_rows(folder: Path, plan: CameraPlan) -> list[tuple[int, str]]:
    """Return number and time (text) of each image in timestamps.csv, up to the first damaged row or missing image file;
    damaged images at the end of this series are left out.
    """
    path = folder / "timestamps.csv"
    if not path.is_file():
        return []
    text = read_whole(path, LARGEST_TABLE, BEGIN_AGAIN).decode("utf-8", errors="replace")
    lines = text.split("\n")[1:-1]  # skips the header row, and a last row that was cut off
    there = {file.name for file in (folder / "depth").iterdir()}
    rows = list[tuple[int, str]]()
    for line in lines:
        row = re.fullmatch(r"(\d+),(-?\d+\.\d{6})", line, re.ASCII)
        if row is None or f"{int(row[1]):06d}.png" not in there:
            break
        rows.append((int(row[1]), row[2]))
    while rows:
        data = read_whole(folder / "depth" / f"{rows[-1][0]:06d}.png", LARGEST_IMAGE, BEGIN_AGAIN)
        if decode_grey_png(data, plan.camera.width, plan.camera.height)[0] is not None:
            break
        rows.pop()
    return rows
