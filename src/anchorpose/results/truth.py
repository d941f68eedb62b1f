"""Read truth.npz, a recording's true joints; check that they have the unit, axes and labels of the results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES
from anchorpose.body.equipment_gaps import FEET
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LIMBS
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M, FARTHEST_TIME_S, require_seconds
from anchorpose.recording.regular_file import read_arrays

_READ = ("joints", "names", "time", "occluded", "seen_share")


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints: time_s (t,), position_m (t, 21, 3) world, NaN where unknown; occluded (t,) bool: frames that the
    file calls occluded.

    seen_share (t, 21, cameras), 0 to 1, with the dtype of the file: share of the skin around the joint that the camera
    sees; None if the file does not state it.
    """

    time_s: np.ndarray
    position_m: np.ndarray
    occluded: np.ndarray
    seen_share: np.ndarray | None = None


def read_truth(path: Path) -> Truth:
    """Read a truth.npz with ``joints`` (t, n, 3), ``names`` (n), ``time`` (t) and optionally ``occluded`` (t) and
    ``seen_share`` (t, n, cameras).

    Joints may come in any order and some may be missing (NaN). Raises InputError if the file has other content.
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
        raise InputError(path, "its times are missing or do not increase", remedy)
    require_seconds(path, time_s)
    order, seen = _order(path, names), arrays.get("seen_share")
    return Truth(
        time_s.astype(np.float64),
        _ordered(joints.astype(np.float64, copy=False), order, np.nan),
        occluded.astype(bool),
        None if seen is None else _ordered(_checked_shares(path, seen, joints.shape[:2]), order, 0.0),
    )


def _checked_shares(path: Path, seen: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the shares unchanged; raise InputError if the shares do not fit the joints, shape (t, n), or are
    invalid.
    """
    remedy = "give seen_share (t, n, cameras) with shares from 0 to 1, or leave it out"
    if seen.ndim != 3 or seen.shape[:2] != shape or seen.shape[2] == 0 or seen.dtype.kind not in "fiu":
        raise InputError(path, f"its seen_share {seen.shape} does not fit its joints {shape}", remedy)
    if not ((seen >= 0) & (seen <= 1)).all():
        raise InputError(path, "its seen_share has values outside of 0 to 1", remedy)
    return seen


def _order(path: Path, names: list[str]) -> list[int]:
    """Return the index in ``JOINT_NAMES`` of each joint of the file."""
    for name in names:
        if name not in JOINT_INDEX or names.count(name) > 1:
            raise InputError(path, f"its joint '{name}' is unknown or given twice", f"use {', '.join(JOINT_NAMES)}")
    return [JOINT_INDEX[name] for name in names]


def _ordered(columns: np.ndarray, order: list[int], missing: float) -> np.ndarray:
    """Reorder columns (t, n, k) to (t, 21, k) in the order of ``JOINT_NAMES``; ``missing`` fills columns that the file
    lacks.
    """
    if order == list(range(JOINT_COUNT)):
        return columns
    found = np.full((len(columns), JOINT_COUNT, columns.shape[2]), missing, columns.dtype)
    found[:, order] = columns
    return found


@dataclass(frozen=True, slots=True, eq=False)
class TrueTouch:
    """The true contacts of the patient. bones (t, b) bool: whether another person, or the equipment, touches the skin
    of a bone in a frame; names (b): names of the bones.
    """

    bones: np.ndarray
    names: tuple[str, ...]


FOOT_BONES: Final = frozenset(bone for region in FEET for bone in REGION_BONES[region])


def read_true_support(path: Path) -> TrueTouch | None:
    """Return the contacts with equipment in a truth.npz, ``on_equipment`` (t, parts, b) and ``part_names`` (b); None
    where the file has no such arrays. Feet are left out, since contacts.parquet has no contacts of feet with equipment
    either.

    Raises InputError if the two arrays do not fit each other.
    """
    arrays = read_arrays(path, ("on_equipment", "part_names", "time"), SUPPORT_REMEDY)
    if "on_equipment" not in arrays or "part_names" not in arrays:
        return None
    touched, names = arrays["on_equipment"], tuple(map(str, arrays["part_names"].ravel()))
    shape = (*arrays["time"].shape, len(names))
    if touched.ndim != 3 or (touched.shape[0], touched.shape[2]) != shape or touched.dtype.kind not in "fiub":
        raise InputError(path, "its on_equipment and part_names do not fit together", SUPPORT_REMEDY)
    judged = np.array([name not in FOOT_BONES for name in names])
    return TrueTouch(touched.astype(bool).any(axis=1) & judged, names)


SUPPORT_REMEDY: Final = "give on_equipment (t, parts, b) and part_names (b)"


