"""Whether joints of another system, or true ones, are in another unit, or have axes or labels the wrong way round."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, LIMBS

WRONG_M: Final = 0.15
"""Farther off than this, half a forearm, a joint says nothing about the patient, and its limb is wrong."""

CLEARLY_BETTER: Final = 0.7
"""Ratio of two misfits from which on the smaller is the right one. In six simulated laboratories it was at most 0.1."""

LARGEST_DEFINITION_M: Final = 0.03
"""A misfit up to here needs no other explanation: joint centres of two systems differ by as much by definition."""


class Sides(NamedTuple):
    """What is the wrong way round."""

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
    """Raises InputError where the file fits much better with axes or labels the other way round.

    misfit: by what is reversed, in metres where it is a length; without an entry where nothing can be compared.
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
"""Ratio of bone lengths between truth and results. A wrong body differs by tens of percent, a foot by 3.3."""

UPRIGHT_DEG, LYING_DEG = 45.0, 60.0
"""Tilt of the trunk up to which the results stand, and from which the truth lies or is upside down."""

LEAST_FORWARD_M: Final = 0.05
"""Toes before ankles and knees before the line of the leg, all four together: less shows no direction."""

UNIT: Final = "write its joints in metres, in a right-handed world with Y up"

_BONES: Final = np.array(LIMBS)


def require_same_world(path: Path, ours_m: np.ndarray, truth_m: np.ndarray) -> None:
    """Raises InputError where the truth (n, 21, 3), in frames of ours (n, 21, 3), is in another unit or other axes.

    What a right truth always has is asked of it alone, as far as that goes: a patient who was tracked back to front, or
    elsewhere, is an error to be reported, as is any other misfit over ``WRONG_M``.
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
    """The median ratio of two arrays (k,), 1 where nothing can be compared."""
    known = np.isfinite(first) & (second > 0)
    return float(np.median(first[known] / second[known])) if known.any() else 1.0


def _bone_lengths(joints_m: np.ndarray) -> np.ndarray:
    """(20,) the median over the frames, NaN where unknown; joints_m (n, 21, 3)."""
    length = np.linalg.norm(joints_m[:, _BONES[:, 1]] - joints_m[:, _BONES[:, 0]], axis=2)
    return _median(length)


def _median(values: np.ndarray) -> np.ndarray:
    """(k,) the median of each column of (n, k) without NaN; NaN where it has nothing else."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([np.median(known) if len(known) else np.nan for known in columns])


def _joint(joints_m: np.ndarray, name: str) -> np.ndarray:
    return np.asarray(joints_m[:, JOINT_INDEX[name]])


def _up(joints_m: np.ndarray) -> np.ndarray:
    return _joint(joints_m, "SpineShoulder") - _joint(joints_m, "SpineBase")


def _trunk_tilt_deg(joints_m: np.ndarray) -> float:
    """The median angle between the trunk and the vertical; NaN where unknown."""
    up = _up(joints_m)
    across = np.hypot(up[:, 0], up[:, 2])
    return float(_median(np.degrees(np.arctan2(across, up[:, 1]))[:, None])[0])


def _handedness(joints_m: np.ndarray) -> float:
    """Whether up, right and forward are right-handed: of -1 to 1, negative where toes and knees point backward of what
    left, right, head and pelvis say. NaN where they show no direction."""
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
    """The median distance (m) after the best motion about the vertical, and after the best one with a mirror.

    With labels as they are or exchanged, whichever fits better: a patient may have been tracked back to front.
    """
    misfit = dict.fromkeys((AS_IS, MIRRORED), np.inf)
    for sides in misfit:
        for labels in (slice(None), _EXCHANGED):
            mirrored_m = truth_m[:, labels] * ([1.0, 1.0, -1.0] if sides.mirrored else 1.0)
            misfit[sides] = min(misfit[sides], _misfit_m(ours_m, mirrored_m))
    return misfit


def _misfit_m(ours_m: np.ndarray, truth_m: np.ndarray) -> float:
    """The median distance after the motion about the vertical that fits best, least squares; inf where unknown."""
    known = np.isfinite(ours_m).all(axis=2) & np.isfinite(truth_m).all(axis=2)
    if not known.any():
        return np.inf
    ours, truth = (each[known] - each[known].mean(axis=0) for each in (ours_m, truth_m))
    to, of = ours[:, 0] + 1j * ours[:, 2], truth[:, 0] + 1j * truth[:, 2]
    turn = np.exp(1j * np.angle((to * of.conj()).sum()))
    return float(np.median(np.hypot(np.abs(to - turn * of), ours[:, 1] - truth[:, 1])))
