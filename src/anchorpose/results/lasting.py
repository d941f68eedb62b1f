"""How sure a mean over frames is: most of a joint's error lasts, so more frames do not make it much smaller."""

from __future__ import annotations

from typing import Final

import numpy as np

LASTING_SHARE: Final = 0.7
"""Of the variance of an error, how much stays the same through a recording: the learnt body's lengths, clothes, and how
its joints lie in it. On simulated recordings 0.6 for angles and 0.8 for joints (docs/measures.md)."""

CORRELATION_S: Final = 1.5
"""How long the rest takes to change: after this time its correlation has fallen to about a third."""


def sigma_of_mean(sigma: np.ndarray, seconds: float) -> float:
    """Of the mean of values (k,) with one standard deviation each, spread over ``seconds``.

    The lasting share stays whole; the rest shrinks as if every two correlation times gave one independent value.
    """
    averaged = min(1.0, 2.0 * CORRELATION_S / seconds) if seconds > 0 else 1.0
    return float(np.sqrt(np.mean(sigma**2) * (LASTING_SHARE + (1.0 - LASTING_SHARE) * averaged)))


def lasting_sigma(sigma: np.ndarray) -> np.ndarray:
    """The part of sigma that stays the same through a recording."""
    return np.sqrt(LASTING_SHARE) * sigma


def changing_sigma(sigma: np.ndarray) -> np.ndarray:
    """The part of sigma that comes and goes."""
    return np.sqrt(1.0 - LASTING_SHARE) * sigma
