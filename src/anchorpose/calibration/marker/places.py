"""Cameras placed by markers: the pictures that show them, and what each camera makes of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.calibration import PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.marker.layout import MarkerLayout
from anchorpose.calibration.marker.pose import NoMarkers, pose_from_markers
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording

MARKER_PICTURES: Final = ("infrared.png", "color.png")  # in a camera's folder, of the depth pictures' geometry


def place_by_markers(recording: Recording, layout: MarkerLayout) -> tuple[Recording, dict[str, PoseRecord]]:
    """The recording with poses of all cameras that have a picture of markers, and a record of each by camera name.

    Cameras without such a picture keep the pose they have, or have none. Raises InputError where no camera has one,
    where a picture is no picture of its camera, or where the markers in it do not tell the pose.
    """
    cameras, records = list[Camera](), dict[str, PoseRecord]()
    for camera, background in zip(recording.cameras, recording.backgrounds_m, strict=True):
        path = _marker_picture(recording.folder / camera.name)
        if path is None:
            cameras.append(camera)
            continue
        found = pose_from_markers(_read(path, camera), camera, layout, background)
        if isinstance(found, NoMarkers):
            raise InputError(path, found.value, "hang up more or larger markers, in different planes, and record again")
        cameras.append(replace(camera, T_world_camera=found.T_world_camera))
        figures = (
            PoseFigure("markers, rms of their corners", found.rms_px, "px"),
            PoseFigure("markers, corners used", float(found.corners), "corners"),
        )
        records[camera.name] = PoseRecord(camera.name, PoseSource.MARKERS, found.sigma_m, found.sigma_rad, figures)
    if not records:
        problem = f"no camera's folder holds {' or '.join(MARKER_PICTURES)}"
        raise InputError(recording.folder, problem, "add a picture of the markers from each camera")
    return replace(recording, cameras=tuple(cameras)), records


def _marker_picture(folder: Path) -> Path | None:
    return next((folder / name for name in MARKER_PICTURES if (folder / name).is_file()), None)


def _read(path: Path, camera: Camera) -> np.ndarray:
    """(height, width) or (height, width, 3), 8 or 16 bit."""
    picture = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype not in (np.uint8, np.uint16):
        raise InputError(path, "is no picture of 8 or 16 bit that can be read", "export it again as PNG")
    if picture.shape[:2] != (camera.height, camera.width):
        size = f"{picture.shape[1]} x {picture.shape[0]}"
        problem = f"is {size} pixels, the depth pictures are {camera.width} x {camera.height}"
        raise InputError(path, problem, "export it registered to the depth pictures")
    return np.asarray(picture[..., :3] if picture.ndim == 3 else picture)
