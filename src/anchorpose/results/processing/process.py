"""Smoothing and gap filling: what the user may ask for, and the joints and angles after it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, STATE_CODE, JointState
from anchorpose.results.frame_time import blocks, longest_even_step_s, unbroken_runs, usual_step_s
from anchorpose.results.kinematics.joint_angles import ANGLE_GROUPS, joint_angles
from anchorpose.results.processing.filters import (
    MOST_UNEVEN,
    evenness,
    filter_stretch,
    highest_cutoff_hz,
    shortest_frames,
    smooth_stretch,
)
from anchorpose.results.processing.gaps import Filling, fill_gaps
from anchorpose.results.tables import PROCESSING, JointTable, ProcessedAngles
from anchorpose.settings import Positive, settings

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


def process_angles(joints: JointTable, config: ProcessingConfig) -> Iterator[ProcessedAngles]:
    """The angles of the processed joints, some frames after the other.

    An angle is as processed as the most processed of its joints.
    """
    done = process_joints(joints, config)
    counts = {f"joint_frames_{name}": int((done.processing == code).sum()) for code, name in enumerate(PROCESSING)}
    counts["joint_frames_measured"] -= int(done.joints.lost.sum())
    counts["joint_frames_lost"] = int(done.joints.lost.sum())
    for rows in blocks(len(joints.frame)):
        angles = joint_angles(done.joints.frames(rows))
        columns = [
            done.processing[rows][:, [JOINT_INDEX[name] for name in group.joints]].max(axis=1)
            for group in ANGLE_GROUPS for _ in group.names
        ]  # fmt: skip
        arrays = {field.name: getattr(angles, field.name) for field in fields(angles)}
        yield ProcessedAngles(**arrays, processing=np.stack(columns, axis=1), policy=policy_text(config, counts))


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
