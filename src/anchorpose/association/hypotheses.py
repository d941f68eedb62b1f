"""Subset hypotheses: where a node may be in the next frame (paper, Section IV, track tree construction)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """For each source node, one possible match a subset of anchors; a missed one is a value, not an error.

    match (m, s) int32: node of the next surface, -1 = nothing within the gate. subsets (s, n_s) int: anchor indices.
    """

    match: np.ndarray
    subsets: np.ndarray
