"""Skeletons of other trackers as reference movements: an .npz of clips, its joints taken over by name."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.tracking.motion_file import ReferenceClips, read_arrays

_ARRAYS: Final = ("joints_mm", "offsets", "names", "joint_names", "rate_hz")
_REMEDY: Final = (
    "give joints_mm (frames, joints, 3) with Y up, offsets (clips + 1), names (clips) and joint_names (joints)"
)
FARTHEST_MM: Final = 10_000  # from where a clip begins: beyond, the unit is not the millimetre

_TRUNK: Final = {"SpineBase": "Waist", "SpineMid": "Spine", "SpineShoulder": "Chest"}
_LIMBS: Final = {
    "Shoulder": "UpperArm", "Elbow": "Forearm", "Wrist": "Hand", "Hip": "UpperLeg", "Knee": "LowerLeg",
    "Ankle": "Foot", "Foot": "Toes",
}  # fmt: skip
BONE_BEGINNING_AT: Final = _TRUNK | {
    f"{joint}{side}": f"{side[0]}{bone}" for joint, bone in _LIMBS.items() for side in ("Left", "Right")
}
"""What the joint is called where joints bear the name of the bone that begins there, as in UI-PRMD."""

DERIVED: Final = {
    "HandLeft": ("ElbowLeft", "WristLeft", 1.15),
    "HandRight": ("ElbowRight", "WristRight", 1.15),
    "Neck": ("SpineShoulder", "Head", 0.31),
}
"""Joints that a file may lack: how far from the first towards the second one they lie, on the shipped mean adult."""


def read_skeletons(path: Path, rate_hz: float | None) -> ReferenceClips:
    """The clips of a skeleton file, in our joints.

    rate_hz: frames a second where the file has no ``rate_hz`` itself. Joints are found by our names or by those of the
    bones that begin there; hands and neck may be derived, which a note says. Raises InputError where a joint is missing
    and for anything that does not fit.
    """
    arrays = read_arrays(path, _ARRAYS, _REMEDY)
    missing = [name for name in _ARRAYS[:-1] if name not in arrays]
    if missing:
        raise InputError(path, f"has no array '{missing[0]}'", _REMEDY)
    joints, offsets, names, columns = (arrays[name] for name in _ARRAYS[:-1])
    columns = [str(name) for name in columns]
    if joints.ndim != 3 or joints.shape[1:] != (len(columns), 3) or joints.dtype.kind not in "iuf":
        raise InputError(path, f"its joints_mm {joints.shape} do not fit {len(columns)} joint names", _REMEDY)
    whole = offsets.ndim == 1 and offsets.dtype.kind in "iu" and len(offsets) == len(names) + 1 > 1
    if not whole or offsets[0] != 0 or offsets[-1] != len(joints) or not (np.diff(offsets) > 0).all():
        raise InputError(path, "its offsets do not cut the frames into as many clips as there are names", _REMEDY)
    if not np.isfinite(joints).all():
        raise InputError(path, "has joints that are not numbers", "cut the clips there")
    own, derived = _in_our_joints(path, joints.astype(np.float64), columns)
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
            raise InputError(path, "its rate_hz is not one number above 0", "write the frames a second")
        return float(stored.ravel()[0])
    if given is None:
        raise InputError(path, "does not say how many frames a second it has", "give --rate, for example --rate 30")
    return given
