"""Provide the depth images from which results were computed: the labelled points of all cameras, and the patient's
surface.

The cameras' clocks are taken from run.json (the record of the tracking run), so that images of several cameras that
were tracked as one frame are shown as one frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.depth_image import read_depth_image
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Clock, Recording, align_clocks, pair_frames
from anchorpose.results.records import PEOPLE_FILE, ROOM, StoredPeople, decode_labels
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.surface.mesh import build_surface, faces


def clocks_of_run(path: Path, run: dict[str, Any], cameras: tuple[str, ...]) -> tuple[Clock, ...]:
    """Return the clock of each camera, in the order of the names, from the run.json at ``path``; raises InputError if a
    clock is missing.
    """
    clocks = {camera["name"]: camera.get("clock") for camera in run["cameras"]}
    if not all(clocks.get(camera) for camera in cameras):
        raise InputError(path, "does not state the cameras' clocks", "track the recording again with this version")
    return tuple(Clock(**clocks[camera]) for camera in cameras)


# pixels, distance to each side of a pixel at which depth is read to compute the slope of the surface; both sides
# together are about 5 cm wide on a surface at 2 m. With a smaller distance, noise would be visible in the brightness of
# the surface.
REACH_PX: Final = 4
JUMP_M: Final = 0.15  # m, maximum step in depth within a surface; a larger step is the edge of another surface

_LIGHT: Final = np.array(
    [0.35, -0.5, -0.79]
)  # direction of the light in the camera frame: from above, a little from the side, mostly from the camera


def shade(depth_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the brightness of each pixel (height, width) uint8, 255 = the surface faces the light. Brightness is used
    only for display, where it shows the shape of surfaces.

    depth_m (height, width) metres, 0 = no reading. Where a neighbouring reading is missing or on another surface, the
    slope of the surface counts as 0.
    """
    z = np.maximum(depth_m, 0.1)
    across = _slope(depth_m, 1) * (camera.intrinsics.fx / (2 * REACH_PX)) / z
    down = _slope(depth_m, 0) * (camera.intrinsics.fy / (2 * REACH_PX)) / z
    facing = (across * _LIGHT[0] + down * _LIGHT[1] - _LIGHT[2]) / np.sqrt(1.0 + across**2 + down**2)
    return np.asarray(255.0 * np.clip(facing, 0.0, 1.0)).astype(np.uint8)


def _slope(depth_m: np.ndarray, axis: int) -> np.ndarray:
    """Return the change of depth over ``2 * REACH_PX`` pixels along an axis; 0 where it is unknown."""
    before, after = np.roll(depth_m, REACH_PX, axis), np.roll(depth_m, -REACH_PX, axis)
    change = after - before
    known = (before > 0) & (after > 0) & (np.abs(change) < JUMP_M)
    edge = [slice(None), slice(None)]
    for edge[axis] in (slice(None, REACH_PX), slice(-REACH_PX, None)):
        known[tuple(edge)] = False
    return np.where(known, change, np.float32(0.0))


UNLABELLED: Final = 255
"""Label of all pixels if the results have no people.parquet (the file with the person labels)."""

ROOM_STEP: Final = 3
"""Step, in rows and columns, between the pixels of the room that are sent to the page: the page shows the room only for
orientation, so few pixels suffice.
"""

