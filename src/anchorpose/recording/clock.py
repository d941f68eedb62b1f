"""The clock of a camera against the reference clock, and a recording with its clocks put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.recording.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """What a camera's clock says: at the reference time t it shows t + ahead_s + drift (t - at_s)."""

    ahead_s: float = 0.0
    drift: float = 0.0  # seconds a second
    at_s: float = 0.0  # the reference time at which ahead_s holds

    def reference_s(self, own_s: np.ndarray) -> np.ndarray:
        """The reference times of what this clock showed, (n,) float64."""
        return np.asarray(self.at_s + (own_s - self.at_s - self.ahead_s) / (1.0 + self.drift))

    def own_s(self, reference_s: float) -> float:
        """What this clock shows at a reference time."""
        return reference_s + self.ahead_s + self.drift * (reference_s - self.at_s)


def put_clocks_together(recording: Recording, clocks: Sequence[Clock]) -> Recording:
    """``recording`` with the times of every camera on the reference clock; one clock a camera."""
    streams = tuple(
        replace(stream, time_s=clock.reference_s(stream.time_s))
        for stream, clock in zip(recording.streams, clocks, strict=True)
    )
    return replace(recording, streams=streams)
