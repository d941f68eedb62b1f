"""Compare joints labelled in depth images with tracked joints, in the plane of the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, LOST, JointState
from anchorpose.recording.document import read_rows
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Clock, DepthStream, Recording, half_period_s, nearest_within
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.verify import require_own
from anchorpose.settings import LARGEST

HEAD: Final = ["camera", "frame", "joint", "u", "v"]
REMEDY: Final = "give rows camera,frame,joint,u,v with the column u and the row v of the joint in the image"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageErrors:
    """Distances between labelled and tracked joints in the plane of the image, for one joint or a group of joints
    (``name``); fields of distances are None if no distance is known.

    labelled: number of labels in tracked frames; lost: number of these labels for which no distance is known, usually
    because the joint was lost. Pixels are converted to millimetres at the depth of the tracked joint. within_50,
    within_100: share of all labels whose distance is at most 50 or 100 mm; labels without a distance count as farther
    away.
    """

    name: str
    labelled: int
    lost: int
    median_px: float | None
    median_mm: float | None
    p95_mm: float | None
    within_50: float | None
    within_100: float | None


@dataclass(frozen=True, slots=True)
class _Label:
    camera: str
    frame: int
    joint: str
    pixel: tuple[float, float]


def evaluate_labels(results: Path, recording: Path, labels: Path) -> tuple[ImageErrors, ...]:
    """Return the errors of all joints together, of observed and of inferred joints, and of each labelled joint.

    Raises InputError if a file cannot be used, or no labelled frame is among the results.
    """
    require_own(results, (JOINTS_FILE,))
    rows, joints = _read_labels(labels), read_joints(results / JOINTS_FILE)
    views = _views(results, open_recording(recording))
    found = list[_Distance]()
    for label in rows:
        if label.camera not in views:
            remedy = f"the results have poses of {', '.join(sorted(views)) or 'no camera of this recording'}"
            raise InputError(labels, f"names camera '{label.camera}', which has no pose in {results}", remedy)
        camera, stream = views[label.camera]
        image = np.flatnonzero(stream.frame == label.frame)
        row = nearest_within(stream.time_s[image], joints.time_s, half_period_s(joints.time_s)) if len(image) else image
        if len(row) and row[0] >= 0:
            found.append(_distance(camera, joints, int(row[0]), label))
    if not found:
        raise InputError(labels, "labels no frame of these results", "give the labels of that recording")
    return _groups(found)


class _Distance(NamedTuple):
    """The distance between one label and its tracked joint; pixels and millimetres are NaN if the joint was lost or
    cannot be projected to the image.
    """

    joint: str
    state: int
    pixels: float
    mm: float


def _views(results: Path, recording: Recording) -> dict[str, tuple[Camera, DepthStream]]:
    """Return, by camera name, each camera with the pose that tracking used, and the camera's images with their times on
    the clock of the results; cameras without a pose in run.json are left out.
    """
    records = {str(each["name"]): each for each in read_run(results / RUN_FILE).get("cameras", [])}
    found = {}
    for camera, stream in zip(recording.cameras, recording.streams, strict=True):
        record = records.get(camera.name, {})
        if record.get("camera_to_world") is not None:
            placed = replace(camera, T_world_camera=np.array(record["camera_to_world"], dtype=np.float64))
            clock = Clock(**(record.get("clock") or {}))
            found[camera.name] = placed, replace(stream, time_s=clock.reference_s(stream.time_s))
    return found


def _distance(camera: Camera, joints: JointTable, row: int, label: _Label) -> _Distance:
    column = JOINT_INDEX[label.joint]
    point = transform_points(invert_rigid(camera.require_pose()), joints.position_m[row, column])
    pixels = float(np.linalg.norm(camera.project(point[None])[0] - label.pixel))
    focal = 0.5 * float(camera.intrinsics.matrix[0, 0] + camera.intrinsics.matrix[1, 1])
    return _Distance(
        label.joint, int(joints.state_code[row, column]), pixels, 1000.0 * pixels * float(point[2]) / focal
    )


def _groups(found: list[_Distance]) -> tuple[ImageErrors, ...]:
    seen = [row for row in found if row.state == 0]
    inferred = [row for row in found if 0 < row.state < LOST]
    named = [(name, [row for row in found if row.joint == name]) for name in JOINT_NAMES]
    groups = [("all joints", found), (str(JointState.OBSERVED), seen), ("inferred", inferred), *named]
    return tuple(_summary(name, rows) for name, rows in groups if rows)


def _summary(name: str, rows: list[_Distance]) -> ImageErrors:
    numbers = np.array([row[2:] for row in rows])
    known = numbers[np.isfinite(numbers[:, 0])]
    some = len(known) > 0
    return ImageErrors(
        name=name,
        labelled=len(rows),
        lost=len(rows) - len(known),
        median_px=float(np.median(known[:, 0])) if some else None,
        median_mm=float(np.median(known[:, 1])) if some else None,
        p95_mm=float(np.percentile(known[:, 1], 95)) if some else None,
        within_50=float((known[:, 1] <= 50.0).sum() / len(rows)),
        within_100=float((known[:, 1] <= 100.0).sum() / len(rows)),
    )


def _read_labels(path: Path) -> list[_Label]:
    rows = read_rows(path)
    if not rows or [cell.lower() for cell in rows[0][1]] != HEAD:
        raise InputError(path, f"does not begin with the line {','.join(HEAD)}", REMEDY)
    found = []
    for number, row in rows[1:]:
        try:
            camera, frame, joint, u, v = row
            label = _Label(camera, int(frame), joint, (float(u), float(v)))
        except ValueError:
            raise InputError(path, f"line {number} is not camera,frame,joint,u,v", REMEDY) from None
        if joint not in JOINT_INDEX or not np.abs(label.pixel).max() <= LARGEST:
            raise InputError(path, f"line {number} names the joint '{joint}' at {u}, {v}", REMEDY)
        found.append(label)
    if not found:
        raise InputError(path, "holds no labels", REMEDY)
    return found
