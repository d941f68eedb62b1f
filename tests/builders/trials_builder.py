"""Results with trials made up for the tests: a patient who stands with the knees bent as the stimulation allows."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from results_builder import make_frame, write_results
from session_builder import RATE, squatting_joints

from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig

TRIAL_S = 4.0


def trials_in_turn(amplitudes: Sequence[float | None], second_s: float = TRIAL_S) -> Trials:
    """One trial after the other; without an amplitude the condition is ``off``, else ``on``."""
    rows = [
        Trial(k + 1, "off" if amplitude is None else "on", k * second_s, second_s, k * second_s, (amplitude, "L1-L2"))
        for k, amplitude in enumerate(amplitudes)
    ]
    return Trials((TrialColumn("amplitude", "mA"), TrialColumn("electrodes", None)), tuple(rows))


def write_trial_results(
    folder: Path, amplitudes: Sequence[float | None], degrees_per_ma: float = 0.2, sigma_m: float = 0.004
) -> Path:
    """A results folder whose knees are bent by 12 degrees, less with the amplitude, and by chance in every trial."""
    random, steps = np.random.default_rng(3), round(TRIAL_S * RATE)
    bent = [
        12.0 - degrees_per_ma * (amplitude or 0.0) + random.normal(scale=0.8) + random.normal(scale=0.3, size=steps)
        for amplitude in amplitudes
    ]
    degrees = np.concatenate(bent)
    joints = squatting_joints(0.5 * degrees, 0.5 * degrees)
    frames = [make_frame(k, k / RATE, joints[k], sigma_m=sigma_m) for k in range(len(joints))]
    write_results(folder, frames)
    write_measured(folder, ProcessingConfig(), MeasureConfig(), trials_in_turn(amplitudes))
    return folder
