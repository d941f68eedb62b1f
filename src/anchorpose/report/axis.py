"""The two axes of a chart: round numbers beside it, and frames in groups along it.

A long recording on a narrow page is drawn in groups of frames, each by its lowest and highest value. Every k-th frame
would lose what lasts one frame: a jerk, a gap, the worst moment. The lowest and highest of each group are what a line
through all frames would cover, so peaks keep their place and height.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.report.words import number

UNITS: Final = 1000
"""Rows are drawn on a square of this many units and stretched to their place: whole numbers keep the page small."""

Spans = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, slots=True)
class Axis:
    """From ``low`` at the bottom to ``high`` at the top."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def down(self, value: np.ndarray) -> np.ndarray:
        """Whole units from the top; a value beyond the axis lies beyond the picture, by no more than its height."""
        place = (self.high - np.asarray(value, dtype=np.float64)) / (self.high - self.low)
        return np.round(UNITS * np.clip(place, -1.0, 2.0))

    def labels(self) -> list[tuple[float, str]]:
        """(share from the top, text) of each tick."""
        step = self.ticks[1] - self.ticks[0] if len(self.ticks) > 1 else 1.0
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        return [((self.high - tick) / (self.high - self.low), number(tick, decimals)) for tick in self.ticks]


def make_axis(values: Spans, bands: Spans, least_span: float, most_ticks: int = 5) -> Axis:
    """Holds all values, and as much of the bands as leaves the values at least half of the height.

    values, bands: (lowest, highest) pairs of arrays, NaN where not known. least_span: so that noise is not magnified.
    """
    low, high = _extremes(values)
    if low is None or high is None:
        return Axis(0.0, 1.0, ())
    span = max(high - low, least_span)
    middle = (low + high) / 2.0
    low, high = min(low, middle - span / 2.0), max(high, middle + span / 2.0)
    outer_low, outer_high = _extremes(bands)
    low = low if outer_low is None else max(min(low, outer_low), low - span / 2.0)
    high = high if outer_high is None else min(max(high, outer_high), high + span / 2.0)
    step = round_step((high - low) / most_ticks)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, tuple(step * k for k in range(first, last + 1)))


def round_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, ... (and of their tenths, hundredths) that is at least ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1 - 1e-9))


def _extremes(spans: Spans) -> tuple[float | None, float | None]:
    known = [pair for pair in spans if np.isfinite(pair[0]).any()]
    if not known:
        return None, None
    return min(float(np.nanmin(low)) for low, _ in known), max(float(np.nanmax(high)) for _, high in known)


MOST_BINS: Final = 600
"""Groups at most: about one and a half pixels each on a page, a third of a millimetre on paper."""

PAUSE: Final = 3.0
"""A gap of more than this many usual intervals between frames is a pause, across which no line is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Groups of neighbouring frames. start (b,) first row of each group; time_s (n,), frame (n,) of all frames.

    after_pause (b,) bool: no line connects this group with the one before. clock: the name of the session, where a page
    shows several.
    """

    frame: np.ndarray
    time_s: np.ndarray
    start: np.ndarray
    after_pause: np.ndarray
    clock: str = ""

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.start)

    @property
    def last(self) -> np.ndarray:
        """(b,) last row of each group."""
        return np.append(self.start[1:], len(self.frame)) - 1

    @property
    def thinned(self) -> bool:
        """Whether any group holds more than one frame."""
        return self.count < len(self.frame)

    @property
    def place(self) -> np.ndarray:
        """(b,) where the middle of each group lies between the first frame (0) and the last (1)."""
        middle = (self.time_s[self.start] + self.time_s[self.last]) / 2.0
        return self.place_of(middle)

    def place_of(self, time_s: np.ndarray) -> np.ndarray:
        """Where a time lies between the first frame (0) and the last (1); one frame alone lies in the middle."""
        span = self.time_s[-1] - self.time_s[0]
        return (time_s - self.time_s[0]) / span if span > 0 else np.full(np.shape(time_s), 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """The lowest and highest known value of each group, (b,) each, NaN where no frame of it has one.

    rising (b,) bool: the lowest comes first.
    """

    low: np.ndarray
    high: np.ndarray
    rising: np.ndarray


def make_bins(frame: np.ndarray, time_s: np.ndarray, clock: str = "", most: int = MOST_BINS) -> Bins:
    """At most ``most`` groups of equally many frames; one frame each where that suffices."""
    count = min(len(frame), most)
    start = np.arange(count) * len(frame) // count
    step = np.diff(time_s)
    pauses = np.append(False, step > PAUSE * np.median(step)) if len(step) else np.zeros(1, dtype=bool)
    return Bins(frame, time_s, start, np.logical_or.reduceat(pauses, start), clock)


def envelope(values: np.ndarray, bins: Bins) -> Envelope:
    """values (n,), NaN where not known."""
    low, high = np.fmin.reduceat(values, bins.start), np.fmax.reduceat(values, bins.start)
    group = np.repeat(np.arange(bins.count), np.diff(np.append(bins.start, len(values))))
    rows = np.arange(len(values))
    at_low = np.minimum.reduceat(np.where(values == low[group], rows, len(values)), bins.start)
    at_high = np.minimum.reduceat(np.where(values == high[group], rows, len(values)), bins.start)
    return Envelope(low, high, at_low <= at_high)


def worst(state_code: np.ndarray, bins: Bins) -> np.ndarray:
    """(b,) the worst state of each group."""
    return np.maximum.reduceat(state_code, bins.start)