def read_true_touch(path: Path) -> TrueTouch | None:
    """Return the contacts with people in a truth.npz, ``touched`` (t, b) and ``part_names`` (b); None if the file has
    no such arrays.

    Raises InputError if the two arrays do not fit each other, or if none of the bones belongs to the body.
    """
    remedy = "give touched (t, b) and part_names (b)"
    arrays = read_arrays(path, ("touched", "part_names", "time"), remedy)
    if "touched" not in arrays or "part_names" not in arrays:
        return None
    touched, names = arrays["touched"], tuple(map(str, arrays["part_names"].ravel()))
    known = {bone for bones in REGION_BONES.values() for bone in bones}
    is_number = touched.dtype.kind in "fiub"
    if touched.shape != (*arrays["time"].shape, len(names)) or not is_number or not known & set(names):
        raise InputError(path, "its touched and part_names do not fit together", remedy)
    return TrueTouch(touched.astype(bool), names)


WRONG_M: Final = 0.15
"""Maximum error in m of a usable joint: half a forearm. With a larger error, the joint's limb counts as wrong."""

CLEARLY_BETTER: Final = 0.7
"""The file's axes and labels are taken to be wrong if the misfit to the results under another assumption (``Sides``) is
at most this share of the file's misfit as it is. In six simulated laboratories, the misfit under the right assumption
was at most 0.1 times the misfit under a wrong assumption.
"""

LARGEST_DEFINITION_M: Final = 0.03
"""Misfit in m below which axes and labels are accepted as they are, since definitions of joint centres differ by as
much.
"""


class Sides(NamedTuple):
    """An assumption on a file's labels and axes: whether left and right are exchanged, whether an axis is mirrored."""

    exchanged: bool
    mirrored: bool


AS_IS: Final = Sides(False, False)

WRONG: Final = {
    Sides(True, False): (
        "left and right are exchanged: with them the other way round it fits",
        "correct the labels in the other system, or give --exchange-sides (leave it out where it was given)",
    ),
    Sides(False, True): (
        "is mirrored: with one axis reversed it fits",
        "export it with right-handed axes, or change the sign of one of its axes, such as z",
    ),
    Sides(True, True): (
        "is mirrored, and left and right are exchanged: with both the other way round it fits",
        "export it with right-handed axes, or change the sign of one of its axes, and correct the labels, or give "
        "--exchange-sides (leave it out where it was given)",
    ),
}


def require_as_is(path: Path, misfit: Mapping[Sides, float], is_length: bool) -> None:
    """Raise InputError if the file fits much better with a mirrored axis or exchanged labels.

    misfit: the misfit under each assumption that can be compared. is_length: whether misfits are lengths in metres.
    """
    best = min(misfit, key=lambda sides: misfit[sides], default=AS_IS)
    if best == AS_IS:
        return
    problem, remedy = WRONG[best]
    if AS_IS in misfit:
        if misfit[best] > CLEARLY_BETTER * misfit[AS_IS] or (is_length and misfit[AS_IS] < LARGEST_DEFINITION_M):
            return
        if is_length:
            problem += f" within {1000 * misfit[best]:.0f} mm instead of {1000 * misfit[AS_IS]:.0f} mm"
    raise InputError(path, problem, remedy)


_EXCHANGED: Final = [
    JOINT_INDEX[name.replace("Left", "-").replace("Right", "Left").replace("-", "Right")] for name in JOINT_NAMES
]


MOST_SCALE: Final = 1.5
"""Maximum ratio between bone lengths of truth and results. With a wrongly learnt body, lengths differ by tens of
percent; with feet in place of metres, the ratio is 3.3.
"""

UPRIGHT_DEG, LYING_DEG = 45.0, 60.0
"""Tilts of the trunk in degrees. Below ``UPRIGHT_DEG``, the patient of the results is upright; above ``LYING_DEG``, the
patient of the truth lies or is upside down. If both conditions hold, truth and results have different axes.
"""

LEAST_FORWARD_M: Final = 0.05
"""For each leg, two distances are added: of the toes in front of the ankle, and of the knee in front of the line from
hip to ankle. If the sum over both legs is below this value in m, it is unknown which way is forward.
"""

UNIT: Final = "write its joints in metres, in a right-handed world with Y up"

_BONES: Final = np.array(LIMBS)


def require_same_world(path: Path, ours_m: np.ndarray, truth_m: np.ndarray) -> None:
    """Raise InputError if the truth (n, 21, 3) is in another unit or other axes than the results' joints (n, 21, 3)
    of the same frames.

    As far as possible, the tests use only the truth, and properties that every correct truth has. The results may be
    wrong (for example, track the patient back to front or in another place); the evaluation must measure such errors,
    not refuse them.
    """
    scale = _ratio(_bone_lengths(truth_m), _bone_lengths(ours_m))
    if not 1 / MOST_SCALE <= scale <= MOST_SCALE:
        raise InputError(path, f"has bones {scale:.3g} times as long as those of the results", UNIT)
    tilt_deg = _trunk_tilt_deg(truth_m)
    if tilt_deg > LYING_DEG and _trunk_tilt_deg(ours_m) < UPRIGHT_DEG:
        raise InputError(path, f"has a trunk {tilt_deg:.0f} degrees off the vertical, unlike the results", UNIT)
    if _handedness(truth_m) < 0.0:
        problem = "has toes and knees that point backward: it is mirrored, or its left and right are exchanged"
        raise InputError(path, problem, "change the sign of one of its axes, or correct its labels")
    misfit = _misfit_by_sides(ours_m, truth_m)
    if misfit[MIRRORED] < WRONG_M:
        require_as_is(path, misfit, is_length=True)


