"""Parsing recording.json, the format ``rgbd-recording``.

The patient's height where somebody measured it: in recording.json, or told when tracking.

calibration.json, the format ``camera-calibration``: poses of cameras, found once and used for many recordings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.camera import Camera, Intrinsics
from anchorpose.errors import InputError
from anchorpose.recording.document import JsonObject, check_format, read_json_object
from anchorpose.recording.equipment_file import check_relative, is_rotation
from anchorpose.recording.recording import Recording

FARTHEST_CAMERA_M: Final = 100.0
"""A camera stands in the room of its world frame; a larger translation was written in millimetres."""

COARSEST_DEPTH_SCALE_M: Final = 0.1
"""A step of 10 cm resolves no limb; a larger scale means that the unit was mistaken."""

PINHOLE: Final = (0.0, 0.0, 0.0, 0.0, 0.0)
"""What an absent distortion means: the recorder has undistorted its pictures."""

SHORTEST_SUBJECT_M, TALLEST_SUBJECT_M = 0.4, 2.8


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingDocument:
    """What recording.json says, before anything else in the folder is looked at."""

    cameras: tuple[Camera, ...]
    fps: tuple[float | None, ...]  # one a camera; None where timestamps.csv has to give the times
    equipment_file: str | None
    subject_height_m: float | None


def read_recording_document(path: Path) -> RecordingDocument:
    """Checked content of a recording.json; raises InputError naming the file, the key and the remedy.

    ``fps`` stands in a camera, or at the top for all cameras that do not say their own. An absent ``camera_to_world``,
    ``equipment`` or ``subject`` is the same as null: unknown.
    """
    top = read_json_object(path)
    top.only("format", "version", "cameras", "equipment", "subject", "fps")
    check_format(top, "rgbd-recording")
    entries = top.objects("cameras")
    if not entries:
        raise top.refuse("cameras", "is empty", "list at least one camera")
    cameras = tuple(_parse_camera(entry) for entry in entries)
    _check_unique(top, [camera.name for camera in cameras])
    return RecordingDocument(
        cameras=cameras,
        fps=tuple(_fps(entry if entry.has("fps") else top) for entry in entries),
        equipment_file=check_relative(top, "equipment") if top.has("equipment") else None,
        subject_height_m=_parse_subject(top.object("subject")) if top.has("subject") else None,
    )


def _parse_camera(entry: JsonObject) -> Camera:
    entry.only("name", "width", "height", "depth_scale", "intrinsics", "camera_to_world", "fps")
    name = entry.text("name")
    if not re.fullmatch(r"[\w][\w .+-]*", name) or name.endswith((".", " ")):
        raise entry.refuse("name", f"is '{name}'", "it names a folder: use letters, digits, - and _")
    return Camera(
        name=name,
        width=entry.whole_number("width", above=0, at_most=16384, meaning="the width of the pictures in pixels"),
        height=entry.whole_number("height", above=0, at_most=16384, meaning="the height of the pictures in pixels"),
        depth_scale=entry.number(
            "depth_scale",
            above=0,
            at_most=COARSEST_DEPTH_SCALE_M,
            meaning="metres a grey value (0.001 for millimetres)",
        ),
        intrinsics=_parse_intrinsics(entry.object("intrinsics")),
        T_world_camera=parse_pose(entry) if entry.has("camera_to_world") else None,
    )


def _parse_intrinsics(entry: JsonObject) -> Intrinsics:
    entry.only("fx", "fy", "cx", "cy", "distortion")
    focal = "the focal length in pixels"
    principal = "the principal point in pixels"
    distortion = PINHOLE
    if entry.has("distortion"):
        k1, k2, p1, p2, k3 = entry.numbers("distortion", (5,), "OpenCV's k1, k2, p1, p2, k3").tolist()
        distortion = (k1, k2, p1, p2, k3)
    return Intrinsics(
        fx=entry.number("fx", above=0, meaning=focal),
        fy=entry.number("fy", above=0, meaning=focal),
        cx=entry.number("cx", meaning=principal),
        cy=entry.number("cy", meaning=principal),
        distortion=distortion,
    )


def parse_pose(entry: JsonObject) -> np.ndarray:
    """``camera_to_world`` (4, 4), refused unless it is a rigid motion: a scaled or mirrored world measures nothing."""
    pose = entry.numbers("camera_to_world", (4, 4), "four rows of four numbers, or null where the pose is unknown")
    remedy = "write a rotation and a translation in metres with the last row 0 0 0 1, or null to have it estimated"
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9 or not is_rotation(pose[:3, :3]):
        raise entry.refuse("camera_to_world", "is no rigid motion", remedy)
    if np.abs(pose[:3, 3]).max() > FARTHEST_CAMERA_M:
        raise entry.refuse("camera_to_world", f"puts the camera {np.abs(pose[:3, 3]).max():.0f} m away", remedy)
    return pose


def _parse_subject(entry: JsonObject) -> float | None:
    entry.only("height_m")
    if not entry.has("height_m"):
        return None
    return entry.number(
        "height_m", above=SHORTEST_SUBJECT_M, at_most=TALLEST_SUBJECT_M, meaning="the patient's height in metres"
    )


def _fps(entry: JsonObject) -> float | None:
    return entry.number("fps", above=0, at_most=1000, meaning="pictures a second") if entry.has("fps") else None


def _check_unique(top: JsonObject, names: list[str]) -> None:
    folded = [name.casefold() for name in names]  # folder names are the same in either case on some disks
    for index, name in enumerate(names):
        if folded.index(name.casefold()) < index:
            raise top.refuse("cameras", f"has two cameras named '{name}'", "give each camera its own name")


SAME_HEIGHT_M: Final = 0.03  # shoes and the time of day; more is another person, or a slip of the pen


def with_height(recording: Recording, height_m: float | None) -> Recording:
    """The recording with the told height, or its own where none is told.

    Raises InputError where the two contradict each other: nobody can know which one is wrong.
    """
    own_m = recording.subject_height_m
    if height_m is None:
        return recording
    if own_m is not None and abs(own_m - height_m) > SAME_HEIGHT_M:
        raise InputError(
            recording.folder / "recording.json",
            f"says that the patient is {own_m:.2f} m tall, and the told height is {height_m:.2f} m",
            "measure again, and correct the one or leave the other out",
        )
    return replace(recording, subject_height_m=height_m)


CALIBRATION_FORMAT: Final = "camera-calibration"
CALIBRATION_FILE: Final = "calibration.json"


def read_calibration(path: Path) -> dict[str, np.ndarray]:
    """T_world_camera (4, 4) by camera name; raises InputError naming the file, the key and the remedy."""
    top = read_json_object(path / CALIBRATION_FILE if path.is_dir() else path)
    top.only("format", "version", "recording", "cameras", "floor_height_m", "notes", "versions")
    check_format(top, CALIBRATION_FORMAT)
    poses: dict[str, np.ndarray] = {}
    for entry in top.objects("cameras"):
        name = entry.text("name")
        if name in poses:
            raise entry.refuse("name", f"'{name}' stands there twice", "keep one of the two")
        poses[name] = parse_pose(entry)
    return poses


def with_poses(recording: Recording, path: Path) -> Recording:
    """The recording with the poses of a calibration file instead of its own.

    Raises InputError where the file has no pose for one of its cameras: some old and some new poses make no world.
    """
    poses = read_calibration(path)
    missing = [camera.name for camera in recording.cameras if camera.name not in poses]
    if missing:
        remedy = "calibrate a recording of the same cameras, or leave this file out"
        raise InputError(path, f"has no pose for camera {', '.join(missing)}", remedy)
    cameras = tuple(replace(camera, T_world_camera=poses[camera.name]) for camera in recording.cameras)
    return replace(recording, cameras=cameras)
