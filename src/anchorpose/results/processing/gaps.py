"""Filling short gaps of one joint, with an uncertainty that is measured on the same joint where it was seen."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np

from anchorpose.results.frame_time import longest_even_step_s, usual_step_s

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
