"""Estimate the whole body's centre of mass from the joints and a table of segment masses, and measure its sway.

The masses are from de Leva 1996 (doi:10.1016/0021-9290(95)00178-6), Table 4, which describes living young adults, women
and men. The patient's sex is unknown, so the mean of the columns for women and men is used. Between the two columns,
the height of a standing body's centre of mass differs by 4 mm.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.frame_time import LONGEST_STEP, unbroken_runs, usual_step_s
from anchorpose.results.processing import low_pass
from anchorpose.results.records import Measure
from anchorpose.results.stand_training.stance import Session, known, unknown
from anchorpose.results.tables import JointTable
from anchorpose.results.uncertainty import JOINT_SHARE, random_sigma
from anchorpose.settings import NotNegative, Positive, settings


class Segment(NamedTuple):
    """A body segment. mass: its share of the body's mass (for a segment of a limb, the mass on one side of the body).
    fraction: position of its centre of mass between start (0) and end (1).

    starts, ends: joints at whose mean the segment starts and ends; ``{side}`` stands for Left and Right.
    """

    mass: float
    starts: tuple[str, ...]
    ends: tuple[str, ...]
    fraction: float


_SHOULDERS, _HIPS = ("ShoulderLeft", "ShoulderRight"), ("HipLeft", "HipRight")

SINGLE_SEGMENTS: Final = (
    # head and neck: the table's centre of mass lies 0.492 of the way from the vertex (top of the head) to the cervicale
    # (tip of the seventh neck vertebra); on the body model, this place is 0.72 of the way from SpineShoulder to Head
    Segment(0.0681, ("SpineShoulder",), ("Head",), 0.72),
    Segment(0.43015, _SHOULDERS, _HIPS, 0.4046),
)

PAIRED_SEGMENTS: Final = (
    Segment(0.0263, ("Shoulder{side}",), ("Elbow{side}",), 0.5763),
    Segment(0.0150, ("Elbow{side}",), ("Wrist{side}",), 0.4567),
    # The hand: its centre of mass is put 68 mm beyond the wrist in line with the forearm, even if the wrist is bent.
    # This simplification shifts the body's centre of mass by at most 0.4 mm, and keeps it known if the hand is lost.
    Segment(0.00585, ("Elbow{side}",), ("Wrist{side}",), 1.29),
    Segment(0.1447, ("Hip{side}",), ("Knee{side}",), 0.3854),
    Segment(0.0457, ("Knee{side}",), ("Ankle{side}",), 0.4374),
    # the foot: the table's centre of mass lies 0.42 of the way from heel to toe tip; on the body model, this place is
    # 0.36 of the way from Ankle to Foot
    Segment(0.0133, ("Ankle{side}",), ("Foot{side}",), 0.36),
)


@cache
def joint_weights() -> np.ndarray:
    """Return the weight (21,) of each joint in the centre of mass, as a read-only array. The weights sum to 1; some may
    be negative.
    """
    weights = np.zeros(JOINT_COUNT)
    for segment, side in (*product(SINGLE_SEGMENTS, [""]), *product(PAIRED_SEGMENTS, ["Left", "Right"])):
        for joints, share in ((segment.starts, 1.0 - segment.fraction), (segment.ends, segment.fraction)):
            for name in joints:
                weights[JOINT_INDEX[name.format(side=side)]] += segment.mass * share / len(joints)
    weights /= weights.sum()  # the sum is 0.9999 because the table is rounded
    weights.setflags(write=False)
    return weights


SHARED_ERROR: Final = 0.3
"""Share of the variance of a joint's error that is common to all joints: if the body is placed too far away, all joints
are too far away. If the errors were independent, sigma of the centre of mass would be 1.6 mm; in simulated recordings,
its errors were up to 5 mm (docs/measures.md).
"""


class CentreOfMass(NamedTuple):
    """The centre of mass in every frame. position_m (n, 3) world, NaN where a joint on which it depends is lost;
    sigma_m (n,) per axis; state_code (n,): worst state of these joints.

    sigma_m follows from the joints' sigma; differences between the patient's masses and the table are not included.
    """

    position_m: np.ndarray
    sigma_m: np.ndarray
    state_code: np.ndarray


def centre_of_mass(joints: JointTable) -> CentreOfMass:
    """Compute the centre of mass in every frame. Its sigma allows for the share ``SHARED_ERROR`` of the variance of the
    joints' errors, which is common to all joints.
    """
    weights = joint_weights()
    used = weights != 0
    position_m = np.einsum("j,njk->nk", weights[used], joints.position_m[:, used])
    own, shared = (joints.sigma_m[:, used] ** 2) @ weights[used] ** 2, (joints.sigma_m[:, used] @ weights[used]) ** 2
    sigma_m = np.sqrt((1.0 - SHARED_ERROR) * own + SHARED_ERROR * shared)
    return CentreOfMass(position_m, sigma_m, joints.state_code[:, used].max(axis=1))


CHI2_95: Final = 5.991
"""Quantile of chi-squared with two degrees of freedom, which determines the size of the ellipse within which 95 of 100
normally distributed points lie (Schubert and Kirchner 2014, doi:10.1016/j.gaitpost.2013.09.001).
"""

SCALE_ERROR: Final = 0.03
"""Standard deviation of the relative error of a measure of sway, as found on simulated recordings."""

STEPS_PER_PERIOD: Final = 4.0
"""Minimum number of frames per period of the cutoff frequency, since noise is measured between the cutoff frequency and
half the frame rate.
"""

UNITS: Final = {
    "sway_path": "mm",
    "sway_velocity": "mm/s",
    "sway_rms_ap": "mm",
    "sway_rms_ml": "mm",
    "sway_ellipse_area": "cm2",
}


@settings
class SwayConfig:
    """Settings of which bouts of standing, and which part of the movement in them, count as sway."""

    cutoff_hz: Positive = 1.5  # Hz, cutoff of the low-pass filter; a standing body sways below 1 Hz
    shortest_bout_s: Positive = 5.0  # s, minimum duration of a bout of standing
    settle_s: NotNegative = 1.0  # s, time after standing up that is left out: the body is not at rest yet
    # minimum sway that is reported, as a multiple of the sway that noise alone would cause
    times_noise: Annotated[float, Field(ge=1)] = 2.0


class Bout(NamedTuple):
    """A bout of standing. deviation_m (k, 2): position of the centre of mass relative to its mean in the bout, forwards
    and to the patient's right, low-passed, evenly spaced in time.

    path_m: length of the centre's horizontal path; noise_m: length of the path that errors of measurement alone would
    cause; seconds: duration of the bout; frames: rows of the bout in the session.
    """

    deviation_m: np.ndarray
    path_m: float
    noise_m: float
    seconds: float
    frames: slice


def sway_bouts(session: Session, config: SwayConfig) -> list[Bout]:
    """Return every bout of standing that is long enough, has enough frames per second, and has a known centre of mass
    in all its frames. The time just after standing up is left out.
    """
    time_s = session.joints.time_s
    settled = session.upright & ~session.moving(config.settle_s)
    whole = settled & np.isfinite(session.posture.com_m).all(axis=1)
    return [
        _bout(session, run, config)
        for run in unbroken_runs(whole, time_s, LONGEST_STEP / (STEPS_PER_PERIOD * config.cutoff_hz))
        if time_s[run.stop - 1] - time_s[run.start] >= config.shortest_bout_s
        and usual_step_s(time_s[run]) * STEPS_PER_PERIOD * config.cutoff_hz <= 1.0
    ]


def sway_measures(session: Session, config: SwayConfig) -> list[Measure]:
    """Return the sway's path, mean velocity, root mean square forwards (AP) and sideways (ML) and 95 % ellipse area."""
    bouts = sway_bouts(session, config)
    if not bouts:
        why = (
            f"no upright bout of {config.shortest_bout_s:g} s had the centre of mass in all its frames, "
            f"at {STEPS_PER_PERIOD * config.cutoff_hz:g} frames a second or more"
        )
        names = {"sway_time": "s", **UNITS, "sway_path_noise": "mm"}
        return [unknown(name, unit, why) for name, unit in names.items()]
    state_code = np.concatenate([session.posture.state_code[bout.frames] for bout in bouts])
    rows = [("sway_time", sum(bout.seconds for bout in bouts), None), *_values(session, bouts, config)]
    rows.append(("sway_path_noise", 1000.0 * sum(bout.noise_m for bout in bouts), None))
    return [_row(name, value, sigma, state_code, config) for name, value, sigma in rows]


