"""Range of motion of each joint: how far it was moved in the recording, from its lowest to its highest angle."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from anchorpose.results.frame_time import unbroken_runs, usual_step_s
from anchorpose.results.records import Measure
from anchorpose.results.stand_training.session import Session, inferred_share
from anchorpose.results.uncertainty import NORMAL_95, sigma_of_difference

SIDED: Final = (
    "hip_flexion", "hip_adduction", "knee_flexion", "ankle_dorsiflexion", "shoulder_elevation", "elbow_flexion",
)  # fmt: skip
UNSIDED: Final = ("trunk_flexion", "trunk_side_bend", "trunk_pelvis_rotation", "neck_flexion")

HELD_S: Final = 0.2
"""An extreme must be held for about half of this time (running median): a single frame's extreme is its error as much
as the patient's."""

LEAST_S: Final = 1.0


def range_measures(session: Session) -> list[Measure]:
    """``ANGLE_range`` in degrees of every joint, per side, with no value where the joint moved no more than it errs."""
    names = [(angle, side) for angle in SIDED for side in ("left", "right")] + [(angle, None) for angle in UNSIDED]
    return [_range(session, angle, side) for angle, side in names]


def _range(session: Session, angle: str, side: str | None) -> Measure:
    measure, column = f"{angle}_range", session.angles.column(angle if side is None else f"{angle}_{side}")
    degrees, sigma = session.angles.degrees[:, column], session.angles.sigma_deg[:, column]
    rows, held = _held(degrees, session.joints.time_s)
    if not len(rows):
        why = f"the angle was never known for {LEAST_S:g} s without a break"
        return Measure(measure=measure, side=side, value=None, unit="deg", frames=0, why=why)
    low, high = int(np.argmin(held)), int(np.argmax(held))
    value, (first, second) = float(held[high] - held[low]), sigma[rows[[low, high]]]
    shared = inferred_share(session.angles.state_code[rows, column])
    if value <= NORMAL_95 * np.hypot(first, second):  # extremes of errors alone are as far apart as independent ones
        why = "the joint moved by no more than the errors of its angle"
        return Measure(
            measure=measure, side=side, value=None, unit="deg", frames=len(rows), inferred_share=shared, why=why
        )
    spread = sigma_of_difference(first, second)
    return Measure(
        measure=measure, side=side, value=value, unit="deg", sigma=spread, frames=len(rows), inferred_share=shared
    )


def _held(degrees: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) of stretches that are long enough, and the running median (k,) within each."""
    step_s = usual_step_s(time_s)
    if not np.isfinite(step_s):
        return np.empty(0, dtype=np.int64), np.empty(0)
    window = 2 * round(0.5 * HELD_S / step_s) + 1
    rows, held = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for run in unbroken_runs(np.isfinite(degrees), time_s, 2.0 * step_s):
        if time_s[run.stop - 1] - time_s[run.start] >= LEAST_S:
            rows.append(np.arange(run.start, run.stop))
            held.append(median_filter(degrees[run], window, mode="nearest"))
    return np.concatenate(rows), np.concatenate(held)
