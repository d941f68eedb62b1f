"""Match the frames of a results folder with the frames of another system's recording: express both on the same clock,
in the same frame of reference, with the same joints and angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.clock import (
    Clock,
    NoCommonMovement,
    common_signals,
    find_clock,
    position_signals,
    refine_clock,
    resampled,
)
from anchorpose.agreement.placement import Placement, place, residual, segment_axes
from anchorpose.agreement.reference import Reference, exchanged
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry, InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.joint_angles import ANGLE_NAMES, joint_angles
from anchorpose.results.tables import JOINTS_FILE, AngleTable, JointTable, read_joints
from anchorpose.results.truth import Sides, require_as_is
from anchorpose.results.verify import require_own
from anchorpose.rotations import fit_rigid_transform

LARGEST_SCALE: Final = 1.3
"""Maximum ratio between the body's sizes in the two systems. Different definitions of joints change the size by less; a
larger ratio means that the reference's lengths are in another unit.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A results folder and a reference (the recording of another system) at the same times: joints and angles of the
    reference are resampled to the frames of ``joints``, and all arrays have a row per frame of ``joints``.

    theirs_m (n, 21, 3): the reference's joints in the world of the results, NaN where missing; axes (n, 21, 3, 3): axes
    of the body segment of each joint. theirs: angles of the reference's joints by this program's formulas, None if the
    reference has no joints. given_deg (n, a): the angles ``reference.angles`` as the other system computes them, with
    the sign of this program. placement: None if the reference has only angles.
    """

    results: Path
    reference: Reference
    clock: Clock
    placement: Placement | None
    joints: JointTable
    theirs_m: np.ndarray
    axes: np.ndarray
    ours: AngleTable
    theirs: AngleTable | None
    given_deg: np.ndarray


def match_results(results: Path, reference: Reference, given: np.ndarray | None = None) -> Match:
    """Match results with a reference: find the reference's clock and pose. given: the reference's pose
    T_world_reference (4, 4), if known.

    Raises InputError if the reference's lengths seem to be in another unit than stated, if the reference fits much
    better with a mirrored axis or with left and right exchanged, or if no common movement is found.
    """
    require_own(results, (JOINTS_FILE,))
    joints = read_joints(results / JOINTS_FILE)
    ours = joint_angles(joints)
    reference = with_knee_sign(reference, ours)
    if reference.angles and not reference.centres.joints and np.isnan(reference.degrees).all():
        problem = "has no joints, and its only angles are knee angles whose sign the results do not show"
        remedy = "name the angles knee_flexion_left and knee_flexion_right in the file, with flexion positive"
        raise InputError(reference.path, problem, remedy)
    _require_scale(joints, reference)
    require_as_is(reference.path, _misfits(joints, ours, reference), is_length=bool(reference.centres.joints))
    try:
        return _match(results, joints, ours, reference, given)
    except NoCommonMovement as error:
        problem = f"shares no movement with {results / JOINTS_FILE}: {error}"
        remedy = "give the reference of this recording, with at least ten seconds of the same movement"
        raise InputError(reference.path, problem, remedy) from None


def _match(
    results: Path, joints: JointTable, ours: AngleTable, reference: Reference, given: np.ndarray | None
) -> Match:
    clock, axes = _clock_of_movement(joints, ours, reference), segment_axes(joints.position_m)
    at_s = clock.reference_time_s(joints.time_s)
    theirs_m = resampled(reference.time_s, reference.centres.position_m, at_s)
    if not reference.centres.joints:
        given_deg = resampled(reference.time_s, reference.degrees, at_s)
        return Match(results, reference, clock, None, joints, theirs_m, axes, ours, None, given_deg)
    try:
        placement = place(joints.position_m, joints.sigma_m, theirs_m, axes, given)
        clock = _clock_of_positions(joints, axes, reference, placement, clock)
        at_s = clock.reference_time_s(joints.time_s)
        theirs_m = resampled(reference.time_s, reference.centres.position_m, at_s)
        placement = place(joints.position_m, joints.sigma_m, theirs_m, axes, given)
    except DegenerateGeometry:
        raise NoCommonMovement("the joints that both have do not determine a frame") from None
    theirs_m = transform_points(placement.T_world_reference, theirs_m)
    given_deg = resampled(reference.time_s, reference.degrees, at_s)
    theirs = _angles_of(joints, theirs_m)
    return Match(results, reference, clock, placement, joints, theirs_m, axes, ours, theirs, given_deg)


def _clock_of_movement(joints: JointTable, ours: AngleTable, reference: Reference) -> Clock:
    """Return the reference's clock, found from distances between joints and from angles; raises NoCommonMovement if
    these signals do not determine the clock.
    """
    columns = [ours.column(name) for name in reference.angles]
    signals = common_signals(
        (joints.time_s, joints.position_m, ours.degrees[:, columns]),
        (reference.time_s, reference.centres.position_m, reference.degrees),
    )
    if signals is None:
        raise NoCommonMovement("no joint that both have moves against another by more than noise")
    return find_clock(*signals)


def _clock_of_positions(
    joints: JointTable, axes: np.ndarray, reference: Reference, placement: Placement, clock: Clock
) -> Clock:
    """Refine the clock with joint positions in the world, which determine the clock better than distances between
    joints do.
    """
    nothing = np.zeros_like(joints.position_m)
    ours = position_signals(joints.time_s, residual(joints.position_m, nothing, axes, placement.offset_m))
    theirs_m = transform_points(placement.T_world_reference, reference.centres.position_m)
    return refine_clock(ours, position_signals(reference.time_s, theirs_m), clock)


def _angles_of(joints: JointTable, position_m: np.ndarray) -> AngleTable:
    """Return the angles of the other system's joints by this program's formulas; sigma in the returned table has no
    meaning.
    """
    return joint_angles(
        JointTable(
            joints.frame, joints.time_s, position_m, joints.state_code, np.zeros((len(joints.frame), JOINT_COUNT))
        )
    )


def _require_scale(joints: JointTable, reference: Reference) -> None:
    common = [JOINT_INDEX[name] for name in reference.centres.joints]
    ratios = [
        _median_distance(reference.centres.position_m, a, b) / _median_distance(joints.position_m, a, b)
        for a, b in combinations(common, 2)
    ]
    known = [ratio for ratio in ratios if np.isfinite(ratio)]
    if not known:
        return
    scale = float(np.median(known))
    if not 1.0 / LARGEST_SCALE <= scale <= LARGEST_SCALE:
        problem = f"has a body {scale:.3g} times as large as the results: its lengths are in another unit"
        raise InputError(reference.path, problem, "give the unit of its lengths with --unit mm, --unit cm or --unit m")


def _median_distance(position_m: np.ndarray, a: int, b: int) -> float:
    distance = np.linalg.norm(position_m[:, a] - position_m[:, b], axis=1)
    known = distance[np.isfinite(distance)]
    return float(np.median(known)) if len(known) else float("nan")


def _misfits(joints: JointTable, ours: AngleTable, reference: Reference) -> dict[Sides, float]:
    """Return the misfit between both systems for each combination of two possible faults of the reference: left and
    right may be exchanged, and an axis may be mirrored. The misfit is the median distance in metres between both
    systems' joints after the best rigid motion. If the reference has no joints, the misfit is the share of the movement
    that the best clock leaves unexplained. Combinations without a common movement are left out.
    """
    found = dict[Sides, float]()
    for is_exchanged, other in ((False, reference), (True, exchanged(reference))):
        try:
            clock = _clock_of_movement(joints, ours, other)
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
    """Return the median distance between both systems' joints (n, 21, 3), NaN where missing, after the best rigid
    motion of the other system's joints onto the joints of the results.
    """
    both = np.isfinite(ours_m).all(axis=2) & np.isfinite(theirs_m).all(axis=2)
    T = fit_rigid_transform(theirs_m[both], ours_m[both])
    return float(np.median(np.linalg.norm(ours_m[both] - transform_points(T, theirs_m[both]), axis=1)))


LARGEST_ZERO_DEG: Final = 10.0
"""Maximum difference in degrees between the zeros of knee flexion in two systems. Centres of joints differ by up to 30
mm between definitions; a knee that lies 30 mm farther forward changes the flexion by 9 degrees.
"""


def with_knee_sign(reference: Reference, ours: AngleTable) -> Reference:
    """Return the reference with knee angles whose positive sign means flexion, and with a note on how this sign was
    determined. ours: angles of the results. The systems differ in this sign: in OpenSim's models, for example, a bent
    knee is negative in gait2392 and positive in the model of Rajagopal.

    Both knees get the same sign: the sign with which the middle of the range of the file's knee angles is nearer to the
    middle of the range in the results. Since knees bend in one direction only, this comparison needs no common clock.
    If both signs fit about equally, for example to straight knees, the angles become NaN. Knee angles that have this
    program's names in the file keep their sign.
    """
    named = enumerate(zip(reference.angles, reference.labels, strict=True))
    knees = [k for k, (name, label) in named if name.startswith("knee_flexion") and label not in ANGLE_NAMES]
    if not knees:
        return reference
    middle = _middle_of_range(ours.degrees[:, [ours.column(reference.angles[k]) for k in knees]])
    in_file = _middle_of_range(reference.degrees[:, knees])
    sign, how = _knee_sign(abs(middle - in_file), abs(middle + in_file))
    degrees = reference.degrees.copy()
    degrees[:, knees] *= sign
    note = (
        f"{' and '.join(reference.labels[k] for k in knees)}: {how}; the middle of the range is "
        f"{_degrees_text(in_file)} in the file and {_degrees_text(middle)} in the results. "
        "To state the sign yourself, name the angles "
        "knee_flexion_left and knee_flexion_right in the file, with flexion positive."
    )
    return replace(reference, degrees=degrees, notes=(*reference.notes, note))


def _degrees_text(degrees: float) -> str:
    return "unknown" if np.isnan(degrees) else f"{degrees:.0f} degrees"


def _middle_of_range(degrees: np.ndarray) -> float:
    """Return the middle between the 5th and the 95th percentile of all known angles; NaN if no angle is known."""
    known = degrees[np.isfinite(degrees)]
    return float(np.percentile(known, [5.0, 95.0]).mean()) if len(known) else float("nan")


def _knee_sign(as_given_deg: float, opposite_deg: float) -> tuple[float, str]:
    """Return the sign (1, -1, or NaN if it is undecided), and a text that explains it. as_given_deg, opposite_deg:
    absolute difference between the middle of the range in the results and in the file, with the sign as in the file and
    with the opposite sign.
    """
    if opposite_deg - as_given_deg > LARGEST_ZERO_DEG:
        return 1.0, "taken with the sign as given"
    if as_given_deg - opposite_deg > LARGEST_ZERO_DEG:
        return -1.0, "taken with the opposite sign"
    return float("nan"), "left out, since the results do not show which sign means flexion"
