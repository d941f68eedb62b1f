"""Measure how straight knees and hips are while the patient is upright, how left and right differ, and each joint's
range of motion.
"""

from __future__ import annotations

from itertools import product
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field
from scipy.ndimage import median_filter

from anchorpose.results.frame_time import longest_dropped_s, unbroken_runs, usual_step_s
from anchorpose.results.records import Measure
from anchorpose.results.stand_training.centre_of_mass import CentreOfMass
from anchorpose.results.stand_training.stance import ANKLES, SIDES, Angle, Session, known, unknown
from anchorpose.results.tables import JointTable
from anchorpose.results.uncertainty import (
    ANGLE_SHARE,
    JOINT_SHARE,
    NORMAL_95,
    sigma_of_difference,
    sigma_of_mean,
    systematic_sigma,
)
from anchorpose.settings import settings

NOT_UPRIGHT_WITH: Final = "the patient was never known to be upright with this angle known"
EXTENDED: Final = ("knee_flexion", "hip_flexion")
# percentile of a joint's flexion, over the frames in which the patient stands, that is reported as the least flexion
# (95: as the greatest); the minimum and the maximum over these frames are mostly errors
LEAST_PERCENTILE: Final = 5.0


@settings
class ExtensionConfig:
    """Settings of when a knee counts as straight: bent or hyperextended by at most ``straight_deg`` degrees."""

    straight_deg: Annotated[float, Field(gt=0, lt=90)] = 10.0


def extension_measures(session: Session, config: ExtensionConfig) -> list[Measure]:
    """Return the mean, least and greatest flexion of each knee and hip while the patient stands, and the time for which
    each knee is straight.
    """
    rows = [row for angle in EXTENDED for side in SIDES for row in _flexion(session, angle, side)]
    return rows + [_straight_time(session, side, config.straight_deg) for side in SIDES]


def known_upright(session: Session, name: str) -> tuple[np.ndarray, Angle]:
    """Return (n,) bool: frames in which the patient stands and the angle ``name`` is known. Also return this angle in
    all frames.
    """
    angle = session.angle(name)
    return session.standing & np.isfinite(angle.degrees), angle


def _flexion(session: Session, angle: str, side: str) -> list[Measure]:
    used, series = known_upright(session, f"{angle}_{side}")
    if not used.any():
        names = (f"{angle}_upright_{which}" for which in ("mean", "least", "greatest"))
        return [unknown(measure, "deg", NOT_UPRIGHT_WITH, side) for measure in names]
    (value, sigma, state_code), seconds = (rows[used] for rows in series), session.weights[used]
    shares = [LEAST_PERCENTILE, 100.0 - LEAST_PERCENTILE]
    least, greatest = np.percentile(value, shares, weights=seconds, method="inverted_cdf")
    found = (
        ("mean", float(np.average(value, weights=seconds)), sigma_of_mean(sigma, seconds, ANGLE_SHARE)),
        ("least", float(least), _sigma_near(sigma, value <= least)),
        ("greatest", float(greatest), _sigma_near(sigma, value >= greatest)),
    )
    return [
        known(f"{angle}_upright_{which}", "deg", number, state_code, spread, side) for which, number, spread in found
    ]


def _sigma_near(sigma: np.ndarray, there: np.ndarray) -> float:
    """Return the sigma of a percentile: the root mean square of the sigmas in the frames ``there``, whose values lie
    beyond the percentile. This sigma does not decrease with the number of frames.
    """
    return float(np.sqrt(np.mean(sigma[there] ** 2)))


def _straight_time(session: Session, side: str, straight_deg: float) -> Measure:
    """Measure the time with a straight knee while upright. Its sigma is half of the difference between two times: the
    times that would result if all angles were smaller, or larger, by their systematic sigma.
    """
    used, knee = known_upright(session, f"knee_flexion_{side}")
    if not used.any():
        return unknown("knee_straight_time", "s", NOT_UPRIGHT_WITH, side)
    error = systematic_sigma(knee.sigma_deg[used], ANGLE_SHARE)
    straight_s = [
        float(session.seconds[used][np.abs(knee.degrees[used]) + shift * error <= straight_deg].sum())
        for shift in (0.0, -1.0, 1.0)
    ]
    sigma = 0.5 * (straight_s[1] - straight_s[2])
    return known("knee_straight_time", "s", straight_s[0], knee.state_code[used], sigma, side)


LEAST_STANCE_M: Final = 0.08
"""Minimum distance of the ankles in m; at a smaller distance, the centre of mass does not determine the load on each
foot well enough.
"""

NO_STANCE: Final = (
    "the patient was never known to be upright on feet at least 8 cm apart, with the centre of mass between them and "
    "no joint lost"
)


def symmetry_measures(session: Session) -> list[Measure]:
    """Return the differences of knee and hip flexion (left minus right), and the load on each foot."""
    return [*(_difference(session, angle) for angle in EXTENDED), *_load_shares(session)]


def _difference(session: Session, angle: str) -> Measure:
    measure = f"{angle}_difference"
    (left_known, left), (right_known, right) = (known_upright(session, f"{angle}_{side}") for side in SIDES)
    used = left_known & right_known
    if not used.any():
        return unknown(measure, "deg", NOT_UPRIGHT_WITH)
    sigma = np.sqrt(left.sigma_deg[used] ** 2 + right.sigma_deg[used] ** 2)
    sigma_deg = sigma_of_mean(sigma, session.weights[used], ANGLE_SHARE)
    value = float(np.average(left.degrees[used] - right.degrees[used], weights=session.weights[used]))
    return known(measure, "deg", value, np.maximum(left.state_code, right.state_code)[used], sigma_deg)