def _values(session: Session, bouts: list[Bout], config: SwayConfig) -> list[tuple[str, float | None, float | None]]:
    """Return name, value and sigma of each sway measure, in the units of ``UNITS``; the value is None if it may be
    mostly noise.
    """
    deviation = 1000.0 * np.concatenate([bout.deviation_m for bout in bouts])
    path, noise, seconds = (
        sum(getattr(bout, name) for bout in bouts) * scale
        for name, scale in (("path_m", 1000.0), ("noise_m", 1000.0), ("seconds", 1.0))
    )
    sigma_m = np.concatenate([session.posture.com_sigma_m[bout.frames] for bout in bouts])
    error = 1000.0 * float(np.sqrt(np.mean(random_sigma(sigma_m, JOINT_SHARE) ** 2)))
    covariance = deviation.T @ deviation / (len(deviation) - 1)
    rms = np.sqrt(np.diag(covariance))
    axes = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0))
    area_cm2 = np.pi * CHI2_95 * axes.prod() / 100.0
    path_sigma = float(_with_noise(np.array(path), noise))
    rms_sigma, axes_sigma = _with_noise(rms, error), _with_noise(axes, error)
    area_sigma = np.pi * CHI2_95 * np.hypot(axes[0] * axes_sigma[1], axes[1] * axes_sigma[0]) / 100.0
    return [
        ("sway_path", path if path >= config.times_noise * noise else None, path_sigma),
        ("sway_velocity", path / seconds if path >= config.times_noise * noise else None, path_sigma / seconds),
        ("sway_rms_ap", float(rms[0]) if rms[0] >= config.times_noise * error else None, float(rms_sigma[0])),
        ("sway_rms_ml", float(rms[1]) if rms[1] >= config.times_noise * error else None, float(rms_sigma[1])),
        # the ellipse's area has the relative errors of both axes of the ellipse, so the shorter axis must exceed its
        # noise, too
        ("sway_ellipse_area", float(area_cm2) if axes.min() >= config.times_noise * error else None, float(area_sigma)),
    ]


