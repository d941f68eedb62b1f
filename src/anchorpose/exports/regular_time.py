"""Bring samples to a fixed frame rate, and find stretches of frames without a gap, for formats that need a fixed rate
or no gaps.

At a fixed rate, frames have evenly spaced times (the grid). A measured sample stays unchanged if its time is close
enough to a time of the grid (``NEAR_SHARE``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from anchorpose.errors import AnchorposeError
from anchorpose.exports.formats import Samples
from anchorpose.joints import LOST
from anchorpose.results.frame_time import LONGEST_STEP, longest_known_gap_s, runs_of

NEAR_SHARE: Final = 0.01
"""Maximum difference between the time of a sample and a grid time for the sample to be used unchanged, as a share of
the time between frames. At 30 frames per second, this difference is 0.3 ms, in which a hand at 3 m/s moves by 1 mm.
"""


MOST_ROWS: Final = 20
"""Maximum number of grid frames per recorded frame; with more grid frames, the recording consists mostly of pauses."""


class TimeBase(StrEnum):
    """The way in which the times of the samples were changed for a fixed rate."""

    AS_RECORDED = "as recorded"
    GAPS_FILLED_UP = "as recorded; frames that were not recorded are there without values"
    RESAMPLED = "resampled: linear between neighbours near in time, never across a gap"


@dataclass(frozen=True, slots=True, eq=False)
class Interpolation:
    """The recorded samples between which each time of a regular grid lies.

    before (g,): index of the sample before each grid time; share (g,): position of the grid time between this sample
    (0) and the next (1), exactly 0 or 1 where a sample is used unchanged; bridged (g,) bool: False in a gap between
    samples.
    """

    before: np.ndarray
    share: np.ndarray
    bridged: np.ndarray

    @property
    def recorded(self) -> np.ndarray:
        """Return (g,) bool: True for grid times at which a recorded sample is used unchanged."""
        return self.bridged & ((self.share == 0.0) | (self.share == 1.0))

    def values(self, values: np.ndarray, turn: float = np.inf) -> np.ndarray:
        """Interpolate values (n, ...) linearly to (g, ...), NaN in a gap and where a needed sample is NaN.

        turn: a full turn in the unit of the values, if these are angles; angles are interpolated along the shorter arc.
        """
        fit = (slice(None), *[None] * (values.ndim - 1))
        share, left, right = self.share[fit], values[self.before], values[self.before + 1]
        change = right - left
        if np.isfinite(turn):
            change = (change + turn / 2.0) % turn - turn / 2.0
        mixed = np.where(share == 0.0, left, np.where(share == 1.0, right, left + share * change))
        return np.where(self.bridged[fit], mixed, np.nan)

    def worse_state(self, state_code: np.ndarray) -> np.ndarray:
        """Return the worse state code, (g, ...), of the two samples around each grid time; in a gap, the code of
        ``lost``.
        """
        share, left, right = self.share[:, None], state_code[self.before], state_code[self.before + 1]
        worst = np.where(share == 0.0, left, np.where(share == 1.0, right, np.maximum(left, right)))
        return np.where(self.bridged[:, None], worst, LOST).astype(np.int8)


@dataclass(frozen=True, slots=True, eq=False)
class RegularSamples:
    """Samples at the fixed rate ``rate_hz``. interpolation: how to interpolate other values from the recorded times to
    the times of ``samples``.
    """

    samples: Samples
    rate_hz: float
    base: TimeBase
    interpolation: Interpolation


def regular_samples(samples: Samples) -> RegularSamples:
    """Bring the samples to a fixed rate; at times without samples, values are NaN and every state is ``lost``.

    If all times lie on a regular grid, times and values stay unchanged to the bit, and grid frames that were not
    recorded are added without values. Otherwise, and if the camera was slower than the grid for a while, values are
    interpolated linearly between the two samples around each new time, if these samples are near in time and both have
    a value. The state is the worse state of the two samples. Sigma is interpolated too, as if both samples had the same
    error. Raises AnchorposeError for a single frame, or if the recording mostly paused.
    """
    time_s = samples.time_s
    rate_hz, slot, on_grid = _grid(time_s)
    if slot[-1] + 1 > MOST_ROWS * len(time_s):
        raise AnchorposeError("The recording pauses for most of its time; track its parts, or export with --to csv.")
    if not on_grid or (np.diff(slot)[near_in_time(time_s)] > 1).any():
        grid_s, interpolation = _resampling(time_s, rate_hz)
        return RegularSamples(_at(samples, grid_s, interpolation), rate_hz, TimeBase.RESAMPLED, interpolation)
    grid_s, interpolation = _placing(time_s, rate_hz, slot)
    base = TimeBase.AS_RECORDED if interpolation.recorded.all() else TimeBase.GAPS_FILLED_UP
    return RegularSamples(_at(samples, grid_s, interpolation), rate_hz, base, interpolation)


def nominal_rate_hz(time_s: np.ndarray) -> float:
    """Return the frame rate (Hz) of times (n,), with as few decimals as the times allow; raises AnchorposeError for one
    frame.
    """
    return _grid(time_s)[0]


def near_in_time(time_s: np.ndarray) -> np.ndarray:
    """Return (n - 1,) bool: whether a frame and the next are so near in time that no frame is missing between them. The
    time between them (the step) must be at most ``LONGEST_STEP`` times the median step in the second around them, since
    a camera may slow down in poor light, and at most ``longest_known_gap_s``. Raises AnchorposeError for a single
    frame.
    """
    steps_s = np.diff(time_s)
    # The median is taken over a step (the time from a frame to the next) and this number of steps on either side. The
    # number is even: where short and long steps alternate, the median around a step then equals this step, so no frame
    # counts as missing
    per_side = 2 * round(nominal_rate_hz(time_s) / 4.0)
    usual_s = median_filter(steps_s, 2 * per_side + 1, mode="mirror")
    return np.asarray((steps_s <= LONGEST_STEP * usual_s) & (steps_s <= longest_known_gap_s(time_s)))


def _grid(time_s: np.ndarray) -> tuple[float, np.ndarray, bool]:
    """Return the frame rate (Hz) with the fewest decimals for which all samples lie on a grid, each sample's index on
    this grid, and True. If the samples lie on no such grid, return a rounded rate, indices counted in steps of the
    usual interval between frames, and False.
    """
    if len(time_s) < 2:
        raise AnchorposeError("One frame has no frame rate; export it with --to csv.")
    steps_s = np.diff(time_s)
    step_s = float(np.median(steps_s))
    for _ in range(3):  # each step is rounded separately, so that an error of step_s does not add up
        slot = np.concatenate([[0], np.cumsum(np.rint(steps_s / step_s).astype(np.int64))])
        step_s = float((time_s[-1] - time_s[0]) / max(slot[-1], 1))
    for rate_hz in (*(round(1.0 / step_s, digits) for digits in (0, 1, 2, 3, 6)), 1.0 / step_s):
        if rate_hz > 0 and _lies_on_grid(time_s, rate_hz, slot):
            return rate_hz, slot, True
    return _round_rate(1.0 / step_s), slot, False


def _lies_on_grid(time_s: np.ndarray, rate_hz: float, slot: np.ndarray) -> bool:
    off_s = np.abs(time_s - time_s[0] - slot / rate_hz)
    return bool((off_s <= NEAR_SHARE / rate_hz).all() and (np.diff(slot) > 0).all())


def _round_rate(rate_hz: float) -> float:
    """Round a rate (Hz) to a whole number if the two differ by at most 1 %, otherwise to three decimals."""
    whole = round(rate_hz)
    return float(whole) if whole and abs(rate_hz - whole) <= NEAR_SHARE * rate_hz else round(rate_hz, 3)


def _placing(time_s: np.ndarray, rate_hz: float, slot: np.ndarray) -> tuple[np.ndarray, Interpolation]:
    """Return the times of a regular grid, and an ``Interpolation`` that copies each sample to its index ``slot`` in the
    grid. At these indices, the grid has the samples' own times; all other grid times are gaps.
    """
    count = int(slot[-1]) + 1
    grid_s = time_s[0] + np.arange(count) / rate_hz
    grid_s[slot] = time_s
    recorded = np.zeros(count, dtype=bool)
    recorded[slot] = True
    before = np.zeros(count, dtype=np.int64)
    before[slot] = np.minimum(np.arange(len(slot)), len(slot) - 2)
    share = np.zeros(count)
    share[slot[-1]] = 1.0
    return grid_s, Interpolation(before, share, recorded)


def _resampling(time_s: np.ndarray, rate_hz: float) -> tuple[np.ndarray, Interpolation]:
    """Return grid times from the first sample to the last, and the samples on both sides of each grid time."""
    count = int(np.floor((time_s[-1] - time_s[0]) * rate_hz + NEAR_SHARE)) + 1
    grid_s = time_s[0] + np.arange(count) / rate_hz
    before = np.clip(np.searchsorted(time_s, grid_s, side="right") - 1, 0, len(time_s) - 2)
    apart_s = time_s[before + 1] - time_s[before]
    share, near = (grid_s - time_s[before]) / apart_s, NEAR_SHARE / rate_hz / apart_s
    share = np.where(share <= near, 0.0, np.where(share >= 1.0 - near, 1.0, share))
    bridged = near_in_time(time_s)[before] | (share == 0.0) | (share == 1.0)
    return grid_s, Interpolation(before, share, bridged)


def _at(samples: Samples, grid_s: np.ndarray, interpolation: Interpolation) -> Samples:
    return replace(
        samples,
        time_s=grid_s,
        position_m=interpolation.values(samples.position_m),
        joint_sigma_m=interpolation.values(samples.joint_sigma_m),
        joint_state_code=interpolation.worse_state(samples.joint_state_code),
        degrees=interpolation.values(samples.degrees, turn=360.0),
        sigma_deg=interpolation.values(samples.sigma_deg),
        angle_state_code=interpolation.worse_state(samples.angle_state_code),
    )


KEPT_SHARE: Final = 0.5
"""Minimum share of frames in which a column has a value, among the frames in which any column has a value. Columns with
a smaller share are not written, since they would leave too few complete frames.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """The columns and stretches of frames to write. kept (c,) bool: columns to write; runs: for each stretch (run of
    two or more frames) in which all these columns are known, the index of its first frame, and the index after its last
    frame; alone: number of frames in which all these columns are known, but not in the frame before or after, so that
    no stretch holds them.
    """

    kept: np.ndarray
    runs: tuple[tuple[int, int], ...]
    alone: int

    @property
    def frames(self) -> int:
        """Return the number of frames in all stretches."""
        return sum(last - first for first, last in self.runs)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return a note for users on the number of frames that stand alone (``alone``); no note without such frames."""
        return (f"Complete frames left out, since the frames next to them are not: {self.alone}.",) * (self.alone > 0)


def stretches_of(known: np.ndarray, joined: np.ndarray | None = None) -> Stretches:
    """Find the stretches of frames to write. known (n, c) bool: whether each column has a value in each frame; joined
    (n - 1,) bool: whether a frame and the next frame are neighbours in time; None if all are. ``runs`` is empty if no
    two neighbouring frames have all columns to write.
    """
    frames = int(known.any(axis=1).sum())  # neither pauses nor frames in which the patient is lost count
    kept = known.sum(axis=0) >= KEPT_SHARE * max(frames, 1)
    whole = np.asarray(known[:, kept].all(axis=1) & kept.any())
    runs = runs_where(whole, joined)
    return Stretches(kept, runs, int(whole.sum()) - sum(last - first for first, last in runs))


def runs_where(whole: np.ndarray, joined: np.ndarray | None = None) -> tuple[tuple[int, int], ...]:
    """Return, for each run of two or more True values in ``whole`` (n,) bool, the index of its first frame and the
    index after its last frame.

    joined (n - 1,) bool: whether a frame and the next frame are neighbours in time; None if all are.
    """
    return tuple((run.start, run.stop) for run in runs_of(whole, joined) if run.stop - run.start >= 2)


def stretch_name(stem: str, suffix: str, number: int, count: int) -> str:
    """Return a stretch's file name: ``motion.mot``, or ``motion_001.mot`` if there are several stretches."""
    return f"{stem}{suffix}" if count == 1 else f"{stem}_{number + 1:03d}{suffix}"
