"""Read labels (pixels of joints, set by eye in real depth images); compare two labellers' labels with each other, or
labels with tracked joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.document import read_json
from anchorpose.results.tables import JointTable

LABELLERS: Final = ("first", "second")
# px, distance from a label to the outermost rows and columns of a square; the median depth in this square counts as the
# depth of the skin
PATCH_PX: Final = 3
# m, maximum distances of a tracked joint in front of and behind the skin at the joint's label; a farther joint counts
# as lost
IN_FRONT_M, BEHIND_M = 0.10, 0.35
TRUNK: Final = ("SpineShoulder", "SpineBase")
BY_PROPORTION: Final = frozenset({"SpineShoulder", "SpineBase", "HipLeft", "HipRight"})
"""Joints that clothes hide. Two labellers estimated the positions of these joints from the body's proportions; the
labels of the two differ by up to 12 cm.
"""
DEEP_M: Final = 0.10  # m, distance from the trunk's seen skin to its axis, which lies behind the skin


@dataclass(frozen=True, slots=True)
class LabelledPerson:
    """The labels of one person in one frame."""

    person: str
    plain: bool  # whether the person is in plain view: head and more than half of the trunk are seen
    box: tuple[float, float, float, float]  # box around the person: first column, first row, last column, last row
    joints: dict[str, tuple[float, float]]  # (column, row) by name of the joint, only for seen joints
    unclear: frozenset[str] = frozenset()  # joints whose labels are uncertain


Frames = dict[int, tuple[LabelledPerson, ...]]


def labelled_recordings(folder: Path) -> list[str]:
    """Return the names of all recordings that have a file of labels of their own. folder: the folder benchmarks/labels,
    as in ``read_labels``.
    """
    names = sorted(path.name.split(".")[0] for path in folder.glob(f"*.{LABELLERS[0]}.json"))
    return [name for name in names if "frames" in _document(folder, name, LABELLERS[0])]


def read_labels(folder: Path, recording: str, labeller: str) -> Frames:
    """Return the people that one of ``LABELLERS`` labelled, by number of the frame. folder: benchmarks/labels."""
    return _frames(_document(folder, recording, labeller)["frames"])


def read_label_set(folder: Path, name: str, labeller: str) -> dict[str, Frames]:
    """Return the labelled frames by name of the recording, from one file with the labels of several recordings."""
    return {recording: _frames(frames) for recording, frames in _document(folder, name, labeller)["recordings"].items()}


def _document(folder: Path, name: str, labeller: str) -> dict[str, Any]:
    document: dict[str, Any] = read_json(folder / f"{name}.{labeller}.json")
    return document


def _frames(frames: dict[str, Any]) -> Frames:
    return {int(frame): tuple(_person(entry) for entry in entries) for frame, entries in frames.items()}


def _person(entry: dict[str, Any]) -> LabelledPerson:
    joints = {name: (float(c), float(r)) for name, (c, r) in entry.get("joints", {}).items()}
    c0, r0, c1, r1 = entry["box"]
    unclear = frozenset(entry.get("unclear", ()))
    return LabelledPerson(entry["person"], bool(entry.get("plain")), (c0, r0, c1, r1), joints, unclear)


def skin_depth_m(depth_m: np.ndarray, place: tuple[float, float]) -> float:
    """Return the median depth in metres around a pixel (column, row); NaN without readings there."""
    column, row = (round(value) for value in place)
    patch = depth_m[max(row - PATCH_PX, 0) : row + PATCH_PX + 1, max(column - PATCH_PX, 0) : column + PATCH_PX + 1]
    read = patch[patch > 0]
    return float(np.median(read)) if read.size else float("nan")


def place_of(person: LabelledPerson, depth_m: np.ndarray, camera: Camera) -> np.ndarray | None:
    """Return the position (3,), metres, world, of the middle of a labelled trunk; None if no joint of ``TRUNK`` has
    both a label and a depth reading.
    """
    found = []
    for name in TRUNK:
        if name in person.joints and np.isfinite(z := skin_depth_m(depth_m, person.joints[name])):
            column, row = person.joints[name]
            lens = camera.intrinsics
            ray = np.array([(column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy, 1.0])
            found.append(transform_points(camera.require_pose(), ray * (z + DEEP_M)))
    return np.mean(found, axis=0) if found else None


def off_m(person: LabelledPerson, joints_m: np.ndarray, depth_m: np.ndarray, camera: Camera) -> dict[str, float]:
    """Return, for each labelled joint, the distance (m) of the tracked joint from the label, perpendicular to the line
    of sight.

    joints_m (21, 3): tracked joints, world. The distance is inf if the tracked joint is lost, or too far in front of or
    behind the labelled skin (``IN_FRONT_M``, ``BEHIND_M``). Joints that clothes hide (``BY_PROPORTION``), and labels
    without a depth reading, are left out.
    """
    distances = {}
    for name, (right, down, behind) in shift_m(person, joints_m, depth_m, camera).items():
        near = np.isfinite(behind) and -IN_FRONT_M < behind < BEHIND_M
        distances[name] = float(np.hypot(right, down)) if near else float("inf")
    return distances


def shift_m(person: LabelledPerson, joints_m: np.ndarray, depth_m: np.ndarray, camera: Camera) -> dict[str, np.ndarray]:
    """Return, for each labelled joint, the position of the tracked joint relative to the label: to the right, down and
    behind, (3,) metres.

    joints_m (21, 3): tracked joints, world. A lost joint gives NaN. The label is taken as a point on the skin. Joints
    that clothes hide (``BY_PROPORTION``), and labels without a depth reading, are left out.
    """
    T_camera_world, lens = invert_rigid(camera.require_pose()), camera.intrinsics
    shifts = {}
    for name, (column, row) in person.joints.items():
        skin_m = skin_depth_m(depth_m, (column, row))
        if name in BY_PROPORTION or not np.isfinite(skin_m):
            continue
        x, y, z = transform_points(T_camera_world, joints_m[JOINT_INDEX[name]])
        right, down = x / z + (lens.cx - column) / lens.fx, y / z + (lens.cy - row) / lens.fy
        shifts[name] = np.array([right * skin_m, down * skin_m, z - skin_m])
    return shifts


def apart_m(one: LabelledPerson, other: LabelledPerson, depth_m: np.ndarray, camera: Camera) -> dict[str, float]:
    """Return, for each joint that both ``one`` and ``other`` label, the distance (m) between the two labels, at the
    depth of the skin at the label of ``one``. Joints that clothes hide (``BY_PROPORTION``), and labels of ``one``
    without a depth reading, are left out.
    """
    lens = camera.intrinsics
    return {
        name: float(np.hypot((c - other.joints[name][0]) / lens.fx, (r - other.joints[name][1]) / lens.fy) * z)
        for name, (c, r) in one.joints.items()
        if name in other.joints and name not in BY_PROPORTION and np.isfinite(z := skin_depth_m(depth_m, (c, r)))
    }


def trunk_pixel(table: JointTable, row: int, camera: Camera) -> np.ndarray | None:
    """Return (3,) column, row and depth (m) of the tracked trunk's middle; None if a joint of ``TRUNK`` is lost, or if
    the middle is not in front of the camera.
    """
    middle = table.position_m[row, [JOINT_INDEX[name] for name in TRUNK]].mean(axis=0)
    if not np.isfinite(middle).all():
        return None
    x, y, z = transform_points(invert_rigid(camera.require_pose()), middle)
    lens = camera.intrinsics
    return np.array([lens.fx * x / z + lens.cx, lens.fy * y / z + lens.cy, z]) if z > 0 else None


def within(box: tuple[float, float, float, float], place: np.ndarray) -> bool:
    """Return whether a pixel lies in a box."""
    return bool(box[0] <= place[0] <= box[2] and box[1] <= place[1] <= box[3])
