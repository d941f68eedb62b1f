"""Joints low-passed without delay, stretch by stretch."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.results.processing.low_pass import low_pass, shortest_frames

MOST_UNEVEN: Final = 0.25
"""Of the usual step. The filter needs even steps; stamps that jitter more are refused rather than resampled."""


def evenness(time_s: np.ndarray) -> float:
    """The greatest deviation of a step within these frames (n,) from their usual one, in usual steps."""
    step = np.diff(time_s)
    return float(np.abs(step / np.median(step) - 1.0).max()) if len(step) else 0.0


def filter_stretch(
    time_s: np.ndarray, position_m: np.ndarray, sigma_m: np.ndarray, cutoff_hz: float
) -> tuple[np.ndarray, np.ndarray] | None:  # fmt: skip
    """Position (n, 3) and sigma (n,) of one joint that is known in all frames; None of too short a stretch.

    Sigma stays what it was, or becomes that of the worst neighbours within half a period of the cutoff: errors that
    last are not filtered away, and a poorly known frame moves its neighbours.
    """
    rate_hz = 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if not rate_hz or len(time_s) < shortest_frames(rate_hz, cutoff_hz):
        return None
    reach = max(1, round(0.5 * rate_hz / cutoff_hz))
    padded = np.pad(sigma_m, reach, mode="edge")
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return low_pass(position_m, rate_hz, cutoff_hz), np.maximum(sigma_m, np.sqrt((near**2).mean(axis=1)))
