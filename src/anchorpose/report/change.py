"""Whether a measure changed between two sessions by more than the errors that are stated for it.

|b - a| > 1.96 sqrt(sigma_a^2 + sigma_b^2): the smallest change that errors of measurement alone, normal and independent
between the sessions, would exceed only 5 times in 100 (the smallest detectable change; Weir 2005,
doi:10.1519/15184.1). It knows nothing of how a patient differs from day to day, so that a larger change may still be
none in the patient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from anchorpose.report.words import COVERAGE
from anchorpose.results.measures import Measure


@dataclass(frozen=True, slots=True)
class Change:
    """difference: later minus first; detectable: the least that exceeds the errors, None where no error is stated."""

    difference: float
    detectable: float | None

    @property
    def exceeds(self) -> bool | None:
        """Whether it is more than the errors; None where that cannot be told."""
        return None if self.detectable is None else abs(self.difference) > self.detectable


def change_between(first: Measure, later: Measure) -> Change | None:
    """None where one of them has no value. Raises ValueError for different measures or units."""
    if (first.measure, first.side, first.part, first.unit) != (later.measure, later.side, later.part, later.unit):
        raise ValueError(f"{first} and {later} are not the same measure")
    if first.value is None or later.value is None:
        return None
    difference = later.value - first.value
    if not first.sigma or not later.sigma:  # of no error nothing follows, and an error of 0 is none that was measured
        return Change(difference, None)
    return Change(difference, COVERAGE * math.hypot(first.sigma, later.sigma))
