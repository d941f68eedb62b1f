"""Whether a reference has its axes or its labels the wrong way round: mirrored, left and right exchanged, or both."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from anchorpose.agreement.clock import NoCommonMovement, find_clock
from anchorpose.agreement.placement import moved
from anchorpose.agreement.reference import Reference, exchanged
from anchorpose.agreement.signals import common_signals, resampled
from anchorpose.errors import DegenerateGeometry, InputError
from anchorpose.results.tables import AngleTable, JointTable
from anchorpose.rotations import fit_rigid_transform

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


def require_sides(joints: JointTable, ours: AngleTable, reference: Reference) -> None:
    """Raises InputError where the reference fits much better with axes or labels the other way round."""
    misfit = _misfits(joints, ours, reference)
    best = min(misfit, key=lambda sides: misfit[sides], default=AS_IS)
    if best == AS_IS:
        return
    problem, remedy = WRONG[best]
    is_length = bool(reference.centres.joints)
    if AS_IS in misfit:
        if misfit[best] > CLEARLY_BETTER * misfit[AS_IS] or (is_length and misfit[AS_IS] < LARGEST_DEFINITION_M):
            return
        if is_length:
            problem += f" within {1000 * misfit[best]:.0f} mm instead of {1000 * misfit[AS_IS]:.0f} mm"
    raise InputError(reference.path, problem, remedy)


def _misfits(joints: JointTable, ours: AngleTable, reference: Reference) -> dict[Sides, float]:
    """By what is reversed: the median distance of joints in metres after the best rigid motion; without joints, the
    share of movement that is unexplained. Nothing where no common movement is found."""
    found = dict[Sides, float]()
    for is_exchanged, other in ((False, reference), (True, exchanged(reference))):
        columns = [ours.column(name) for name in other.angles]
        signals = common_signals(
            (joints.time_s, joints.position_m, ours.degrees[:, columns]),
            (other.time_s, other.centres.position_m, other.degrees),
        )
        try:
            if signals is None:
                continue
            clock = find_clock(*signals)
            if not other.centres.joints:
                found[Sides(is_exchanged, False)] = 1.0 - clock.correlation**2
                continue
            theirs_m = resampled(other.time_s, other.centres.position_m, clock.reference_time_s(joints.time_s))
            for is_mirrored, axes in ((False, [1.0, 1.0, 1.0]), (True, [1.0, 1.0, -1.0])):
                found[Sides(is_exchanged, is_mirrored)] = _distance_m(joints.position_m, theirs_m * axes)
        except (NoCommonMovement, DegenerateGeometry):
            continue
    return found


def _distance_m(ours_m: np.ndarray, theirs_m: np.ndarray) -> float:
    """Median distance of joints (n, 21, 3), NaN where missing, after the best rigid motion of theirs onto ours."""
    both = np.isfinite(ours_m).all(axis=2) & np.isfinite(theirs_m).all(axis=2)
    T = fit_rigid_transform(theirs_m[both], ours_m[both])
    return float(np.median(np.linalg.norm(ours_m[both] - moved(T, theirs_m[both]), axis=1)))