class FeetLoad(NamedTuple):
    """The load on the feet in every frame. rightwards (n,): the right foot's share of the load minus one half, computed
    as for a patient who stands still; the left foot has the same value with the sign reversed. sigma (n,); state_code
    (n,): worst state of the joints used.

    Values are NaN where a joint is lost, where the feet are closer than ``LEAST_STANCE_M``, and where the centre of
    mass lies to the side of both ankles. A patient who stands still with the centre of mass there would fall without
    support.
    """

    rightwards: np.ndarray
    sigma: np.ndarray
    state_code: np.ndarray


def feet_load(joints: JointTable, com: CentreOfMass) -> FeetLoad:
    """Return the load on the feet by the place of the centre of mass between the ankles, seen from above: with the
    centre of mass midway, each foot carries one half.
    """
    left, right = (joints.position_m[:, joint][:, [0, 2]] for joint in ANKLES)
    width = np.linalg.norm(right - left, axis=1)
    width = np.where(width >= LEAST_STANCE_M, width, np.nan)
    off = com.position_m[:, [0, 2]] - 0.5 * (left + right)
    along = np.einsum("nk,nk->n", off, right - left) / width**2
    along = np.where(np.abs(along) <= 0.5, along, np.nan)
    feet = joints.sigma_m[:, ANKLES]
    sigma = np.hypot(com.sigma_m, 0.5 * np.hypot(feet[:, 0], feet[:, 1])) / width
    state_code = np.maximum(com.state_code, joints.state_code[:, ANKLES].max(axis=1))
    return FeetLoad(along, np.where(np.isnan(along), np.nan, sigma), state_code)


def _load_shares(session: Session) -> list[Measure]:
    """Return each foot's share of the load, as the mean over all standing frames in which the load is known."""
    com = CentreOfMass(session.posture.com_m, session.posture.com_sigma_m, session.posture.state_code)
    load = feet_load(session.joints, com)
    used = session.standing & np.isfinite(load.rightwards)
    names = (("left", -1.0), ("right", 1.0))
    if not used.any():
        return [unknown("load_share", "1", NO_STANCE, side) for side, _ in names]
    along = float(np.average(load.rightwards[used], weights=session.weights[used]))
    sigma = sigma_of_mean(load.sigma[used], session.weights[used], JOINT_SHARE)
    return [known("load_share", "1", 0.5 + sign * along, load.state_code[used], sigma, side) for side, sign in names]


SIDED: Final = (
    "hip_flexion",
    "hip_adduction",
    "knee_flexion",
    "ankle_dorsiflexion",
    "shoulder_elevation",
    "elbow_flexion",
)
UNSIDED: Final = ("trunk_flexion", "trunk_side_bend", "trunk_pelvis_rotation", "neck_flexion")

HELD_S: Final = 0.2
"""Length in s of the window of the running median over an angle. With a median, an extreme angle counts only if it
lasts for about half of the window, since the extreme in a single frame is mostly error.
"""

LEAST_S: Final = 1.0  # s, minimum duration of a run of frames in which the angle is known, for its range to be measured


def range_measures(session: Session) -> list[Measure]:
    """Return, for every joint's angle and side, the range of the angle in degrees (measure ``ANGLE_range``). The
    measure has no value if the joint moved by no more than the errors of its angle.
    """
    names = [*product(SIDED, SIDES), *product(UNSIDED, [None])]
    return [_range(session, angle, side) for angle, side in names]


def _range(session: Session, angle: str, side: str | None) -> Measure:
    measure, series = f"{angle}_range", session.angle(angle if side is None else f"{angle}_{side}")
    rows, held = _held(series.degrees, session.joints.time_s)
    if not len(rows):
        return unknown(measure, "deg", f"the angle was never known for {LEAST_S:g} s without a break", side)
    low, high = int(np.argmin(held)), int(np.argmax(held))
    value, (first, second) = float(held[high] - held[low]), series.sigma_deg[rows[[low, high]]]
    state_code = series.state_code[rows]
    # the least and the greatest angle of a joint that does not move differ only by their errors, which are here taken
    # as independent
    if value <= NORMAL_95 * np.hypot(first, second):
        return unknown(measure, "deg", "the joint moved by no more than the errors of its angle", side, state_code)
    return known(measure, "deg", value, state_code, sigma_of_difference(first, second, ANGLE_SHARE), side)


def _held(degrees: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (k,) of all runs of frames that last ``LEAST_S`` or more and have a known angle, and the running
    median (k,) of the angle in them.
    """
    step_s = usual_step_s(time_s)
    if not np.isfinite(step_s):
        return np.empty(0, dtype=np.int64), np.empty(0)
    window = 2 * round(0.5 * HELD_S / step_s) + 1
    rows, held = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for run in unbroken_runs(np.isfinite(degrees), time_s, longest_dropped_s(time_s)):
        if time_s[run.stop - 1] - time_s[run.start] >= LEAST_S:
            rows.append(np.arange(run.start, run.stop))
            held.append(median_filter(degrees[run], window, mode="nearest"))
    return np.concatenate(rows), np.concatenate(held)
