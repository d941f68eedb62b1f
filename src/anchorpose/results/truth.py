"""The truth of a simulated recording, truth.npz: joints over time, and the bones that were touched."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints: time_s (t,), position_m (t, 21, 3) world, NaN where unknown; occluded (t,) bool."""

    time_s: np.ndarray
    position_m: np.ndarray
    occluded: np.ndarray


def read_truth(path: Path) -> Truth:
    """A truth.npz with ``joints`` (t, n, 3), ``names`` (n), ``time`` (t) and perhaps ``occluded`` (t).

    Joints may come in any order and some may be missing (NaN). Raises InputError where that is not what it holds.
    """
    remedy = "give a truth.npz with joints (t, 21, 3), names (21) and time (t)"
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in ("joints", "names", "time", "occluded") if name in file.files}
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path of the truth") from None
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        raise InputError(path, f"cannot be read ({str(error).splitlines()[0][:80]})", remedy) from None
    missing = [name for name in ("joints", "names", "time") if name not in arrays]
    if missing:
        raise InputError(path, f"has no array '{missing[0]}'", remedy)
    joints, names, time_s = arrays["joints"], [str(name) for name in arrays["names"].ravel()], arrays["time"]
    occluded = arrays.get("occluded", np.zeros(len(time_s), dtype=bool))
    if joints.shape != (len(time_s), len(names), 3) or occluded.shape != time_s.shape or time_s.ndim != 1:
        raise InputError(path, f"its arrays do not fit together (joints {joints.shape}, time {time_s.shape})", remedy)
    if joints.dtype.kind not in "fiu" or time_s.dtype.kind not in "fiu":
        raise InputError(path, "its joints or times are not numbers", remedy)
    if len(time_s) == 0 or not (np.diff(time_s) > 0).all():
        raise InputError(path, "its times are none or do not increase", remedy)
    return Truth(time_s.astype(np.float64), _in_order(path, joints, names), occluded.astype(bool))


def _in_order(path: Path, joints: np.ndarray, names: list[str]) -> np.ndarray:
    position_m = np.full((len(joints), JOINT_COUNT, 3), np.nan)
    for column, name in enumerate(names):
        if name not in JOINT_INDEX or names.count(name) > 1:
            raise InputError(path, f"its joint '{name}' is unknown or given twice", f"use {', '.join(JOINT_NAMES)}")
        position_m[:, JOINT_INDEX[name]] = joints[:, column]
    return position_m


@dataclass(frozen=True, slots=True, eq=False)
class TrueTouch:
    """bones (t, b) bool: in each frame the bones whose skin somebody touches; names (b) of the bones."""

    bones: np.ndarray
    names: tuple[str, ...]


def read_true_touch(path: Path) -> TrueTouch | None:
    """The contacts in a truth.npz, ``touched`` (t, b) and ``part_names`` (b); None where it has none.

    Raises InputError where the two do not fit each other, or none of the bones is one of the body's.
    """
    with np.load(path, allow_pickle=False) as file:
        if "touched" not in file.files or "part_names" not in file.files:
            return None
        touched, names = file["touched"], tuple(str(name) for name in file["part_names"])
        times = len(file["time"])
    known = {bone for bones in REGION_BONES.values() for bone in bones}
    if touched.shape != (times, len(names)) or not known & set(names):
        raise InputError(path, "its touched and part_names do not fit", "give touched (t, b) and part_names (b)")
    return TrueTouch(touched.astype(bool), names)
