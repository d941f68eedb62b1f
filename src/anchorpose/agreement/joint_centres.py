"""Joint centres of another system: as it gives them, midway between markers, or the hip by regression or by function.

Hip by regression: Harrington et al. 2007 (doi:10.1016/j.jbiomech.2006.02.003), their equations of one variable each,
which Sangeux et al. 2014 (doi:10.1016/j.gaitpost.2014.01.024) found to be the most accurate regression in adults. Hip
by function: the point of the pelvis about which the thigh's markers move on spheres, Gamage and Lasenby 2002
(doi:10.1016/S0021-9290(01)00160-9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.agreement.captured import Captured
from anchorpose.agreement.labels import SIDES, Marking
from anchorpose.agreement.reference_settings import HipCentre
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.rotations import unit

MM: Final = 0.001

LEAST_SWING: Final = 0.02
"""Least ratio of the smallest to the largest singular value of the spheres' equations: below it the thigh moved in a
plane or hardly at all, and the centre is not determined along one direction."""


FARTHEST_M: Final = 0.04
"""From the hip of the regression, which is good to 15 mm: a fit farther away followed skin that slid over the bone. In
a recording of walking (ezc3d's example of Qualisys) both hips were 67 mm away."""


@dataclass(frozen=True, slots=True, eq=False)
class CentreTrack:
    """position_m (t, 21, 3) in the frame of the other system, NaN where missing; origin: how each joint was found."""

    position_m: np.ndarray
    origin: tuple[str | None, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that there are."""
        return tuple(name for name, how in zip(JOINT_NAMES, self.origin, strict=True) if how is not None)


def joint_centres(captured: Captured, marking: Marking, hip: HipCentre) -> CentreTrack:
    """All joints that the labels determine; raises InputError where ``hip`` cannot be used."""
    position = np.full((len(captured.time_s), JOINT_COUNT, 3), np.nan)
    origin: list[str | None] = [None] * JOINT_COUNT

    def put(joint: str, place_m: np.ndarray, how: str) -> None:
        if np.isfinite(place_m).all(axis=1).any():
            position[:, JOINT_INDEX[joint]], origin[JOINT_INDEX[joint]] = place_m, how

    for joint, label in marking.centres.items():
        put(joint, captured.point(label), f"{label}, as given")
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
    """Axes (t, 3, 3), columns x forward, y up, z right; origin (t, 3) midway between the ASIS; width and depth in m.

    All inputs (t, 3). Width and depth are medians over the recording, since a bone does not change.
    """
    middle, behind = 0.5 * (left_asis + right_asis), 0.5 * (left_psis + right_psis)
    z = unit(right_asis - left_asis)
    ahead = middle - behind
    x = unit(ahead - (ahead * z).sum(axis=1, keepdims=True) * z)
    width = float(np.nanmedian(np.linalg.norm(right_asis - left_asis, axis=1)))
    depth = float(np.nanmedian(np.linalg.norm(ahead, axis=1)))
    return np.stack([x, np.cross(z, x), z], axis=-1), middle, width, depth


def harrington_hip(width_m: float, depth_m: float) -> np.ndarray:
    """(3,) metres of the right hip centre in ``pelvis_frame``: x forward, y up, z right; the left one has -z."""
    return np.array([-0.24 * depth_m - 9.9 * MM, -0.30 * width_m - 10.9 * MM, 0.33 * width_m + 7.3 * MM])


def functional_centre(markers_m: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """(3,) the common centre of spheres on which each marker (t, 3) moves, and how well it is determined.

    The second is the ratio of the smallest to the largest singular value of the equations. Raises ValueError for no
    marker with four known positions.
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
    """In the pelvis; raises InputError where the thigh has no markers or its movement does not determine it."""
    axes, origin_m = pelvis
    if not markers:
        raise InputError(captured.path, f"has no markers on the {side.lower()} thigh", "leave out --hip functional")
    local = [np.einsum("tij,ti->tj", axes, marker - origin_m) for marker in markers]
    centre, swing = functional_centre(local)
    if swing < LEAST_SWING or np.linalg.norm(centre - regression_m) > FARTHEST_M:
        problem = f"shows too little movement of the {side.lower()} thigh in several planes for a functional fit"
        raise InputError(captured.path, problem, "leave out --hip functional, or record a movement of the hip")
    return centre


def with_sides_exchanged(track: CentreTrack) -> CentreTrack:
    """Left joints take the place of right ones and the other way round."""
    other = [JOINT_INDEX[other_side(name)] for name in JOINT_NAMES]
    return CentreTrack(track.position_m[:, other], tuple(track.origin[index] for index in other))


def other_side(name: str) -> str:
    """The same joint or angle of the other side; itself where it has none."""
    for left, right in ((*SIDES.values(),), ("_left", "_right")):
        if name.endswith(left):
            return name.removesuffix(left) + right
        if name.endswith(right):
            return name.removesuffix(right) + left
    return name