UNLABELLED_STEP: Final = 2
"""Step in rows and columns at which pixels of images without person labels are sent, since most of these pixels show
the room.
"""


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrames:
    """A recording with the clocks and camera poses of a tracking run.

    frame (n,): numbers of the results' frames. pairs (n, cameras): for each of these frames, the index of each camera's
    depth image among all images of this camera, -1 = none. people: None if the results have no person labels.
    """

    recording: Recording
    frame: np.ndarray
    pairs: np.ndarray
    people: StoredPeople | None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras, in the order in which ``points`` lists them."""
        return self.recording.cameras

    def points(self, position: int, room: bool) -> tuple[list[np.ndarray], list[str]]:
        """Return for each camera (m, 4) uint16: column, row, grey value and look (brightness and label) of each pixel
        with a reading. Also return sentences on problems, for the user.

        The pixels of coarse grids come first (every eighth row and column, then every fourth, then every second, then
        all), so that a page on a slow computer may draw only the first part. The look of a pixel is 256 times the
        brightness from ``shade``, plus the person label. position: row of the frame in the results. room: whether to
        include a part of the pixels that show the room.
        """
        found, problems = list[np.ndarray](), list[str]()
        for number, camera in enumerate(self.cameras):
            depth_m, problem = self.depth(position, number)
            if depth_m is None:
                found.append(np.empty((0, 4), np.uint16))
                problems.append(f"Camera {camera.name}: {problem}.")
                continue
            found.append(_pixels(depth_m, self.labels(position, number), camera, room))
        return found, problems

    def surface(self, position: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the patient's surface as the cameras see it: vertices (v, 3), world, metres, faces (f, 3) int32; empty
        without labels.

        The surface consists of one mesh per camera, as ``surface.mesh`` makes it. Unlike in tracking, the meshes are
        neither cut where parts of the body touch nor joined to one surface.
        """
        vertices, triangles, count = [np.empty((0, 3), np.float32)], [np.empty((0, 3), np.int32)], 0
        for number, camera in enumerate(self.cameras):
            depth_m, _ = self.depth(position, number)
            labels = self.labels(position, number)
            if depth_m is None or labels is None or camera.T_world_camera is None:
                continue
            sheet = build_surface(depth_m, labels == PixelLabel.PATIENT, camera)
            vertices.append(sheet.points_m)
            triangles.append(faces(sheet) + count)
            count += len(sheet)
        return np.concatenate(vertices), np.concatenate(triangles)

    def place_of_person(self, position: int, camera: str, column: int, row: int) -> tuple[np.ndarray | None, str]:
        """Return the point (3,), in metres in the world, at which a pixel shows a person, and an empty text. If the
        pixel shows no person, return None and the reason, as a sentence for the user.

        If the results have no person labels, a point on any surface is accepted; the command ``track`` later checks
        whether a person is there. Raises ValueError for a camera or a pixel that does not exist.
        """
        names = [one.name for one in self.cameras]
        if camera not in names:
            raise ValueError(f"there is no camera '{camera}'")
        number = names.index(camera)
        about = self.cameras[number]
        if not (0 <= column < about.width and 0 <= row < about.height):
            raise ValueError(f"camera {camera} has no pixel at column {column}, row {row}")
        depth_m, problem = self.depth(position, number)
        if depth_m is None:
            return None, f"Camera {camera}: {problem}."
        if not depth_m[row, column] > 0:
            return None, "The camera has no reading here; click on the trunk of a person."
        ray = np.append(about.pixel_rays()[row, column].astype(np.float64), 1.0)
        place_m = transform_points(about.require_pose(), ray * float(depth_m[row, column]))
        labels = self.labels(position, number)
        if labels is not None and labels[row, column] < PixelLabel.PATIENT:
            x, _, z = place_m
            return None, (
                "This is the room or the equipment; click on the trunk of a person, or, if this is a person who never "
                f"moves, track with --patient {x:.2f},{z:.2f}@{self.frame[position]}."
            )
        return place_m, ""

    def depth(self, position: int, camera: int) -> tuple[np.ndarray | None, str]:
        """Return a camera's depth image (height, width) in metres and an empty text, or None and the reason why the
        image is missing. position: row of the frame in the results; camera: the camera's number.
        """
        index = self.pairs[position, camera]
        if index < 0:
            return None, "there is no picture of this time"
        picture = read_depth_image(self.recording.streams[camera].files[index], self.cameras[camera])
        return picture.depth_m, f"the picture {picture.problem}" if picture.problem else ""

    def labels(self, position: int, camera: int) -> np.ndarray | None:
        """Return the person label of each pixel (height, width) uint8: ``ROOM`` at all pixels in a frame without
        people; None if the results have no labels.
        """
        if self.people is None:
            return None
        packed = self.people.get(int(self.frame[position]), self.cameras[camera].name)
        if packed is None:
            return np.full((self.cameras[camera].height, self.cameras[camera].width), ROOM, np.uint8)
        return decode_labels(packed)


