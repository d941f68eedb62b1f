"""Read another system's recording, and convert it to this program's joints and angles. Times stay on the other system's
clock, and positions stay in its frame of reference.

A joint centre is a labelled point of the file, or the mean of several markers. A hip centre may also be estimated from
markers of the pelvis, by a regression or by a functional method. The regression is that of Harrington et al. 2007
(doi:10.1016/j.jbiomech.2006.02.003), in the equations with one variable each, which Sangeux et al. 2014
(doi:10.1016/j.gaitpost.2014.01.024) found to be the most accurate regression in adults. The functional method finds the
point of the pelvis about which the thigh's markers move on spheres: Gamage and Lasenby 2002
(doi:10.1016/S0021-9290(01)00160-9).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.captured import Captured, read_captured
from anchorpose.agreement.marking import SIDES, Marking, given_marking, known_marking
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.options import HipCentre
from anchorpose.results.joint_angles import ANGLE_NAMES
from anchorpose.rotations import unit

LEAST_SWING: Final = 0.02
"""Minimum ratio of the smallest to the largest singular value in ``functional_centre``. With a smaller ratio, the thigh
moved in one plane or hardly at all, so the centre is undetermined along one direction.
"""


FARTHEST_M: Final = 0.04
"""Maximum distance in metres between the functional hip centre and the centre from the regression; the regression is
accurate to 15 mm. A larger distance means that the markers moved with the skin over the bone: in a recording of walking
(ezc3d's example of Qualisys), the functional centres of both hips were 67 mm away from the regression's centres.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CentreTrack:
    """Joint centres over time: position_m (t, 21, 3) in the other system's frame, NaN where missing; origin: for each
    joint, a text on how its centre was found, None for a joint that was not found.
    """

    position_m: np.ndarray
    origin: tuple[str | None, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the joints that were found."""
        return tuple(name for name, how in zip(JOINT_NAMES, self.origin, strict=True) if how is not None)


def joint_centres(captured: Captured, marking: Marking, hip: HipCentre) -> CentreTrack:
    """Compute all joint centres that the labels determine. hip: method for a hip centre that no label gives; raises
    InputError if this method cannot be used.
    """
    position = np.full((len(captured.time_s), JOINT_COUNT, 3), np.nan)
    origin: list[str | None] = [None] * JOINT_COUNT

    def put(joint: str, place_m: np.ndarray, how: str) -> None:
        if np.isfinite(place_m).all(axis=1).any():
            position[:, JOINT_INDEX[joint]], origin[JOINT_INDEX[joint]] = place_m, how

    for joint, label in marking.centres.items():
        how = "taken as the joint's centre" if joint in marking.assumed else "as given"
        put(joint, captured.point(label), f"{label}, {how}")
    for joint, labels in marking.midpoints.items():
        put(joint, np.mean([captured.point(label) for label in labels], axis=0), f"middle of {' and '.join(labels)}")
    pelvis = [] if marking.pelvis is None else [captured.point(label) for label in marking.pelvis]
    if pelvis and np.isfinite(pelvis).all(axis=(0, 2)).any():
        axes, middle_m, width_m, depth_m = pelvis_frame(*pelvis)
        for side, sign in (("Left", -1.0), ("Right", 1.0)):
            if f"Hip{side}" in marking.centres or f"Hip{side}" in marking.midpoints:
                continue
            local = harrington_hip(width_m, depth_m) * [1.0, 1.0, sign]
            if hip is HipCentre.FUNCTIONAL:
                thigh = [captured.point(label) for label in marking.thighs[side]]
                local = _functional_centre(captured, side, thigh, (axes, middle_m), local)
            put(f"Hip{side}", middle_m + np.einsum("tij,j->ti", axes, local), _HOW[hip])
    elif hip is HipCentre.FUNCTIONAL:
        raise InputError(captured.path, "has no four markers of the pelvis", "leave out --hip functional")
    return CentreTrack(position, tuple(origin))


_HOW: Final = {
    HipCentre.HARRINGTON: "regression of Harrington 2007",
    HipCentre.FUNCTIONAL: "functional fit of the thigh's movement",
}


def pelvis_frame(
    left_asis: np.ndarray, right_asis: np.ndarray, left_psis: np.ndarray, right_psis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return the axes (t, 3, 3), columns x forward, y up, z right; the origin (t, 3) midway between the two ASIS; and
    the width and depth of the pelvis in m.

    All inputs are positions (t, 3). Width and depth are medians over the recording, since a bone does not change.
    """
    middle, behind = 0.5 * (left_asis + right_asis), 0.5 * (left_psis + right_psis)
    z = unit(right_asis - left_asis)
    ahead = middle - behind
    x = unit(ahead - (ahead * z).sum(axis=1, keepdims=True) * z)
    width = float(np.nanmedian(np.linalg.norm(right_asis - left_asis, axis=1)))
    depth = float(np.nanmedian(np.linalg.norm(ahead, axis=1)))
    return np.stack([x, np.cross(z, x), z], axis=-1), middle, width, depth


def harrington_hip(width_m: float, depth_m: float) -> np.ndarray:
    """Estimate the right hip centre (3,) from the pelvis's width and depth, by the regression of Harrington et al.
    2007; metres in ``pelvis_frame`` (x forward, y up, z right). For the left hip, z is reversed.
    """
    return np.array([-0.24 * depth_m - 0.0099, -0.30 * width_m - 0.0109, 0.33 * width_m + 0.0073])


def functional_centre(markers_m: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Return the common centre (3,) of the spheres on which the markers (t, 3) move, and a number that states how well
    the markers' movement determines the centre.

    This number is the ratio of the smallest to the largest singular value of the equations; it is 0 if the centre is
    undetermined. Raises ValueError if no marker with four known positions moves.
    """
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for marker in markers_m:
        known = marker[np.isfinite(marker).all(axis=1)]
        if len(known) < 4:
            continue
        square = (known**2).sum(axis=1)
        centred = known - known.mean(axis=0)
        matrix += 2.0 * centred.T @ centred / len(known)
        right += centred.T @ (square - square.mean()) / len(known)
    values = np.linalg.svd(matrix, compute_uv=False)
    if values[0] == 0.0:
        raise ValueError("no marker moved")
    return np.linalg.lstsq(matrix, right, rcond=None)[0], float(np.sqrt(values[2] / values[0]))


def _functional_centre(
    captured: Captured,
    side: str,
    markers: list[np.ndarray],
    pelvis: tuple[np.ndarray, np.ndarray],
    regression_m: np.ndarray,
) -> np.ndarray:
    """Return the functional hip centre (3,) in ``pelvis_frame``. pelvis: axes and origin of that frame; regression_m:
    the hip centre that ``harrington_hip`` estimates. Raises InputError if the thigh has no markers, if their movement
    does not determine the centre, or if the centre is more than ``FARTHEST_M`` away from ``regression_m``.
    """
    axes, origin_m = pelvis
    if not markers:
        raise InputError(captured.path, f"has no markers on the {side.lower()} thigh", "leave out --hip functional")
    local = [np.einsum("tij,ti->tj", axes, marker - origin_m) for marker in markers]
    centre, swing = functional_centre(local)
    if swing < LEAST_SWING or np.linalg.norm(centre - regression_m) > FARTHEST_M:
        problem = f"shows too little movement of the {side.lower()} thigh in several planes for a functional fit"
        raise InputError(captured.path, problem, "leave out --hip functional, or record a movement of the hip")
    return centre


def other_side(name: str) -> str:
    """Return the name of the same joint or angle on the other side of the body; a name without a side is returned
    unchanged.
    """
    for left, right in (("Left", "Right"), ("_left", "_right")):
        if name.endswith(left):
            return name.removesuffix(left) + right
        if name.endswith(right):
            return name.removesuffix(right) + left
    return name


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
"""Angles of this program by the other system's name (``_OPENSIM``, ``_PLUG_IN``); the two angles differ by a constant
at most, apart from the sign of the knee (``with_knee_sign``). Angles of Plug-in Gait have three components, of which
the first (flexion) is compared.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The other system's recording, converted to this program's joints and angles. time_s (t,): times on its clock;
    centres: joint centres in its frame; degrees (t, a): the angles that have the names ``angles`` in this program and
    the names ``labels`` in the file. notes: sentences on how labels and signs in the file were interpreted.
    """

    path: Path
    time_s: np.ndarray
    centres: CentreTrack
    angles: tuple[str, ...]
    labels: tuple[str, ...]
    degrees: np.ndarray
    notes: tuple[str, ...]


def read_reference(
    path: Path, unit: str | None = None, names: Path | None = None, hip: HipCentre = HipCentre.HARRINGTON
) -> Reference:
    """Read the joints and angles of a file. names: the user's table of the joints that the labels stand for (read by
    ``given_marking``); None = labels have their usual meaning (``known_marking``).

    Raises InputError if the file has none of this program's joints and angles.
    """
    captured = read_captured(path, unit)
    marking = known_marking(captured.points) if names is None else given_marking(names, captured.points)
    centres = joint_centres(captured, marking, hip)
    angles, labels, degrees = _angles(captured)
    if not centres.joints and not angles:
        listed = ", ".join((*captured.points, *captured.angles)[:6])
        remedy = f"state what they are with --names FILE.csv (rows joint,label; joints are {', '.join(JOINT_NAMES)})"
        raise InputError(path, f"has no label that is a known joint or angle (it has {listed} ...)", remedy)
    found = [f"{name}: {how}" for name, how in zip(JOINT_NAMES, centres.origin, strict=True) if how is not None]
    notes = (*found, *(f"{name}: {label}" for name, label in zip(angles, labels, strict=True)))
    return Reference(path, captured.time_s, centres, angles, labels, degrees, notes)


def exchanged(reference: Reference) -> Reference:
    """Return the recording with the names of left and right joints and angles exchanged."""
    other, centres = [JOINT_INDEX[other_side(name)] for name in JOINT_NAMES], reference.centres
    centres = CentreTrack(centres.position_m[:, other], tuple(centres.origin[index] for index in other))
    return replace(reference, centres=centres, angles=tuple(other_side(name) for name in reference.angles))


def _angles(captured: Captured) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
    """Return this program's names of the file's angles, their labels in the file, and the angles (t, a) in degrees.

    If the file has the angle ``pelvis_list``, a coordinate of OpenSim's models, its pelvis angles are OpenSim's. They
    are left out, because this program's angles of the same names have other signs and zeros.
    """
    columns, of_opensim = dict[str, int](), "pelvis_list" in captured.angles
    for column, label in enumerate(captured.angles):
        name = _our_angle(label)
        if name is not None and not (of_opensim and name.startswith("pelvis_")):
            columns.setdefault(name, column)
    chosen = list(columns.values())
    return tuple(columns), tuple(captured.angles[column] for column in chosen), captured.degrees[:, chosen]


def _our_angle(label: str) -> str | None:
    if label in ANGLE_NAMES:
        return label
    opensim = re.match(r"^(.*)_(l|r)$", label)
    if opensim and opensim[1] in _OPENSIM:
        return f"{_OPENSIM[opensim[1]]}_{SIDES[opensim[2].upper()].lower()}"
    if label[:1] in SIDES and label[1:] in _PLUG_IN:
        return f"{_PLUG_IN[label[1:]]}_{SIDES[label[0]].lower()}"
    return None
