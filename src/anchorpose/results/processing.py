"""Smoothing and gap filling: only when asked for, by a policy that is written down with what came of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal, NamedTuple

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, STATE_CODE, JointState
from anchorpose.results.filters import (
    MOST_UNEVEN,
    evenness,
    filter_stretch,
    highest_cutoff_hz,
    shortest_frames,
    smooth_stretch,
)
from anchorpose.results.frame_time import longest_even_step_s, unbroken_runs, usual_step_s
from anchorpose.results.kinematics.joint_angles import ANGLE_GROUPS, joint_angles
from anchorpose.results.tables import PROCESSING, JointTable, ProcessedAngles
from anchorpose.settings import Positive, settings

Filling = Literal["none", "linear", "spline"]

LEAST_TRIALS: Final = 20
"""Places of the recording in which the same gap is cut and filled on trial, to measure the error of a filling."""


class Filled(NamedTuple):
    """position_m (n, 3) and sigma_m (n,) of one joint, and filled (n,) bool: which frames were gaps before."""

    position_m: np.ndarray
    sigma_m: np.ndarray
    filled: np.ndarray


def fill_gaps(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, fill: Filling, longest_s: float
) -> Filled:
    """One joint, position_m (n, 3), NaN where it is lost, with its gaps up to longest_s filled.

    A gap stays where it is longer (from the last frame before to the first after), where it begins or ends the
    recording, where frames are missing around it, and where the joint was not seen for long enough elsewhere to measure
    the error of a filling. That error is measured by cutting the same gap into every stretch in which the joint is
    known, and filling it; it grows towards the middle of the gap.
    """
    known = np.isfinite(position_m).all(axis=1)
    reach = 1 if fill == "linear" else 2
    filled_m, spread, marked = position_m.copy(), sigma_m.copy(), np.zeros(len(time_s), dtype=bool)
    for start, stop in _gaps(known, time_s, reach, longest_s):
        missing = np.arange(start, stop)
        around = np.concatenate([np.arange(start - reach, start), np.arange(stop, stop + reach)])
        weights = _weights(time_s[missing], time_s[around])
        error_m = _trial_error(time_s, position_m, known, reach, stop - start)
        if error_m is None:
            continue
        filled_m[missing] = weights @ position_m[around]
        spread[missing] = np.hypot(np.abs(weights) @ sigma_m[around], error_m)
        marked[missing] = True
    return Filled(filled_m, spread, marked)


def _gaps(known: np.ndarray, time_s: np.ndarray, reach: int, longest_s: float) -> list[tuple[int, int]]:
    """First frame and one past the last of the gaps that may be filled."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], known, [True]])))
    found = []
    longest_step = longest_even_step_s(time_s)
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        first, last = start - reach, stop + reach
        if first < 0 or last > len(known) or not (known[first:start].all() and known[stop:last].all()):
            continue
        if time_s[stop] - time_s[start - 1] <= longest_s and np.diff(time_s[first:last]).max() <= longest_step:
            found.append((start, stop))
    return found