def open_depth_frames(folder: Path, results: Path, run: dict[str, Any], frame: np.ndarray) -> DepthFrames:
    """Open the recording from which the results were made; raises InputError if the folder holds another recording.

    frame (n,): the numbers of the results' frames.
    """
    recording = open_recording(folder)
    poses = {camera["name"]: camera["camera_to_world"] for camera in run["cameras"]}
    _refuse_another(recording, run, poses)
    cameras = tuple(
        replace(camera, T_world_camera=None if poses[camera.name] is None else np.array(poses[camera.name]))
        for camera in recording.cameras
    )
    clocks = clocks_of_run(results / RUN_FILE, run, tuple(camera.name for camera in cameras))
    recording = align_clocks(replace(recording, cameras=cameras), clocks)
    rows = {int(number): row for row, number in enumerate(recording.streams[0].frame)}
    missing = [int(number) for number in frame if int(number) not in rows]
    if missing:
        raise InputError(folder, f"has no frame {missing[0]}, but the results do", _REMEDY)
    pairs = pair_frames(recording)[[rows[int(number)] for number in frame]]
    people = StoredPeople(results / PEOPLE_FILE) if (results / PEOPLE_FILE).exists() else None
    return DepthFrames(recording, frame, pairs, people)


_REMEDY: Final = "give the recording that these results were made of"


def _refuse_another(recording: Recording, run: dict[str, Any], poses: dict[str, Any]) -> None:
    """Raise InputError if the results were made from another recording. Only cameras, timestamps, and the first and
    last images are compared, since hashing all images would take minutes.
    """
    names = [camera.name for camera in recording.cameras]
    if set(names) != set(poses):
        raise InputError(recording.folder, f"has the cameras {', '.join(names)}, not {', '.join(poses)}", _REMEDY)
    for name, stream in zip(names, recording.streams, strict=True):
        times = recording.folder / name / "timestamps.csv"
        checked = [stream.files[0], stream.files[-1], *([times] if times.exists() else [])]
        for file, digest in hash_files(checked, recording.folder):
            if run["inputs_sha256"].get(file) != digest:
                raise InputError(recording.folder / file, "is not what the results were made of", _REMEDY)


def _pixels(depth_m: np.ndarray, labels: np.ndarray | None, camera: Camera, room: bool) -> np.ndarray:
    thin = np.zeros(depth_m.shape, bool)
    step = UNLABELLED_STEP if labels is None else ROOM_STEP
    thin[::step, ::step] = True
    if labels is None:
        labels = np.full(depth_m.shape, UNLABELLED, np.uint8)
        shown = thin
    else:
        shown = (labels != ROOM) | (thin & room)
    row, column = np.nonzero(shown & (depth_m > 0))
    if not len(row):
        return np.empty((0, 4), np.uint16)
    coarse_first = np.argsort(_fineness(row, column), kind="stable")
    row, column = row[coarse_first], column[coarse_first]
    grey = np.rint(depth_m[row, column] / np.float32(camera.depth_scale))
    # brightness is computed only for the part of the image with shown pixels, to save time
    top, left = max(0, row.min() - REACH_PX), max(0, column.min() - REACH_PX)
    lit = shade(depth_m[top : row.max() + REACH_PX + 1, left : column.max() + REACH_PX + 1], camera)
    look = 256 * lit[row - top, column - left].astype(np.uint16) + labels[row, column]
    return np.column_stack([column, row, grey, look]).astype(np.uint16)


def _fineness(row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return a rank (n,) for pixels: 0 if row and column are multiples of eight, 1 if they are multiples of four, 2 if
    they are multiples of two, 3 for all other pixels.
    """
    both = row | column
    ranks = np.where(both % 2, 3, np.where(both % 4, 2, np.where(both % 8, 1, 0)))
    return ranks.astype(np.uint8)  # numpy sorts single bytes fastest, by counting
