"""Read and index reference movements. They come from the shipped file, from files that the command ``motions build``
writes, and from the skeletons of other trackers.

A pose vector theta does not depend on where the patient stands or which way the patient faces. The vector has 21 x 3
joint positions relative to SpineBase (the joint at the pelvis) in the trunk's heading frame (X in the direction in
which the trunk faces, Y up, Z to the trunk's right), then 4 numbers for the path. The first three numbers are the
distances that SpineBase has travelled along X, Y and Z of the heading frame, summed over all frames so far; each step
is measured in the heading frame of its moment. The fourth number is the heading in radians, unwrapped. Only differences
of these 4 numbers between frames have a meaning.

A sub-list is a short series of poses in a reference movement. The scaled set D_s (paper, Section V) has the sub-lists
of all movements at several speeds. The poses of D_s are not stored: two numbers describe a sub-list, the place of its
newest pose in the clips and its speed (frames of the clip per frame of the recording). The poses of a sub-list are
interpolated on demand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.recording.regular_file import read_arrays
from anchorpose.recording.writable import whole_file

COMPARED: Final = 3 * JOINT_COUNT
"""Number of columns of a pose vector that measure how similar two poses are."""

# number of successive sub-lists (short series of poses) in a segment. The search for similar sub-lists skips a segment
# if a lower bound for the costs (differences from the patient's last poses) of all its sub-lists is too high. The
# larger the segments, the looser the bounds, and the more sub-lists must be tested
SEGMENT: Final = 4
# number of principal components of the poses from which the lower bounds of the costs are computed; with this number,
# the bounds reach nine tenths of the costs
COLUMNS: Final = 16
_SAMPLES: Final = 5000  # number of poses from which the principal directions are computed

_ROOT: Final = JOINT_INDEX["SpineBase"]
_LEFT: Final = [JOINT_INDEX["HipLeft"], JOINT_INDEX["ShoulderLeft"]]
_RIGHT: Final = [JOINT_INDEX["HipRight"], JOINT_INDEX["ShoulderRight"]]


class SubLists(NamedTuple):
    """All w sub-lists (short series of poses); sub-lists of the same clip and speed are contiguous, in the order of
    time.
    """

    place: np.ndarray  # (w,) float64, row of ``theta`` at which the newest pose is, possibly between two rows
    stride: np.ndarray  # (w,) float64, number of rows of ``theta`` per frame of the recording
    followed: np.ndarray  # (w,) int32, number of frames of the recording from the newest pose to the clip's end
    summary: np.ndarray  # (w, 2, COLUMNS) float32, mean pose and displacement of each sub-list, as from ``summarise``
    # (s + 1,) int64, index of the first sub-list of each segment (group of neighbours); last entry: w
    segment: np.ndarray
    centre: np.ndarray  # (s, 2, COLUMNS) float32, mean of the summaries in each segment
    radius: np.ndarray  # (s, 2) float32, maximum distances of a segment's mean poses and displacements from its centre


@dataclass(frozen=True, slots=True, eq=False)
class MotionDatabase:
    """The reference movements (D in the paper), one after another in ``theta``, and the sub-lists (short series of
    poses) of these movements at several speeds (D_s in the paper).
    """

    theta: np.ndarray  # (n, d) float32, pose vectors of all clips at their recorded rates
    # number of leading columns of a pose vector that are compared to find similar poses; the other columns (the path)
    # are only predicted
    compared: int
    turned: np.ndarray  # (n, compared) float32 = theta[:, :compared] @ basis; poses differ mostly in its first columns
    basis: np.ndarray  # (compared, compared) orthonormal, principal directions of the poses
    sublists: SubLists


def pose_vectors(joints_m: np.ndarray) -> np.ndarray:
    """Return the pose vectors (t, 67) float64 of successive frames' joints (t, 21, 3), world, metres; NaN stays NaN."""
    heading = _steady(heading_rad(joints_m))
    root = joints_m[:, _ROOT]
    relative = _turned(joints_m - root[:, None], -heading)
    steps = _turned(np.diff(root, axis=0)[:, None], -heading[:-1])[:, 0]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return np.concatenate([relative.reshape(len(joints_m), -1), path, heading[:, None]], axis=1)


