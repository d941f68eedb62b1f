"""Files of reference movements: the shipped one, those of ``motions build``, and skeletons of other trackers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.motion.database import MotionDatabase
from anchorpose.motion.prediction import MotionConfig, joint_database
from anchorpose.recording.regular_file import read_arrays
from anchorpose.recording.writable import whole_file

SHIPPED: Final = Path(__file__).parent / "data" / "motions.npz"
"""Movements of stand training by the simulator's people; made by ``tools/build_motion_database.py``."""

FORMAT: Final = "anchorpose-motions 1"
_MOTION_ARRAYS: Final = ("joints_mm", "start", "names", "rate_hz", "notes")
_MOTION_REMEDY: Final = "give a file made by 'anchorpose motions build'"

_SKELETON_ARRAYS: Final = ("joints_mm", "offsets", "names", "joint_names", "rate_hz")
_SKELETON_REMEDY: Final = (
    "give joints_mm (frames, joints, 3) with Y up, offsets (clips + 1), names (clips) and joint_names (joints)"
)
FARTHEST_MM: Final = 10_000  # from where a clip begins: beyond, the unit is not the millimetre

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
"""The bone that begins at a joint: joints of UI-PRMD have these names."""

DERIVED: Final = {
    "HandLeft": ("ElbowLeft", "WristLeft", 1.15),
    "HandRight": ("ElbowRight", "WristRight", 1.15),
    "Neck": ("SpineShoulder", "Head", 0.31),
}
"""Joints that a file may lack: how far from the first towards the second one they lie, on the shipped mean adult."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceClips:
    """Movements without gaps: joints_m (n_i, 21, 3) metres, Y up, any place and heading, each with a name and a rate.

    notes: sentences on where they come from, and what of them was derived or left out.
    """

    joints_m: tuple[np.ndarray, ...]
    names: tuple[str, ...]
    rate_hz: tuple[float, ...]
    notes: tuple[str, ...] = ()

    @property
    def frame_count(self) -> int:
        """Frames of all clips."""
        return sum(len(clip) for clip in self.joints_m)


def join_clips(parts: Sequence[ReferenceClips]) -> ReferenceClips:
    """All clips in one, in order."""
    return ReferenceClips(
        tuple(clip for part in parts for clip in part.joints_m),
        tuple(name for part in parts for name in part.names),
        tuple(rate for part in parts for rate in part.rate_hz),
        tuple(note for part in parts for note in part.notes),
    )


def write_motions(path: Path, clips: ReferenceClips) -> None:
    """Writes the clips to the millimetre, each beside the origin; ``path`` is whole or as it was before."""
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
    """The clips of a file that ``write_motions`` wrote; raises InputError where it is not such a file."""
    arrays = read_arrays(path, ("format", *_MOTION_ARRAYS), _MOTION_REMEDY)
    missing = [name for name in ("format", *_MOTION_ARRAYS) if name not in arrays]
    if missing or str(arrays["format"]) != FORMAT:
        raise InputError(path, "is not a file of reference movements", _MOTION_REMEDY)
    joints, start, names, rate_hz, notes = (arrays[name] for name in _MOTION_ARRAYS)
    fits = joints.ndim == 3 and joints.shape[1:] == (JOINT_COUNT, 3) and joints.dtype == np.int16
    if not fits or len(start) != len(names) + 1 or rate_hz.shape != names.shape or not (rate_hz > 0).all():
        raise InputError(path, "its arrays do not fit together", _MOTION_REMEDY)
    if start[0] != 0 or start[-1] != len(joints) or not (np.diff(start) > 0).all():
        raise InputError(path, "its clips do not follow one another", _MOTION_REMEDY)
    return ReferenceClips(
        tuple(np.split(joints / 1000.0, start[1:-1])),
        tuple(str(name) for name in names),
        tuple(float(rate) for rate in rate_hz),
        tuple(str(note) for note in notes),
    )


def load_motions(path: Path, at_hz: float, config: MotionConfig) -> MotionDatabase | None:
    """The database for a recording of ``at_hz``; None, unread, where the rule needs none. Raises InputError."""
    if not config.uses_database:
        return None
    clips = read_motions(path)
    try:
        return joint_database(clips.joints_m, clips.rate_hz, at_hz, config)
    except ValueError as error:
        raise InputError(path, f"cannot be used at {at_hz:.3g} frames per second ({error})", _MOTION_REMEDY) from None


def read_skeletons(path: Path, rate_hz: float | None) -> ReferenceClips:
    """The clips of a skeleton file, in our joints.

    rate_hz: frames per second where the file has no ``rate_hz``. Joints are found by our names or by those of the
    bones that begin there; hands and neck may be derived, which a note says. Raises InputError where a joint is missing
    and for anything that does not fit.
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
    """(n, 21, 3) and the names of the joints that were derived."""
    found: dict[str, np.ndarray] = {}
    for name in JOINT_NAMES:
        # a column called Neck or Head is ours by either naming; LHand is where the hand begins, so the wrist
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
