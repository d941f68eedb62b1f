"""The range of a vertical axis, and the round numbers written beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.report.words import number

UNITS = 1000
"""Pictures are drawn on a square of so many units and stretched to their place: whole numbers keep the page small."""

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
    """Holds all values, and of the bands so much as does not make the values less than a half of the height.

    values, bands: (lowest, highest) pairs of arrays, NaN where not known. least_span: noise is not blown up beyond it.
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
    """The smallest of 1, 2, 5, 10, ... (and of their tenths, hundredths) that is no less."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1 - 1e-9))


def _extremes(spans: Spans) -> tuple[float | None, float | None]:
    known = [pair for pair in spans if np.isfinite(pair[0]).any()]
    if not known:
        return None, None
    return min(float(np.nanmin(low)) for low, _ in known), max(float(np.nanmax(high)) for _, high in known)
