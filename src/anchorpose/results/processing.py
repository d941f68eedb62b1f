"""Smooth the joints of a recording and fill gaps, only on request. The settings (policy) are stored with the result.

Two smoothers, neither of which causes a delay, are available: the Kalman smoother of Rauch, Tung and Striebel (1965,
doi:10.2514/3.3166), and a Butterworth filter in a forward and a backward pass.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal, NamedTuple

import numpy as np
from numba import njit

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, STATE_CODE, JointState
from anchorpose.results.frame_time import longest_even_step_s, runs_of, unbroken_runs, usual_step_s
from anchorpose.results.joint_angles import ANGLE_GROUPS, joint_angles
from anchorpose.results.tables import PROCESSING, JointTable, ProcessedAngles
from anchorpose.results.uncertainty import JOINT_SHARE, random_sigma, systematic_sigma
from anchorpose.settings import Positive, settings

# m/s, and m/s2 in the next line: standard deviations of a joint's speed and acceleration, assumed in the first frame
FIRST_SPEED_M_S: Final = 1.0
FIRST_ACCELERATION_M_S2: Final = 10.0


def smooth_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed position (n, 3) and sigma (n,) of one joint that is known in all frames, by the Kalman smoother.
    time_s (n,) increases, in steps of any size.

    The acceleration is modelled as a random walk: its standard deviation grows by ``jerk`` times the square root of the
    time. Smoothing reduces only the random part of sigma. The systematic part is added afterwards, so sigma never falls
    below this part.
    """
    course, variance = _smoothed_backwards(
        np.diff(time_s), np.ascontiguousarray(position_m), random_sigma(sigma_m, JOINT_SHARE) ** 2, jerk
    )
    return course, np.sqrt(np.maximum(variance, 0.0) + systematic_sigma(sigma_m, JOINT_SHARE) ** 2)


