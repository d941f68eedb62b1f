"""Read another system's recording as joints and angles of ours, on its own clock and in its own frame."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.captured import Captured, read_captured
from anchorpose.agreement.joint_centres import (
    SIDES,
    CentreTrack,
    given_marking,
    joint_centres,
    known_marking,
    other_side,
    with_sides_exchanged,
)
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.options import HipCentre
from anchorpose.results.kinematics.joint_angles import ANGLE_NAMES

_OPENSIM: Final = {
    "knee_angle": "knee_flexion",
    "hip_flexion": "hip_pelvis_flexion",
    "hip_adduction": "hip_adduction",
    "ankle_angle": "ankle_dorsiflexion",
    "elbow_flex": "elbow_flexion",
}
_PLUG_IN: Final = {
    "KneeAngles": "knee_flexion",
    "HipAngles": "hip_pelvis_flexion",
    "AnkleAngles": "ankle_dorsiflexion",
    "ElbowAngles": "elbow_flexion",
}
"""Angles that mean the same as ours but for a constant; the first component (flexion) of Plug-in Gait's."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """time_s (t,) of its own clock; centres in its own frame; degrees (t, a) of ``angles``, which have our names.

    notes: what was understood of the file, in sentences.
    """

    path: Path
    time_s: np.ndarray
    centres: CentreTrack
    angles: tuple[str, ...]
    degrees: np.ndarray
    notes: tuple[str, ...]


def read_reference(
    path: Path, unit: str | None = None, names: Path | None = None, hip: HipCentre = HipCentre.HARRINGTON
) -> Reference:
    """Joints and angles of a file; names: a table ``joint,label`` in place of the names in common use.

    Raises InputError where no joint and no angle of ours follows from it.
    """
    captured = read_captured(path, unit)
    marking = known_marking(captured.points) if names is None else given_marking(names, captured.points)
    centres = joint_centres(captured, marking, hip)
    angles, degrees, notes = _angles(captured)
    if not centres.joints and not angles:
        listed = ", ".join((*captured.points, *captured.angles)[:6])
        remedy = f"state what they are with --names FILE.csv (rows joint,label; joints are {', '.join(JOINT_NAMES)})"
        raise InputError(path, f"has no label that is a known joint or angle (it has {listed} ...)", remedy)
    found = [f"{name}: {how}" for name, how in zip(JOINT_NAMES, centres.origin, strict=True) if how is not None]
    return Reference(path, captured.time_s, centres, angles, degrees, (*found, *notes))


def exchanged(reference: Reference) -> Reference:
    """The same recording with left and right exchanged."""
    angles = tuple(other_side(name) for name in reference.angles)
    return replace(reference, centres=with_sides_exchanged(reference.centres), angles=angles)


def _angles(captured: Captured) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...]]:
    """Our names, (t, a) degrees, and notes on signs."""
    found, notes = dict[str, np.ndarray](), list[str]()
    for column, label in enumerate(captured.angles):
        name = _our_angle(label)
        if name is None or name in found:
            continue
        values = captured.degrees[:, column]
        if name.startswith("knee_flexion") and _bends_backwards(values):
            values = -values
            notes.append(f"{label}: taken with the opposite sign, since knees bend one way")
        found[name] = values
        notes.append(f"{name}: {label}, as given")
    degrees = np.stack(list(found.values()), axis=1) if found else np.empty((len(captured.time_s), 0))
    return tuple(found), degrees, tuple(notes)


def _our_angle(label: str) -> str | None:
    if label in ANGLE_NAMES:
        return label
    opensim = re.match(r"^(.*)_(l|r)$", label)
    if opensim and opensim[1] in _OPENSIM:
        return f"{_OPENSIM[opensim[1]]}_{SIDES[opensim[2].upper()].lower()}"
    if label[:1] in SIDES and label[1:] in _PLUG_IN:
        return f"{_PLUG_IN[label[1:]]}_{SIDES[label[0]].lower()}"
    return None


def _bends_backwards(degrees: np.ndarray) -> bool:
    known = degrees[np.isfinite(degrees)]
    return bool(len(known) and -np.percentile(known, 5) > max(np.percentile(known, 95), 20.0))
