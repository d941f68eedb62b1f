"""A low-pass filter that delays nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.signal import butter, sosfiltfilt

_ORDER: Final = 2  # of one pass; forwards and backwards make it four
_TWICE: Final = (np.sqrt(2.0) - 1.0) ** 0.25
"""Both passes together are 3 dB down at this share of the cutoff of one, both as tangents, which is how digital filters
see frequencies (Winter, Biomechanics and Motor Control of Human Movement, on digital filtering)."""


def highest_cutoff_hz(rate_hz: float) -> float:
    """The cutoff must lie below this: nine tenths of half the rate."""
    return 0.45 * rate_hz


def shortest_frames(rate_hz: float, cutoff_hz: float) -> int:
    """Frames a stretch must have: two periods of the cutoff, and more than the filter's own padding."""
    return max(3 * (2 * _ORDER + 1) + 1, int(np.ceil(2.0 * rate_hz / cutoff_hz)))


def low_pass(values: np.ndarray, rate_hz: float, cutoff_hz: float) -> np.ndarray:
    """Values (n, ...) filtered along the first axis by a Butterworth of effective order four, zero lag.

    rate_hz: of the evenly spaced, finite values. cutoff_hz: where the two passes together are 3 dB down. Raises
    ValueError for a cutoff that is not below ``highest_cutoff_hz`` and for fewer than ``shortest_frames``.
    """
    if not 0.0 < cutoff_hz < highest_cutoff_hz(rate_hz):
        raise ValueError(f"a cutoff of {cutoff_hz:g} Hz does not fit {rate_hz:g} frames a second")
    if len(values) < shortest_frames(rate_hz, cutoff_hz):
        raise ValueError(f"{len(values)} frames are too few for a cutoff of {cutoff_hz:g} Hz")
    one_pass_hz = rate_hz / np.pi * np.arctan(np.tan(np.pi * cutoff_hz / rate_hz) / _TWICE)
    sections = butter(_ORDER, one_pass_hz, fs=rate_hz, output="sos")
    filtered: np.ndarray = sosfiltfilt(sections, values, axis=0)
    return filtered
