"""Heat kernel signature: how much heat is still at a node some time after it was put there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.features.spectral_sums import body_sums, require_range, weighted_squares
from anchorpose.features.spectrum import Spectrum

DECAY = 4.0 * np.log(10.0)
"""A wave that decays by so much (e^-DECAY = 1e-4) has gone: the shortest and the longest time of Sun et al."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HksConfig:
    """Which times."""

    times: int = 100  # as Sun et al.
    range_m2: tuple[float, float] | None = None  # first and last time; None: from the spectrum, as Sun et al.
    scaled: bool = True  # by the heat trace, as Sun et al. compare: else short times outweigh all others

    def __post_init__(self) -> None:
        if self.times < 1:
            raise ValueError(f"times must be at least 1, got {self.times}")
        require_range("range_m2", self.range_m2)


def hks(spectrum: Spectrum, config: HksConfig | None = None, chosen: np.ndarray | None = None) -> np.ndarray:
    """sum_i exp(-lambda_i t) phi_i(x)^2 at times t evenly apart in their logarithm.

    Times are in m², heat diffusing over one square metre in a time of one. Returns (k, times) float32 in 1/m², a row
    for each chosen node (k,) int, None meaning all; NaN at nodes without triangles, and everywhere if the times are to
    come from a spectrum without positive eigenvalues. Scaled: each time divided by its integral over the largest piece
    of surface, the heat trace.
    Source: Sun, Ovsjanikov and Guibas 2009 (doi:10.1111/j.1467-8659.2009.01515.x), Section 4.
    """
    config = config or HksConfig()
    times_m2 = heat_times(spectrum, config)
    weights = np.exp(-spectrum.eigenvalues[:, None] * times_m2)
    heat = weighted_squares(spectrum, weights, chosen)
    if config.scaled:
        heat /= body_sums(spectrum, weights)
    return heat.astype(np.float32)


def heat_times(spectrum: Spectrum, config: HksConfig) -> np.ndarray:
    """(times,) m²: from when the shortest wave has gone to when the longest has, unless the range is given."""
    positive = spectrum.eigenvalues[spectrum.positive]
    if config.range_m2 is not None:
        first, last = config.range_m2
    elif len(positive):
        first, last = DECAY / positive[-1], DECAY / positive[0]
    else:
        return np.full(config.times, np.nan)
    return np.geomspace(first, last, config.times)
