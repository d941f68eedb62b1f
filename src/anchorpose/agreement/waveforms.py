"""How two waveforms agree in shape and range, and whether a stated uncertainty is that of the errors."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import stats

LEAST_SAMPLES: Final = 10
"""A waveform of fewer samples has no shape to speak of."""

LEVELS: Final = np.linspace(0.05, 0.95, 19)
"""The nominal shares at which coverage is compared with what was found."""


def waveform_correlation(values: np.ndarray, reference: np.ndarray) -> float | None:
    """Coefficient of multiple correlation (CMC) between two systems that measured the same movement; (n,) each.

    1 where both curves coincide; offsets and gains lower it. None where the curves differ by more than they move,
    which leaves the root of a negative number, and for fewer than ``LEAST_SAMPLES`` samples.
    Source: Ferrari et al. 2010 (doi:10.1016/j.gaitpost.2009.09.009), one cycle, two protocols.
    """
    if len(values) < LEAST_SAMPLES:
        return None
    both = np.stack([values, reference])
    between = ((both - both.mean(axis=0)) ** 2).sum() / len(values)
    overall = ((both - both.mean()) ** 2).sum() / (both.size - 1)
    return float(np.sqrt(1.0 - between / overall)) if 0.0 < overall >= between else None


def range_of(values: np.ndarray) -> float:
    """From the lowest to the highest value (n,)."""
    return float(values.max() - values.min())


def coverage_95(error: np.ndarray, sigma: np.ndarray) -> float:
    """Share of errors (n,) within 1.96 of their own sigma (n,)."""
    return float((np.abs(error) <= stats.norm.ppf(0.975) * sigma).mean())


def calibration_error(error: np.ndarray, sigma: np.ndarray) -> float:
    """Expected calibration error: mean difference between the shares of errors found within an interval and nominal.

    error, sigma (n,). 0 where sigma is right at all of ``LEVELS``; 0.5 where it is never or always far too large.
    Source: Kuleshov et al. 2018 (arXiv:1807.00263), for normal errors and central intervals.
    """
    within = np.abs(error / sigma)[None] <= stats.norm.ppf(0.5 + LEVELS / 2.0)[:, None]
    return float(np.abs(within.mean(axis=1) - LEVELS).mean())