@njit(cache=True)
def _smoothed_backwards(
    steps_s: np.ndarray, position_m: np.ndarray, variance: np.ndarray, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the smoothed position (n, 3) and its variance along each axis (n,). The smoother's state has the rows
    position, speed and acceleration.
    """
    count = len(position_m)
    # mean[k], spread[k]: state (position, speed, acceleration) in frame k and its covariance, estimated from frames 0
    # to k
    mean, spread = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    # ahead[k], wide[k]: state (position, speed, acceleration) in frame k and its covariance, predicted from frame k - 1
    ahead, wide = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    mean[0, 0] = position_m[0]
    spread[0, 0, 0] = variance[0]
    spread[0, 1, 1], spread[0, 2, 2] = FIRST_SPEED_M_S**2, FIRST_ACCELERATION_M_S2**2
    for k in range(1, count):
        motion = _motion(steps_s[k - 1])
        ahead[k] = _times(motion, mean[k - 1])
        wide[k] = _times(_times(motion, spread[k - 1]), motion.T) + jerk**2 * _random_walk(steps_s[k - 1])
        gain = wide[k, :, 0] / (wide[k, 0, 0] + variance[k])
        for row in range(3):
            mean[k, row] = ahead[k, row] + gain[row] * (position_m[k] - ahead[k, 0])
            spread[k, row] = wide[k, row] - gain[row] * wide[k, 0]
    for k in range(count - 2, -1, -1):
        back = _times(_times(spread[k], _motion(steps_s[k]).T), _inverse(wide[k + 1]))
        mean[k] += _times(back, mean[k + 1] - ahead[k + 1])
        spread[k] += _times(_times(back, spread[k + 1] - wide[k + 1]), back.T)
    return mean[:, 0].copy(), spread[:, 0, 0].copy()


@njit(cache=True)
def _motion(step_s: float) -> np.ndarray:
    return np.array([[1.0, step_s, 0.5 * step_s**2], [0.0, 1.0, step_s], [0.0, 0.0, 1.0]])


@njit(cache=True)
def _random_walk(step_s: float) -> np.ndarray:
    """Return the covariance (3, 3) of position, speed and acceleration that a random walk of the acceleration adds in
    step_s seconds. The ``jerk`` of the walk is taken as 1: in t seconds, the standard deviation of the acceleration
    grows to sqrt(t).
    """
    h = step_s
    return np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])


@njit(cache=True)
def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two matrices (3, 3). The product is written out, since numba takes about 30 s to compile a
    general product.
    """
    product = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            product[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return product


@njit(cache=True)
def _inverse(a: np.ndarray) -> np.ndarray:
    """Return the inverse of a matrix (3, 3), by its cofactors."""
    inverse = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    return inverse / determinant


_ORDER: Final = 2  # order of the filter in one pass; the forward and backward passes together have order four
_TWICE: Final = (np.sqrt(2.0) - 1.0) ** 0.25
"""Cutoff frequency of both passes together, as a multiple of the cutoff frequency of one pass; each frequency f is
first transformed to tan(pi f / rate). Two passes are 3 dB down at a lower frequency than one pass (Winter, Biomechanics
and Motor Control of Human Movement, on digital filtering).
"""


def highest_cutoff_hz(rate_hz: float) -> float:
    """Return the upper limit of the cutoff frequency: 0.9 times half the frame rate."""
    return 0.45 * rate_hz


def shortest_frames(rate_hz: float, cutoff_hz: float) -> int:
    """Return the minimum number of frames to filter: at least two periods of the cutoff frequency, and more frames than
    the filter pads at each end.
    """
    return max(3 * (2 * _ORDER + 1) + 1, int(np.ceil(2.0 * rate_hz / cutoff_hz)))


def low_pass(values: np.ndarray, rate_hz: float, cutoff_hz: float) -> np.ndarray:
    """Filter values (n, ...) along the first axis by a Butterworth low-pass of effective order four, without delay.

    rate_hz: rate of the values, which are evenly spaced and finite. cutoff_hz: the frequency at which the forward and
    the backward pass together weaken an oscillation by 3 dB. Raises ValueError if the cutoff is not below
    ``highest_cutoff_hz``, or if values has fewer rows than ``shortest_frames``.
    """
    # imported here, since the import takes a third of a second and few recordings are filtered
    from scipy.signal import butter, sosfiltfilt

    if not 0.0 < cutoff_hz < highest_cutoff_hz(rate_hz):
        raise ValueError(f"a cutoff of {cutoff_hz:g} Hz does not fit {rate_hz:g} frames a second")
    if len(values) < shortest_frames(rate_hz, cutoff_hz):
        raise ValueError(f"{len(values)} frames are too few for a cutoff of {cutoff_hz:g} Hz")
    one_pass_hz = rate_hz / np.pi * np.arctan(np.tan(np.pi * cutoff_hz / rate_hz) / _TWICE)
    sections = butter(_ORDER, one_pass_hz, fs=rate_hz, output="sos")
    return sosfiltfilt(sections, values, axis=0)


MOST_UNEVEN: Final = 0.25
"""Maximum deviation of the time between two frames from the usual time, as a share of the usual time. The Butterworth
filter needs evenly spaced frames. Recordings with more jitter are refused, not resampled.
"""


def filter_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, cutoff_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return position (n, 3) after the Butterworth filter and sigma (n,) of one joint. The joint is known in all n
    frames; n is at least ``shortest_frames``.

    The filter spreads the error of a poorly known position to neighbouring frames. So a frame's sigma becomes the root
    mean square of the sigmas within half a period of the cutoff frequency, if this is larger than the frame's own
    sigma. Sigma is never reduced, since filtering does not remove systematic errors.
    """
    rate_hz = 1.0 / usual_step_s(time_s)
    reach = max(1, round(0.5 * rate_hz / cutoff_hz))
    padded = np.pad(sigma_m, reach, mode="edge")
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return low_pass(position_m, rate_hz, cutoff_hz), np.maximum(sigma_m, np.sqrt((near**2).mean(axis=1)))


Filling = Literal["none", "linear", "spline"]

LEAST_TRIALS: Final = 20
"""Minimum number of trials from which the error of filling a gap is estimated. In each trial, as many known positions
as the gap has missing positions are removed and filled.
"""


class Filled(NamedTuple):
    """One joint with filled gaps: position_m (n, 3) and sigma_m (n,), and filled (n,) bool: frames in which the joint
    was lost before filling.
    """

    position_m: np.ndarray
    sigma_m: np.ndarray
    filled: np.ndarray


def fill_gaps(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, fill: Filling, longest_s: float
) -> Filled:
    """Fill gaps of up to longest_s in the positions position_m (n, 3) of one joint, which are NaN where the joint is
    lost.

    A gap is not filled if it lasts longer than longest_s (from the last frame before it to the first frame after it),
    if it begins or ends the recording, if frames are missing around it, or if the joint was not known for long enough
    elsewhere to measure the error of filling. To measure the error of filling, gaps of the same length are cut wherever
    the joint is known, filled, and compared with the known positions. The error grows towards the middle of a gap.
    """
    known = np.isfinite(position_m).all(axis=1)
    reach = 1 if fill == "linear" else 2
    filled_m, spread, marked = position_m.copy(), sigma_m.copy(), np.zeros(len(time_s), dtype=bool)
    for gap in _gaps(known, time_s, reach, longest_s):
        missing = np.arange(gap.start, gap.stop)
        around = np.concatenate([np.arange(gap.start - reach, gap.start), np.arange(gap.stop, gap.stop + reach)])
        weights = _weights(time_s[missing], time_s[around])
        error_m = _trial_error(time_s, position_m, known, reach, len(missing))
        if error_m is None:
            continue
        filled_m[missing] = weights @ position_m[around]
        spread[missing] = np.hypot(np.abs(weights) @ sigma_m[around], error_m)
        marked[missing] = True
    return Filled(filled_m, spread, marked)


def _gaps(known: np.ndarray, time_s: np.ndarray, reach: int, longest_s: float) -> Iterator[slice]:
    """Yield the gaps that may be filled: gaps of at most ``longest_s``, with ``reach`` known rows on either side and
    without missing frames.
    """
    longest_step = longest_even_step_s(time_s)
    for gap in runs_of(~known):
        around = slice(max(gap.start - reach, 0), gap.stop + reach)
        if (
            known[around].sum() == 2 * reach
            and time_s[gap.stop] - time_s[gap.start - 1] <= longest_s
            and np.diff(time_s[around]).max() <= longest_step
        ):
            yield gap


def _weights(missing_s: np.ndarray, around_s: np.ndarray) -> np.ndarray:
    """Return the weights (m, 2 or 4) of the known positions around a gap. Each of the gap's m missing positions is a
    weighted sum of these known positions.

    Two known positions give the straight line between them. Four known positions give a cubic Hermite curve between the
    inner two. At each inner position, the curve's velocity is the mean velocity between this position and the outer
    position of the same side.
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
    """Return the root-mean-square error (missing,) per axis of filling a gap of ``missing`` frames. To measure this
    error, such gaps are cut wherever the joint is known; the result is None if the recording has fewer than
    ``LEAST_TRIALS`` places for them.
    """
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
    return np.sqrt(np.mean((tried - position_m[starts[:, None] + hidden]) ** 2, axis=(0, 2)))


Smoothing = Literal["none", "butterworth", "kalman"]


@settings
class ProcessingConfig:
    """Settings of how joints are smoothed and which gaps are filled; by default nothing is done.

    smooth: "butterworth" (zero lag, effective order four, ``cutoff_hz``) or "kalman" (Rauch, Tung and Striebel with the
    joints' sigma; ``jerk`` states how freely the acceleration changes). fill: "linear" or "spline" for gaps up to
    ``longest_gap_s``; longer gaps are not filled.
    """

    smooth: Smoothing = "none"
    # Hz, usual for walking and standing (Winter, Biomechanics and Motor Control of Human Movement)
    cutoff_hz: Positive = 6.0
    # m/s^2.5, random change of acceleration; large enough to follow a hand that turns back in 0.3 s
    jerk: Positive = 30.0
    fill: Filling = "none"
    longest_gap_s: Positive = 0.2  # s, maximum length of a filled gap; a reaching hand takes longer to turn back

    @property
    def active(self) -> bool:
        """Return whether any smoothing or filling is chosen."""
        return self.smooth != "none" or self.fill != "none"


def policy_text(config: ProcessingConfig, counts: dict[str, int]) -> str:
    """Return the settings as JSON, without unused settings. counts: numbers of joint positions that were measured,
    smoothed, filled and lost.
    """
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
    """Joints after processing. joints: the joints after smoothing and filling; a filled joint has the state ``hidden``.
    processing (n, 21) int8: how each joint was processed (``MEASURED``, ``SMOOTHED`` or ``FILLED``).
    """

    joints: JointTable
    processing: np.ndarray


def process_joints(joints: JointTable, config: ProcessingConfig) -> ProcessedJoints:
    """Fill gaps first, then smooth each joint, separately in every run of known frames without a missing frame.

    Raises AnchorposeError if the chosen filter does not fit the recording.
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


def process_angles(joints: JointTable, config: ProcessingConfig) -> tuple[ProcessedAngles, str]:
    """Return the angles of the processed joints, and the policy: the settings and their outcome, as JSON. An angle
    counts as filled if one of its joints was filled, else as smoothed if one of its joints was smoothed.
    """
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
    return ProcessedAngles(**arrays, processing=np.stack(columns, axis=1)), policy_text(config, counts)


def _smooth(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, config: ProcessingConfig
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return smoothed position (n, 3) and sigma (n,) in an unbroken run of frames; None if the run stays as
    measured.
    """
    if len(time_s) < 2 or config.smooth == "none":
        return None
    if config.smooth == "kalman":
        return smooth_stretch(time_s, position_m, sigma_m, config.jerk)
    if len(time_s) < shortest_frames(1.0 / usual_step_s(time_s), config.cutoff_hz):
        return None
    _require_cutoff(time_s, config.cutoff_hz)  # this run of frames may have a lower frame rate than the recording
    return filter_stretch(time_s, position_m, sigma_m, config.cutoff_hz)


def _require_even_steps(time_s: np.ndarray, cutoff_hz: float) -> None:
    if len(time_s) < 2:
        raise AnchorposeError("a single frame cannot be smoothed; leave --smooth out.")
    _require_cutoff(time_s, cutoff_hz)
    for run in unbroken_runs(np.ones(len(time_s), dtype=bool), time_s, longest_even_step_s(time_s)):
        uneven = float(np.abs(np.diff(time_s[run]) / usual_step_s(time_s[run]) - 1.0).max(initial=0.0))
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