def _ratio(first: np.ndarray, second: np.ndarray) -> float:
    """Return the median ratio of two arrays (k,); 1 if no values can be compared."""
    known = np.isfinite(first) & (second > 0)
    return float(np.median(first[known] / second[known])) if known.any() else 1.0


def _bone_lengths(joints_m: np.ndarray) -> np.ndarray:
    """Return (20,): the median length of each bone over the frames, NaN where unknown; joints_m (n, 21, 3)."""
    length = np.linalg.norm(joints_m[:, _BONES[:, 1]] - joints_m[:, _BONES[:, 0]], axis=2)
    return _median(length)


def _median(values: np.ndarray) -> np.ndarray:
    """Return the median (k,) of each column of (n, k) without NaN; NaN where a column has only NaN."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([np.median(known) if len(known) else np.nan for known in columns])


def _joint(joints_m: np.ndarray, name: str) -> np.ndarray:
    return np.asarray(joints_m[:, JOINT_INDEX[name]])


def _up(joints_m: np.ndarray) -> np.ndarray:
    return _joint(joints_m, "SpineShoulder") - _joint(joints_m, "SpineBase")


def _trunk_tilt_deg(joints_m: np.ndarray) -> float:
    """Return the median, over the frames, of the angle between the trunk and the vertical; NaN if unknown."""
    up = _up(joints_m)
    across = np.hypot(up[:, 0], up[:, 2])
    return float(_median(np.degrees(np.arctan2(across, up[:, 1]))[:, None])[0])


def _handedness(joints_m: np.ndarray) -> float:
    """Return 1 if toes and knees point forward, where forward follows from the directions up and to the patient's
    right. Return -1 if they point backward (the joints are mirrored or exchanged), NaN if they point forward or
    backward by no more than ``LEAST_FORWARD_M``, or if joints are unknown.
    """
    joint = {name: _joint(joints_m, name) for name in JOINT_NAMES}
    right = joint["HipRight"] - joint["HipLeft"] + joint["ShoulderRight"] - joint["ShoulderLeft"]
    forward = sum(
        joint[f"Foot{side}"]
        - joint[f"Ankle{side}"]
        + joint[f"Knee{side}"]
        - (joint[f"Hip{side}"] + joint[f"Ankle{side}"]) / 2
        for side in ("Left", "Right")
    )
    ahead = np.cross(_up(joints_m), right)
    with np.errstate(invalid="ignore", divide="ignore"):
        forward_m = (forward * ahead).sum(axis=1) / np.linalg.norm(ahead, axis=1)
    found_m = float(_median(forward_m[:, None])[0])
    return float(np.sign(found_m)) if abs(found_m) > LEAST_FORWARD_M else np.nan


MIRRORED: Final = Sides(exchanged=False, mirrored=True)


def _misfit_by_sides(ours_m: np.ndarray, truth_m: np.ndarray) -> dict[Sides, float]:
    """Return the median distance (m), over frames and joints, of the results' joints from the true joints, and from the
    mirrored true joints, each after the rotation about the vertical and the translation that fit best.

    Left and right labels are kept or exchanged, whichever fits better, since a patient may have been tracked back to
    front.
    """
    misfit = dict.fromkeys((AS_IS, MIRRORED), np.inf)
    for sides in misfit:
        for labels in (slice(None), _EXCHANGED):
            mirrored_m = truth_m[:, labels] * ([1.0, 1.0, -1.0] if sides.mirrored else 1.0)
            misfit[sides] = min(misfit[sides], _misfit_m(ours_m, mirrored_m))
    return misfit


def _misfit_m(ours_m: np.ndarray, truth_m: np.ndarray) -> float:
    """Return the median distance in m, over frames and joints, between the positions in ``ours_m`` and ``truth_m``,
    after the rotation about the vertical and the translation that fit best, by least squares; inf where unknown.
    """
    known = np.isfinite(ours_m).all(axis=2) & np.isfinite(truth_m).all(axis=2)
    if not known.any():
        return np.inf
    ours, truth = (each[known] - each[known].mean(axis=0) for each in (ours_m, truth_m))
    to, of = ours[:, 0] + 1j * ours[:, 2], truth[:, 0] + 1j * truth[:, 2]
    turn = np.exp(1j * np.angle((to * of.conj()).sum()))
    return float(np.median(np.hypot(np.abs(to - turn * of), ours[:, 1] - truth[:, 1])))
