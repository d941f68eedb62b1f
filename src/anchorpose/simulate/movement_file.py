"""Read captured rehabilitation movements: the skeletons of UI-PRMD (Vakanski et al. 2018, doi:10.3390/data3010002)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import read_arrays

CLIP_HZ: Final = 30.0  # Hz, frame rate of the captured clips
MOVEMENTS: Final = {
    "deep-squat": 1,
    "hurdle-step": 2,
    "inline-lunge": 3,
    "side-lunge": 4,
    "sit-to-stand": 5,
    "leg-raise": 6,
    "shoulder-abduction": 7,
    "shoulder-extension": 8,
    "shoulder-rotation": 9,
    "shoulder-scaption": 10,
}
"""Name of each movement of the data set, and its number in the names of the clips."""

STEPPING: Final = frozenset({"hurdle-step", "inline-lunge", "side-lunge", "leg-raise"})
"""Movements for which the patient needs space in front and at both sides."""

SEATED: Final = frozenset({"sit-to-stand"})
SUBJECTS: Final = (1, 2, 3, 4, 5, 6, 7)
# m/s, maximum speed of a captured ankle or wrist; at a higher speed, the Kinect has lost the joint
LOST_M_S: Final = 8.0
KEYS: Final = ("joints_mm", "offsets", "names", "joint_names")
NEEDED: Final = (
    "Waist",
    "Spine",
    "Chest",
    "Head",
    "HeadTip",
    "LUpperArm",
    "LForearm",
    "LHand",
    "RUpperArm",
    "RForearm",
    "RHand",
    "LUpperLeg",
    "LLowerLeg",
    "LFoot",
    "LToes",
    "RUpperLeg",
    "RLowerLeg",
    "RFoot",
    "RToes",
)
"""Names of the joints that a file must contain. ``Forearm`` is the elbow, ``Foot`` the ankle, ``LowerLeg`` the knee."""

_NAME: Final = re.compile(r"(?P<how>[ci])_m(?P<movement>\d\d)_s(?P<subject>\d\d)_e(?P<episode>\d\d)")


@dataclass(frozen=True, slots=True, eq=False)
class Clips:
    """Clips of one movement of one subject, at 30 Hz, in the order in which they were recorded."""

    names: tuple[str, ...]  # (c,) names of the clips
    joints_m: tuple[np.ndarray, ...]  # per clip (n, j, 3): x to the subject's left, y up, z ahead
    joint_names: tuple[str, ...]  # (j,) names of the joints

    def joint(self, clip: int, name: str) -> np.ndarray:
        """Return the positions (n, 3) of a joint, metres."""
        return np.asarray(self.joints_m[clip][:, self.joint_names.index(name)])


def movement_of(name: str) -> str | None:
    """Return the movement in ``MOVEMENTS`` to which the name of a clip or movement belongs; None for other names."""
    found = _NAME.fullmatch(name)
    names = [key for key, number in MOVEMENTS.items() if found and number == int(found["movement"])]
    return next(iter(names), name if name in MOVEMENTS else None)


def read_clips(path: Path, movement: str, rng: np.random.Generator, subjects: tuple[int, ...] = SUBJECTS) -> Clips:
    """Read the repetitions of a movement by one random subject, all correct or all incorrect; or read one clip by its
    name.

    movement: one of ``MOVEMENTS`` or the name of a clip, such as c_m05_s01_e01. Raises InputError if ``path`` is not a
    file of captured movements, or has no such movement by one of the subjects.
    """
    arrays = _arrays(path)
    names = [str(name) for name in arrays["names"]]
    chosen = [names.index(movement)] if movement in names else _drawn(path, arrays, movement, rng, subjects)
    offsets = arrays["offsets"]
    return Clips(
        names=tuple(names[index] for index in chosen),
        joints_m=tuple(arrays["joints_mm"][offsets[i] : offsets[i + 1]].astype(np.float64) / 1000.0 for i in chosen),
        joint_names=tuple(str(name) for name in arrays["joint_names"]),
    )


def _drawn(
    path: Path, arrays: dict[str, np.ndarray], movement: str, rng: np.random.Generator, subjects: tuple[int, ...]
) -> list[int]:
    """Draw a subject, and either correct or incorrect repetitions; return the indices of these clips."""
    series: dict[tuple[str, str], list[int]] = {}
    for index, name in enumerate(str(name) for name in arrays["names"]):
        found = _NAME.fullmatch(name)
        if not found or _loses_a_limb(arrays, index):
            continue
        if int(found["movement"]) == MOVEMENTS.get(movement) and int(found["subject"]) in subjects:
            series.setdefault((found["subject"], found["how"]), []).append(index)
    if not series:
        known = ", ".join(MOVEMENTS)
        raise InputError(path, f"has no movement {movement} by a subject of {subjects}", f"choose one of {known}")
    keys = sorted(series)
    return series[keys[int(rng.integers(len(keys)))]]


def _loses_a_limb(arrays: dict[str, np.ndarray], index: int) -> bool:
    """Return whether a wrist or an ankle moves faster than ``LOST_M_S`` between two frames of a clip, so that the
    Kinect must have lost it.
    """
    ends = np.isin(arrays["joint_names"], ["LHand", "RHand", "LFoot", "RFoot"])
    clip = arrays["joints_mm"][arrays["offsets"][index] : arrays["offsets"][index + 1], ends]
    steps_m = np.linalg.norm(np.diff(clip.astype(np.float64), axis=0), axis=2) / 1000.0
    return bool(steps_m.max() * CLIP_HZ > LOST_M_S)


def _arrays(path: Path) -> dict[str, np.ndarray]:
    path = Path(path)
    remedy = f"give the skeletons of UI-PRMD as .npz, with the arrays {', '.join(KEYS)}"
    arrays = read_arrays(path, KEYS, remedy)
    if len(arrays) < len(KEYS):
        raise InputError(path, "is not a file of captured movements", remedy)
    missing = [name for name in NEEDED if name not in arrays["joint_names"]]
    if missing:
        raise InputError(path, f"lacks the joints {', '.join(missing)}", "give the file with all joints of UI-PRMD")
    return arrays