def _steady(heading_rad: np.ndarray) -> np.ndarray:
    """Return the trunk's headings (t,) without jumps by half a turn. If a person rolls over on the side, the line
    between the shoulders turns vertical and the heading jumps by half a turn. Such a jump is removed, since nobody
    turns so far from one frame to the next. NaN stays NaN.
    """
    steady, known = heading_rad.copy(), np.isfinite(heading_rad)
    steady[known] = np.unwrap(heading_rad[known], period=np.pi)
    return steady


def joints_after(last_m: np.ndarray, last_theta: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return the world joints (steps, 21, 3) of the pose vectors ``theta`` (steps, 67). The poses follow a frame with
    the joints ``last_m`` (21, 3) and the pose vector ``last_theta``.
    """
    headings = theta[:, -1]
    before = np.concatenate([last_theta[-1:], headings[:-1]])
    steps = np.diff(np.concatenate([last_theta[None, -4:-1], theta[:, -4:-1]]), axis=0)
    root = last_m[_ROOT] + np.cumsum(_turned(steps[:, None], before)[:, 0], axis=0)
    relative = theta[:, :COMPARED].reshape(-1, JOINT_COUNT, 3)
    return _turned(relative, headings) + root[:, None]


def heading_rad(joints_m: np.ndarray) -> np.ndarray:
    """Return the angle (t,) about Y from world X to the trunk's heading. The heading is horizontal, and perpendicular
    to the sum of two vectors: from the left to the right hip, and from the left to the right shoulder. A single known
    vector is enough; the angle is NaN if both are unknown.
    """
    across = joints_m[:, _RIGHT] - joints_m[:, _LEFT]
    across = np.where(np.isfinite(across).all(axis=(2,), keepdims=True), across, 0.0).sum(axis=1)
    unknown = np.linalg.norm(across[:, [0, 2]], axis=1) == 0.0
    return np.where(unknown, np.nan, np.arctan2(across[:, 0], across[:, 2]))


def _turned(vectors: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Return the vectors (t, n, 3) turned about Y by one angle (t,) per frame."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack([cos * x + sin * z, y, cos * z - sin * x], axis=-1)


def build_database(
    clips: Sequence[np.ndarray],
    rate_hz: Sequence[float],
    at_hz: float,
    compared: int,
    speeds: Sequence[float],
    history: int,
    past: int,
) -> MotionDatabase:
    """Build the set D_s of sub-lists (short series of poses) from clips of pose vectors, (n_i, d) each, for a recording
    of ``at_hz`` frames per second. rate_hz: frames per second of each clip.

    compared: number of leading columns of a pose vector that are compared to find similar poses; speeds: factors on the
    speed of the clips; history: number of poses of a sub-list; past: number of frames that a clip must have before the
    newest pose of a sub-list (at least ``history`` - 1). Raises ValueError if a clip has missing values, or if no clip
    has more than ``past`` + 1 frames at any speed.
    """
    if any(not np.isfinite(clip).all() for clip in clips):
        raise ValueError("a clip of the motion database has missing values; cut it there")
    start = np.cumsum([0, *(len(clip) for clip in clips)])
    runs = []
    for first, end, rate in zip(start[:-1], start[1:], rate_hz, strict=True):
        for speed in speeds:
            stride = speed * rate / at_hz
            frames = int((end - 1 - first) / stride + 1e-9) + 1
            if frames > past + 1:
                runs.append((first, stride, frames))
    if not runs:
        raise ValueError(f"no clip of the motion database is longer than {past + 1} frames")
    theta = np.concatenate(clips).astype(np.float32)
    basis = _principal(theta[:, :compared])
    turned = theta[:, :compared] @ basis
    return MotionDatabase(theta, compared, turned, basis, _list(runs, turned, history, past))


def poses_at(theta: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the rows (..., d) of ``theta`` with the row numbers ``place`` (...); a row number with a fraction is
    interpolated linearly between two rows.
    """
    low = place.astype(np.int64)
    share = (place - low)[..., None].astype(np.float32)
    return theta[low] * (1.0 - share) + theta[np.minimum(low + 1, len(theta) - 1)] * share


def summarise(turned: np.ndarray, place: np.ndarray, stride: np.ndarray, history: int) -> np.ndarray:
    """Return, for each of w runs of ``history`` successive poses, the mean pose and the displacement from the oldest to
    the newest pose: (w, 2, COLUMNS) float32. turned: poses along their principal directions, as in ``MotionDatabase``;
    only the first ``COLUMNS`` columns are used.
    """
    leading = turned[:, :COLUMNS].astype(np.float32)
    total = poses_at(leading, place)
    moved = total.copy()
    for back in range(1, history):
        pose = poses_at(leading, place - back * stride)
        total += pose
    return np.stack([total / np.float32(history), moved - pose], axis=1)


def _principal(poses: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (d, d) float32 of principal directions, by decreasing variance of the poses."""
    some = poses[:: max(1, len(poses) // _SAMPLES)].astype(np.float64)
    apart = some - some.mean(axis=0)
    return np.linalg.eigh(apart.T @ apart)[1][:, ::-1].astype(np.float32)


def _list(runs: Sequence[tuple[int, float, int]], turned: np.ndarray, history: int, past: int) -> SubLists:
    """List the sub-lists of all runs; a run is a clip at a certain speed. runs: for each run, its first row, its rows
    per frame, and its number of frames.
    """
    place, stride, followed, segment = [], [], [], [np.zeros(1, dtype=np.int64)]
    listed = 0
    for first, rows, frames in runs:
        newest = np.arange(past, frames - 1)
        place.append(first + newest * rows)
        stride.append(np.full(len(newest), rows))
        followed.append(frames - 1 - newest)
        listed += len(newest)
        segment.append(np.append(np.arange(listed - len(newest), listed, SEGMENT)[1:], listed))
    places, strides, begins = np.concatenate(place), np.concatenate(stride), np.concatenate(segment)
    summary = summarise(turned, places, strides, history)
    centre, radius = _enclose(summary, begins)
    return SubLists(places, strides, np.concatenate(followed).astype(np.int32), summary, begins, centre, radius)


def _enclose(summary: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each segment of sub-lists, the mean of its summaries (mean pose and displacement of each sub-list),
    and the maximum distances of the mean poses and of the displacements from this mean.
    """
    size = np.diff(segment)
    centre = (np.add.reduceat(summary, segment[:-1], axis=0) / size[:, None, None]).astype(np.float32)
    away = np.linalg.norm(summary - np.repeat(centre, size, axis=0), axis=2)
    return centre, np.maximum.reduceat(away, segment[:-1], axis=0).astype(np.float32)


SHIPPED: Final = Path(__file__).parent / "data" / "motions.npz"
"""Movements of simulated people in stand training; written by ``tools/build_motion_database.py``."""

FORMAT: Final = "anchorpose-motions 1"
_MOTION_ARRAYS: Final = ("joints_mm", "start", "names", "rate_hz", "notes")
MOTION_REMEDY: Final = "give a file made by 'anchorpose motions build'"

_SKELETON_ARRAYS: Final = ("joints_mm", "offsets", "names", "joint_names", "rate_hz")
_SKELETON_REMEDY: Final = (
    "give joints_mm (frames, joints, 3) with Y up, offsets (clips + 1), names (clips) and joint_names (joints)"
)
# mm, maximum coordinate of a joint relative to the first joint in the clip's first frame; a file with a larger value is
# refused, since it is probably not in mm
FARTHEST_MM: Final = 10_000

_TRUNK: Final = {"SpineBase": "Waist", "SpineMid": "Spine", "SpineShoulder": "Chest"}
_LIMBS: Final = {
    "Shoulder": "UpperArm",
    "Elbow": "Forearm",
    "Wrist": "Hand",
    "Hip": "UpperLeg",
    "Knee": "LowerLeg",
    "Ankle": "Foot",
    "Foot": "Toes",
}
BONE_BEGINNING_AT: Final = _TRUNK | {
    f"{joint}{side}": f"{side[0]}{bone}" for joint, bone in _LIMBS.items() for side in ("Left", "Right")
}
"""The bone that begins at each joint; UI-PRMD names joints by these bones."""

DERIVED: Final = {
    "HandLeft": ("ElbowLeft", "WristLeft", 1.15),
    "HandRight": ("ElbowRight", "WristRight", 1.15),
    "Neck": ("SpineShoulder", "Head", 0.31),
}
"""Joints that a file may lack. Each of them is placed on the line through two other joints, at the stated share of the
way from the first to the second joint. The shares were measured on the mean adult of the shipped body model.
"""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceClips:
    """Movements without gaps, each with a name and a rate."""

    joints_m: tuple[np.ndarray, ...]  # (n_i, 21, 3) metres each, Y up, at any place and with any heading
    names: tuple[str, ...]
    rate_hz: tuple[float, ...]
    notes: tuple[str, ...] = ()  # sentences about the source of the clips, and about derived or omitted joints

    @property
    def frame_count(self) -> int:
        """Return the number of frames of all clips together."""
        return sum(len(clip) for clip in self.joints_m)


def join_clips(parts: Sequence[ReferenceClips]) -> ReferenceClips:
    """Join the clips of all parts, in the order given."""
    return ReferenceClips(
        tuple(clip for part in parts for clip in part.joints_m),
        tuple(name for part in parts for name in part.names),
        tuple(rate for part in parts for rate in part.rate_hz),
        tuple(note for part in parts for note in part.notes),
    )


def write_motions(path: Path, clips: ReferenceClips) -> None:
    """Write the clips in mm, each shifted so that SpineBase begins at the origin; ``path`` is either completely written
    or unchanged.
    """
    root = JOINT_INDEX["SpineBase"]
    millimetres = [np.rint(1000.0 * (clip - clip[0, root])).astype(np.int16) for clip in clips.joints_m]
    with whole_file(path) as partial, partial.open("wb") as stream:
        np.savez_compressed(
            stream,
            format=np.array(FORMAT),
            joints_mm=np.concatenate(millimetres),
            start=np.cumsum([0, *(len(clip) for clip in millimetres)]),
            names=np.array(clips.names),
            rate_hz=np.array(clips.rate_hz, dtype=np.float64),
            notes=np.array(clips.notes, dtype=np.str_),
        )


def read_motions(path: Path) -> ReferenceClips:
    """Read a file that ``write_motions`` wrote; raises InputError for any other file."""
    arrays = read_arrays(path, ("format", *_MOTION_ARRAYS), MOTION_REMEDY)
    missing = [name for name in ("format", *_MOTION_ARRAYS) if name not in arrays]
    if missing or str(arrays["format"]) != FORMAT:
        raise InputError(path, "is not a file of reference movements", MOTION_REMEDY)
    joints, start, names, rate_hz, notes = (arrays[name] for name in _MOTION_ARRAYS)
    fits = joints.ndim == 3 and joints.shape[1:] == (JOINT_COUNT, 3) and joints.dtype == np.int16
    if not fits or len(start) != len(names) + 1 or rate_hz.shape != names.shape or not (rate_hz > 0).all():
        raise InputError(path, "its arrays do not fit together", MOTION_REMEDY)
    if start[0] != 0 or start[-1] != len(joints) or not (np.diff(start) > 0).all():
        raise InputError(path, "its clips do not follow one another", MOTION_REMEDY)
    return ReferenceClips(
        tuple(np.split(joints / 1000.0, start[1:-1])),
        tuple(str(name) for name in names),
        tuple(float(rate) for rate in rate_hz),
        tuple(str(note) for note in notes),
    )


def read_skeletons(path: Path, rate_hz: float | None) -> ReferenceClips:
    """Read the clips of a skeleton file and convert them to the 21 joints in ``JOINT_NAMES``.

    rate_hz: frames per second, if the file has no ``rate_hz``. A joint of the file is found by its name in
    ``JOINT_NAMES``, or by the name of the bone that begins at the joint. Hands or neck that the file lacks are derived
    from other joints; a note then names them. Raises InputError if a joint is missing or the file is not valid.
    """
    arrays = read_arrays(path, _SKELETON_ARRAYS, _SKELETON_REMEDY)
    missing = [name for name in _SKELETON_ARRAYS[:-1] if name not in arrays]
    if missing:
        raise InputError(path, f"has no array '{missing[0]}'", _SKELETON_REMEDY)
    joints, offsets, names, columns = (arrays[name] for name in _SKELETON_ARRAYS[:-1])
    _check_skeletons(path, joints, offsets, len(names), len(columns))
    own, derived = _in_our_joints(path, joints.astype(np.float64), [str(name) for name in columns])
    clips = np.split(own, offsets[1:-1])
    if max(float(np.abs(clip - clip[0, :1]).max()) for clip in clips) > FARTHEST_MM:
        raise InputError(path, "has joints more than 10 m from where their clip begins", "write them in millimetres")
    rate = _rate(path, arrays.get("rate_hz"), rate_hz)
    note = f"{path.name}: {len(clips)} clips, {len(own)} frames at {rate:g} Hz"
    if derived:
        note += f"; derived, since the file has none: {', '.join(derived)}"
    return ReferenceClips(
        tuple(clip / 1000.0 for clip in clips), tuple(str(name) for name in names), (rate,) * len(clips), (note,)
    )


def _check_skeletons(path: Path, joints: np.ndarray, offsets: np.ndarray, clips: int, columns: int) -> None:
    if joints.ndim != 3 or joints.shape[1:] != (columns, 3) or joints.dtype.kind not in "iuf":
        raise InputError(path, f"its joints_mm {joints.shape} do not fit {columns} joint names", _SKELETON_REMEDY)
    whole = offsets.ndim == 1 and offsets.dtype.kind in "iu" and len(offsets) == clips + 1 > 1
    if not whole or offsets[0] != 0 or offsets[-1] != len(joints) or not (np.diff(offsets) > 0).all():
        raise InputError(
            path, "its offsets do not cut the frames into as many clips as there are names", _SKELETON_REMEDY
        )
    if not np.isfinite(joints).all():
        raise InputError(path, "has joints that are not numbers", "cut the clips there")


def _in_our_joints(path: Path, joints: np.ndarray, columns: list[str]) -> tuple[np.ndarray, list[str]]:
    """Return the 21 joints (n, 21, 3) in the order of ``JOINT_NAMES``, and the names of the joints that were derived
    from other joints (``DERIVED``).
    """
    found: dict[str, np.ndarray] = {}
    for name in JOINT_NAMES:
        # a file may name a joint as this project does, or by the bone that begins at the joint, as the data set UI-PRMD
        # does: its LHand is the left wrist; Neck and Head have the same names in both
        for known in (name, BONE_BEGINNING_AT.get(name)):
            if known in columns and name not in found:
                found[name] = joints[:, columns.index(known)]
    derived = [name for name in DERIVED if name not in found]
    for name in derived:
        start, end, share = DERIVED[name]
        if start in found and end in found:
            found[name] = found[start] + share * (found[end] - found[start])
    lacking = [name for name in JOINT_NAMES if name not in found]
    if lacking:
        remedy = f"name a joint {lacking[0]}" + (
            f" or {BONE_BEGINNING_AT[lacking[0]]}" if lacking[0] in BONE_BEGINNING_AT else ""
        )
        raise InputError(path, f"has no joint for {', '.join(lacking)}", remedy)
    return np.stack([found[name] for name in JOINT_NAMES], axis=1), derived


def _rate(path: Path, stored: np.ndarray | None, given: float | None) -> float:
    if stored is not None:
        if stored.size != 1 or not np.isfinite(stored).all() or not float(stored.ravel()[0]) > 0:
            raise InputError(path, "its rate_hz is not one number above 0", "write the frames per second")
        return float(stored.ravel()[0])
    if given is None:
        raise InputError(path, "does not state how many frames per second it has", "give --rate, for example --rate 30")
    return given
