"""Standing height of people by age and sex: mean and standard deviation."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

Sex = Literal["female", "male"]

GROWN_YEARS: Final = 19.0
YOUNGEST_YEARS: Final = 3.0
_GROWTH_M: Final[dict[Sex, tuple[float, ...]]] = {
    "female": (
        0.951, 1.027, 1.094, 1.151, 1.208, 1.266, 1.325, 1.386, 1.450, 1.512, 1.564, 1.598, 1.617, 1.625, 1.629, 1.631,
        1.632,
    ),
    "male": (
        0.961, 1.033, 1.100, 1.160, 1.217, 1.273, 1.326, 1.378, 1.431, 1.491, 1.560, 1.632, 1.690, 1.729, 1.752, 1.761,
        1.765,
    ),
}  # fmt: skip
"""Medians at 3, 4, ... 19 years: WHO growth standards (to 5 years) and WHO reference 2007 (de Onis et al. 2007,
doi:10.2471/BLT.07.043497)."""

_SPREAD: Final = 0.045  # of the median: WHO's deviations are 4 to 5 % of it at every age
_ADULT_M: Final[dict[Sex, tuple[float, float]]] = {"female": (1.629, 0.064), "male": (1.756, 0.069)}
"""ANSUR II (Gordon et al. 2014, NATICK/TR-15/007), 1,986 women and 4,082 men."""


def stature_m(age_years: float | None, sex: Sex | None) -> tuple[float, float]:
    """Mean and standard deviation; None: unknown, an adult where it is the age; below 3 years: as at 3."""
    sexes: tuple[Sex, ...] = ("female", "male") if sex is None else (sex,)
    if age_years is None or age_years >= GROWN_YEARS:
        mean, spread = np.mean([_ADULT_M[one] for one in sexes], axis=0).tolist()
    else:
        years = np.arange(YOUNGEST_YEARS, GROWN_YEARS + 1.0)
        mean = float(np.mean([np.interp(age_years, years, _GROWTH_M[one]) for one in sexes]))
        spread = _SPREAD * mean
    apart = 0.0 if sex else abs(_ADULT_M["male"][0] - _ADULT_M["female"][0]) / 2.0 * mean / _ADULT_M["female"][0]
    return mean, float(np.hypot(spread, apart if age_years is None or age_years > 12.0 else 0.0))
