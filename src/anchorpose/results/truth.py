"""The truth of a simulated recording, truth.npz: joints over time, and the bones that were touched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M, FARTHEST_TIME_S, require_seconds
from anchorpose.recording.regular_file import read_arrays

_READ = ("joints", "names", "time", "occluded", "seen_share")


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints: time_s (t,), position_m (t, 21, 3) world, NaN where unknown; occluded (t,) bool.

    seen_share (t, 21, cameras), 0 to 1, of the file's type: share of the skin around the joint that nothing hides from
    that camera; None where the file does not say.
    """

    time_s: np.ndarray
    position_m: np.ndarray
    occluded: np.ndarray
    seen_share: np.ndarray | None = None

    def frames(self, chosen: slice | np.ndarray) -> Truth:
        """Some of the frames."""
        seen = None if self.seen_share is None else self.seen_share[chosen]
        return Truth(self.time_s[chosen], self.position_m[chosen], self.occluded[chosen], seen)


def read_truth(path: Path) -> Truth:
    """A truth.npz with ``joints`` (t, n, 3), ``names`` (n), ``time`` (t) and perhaps ``occluded`` (t) and
    ``seen_share`` (t, n, cameras).

    Joints may come in any order and some may be missing (NaN). Raises InputError where that is not what it holds.
    """
    remedy = "give a truth.npz with joints (t, 21, 3), names (21) and time (t)"
    arrays = read_arrays(path, _READ, remedy)
    missing = [name for name in ("joints", "names", "time") if name not in arrays]
    if missing:
        raise InputError(path, f"has no array '{missing[0]}'", remedy)
    joints, names, time_s = arrays["joints"], [str(name) for name in arrays["names"].ravel()], arrays["time"]
    occluded = arrays.get("occluded", np.zeros(time_s.shape, dtype=bool))
    if time_s.ndim != 1 or joints.shape != (*time_s.shape, len(names), 3) or occluded.shape != time_s.shape:
        raise InputError(path, f"its arrays do not fit together (joints {joints.shape}, time {time_s.shape})", remedy)
    if any(each.dtype.kind not in "fiub" for each in (joints, time_s, occluded)):
        raise InputError(path, "its joints, times or occluded are not numbers", remedy)
    with np.errstate(invalid="ignore"):
        if (np.abs(joints) > FARTHEST_CAMERA_M).any() or not (np.abs(time_s) <= FARTHEST_TIME_S).all():
            problem = f"has joints over {FARTHEST_CAMERA_M:g} m away, or times that are no seconds"
            raise InputError(path, problem, "write metres and seconds")
    if len(time_s) == 0 or not (np.diff(time_s) > 0).all():
        raise InputError(path, "its times are none or do not increase", remedy)
    require_seconds(path, time_s)
    order, seen = _order(path, names), arrays.get("seen_share")
    return Truth(
        time_s.astype(np.float64),
        _ordered(joints.astype(np.float64, copy=False), order, np.nan),
        occluded.astype(bool),
        None if seen is None else _ordered(_checked_shares(path, seen, joints.shape[:2]), order, 0.0),
    )


def _checked_shares(path: Path, seen: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Raises InputError where the shares do not fit the joints (t, n) or are none."""
    remedy = "give seen_share (t, n, cameras) with shares from 0 to 1, or leave it out"
    if seen.ndim != 3 or seen.shape[:2] != shape or seen.shape[2] == 0 or seen.dtype.kind not in "fiu":
        raise InputError(path, f"its seen_share {seen.shape} does not fit its joints {shape}", remedy)
    if not ((seen >= 0) & (seen <= 1)).all():
        raise InputError(path, "its seen_share has values that are no shares", remedy)
    return seen


def _order(path: Path, names: list[str]) -> list[int]:
    """The index in ``JOINT_NAMES`` of each column."""
    for name in names:
        if name not in JOINT_INDEX or names.count(name) > 1:
            raise InputError(path, f"its joint '{name}' is unknown or given twice", f"use {', '.join(JOINT_NAMES)}")
    return [JOINT_INDEX[name] for name in names]


def _ordered(columns: np.ndarray, order: list[int], missing: float) -> np.ndarray:
    """(t, 21, k) in the order of ``JOINT_NAMES`` from (t, n, k); ``missing`` where there is no column."""
    if order == list(range(JOINT_COUNT)):
        return columns
    found = np.full((len(columns), JOINT_COUNT, columns.shape[2]), missing, columns.dtype)
    found[:, order] = columns
    return found


@dataclass(frozen=True, slots=True, eq=False)
class TrueTouch:
    """bones (t, b) bool: in each frame the bones whose skin another person touches; names (b) of the bones."""

    bones: np.ndarray
    names: tuple[str, ...]


def read_true_touch(path: Path) -> TrueTouch | None:
    """The contacts in a truth.npz, ``touched`` (t, b) and ``part_names`` (b); None where it has none.

    Raises InputError where the two do not fit each other, or none of the bones is one of the body's.
    """
    remedy = "give touched (t, b) and part_names (b)"
    arrays = read_arrays(path, ("touched", "part_names", "time"), remedy)
    if "touched" not in arrays or "part_names" not in arrays:
        return None
    touched, names = arrays["touched"], tuple(map(str, arrays["part_names"].ravel()))
    known = {bone for bones in REGION_BONES.values() for bone in bones}
    is_number = touched.dtype.kind in "fiub"
    if touched.shape != (*arrays["time"].shape, len(names)) or not is_number or not known & set(names):
        raise InputError(path, "its touched and part_names do not fit", remedy)
    return TrueTouch(touched.astype(bool), names)
