"""Measure tremor and clonus: oscillation of knees and ankles between 3 and 8 Hz, if the frame rate can show it.

Clonus after a spinal-cord injury is a rhythmic contraction at 3 to 8 Hz. Errors of joints contain all frequencies, and
voluntary movement is slower than 3 Hz. So an oscillation counts if a narrow peak holds most of the power above 1 Hz.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field

from anchorpose.joints import STATE_CODE, JointState
from anchorpose.results.frame_time import longest_dropped_s, recorded_seconds, unbroken_runs, usual_step_s
from anchorpose.results.records import STEP_LEFT, STEP_RIGHT, Measure
from anchorpose.results.stand_training.event import ROUNDING_S, fast_enough
from anchorpose.results.stand_training.stance import Session, known, unknown
from anchorpose.settings import Positive, settings

LOWEST_HZ, HIGHEST_HZ = 3.0, 8.0  # Hz, range of frequencies of tremor and clonus

LEAST_HZ: Final = 20.0
"""Minimum frame rate in Hz, which gives 2.5 frames per period of the fastest oscillation."""

WINDOW_S: Final = 2.0
"""Length of a window in s, which contains six periods of the slowest oscillation. The frequencies of its spectrum are
half a hertz apart.
"""

MOVEMENT_HZ: Final = 1.0
"""Power up to this frequency in Hz comes from posture and slow movement; it is left out of ``Window.share``."""

PEAK_HZ: Final = 0.75
"""Half width of a peak in Hz: that of a Hann window of 2 s, plus one frequency step, since the frequency varies."""

JOINTS: Final = {"knee": "knee_flexion", "ankle": "ankle_dorsiflexion"}
UNITS: Final = {"time": "s", "frequency": "Hz", "amplitude": "deg"}

TOO_SLOW: Final = f"oscillations up to {HIGHEST_HZ:g} Hz need {LEAST_HZ:g} frames a second or more"
NOT_SEEN: Final = f"the joint was never seen for {WINDOW_S:g} s without a break and without a step"
NONE: Final = "no such oscillation was seen"


@settings
class TremorConfig:
    """Settings of when an oscillation counts as tremor or clonus."""

    least_deg: Positive = 1.0  # degrees, minimum amplitude (half of peak to peak); less is hardly visible
    # minimum share of the power above 1 Hz that the peak holds; for errors without rhythm, the share is 0.1 at 30
    # frames per second
    peak_share: Annotated[float, Field(gt=0, lt=1)] = 0.6


class Window(NamedTuple):
    """A time window. rows: rows of its frames. seconds: time that these frames represent. frequency_hz, amplitude_deg:
    frequency and amplitude of the highest peak between 3 and 8 Hz; share: share of the power above ``MOVEMENT_HZ`` that
    this peak holds.
    """

    rows: slice
    seconds: float
    frequency_hz: float
    amplitude_deg: float
    share: float


def tremor_measures(session: Session, config: TremorConfig) -> list[Measure]:
    """Return time, frequency and amplitude of the oscillation of each knee and ankle."""
    return [row for joint in JOINTS for side in ("left", "right") for row in _of_joint(session, joint, side, config)]


def _of_joint(session: Session, joint: str, side: str, config: TremorConfig) -> list[Measure]:
    names = {f"tremor_{joint}_{what}": unit for what, unit in UNITS.items()}
    (degrees, _, codes), time_s = session.angle(f"{JOINTS[joint]}_{side}"), session.joints.time_s
    if not fast_enough(time_s, LEAST_HZ):
        return [unknown(name, unit, TOO_SLOW, side) for name, unit in names.items()]
    windows = list(_windows(time_s, degrees, np.isfinite(degrees) & (codes == SEEN) & ~_stepping(session)))
    if not windows:
        return [unknown(name, unit, NOT_SEEN, side) for name, unit in names.items()]
    used = np.concatenate([codes[window.rows] for window in windows])
    shaking = [w for w in windows if w.share >= config.peak_share and w.amplitude_deg >= config.least_deg]
    total_s = float(sum(window.seconds for window in shaking))
    sigma_s = WINDOW_S / np.sqrt(6.0) * np.sqrt(len(shaking)) if shaking else None
    time_name, *others = names
    rows = [known(time_name, "s", total_s, used, None if sigma_s is None else float(sigma_s), side)]
    if not shaking:
        return rows + [unknown(name, names[name], NONE, side) for name in others]
    greatest = max(shaking, key=lambda window: window.amplitude_deg)
    sigma_deg = greatest.amplitude_deg * np.sqrt(1.0 - greatest.share)
    return [
        *rows,
        known(others[0], "Hz", greatest.frequency_hz, codes[greatest.rows], 0.25 / WINDOW_S, side),
        known(others[1], "deg", greatest.amplitude_deg, codes[greatest.rows], float(sigma_deg), side),
    ]


def _stepping(session: Session) -> np.ndarray:
    """Return (n,) bool: frames in which a foot is in the air. The search for tremor and clonus leaves these frames out,
    since quick steps shake a leg as fast as clonus does.
    """
    time_s, stepping = session.joints.time_s, np.zeros(len(session.seconds), dtype=bool)
    for episode in session.episodes:
        if episode.kind in (STEP_LEFT, STEP_RIGHT):
            stepping |= (time_s >= episode.start_s) & (time_s <= episode.end_s)
    return stepping


SEEN: Final = STATE_CODE[JointState.OBSERVED]


def _windows(time_s: np.ndarray, degrees: np.ndarray, seen: np.ndarray) -> Iterator[Window]:
    """Yield successive windows within unbroken runs of usable frames. seen (n,) bool: frames in which the angle is
    known from seen joints and no foot is in the air.
    """
    step_s = usual_step_s(time_s)
    for run in unbroken_runs(seen, time_s, longest_dropped_s(time_s)):
        starts = np.arange(time_s[run.start], time_s[run.stop - 1] - WINDOW_S + 1.5 * step_s, WINDOW_S)
        for start_s in starts.tolist():
            first, stop = np.searchsorted(time_s, [start_s - ROUNDING_S, start_s + WINDOW_S - ROUNDING_S])
            rows = slice(int(first), min(int(stop), run.stop))
            yield _window(time_s[rows], degrees[rows], rows)


def _window(time_s: np.ndarray, degrees: np.ndarray, rows: slice) -> Window:
    """Return a window with the highest peak between 3 and 8 Hz in the spectrum of the angle. The angle's mean and slope
    are subtracted first, and a Hann window is applied.
    """
    count = len(time_s)
    even_s = np.linspace(time_s[0], time_s[-1], count)
    even = np.interp(even_s, time_s, degrees)
    even = even - np.polyval(np.polyfit(even_s - even_s[0], even, 1), even_s - even_s[0])
    taper = np.hanning(count)
    power = np.abs(np.fft.rfft(even * taper)) ** 2
    frequency_hz = np.fft.rfftfreq(count, (even_s[-1] - even_s[0]) / (count - 1))
    band = (frequency_hz >= LOWEST_HZ) & (frequency_hz <= HIGHEST_HZ)
    top = int(np.argmax(np.where(band, power, -1.0)))
    peak = np.abs(frequency_hz - frequency_hz[top]) <= PEAK_HZ
    held, total = float(power[peak].sum()), float(power[frequency_hz > MOVEMENT_HZ].sum())
    # at positive frequencies, a sine of amplitude A in the Hann window ``taper`` has the power A^2 / 4 * count *
    # sum(taper^2)
    amplitude = float(np.sqrt(4.0 * held / (count * (taper**2).sum())))
    share = min(held / total, 1.0) if total > 0 else 0.0
    centre = float((power[peak] * frequency_hz[peak]).sum() / held) if held > 0 else float(frequency_hz[top])
    return Window(rows, recorded_seconds(time_s), centre, amplitude, share)
