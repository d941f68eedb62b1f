"""Hypotheses made when they are asked for: with several cameras the track tree reaches half of the nodes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anchorpose.association.hypotheses import Hypotheses


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
