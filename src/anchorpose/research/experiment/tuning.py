"""Every method's setting is chosen on the training recordings, by one measure for all: nobody is handicapped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.research.experiment.outcome import Tried

MISSED_MM: Final = 100.0
"""What a node without a match counts: as much as the track tree's ``missed_cost_m``."""


def worth_mm(tree_mm: Sequence[np.ndarray]) -> float:
    """Mean distance from the truth after the track tree, over all nodes of all windows; matches farther off than a
    missed one count as missed: the framework registers what the tree leaves, and doubts outliers.

    tree_mm: of each window (m,), NaN without a match. NaN where there are none.
    """
    every = np.concatenate([np.zeros(0), *(np.where(np.isfinite(e), e, MISSED_MM) for e in tree_mm)])
    return float(np.minimum(every, MISSED_MM).mean()) if len(every) else np.nan


def choose(settings: Sequence[object], scores_mm: Sequence[float]) -> tuple[Tried, ...]:
    """The settings with their scores; the best is chosen, of equals the first, and the first where none has a score."""
    known = np.where(np.isfinite(scores_mm), scores_mm, np.inf)
    best = int(np.argmin(known))
    return tuple(
        Tried(describe(setting), float(value), number == best)
        for number, (setting, value) in enumerate(zip(settings, scores_mm, strict=True))
    )


def describe(setting: object) -> str:
    """A setting as text: what differs is in its values."""
    return "no settings" if setting is None else repr(setting)