def _with_noise(value: np.ndarray, noise: float) -> np.ndarray:
    """Return sigma of a measure of sway. This sigma combines ``SCALE_ERROR`` with the amount by which noise, which adds
    to the true sway in quadrature, enlarges the value.
    """
    added = value - np.sqrt(np.maximum(value**2 - noise**2, 0.0))
    return np.hypot(SCALE_ERROR * value, added)


def _row(name: str, value: float | None, sigma: float | None, state_code: np.ndarray, config: SwayConfig) -> Measure:
    unit = UNITS.get(name, "s" if name == "sway_time" else "mm")
    if value is None:
        what = "the path" if name in ("sway_path", "sway_velocity") else "the sway, in one direction at least,"
        why = f"{what} is less than {config.times_noise:g} times that of the joints' noise alone"
        return unknown(name, unit, why, state_code=state_code)
    return known(name, unit, value, state_code, sigma)


def _bout(session: Session, run: slice, config: SwayConfig) -> Bout:
    time_s = session.joints.time_s[run]
    step_s = usual_step_s(time_s)
    even_s = np.linspace(time_s[0], time_s[-1], round((time_s[-1] - time_s[0]) / step_s) + 1)
    com_m = session.posture.com_m[run][:, [0, 2]] @ _patient_axes(session, run).T
    com_m = np.stack([np.interp(even_s, time_s, com_m[:, axis]) for axis in range(2)], axis=1)
    rate_hz = (len(even_s) - 1) / (time_s[-1] - time_s[0])
    slow_m = low_pass(com_m, rate_hz, config.cutoff_hz)
    seconds = float(time_s[-1] - time_s[0])
    noise_m = _noise_speed(com_m - slow_m, rate_hz, config.cutoff_hz) * seconds
    path_m = float(np.linalg.norm(np.diff(slow_m, axis=0), axis=1).sum())
    return Bout(slow_m - slow_m.mean(axis=0), path_m, noise_m, seconds, run)


def _patient_axes(session: Session, run: slice) -> np.ndarray:
    """Return two unit vectors (x, z) on the floor as rows (2, 2): the patient's mean heading in the run, and the
    direction to the patient's right.
    """
    hips = session.joints.position_m[run][:, [JOINT_INDEX["HipLeft"], JOINT_INDEX["HipRight"]]]
    across = (hips[:, 1] - hips[:, 0])[:, [0, 2]]
    x, z = (across / np.linalg.norm(across, axis=1, keepdims=True)).mean(axis=0)
    return np.array([[z, -x], [x, z]]) / np.hypot(x, z)


def _noise_speed(residual_m: np.ndarray, rate_hz: float, cutoff_hz: float) -> float:
    """Return the mean speed in m/s at which errors of measurement alone would move the centre of mass, at frequencies
    below the cutoff frequency.

    residual_m (k, 2): the movement above the cutoff frequency, all of which is taken as error, since no standing body
    moves so fast. Below the cutoff frequency, the errors are assumed to be a random walk with power ~ 1 / f^2. This
    assumption gives the errors more power than was measured (docs/measures.md).
    """
    variance = float(np.mean(residual_m.var(axis=0)))
    speed = np.sqrt(4.0 * np.pi**2 * cutoff_hz * variance / (1.0 / cutoff_hz - 2.0 / rate_hz))
    return float(np.sqrt(np.pi / 2.0) * speed)
