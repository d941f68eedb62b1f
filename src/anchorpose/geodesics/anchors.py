"""Anchors: geodesic extrema of the surface (paper, Definition 2 and the equation after it)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

ANCHOR_NAMES: Final = ("Head", "HandLeft", "HandRight", "FootLeft", "FootRight")
"""The identified anchors, in this order everywhere; left is the patient's left."""


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """The five identified anchors of a surface; a missing one is said to be missing, never guessed.

    node (5,) int32: index into the surface, -1 where missed. position_m (5, 3) float64 world: centroid of the extremal
    cap (steadier than its tip), NaN where missed.
    """

    node: np.ndarray
    position_m: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(5,) bool."""
        return self.node >= 0
