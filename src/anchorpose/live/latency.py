"""How long images take from the moment they were taken to the joints: median and 99 %, in constant memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

STEP_S: Final = 0.001
LONGEST_S: Final = 60.0  # more counts as so much


@dataclass(frozen=True, slots=True)
class LatencySummary:
    """median_s, p99_s: to a millisecond, NaN of nothing; longest_s; count: of frames; dropped: that nobody tracked."""

    median_s: float
    p99_s: float
    longest_s: float
    count: int
    dropped: int

    @property
    def sentence(self) -> str:
        """For the screen and run.json."""
        if not self.count:
            return "no frame was tracked live"
        return (
            f"{self.count} frames were tracked live, {self.dropped} images were dropped; from image to joints "
            f"{1000 * self.median_s:.0f} ms in the median, {1000 * self.p99_s:.0f} ms in 99 of 100 frames, "
            f"{1000 * self.longest_s:.0f} ms at most"
        )


class LatencyMeter:
    """Counts latencies by milliseconds. dropped: images so far that nobody tracked."""

    def __init__(self) -> None:
        self._counts = np.zeros(int(LONGEST_S / STEP_S) + 1, np.int64)
        self._longest_s, self.dropped = 0.0, 0

    def add(self, latency_s: float, dropped: int = 0) -> None:
        """One more frame; dropped: images before it that nobody tracked."""
        self._counts[min(max(round(latency_s / STEP_S), 0), len(self._counts) - 1)] += 1
        self._longest_s = max(self._longest_s, latency_s)
        self.dropped += dropped

    def summary(self) -> LatencySummary:
        """Of all frames so far."""
        count = int(self._counts.sum())
        below = np.cumsum(self._counts)
        median_s, p99_s = (
            float(np.searchsorted(below, share * count)) * STEP_S if count else float("nan") for share in (0.5, 0.99)
        )
        return LatencySummary(median_s, p99_s, self._longest_s, count, self.dropped)
