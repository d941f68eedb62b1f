"""Hypotheses made when they are asked for: with several cameras the track tree reaches half of the nodes.

What nodes of two frames are matched by, and how many anchors at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial import KDTree

from anchorpose.association.hypotheses import GateConfig, Hypotheses
from anchorpose.surface.surface import Surface


class Matcher:
    """The matches of one frame's nodes in the next, each worked out once, when it is first asked for."""

    def __init__(self, find: Callable[[np.ndarray], np.ndarray], node_count: int, subsets: np.ndarray) -> None:
        """find: the matches (k, s) of some nodes (k,), whatever others are asked for with them; subsets (s, n_s)."""
        self.subsets = subsets
        self.match = np.full((node_count, len(subsets)), -1, np.int32)  # as in Hypotheses, -1 also where not yet asked
        self._asked = np.zeros(node_count, dtype=bool)
        self._find = find

    def ask(self, nodes: np.ndarray) -> np.ndarray:
        """(k, s) int32 matches of the nodes (k,), in any order and any of them repeated."""
        wanted = np.zeros(len(self.match), dtype=bool)
        wanted[nodes] = True
        new = np.flatnonzero(wanted & ~self._asked)
        if len(new):
            self.match[new] = self._find(new)
            self._asked[new] = True
        return self.match[nodes]

    def all(self) -> Hypotheses:
        """The hypotheses of every node."""
        return Hypotheses(self.ask(np.arange(len(self.match))), self.subsets)


class Feature(StrEnum):
    """What says that two nodes are the same place of the skin."""

    GEODESIC = "geodesic"  # distances to the anchors (paper, Definition 3)
    POSITION = "position"  # being near to where the node was: what is left without a descriptor, to compare with


@dataclass(frozen=True, slots=True, kw_only=True)
class HypothesisConfig:
    """How hypotheses are made."""

    feature: Feature = Feature.GEODESIC
    subset_size: int = 3  # N_S: three anchors tell nodes apart (paper, Section IV-D); 5: one hypothesis by all of them
    trusted_only: bool = (
        True  # leave out distances that a hole lengthens; False: leave that to the subsets, as the paper
    )

    def __post_init__(self) -> None:
        if self.subset_size < 1:
            raise ValueError(f"subset_size must be at least 1, got {self.subset_size}")


def nearest_hypotheses(source: Surface, target: Surface, config: GateConfig) -> Hypotheses:
    """One hypothesis a node, by position: the nearest node of the target within ``search_radius_m``, else missed.

    It rests on no anchor, so its one subset is empty.
    """
    match = np.full((len(source), 1), -1, np.int32)
    if len(source) and len(target):
        nearest = KDTree(target.points_m).query(source.points_m, distance_upper_bound=config.search_radius_m)[1]
        match[:, 0] = np.where(nearest < len(target), nearest, -1)
    return Hypotheses(match, np.empty((1, 0), np.int64))