def _weights(missing_s: np.ndarray, around_s: np.ndarray) -> np.ndarray:
    """(m, 2 or 4) weights of the known positions in each missing one.

    Two known ones give the straight line between them; four give the cubic that passes the inner two with the speed
    from the outer to the inner ones (Hermite).
    """
    inner = around_s[len(around_s) // 2 - 1 : len(around_s) // 2 + 1]
    gap_s = inner[1] - inner[0]
    u = (missing_s - inner[0]) / gap_s
    if len(around_s) == 2:
        return np.stack([1.0 - u, u], axis=1)
    start, end = 2 * u**3 - 3 * u**2 + 1, 3 * u**2 - 2 * u**3
    leave, arrive = (u**3 - 2 * u**2 + u) * gap_s, (u**3 - u**2) * gap_s
    before, after = leave / (around_s[1] - around_s[0]), arrive / (around_s[3] - around_s[2])
    return np.stack([-before, start + before, end - after, after], axis=1)


def _trial_error(
    time_s: np.ndarray, position_m: np.ndarray, known: np.ndarray, reach: int, missing: int
) -> np.ndarray | None:
    """(missing,) rms error along each axis of the same filling where the joint is known; None with too few places."""
    span = missing + 2 * reach
    if len(time_s) < span:
        return None
    steps = np.append(np.diff(time_s) <= longest_even_step_s(time_s), True)
    windows = np.lib.stride_tricks.sliding_window_view(known & steps, span).all(axis=1)
    starts = np.flatnonzero(windows)
    if len(starts) < LEAST_TRIALS:
        return None
    steps_s = np.arange(span) * usual_step_s(time_s)
    hidden = np.arange(reach, reach + missing)
    around = np.delete(np.arange(span), hidden)
    weights = _weights(steps_s[hidden], steps_s[around])
    tried = np.einsum("ma,sak->smk", weights, position_m[starts[:, None] + around])
    error: np.ndarray = np.sqrt(np.mean((tried - position_m[starts[:, None] + hidden]) ** 2, axis=(0, 2)))
    return error


Smoothing = Literal["none", "butterworth", "kalman"]

DEFAULT_CUTOFF_HZ: Final = 6.0
"""Usual for walking and standing (Winter, Biomechanics and Motor Control of Human Movement)."""


@settings
class ProcessingConfig:
    """How joints are smoothed and which gaps are filled; by default nothing is done.

    smooth: "butterworth" (zero lag, effective order four, ``cutoff_hz``) or "kalman" (Rauch, Tung and Striebel with the
    joints' sigma; ``jerk`` says how freely the acceleration changes). fill: "linear" or "spline" for gaps up to
    ``longest_gap_s``; longer ones stay.
    """

    smooth: Smoothing = "none"
    cutoff_hz: Positive = DEFAULT_CUTOFF_HZ
    jerk: Positive = 30.0  # m/s^3 times the root of a second: a reaching hand turns round within about 0.3 s
    fill: Filling = "none"
    longest_gap_s: Positive = 0.2  # about half the time in which a reaching hand turns round

    @property
    def active(self) -> bool:
        """Whether anything is to be done."""
        return self.smooth != "none" or self.fill != "none"


def policy_text(config: ProcessingConfig, counts: dict[str, int]) -> str:
    """The settings as JSON, without those that were not used; counts: joint positions smoothed, filled and so on."""
    used = asdict(config)
    if config.smooth != "butterworth":
        del used["cutoff_hz"]
    if config.smooth != "kalman":
        del used["jerk"]
    if config.fill == "none":
        del used["longest_gap_s"]
    return json.dumps(used | counts, sort_keys=True)


MEASURED, SMOOTHED, FILLED = range(len(PROCESSING))


@dataclass(frozen=True, slots=True, eq=False)
class ProcessedJoints:
    """joints: after smoothing and filling; a filled one has the state ``hidden``. processing (n, 21) int8."""

    joints: JointTable
    processing: np.ndarray


def process_joints(joints: JointTable, config: ProcessingConfig) -> ProcessedJoints:
    """Gaps filled first, then every unbroken stretch smoothed by itself.

    Raises AnchorposeError where the chosen filter does not fit the recording.
    """
    if config.smooth == "butterworth":
        _require_even_steps(joints.time_s, config.cutoff_hz)
    position_m, sigma_m = joints.position_m.copy(), joints.sigma_m.copy()
    state_code, processing = joints.state_code.copy(), np.zeros(joints.state_code.shape, dtype=np.int8)
    for joint in range(JOINT_COUNT):
        if config.fill != "none":
            filled = fill_gaps(
                joints.time_s, position_m[:, joint], sigma_m[:, joint], config.fill, config.longest_gap_s
            )
            position_m[:, joint], sigma_m[:, joint] = filled.position_m, filled.sigma_m
            state_code[filled.filled, joint] = STATE_CODE[JointState.HIDDEN]
            processing[filled.filled, joint] = FILLED
        for run in unbroken_runs(np.isfinite(sigma_m[:, joint]), joints.time_s, longest_even_step_s(joints.time_s)):
            smoothed = _smooth(joints.time_s[run], position_m[run, joint], sigma_m[run, joint], config)
            if smoothed is not None:
                position_m[run, joint], sigma_m[run, joint] = smoothed
                processing[run, joint] = np.maximum(processing[run, joint], SMOOTHED)
    return ProcessedJoints(JointTable(joints.frame, joints.time_s, position_m, state_code, sigma_m), processing)


def process_angles(joints: JointTable, config: ProcessingConfig) -> ProcessedAngles:
    """Return the angles of the processed joints; an angle is as processed as the most processed of its joints."""
    done = process_joints(joints, config)
    counts = {f"joint_frames_{name}": int((done.processing == code).sum()) for code, name in enumerate(PROCESSING)}
    counts["joint_frames_measured"] -= int(done.joints.lost.sum())
    counts["joint_frames_lost"] = int(done.joints.lost.sum())
    angles = joint_angles(done.joints)
    columns = [
        done.processing[:, [JOINT_INDEX[name] for name in group.joints]].max(axis=1)
        for group in ANGLE_GROUPS
        for _ in group.names
    ]
    arrays = {field.name: getattr(angles, field.name) for field in fields(angles)}
    return ProcessedAngles(**arrays, processing=np.stack(columns, axis=1), policy=policy_text(config, counts))


def _smooth(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, config: ProcessingConfig
) -> tuple[np.ndarray, np.ndarray] | None:
    """Position (n, 3) and sigma (n,) of an unbroken stretch; None where it stays as it was measured."""
    if config.smooth == "butterworth":
        if len(time_s) > 1 and len(time_s) >= shortest_frames(1.0 / usual_step_s(time_s), config.cutoff_hz):
            _require_cutoff(time_s, config.cutoff_hz)  # of its own rate, which may be lower than that of the recording
        return filter_stretch(time_s, position_m, sigma_m, config.cutoff_hz)
    if config.smooth == "kalman" and len(time_s) > 1:
        return smooth_stretch(time_s, position_m, sigma_m, config.jerk)
    return None


def _require_even_steps(time_s: np.ndarray, cutoff_hz: float) -> None:
    if len(time_s) < 2:
        raise AnchorposeError("a single frame cannot be smoothed; leave --smooth out.")
    _require_cutoff(time_s, cutoff_hz)
    for run in unbroken_runs(np.ones(len(time_s), dtype=bool), time_s, longest_even_step_s(time_s)):
        uneven = evenness(time_s[run])
        if uneven > MOST_UNEVEN:
            raise AnchorposeError(
                f"steps between frames differ by up to {100 * uneven:.0f} % from the usual one, and the Butterworth "
                f"filter allows {100 * MOST_UNEVEN:.0f} %; use --smooth kalman, which allows any."
            )


def _require_cutoff(time_s: np.ndarray, cutoff_hz: float) -> None:
    rate_hz = 1.0 / usual_step_s(time_s)
    highest = highest_cutoff_hz(rate_hz)
    if cutoff_hz >= highest:
        raise AnchorposeError(
            f"--cutoff {cutoff_hz:g} Hz is too high for {rate_hz:.3g} frames a second; give less than {highest:.2g} Hz."
        )
