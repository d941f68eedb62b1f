"""Define a recording in memory (cameras with depth images in metres), and write it as a recording folder."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError
from anchorpose.live.recorder import EMPTY_ROOM_FILE, copy_equipment
from anchorpose.recording.document import plain_values, validate
from anchorpose.recording.recording import UNKNOWN, Subject
from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument
from anchorpose.sources.plan import CameraPlan, CameraWriter, encode_grey

LARGEST_GREY: Final = 65535  # the largest 16-bit grey value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setup:
    """The cameras of a recording, and optional prior knowledge about the patient and the room.

    subject: known facts about the patient, such as the height. equipment: path of an equipment.json. empty_room_m: for
    each camera name, a depth image (height, width) of the room without people, in metres.
    """

    cameras: Sequence[Camera]
    subject: Subject = UNKNOWN
    equipment: Path | str | None = None
    empty_room_m: Mapping[str, np.ndarray] = field(default_factory=dict)

    @contextmanager
    def writers(self, folder: Path) -> Iterator[list[CameraWriter]]:
        """Write a recording that has no frames yet into an existing empty folder, and yield one writer per camera,
        which adds the camera's depth images.

        Raises InputError if the description of a camera, the patient or the equipment is wrong, and AnchorposeError if
        ``empty_room_m`` names an unknown camera.
        """
        require_known(self.empty_room_m, self.cameras)
        plans = [CameraPlan(camera=camera) for camera in self.cameras]
        document = self._document([plan.document() for plan in plans])
        validate(Path("cameras and subject"), RecordingDocument, document)
        with ExitStack() as stack:
            writers = [stack.enter_context(CameraWriter(folder / plan.camera.name, plan)) for plan in plans]
            if self.equipment is not None:
                copy_equipment(Path(self.equipment), Path(self.equipment).parent, folder)
            for camera in self.cameras:
                if camera.name in self.empty_room_m:
                    grey = grey_of(self.empty_room_m[camera.name], camera)
                    (folder / camera.name / EMPTY_ROOM_FILE).write_bytes(encode_grey(grey))
            (folder / RECORDING_FILE).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
            yield writers

    def _document(self, cameras: Sequence[dict[str, Any]]) -> dict[str, Any]:
        document: dict[str, Any] = {"format": "rgbd-recording", "version": 1, "cameras": list(cameras)}
        subject = plain_values(asdict(self.subject))
        if stated := {key: value for key, value in subject.items() if value not in (None, [])}:
            document["subject"] = stated
        if self.equipment is not None:
            document["equipment"] = Path(self.equipment).name
        return document


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthImages(Setup):
    """A recording in memory.

    depth_m: for each camera name, depth images (n, height, width), in metres along the optical axis; 0, NaN and
    infinite mean that the pixel has no reading. time_s: increasing times of the images in s; one array (n,) for all
    cameras, or a mapping from camera name to array.
    """

    depth_m: Mapping[str, np.ndarray]
    time_s: np.ndarray | Mapping[str, np.ndarray]

    def write(self, folder: Path) -> Path:
        """Write the recording into an existing empty folder, and return the folder.

        Raises AnchorposeError if images are missing, or do not fit their camera or their times, or if the name of a
        camera is unknown.
        """
        require_known(self.depth_m, self.cameras)
        require_known(self.time_s if isinstance(self.time_s, Mapping) else (), self.cameras)
        series = [(camera, self._images(camera), self._times(camera)) for camera in self.cameras]
        with self.writers(folder) as writers:
            for writer, (camera, images, times) in zip(writers, series, strict=True):
                if len(images) != len(times):
                    problem = f"Camera {camera.name} has {len(images)} depth images and {len(times)} times"
                    raise AnchorposeError(f"{problem}; give one time for each image.")
                for time_s, depth_m in zip(times.tolist(), images, strict=True):
                    if writer.write(time_s, grey_of(depth_m, camera)) is None:
                        problem = f"The times of camera {camera.name} do not rise at {time_s:g} s"
                        raise AnchorposeError(f"{problem}; sort the images by time.")
        return folder

    def _images(self, camera: Camera) -> np.ndarray:
        if camera.name not in self.depth_m:
            raise AnchorposeError(f"Camera {camera.name} has no depth images; give depth_m['{camera.name}'].")
        return self.depth_m[camera.name]

    def _times(self, camera: Camera) -> np.ndarray:
        if isinstance(self.time_s, Mapping) and camera.name not in self.time_s:
            raise AnchorposeError(f"Camera {camera.name} has no times; give time_s['{camera.name}'].")
        times = self.time_s[camera.name] if isinstance(self.time_s, Mapping) else self.time_s
        return np.asarray(times, dtype=np.float64)


def require_known(names: Iterable[str], cameras: Sequence[Camera]) -> None:
    """Raise AnchorposeError if a name belongs to none of the cameras."""
    known = [camera.name for camera in cameras]
    if unknown := [name for name in names if name not in known]:
        raise AnchorposeError(f"The camera {unknown[0]} is unknown; name one of {', '.join(known)}.")


def grey_of(depth_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Convert a depth image in metres to grey values (height, width) uint16, as the camera's image files store depth.

    Raises AnchorposeError if the shape differs from the camera's image size, or if a reading is negative or too large
    for the format.
    """
    depth = np.asarray(depth_m)
    if depth.shape != (camera.height, camera.width):
        problem = f"A depth image of camera {camera.name} has the shape {depth.shape}"
        raise AnchorposeError(f"{problem}; give ({camera.height}, {camera.width}), rows first.")
    grey = np.rint(np.where(np.isfinite(depth), depth, 0.0) / camera.depth_scale)
    if grey.min() < 0:
        problem = f"Camera {camera.name} has negative depth readings"
        raise AnchorposeError(f"{problem}; give metres, and 0 for a missing reading.")
    if grey.max() > LARGEST_GREY:
        problem = f"Camera {camera.name} reads {float(depth[np.isfinite(depth)].max()):g} m"
        farthest_m = LARGEST_GREY * camera.depth_scale
        raise AnchorposeError(f"{problem}, and {farthest_m:g} m is the most; give depth in metres.")
    return grey.astype(np.uint16)
