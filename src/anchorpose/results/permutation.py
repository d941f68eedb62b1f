"""Test by permutation whether a measure differs between two conditions. The observed difference is compared with the
differences under all other assignments of conditions to trials that could have been drawn.

Frames of a recording are not independent, but trials are exchangeable if their condition was drawn at random. If the
conditions have no effect, all assignments of the conditions to the trials of a block would have given the same values,
and each assignment is equally probable. p is the share of assignments whose difference, in either direction, is at
least as large as the observed difference (Fisher 1935, The Design of Experiments, section 21; Edgington and Onghena
2007, Randomization Tests, doi:10.1201/9781420011814). For several conditions, p is adjusted as in Holm 1979
(Scandinavian Journal of Statistics 6:65-70).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, count
from typing import Final

import numpy as np

ALPHA: Final = 0.05  # level of significance

MOST_EXACT: Final = 200_000
"""Maximum number of assignments of conditions to trials at which all are examined, which takes a fraction of a second.
If more are possible, a random sample of them is examined.
"""

SAMPLED: Final = 9_999
SEED: Final = 20_240_611
"""Seed of the random sample of assignments, fixed so that equal trials give equal p values. A sample has 10,000
assignments, including the observed one.
"""

TIE: Final = 1e-9
"""Relative tolerance within which two differences count as equal: sums in another order differ by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Trials of the reference condition and of another condition, and the blocks within which their order was drawn.

    treated (n,) bool: False for the reference; block (n,) int: number of each trial's block. Every block has trials of
    both conditions. weights (n,): the difference is the sum of weights times values; weights are positive for the
    condition, negative for the reference. The difference within a block with n_t and n_r trials of the two conditions
    has the weight n_t n_r / (n_t + n_r), which is optimal if all trials have the same variance.
    """

    treated: np.ndarray
    block: np.ndarray

    @property
    def members(self) -> list[np.ndarray]:
        """Return the indices of each block's trials."""
        return [np.flatnonzero(self.block == number) for number in dict.fromkeys(self.block.tolist())]

    @property
    def weights(self) -> np.ndarray:
        """Return the weights (n,) of the trials in the difference; see ``Blocks``."""
        found = np.zeros(len(self.treated))
        for places in self.members:
            treated = self.treated[places]
            some, others = int(treated.sum()), int((~treated).sum())
            found[places] = np.where(treated, others, -some) / (some + others)
        total = float(found[self.treated].sum())
        return found / total

    @property
    def assignments(self) -> int:
        """Return the number of possible assignments of the conditions to the trials."""
        return math.prod(math.comb(len(places), int(self.treated[places].sum())) for places in self.members)

    @property
    def smallest_p(self) -> float:
        """Return the smallest possible two-sided p: 2 / number of assignments if exchanging the two conditions in any
        assignment gives another possible assignment, else 1 / number of assignments.
        """
        mirrored = all(2 * int(self.treated[places].sum()) == len(places) for places in self.members)
        return min(1.0, (2.0 if mirrored else 1.0) / self.assignments)


def usable(treated: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Return (n,) bool: True for trials in blocks that have both conditions."""
    both = [number for number in set(block.tolist()) if len(set(treated[block == number].tolist())) == 2]
    return np.isin(block, both)


def neighbours(treated: np.ndarray) -> np.ndarray | None:
    """Return the block (n,) of each trial, if successive trials in the order of time form pairs with both conditions;
    else None.

    In ABAB or ABBA the pairs are the first two and the last two trials. In ABABA the last trial has no partner, and is
    a separate block.
    """
    pairs = len(treated) // 2
    firsts, seconds = treated[0 : 2 * pairs : 2], treated[1 : 2 * pairs : 2]
    return np.arange(len(treated)) // 2 if pairs and bool((firsts != seconds).all()) else None


def permutation_p(value: np.ndarray, blocks: Blocks) -> tuple[float, bool]:
    """Return the two-sided p of the difference between conditions in ``value`` (n,), and whether p was computed from
    all assignments, not from a sample.
    """
    observed = abs(float(blocks.weights @ value))
    limit = observed - TIE * max(float(np.abs(value - value.mean()).max()), observed)
    if blocks.assignments <= MOST_EXACT:
        return float(np.mean(np.abs(_all_differences(value, blocks)) >= limit)), True
    drawn = _drawn_differences(value, blocks)
    return float((1 + np.sum(np.abs(drawn) >= limit)) / (1 + len(drawn))), False


def _all_differences(value: np.ndarray, blocks: Blocks) -> np.ndarray:
    """Return the difference between conditions (``Blocks``) under every assignment of conditions to trials."""
    weights, total = blocks.weights, np.zeros(1)
    for places in blocks.members:
        treated = blocks.treated[places]
        chosen = _choices(len(places), int(treated.sum()))
        up, down = weights[places][treated][0], weights[places][~treated][0]
        of_block = np.where(chosen, up, down) @ value[places]
        total = (total[:, None] + of_block[None]).ravel()
    return total


@lru_cache(8)
def _choices(trials: int, treated: int) -> np.ndarray:
    """Return (assignments, trials) bool: one row for each way of choosing ``treated`` of the trials."""
    places = np.array(list(combinations(range(trials), treated)))
    chosen = np.zeros((len(places), trials), dtype=bool)
    np.put_along_axis(chosen, places, True, axis=1)
    chosen.setflags(write=False)
    return chosen


def _drawn_differences(value: np.ndarray, blocks: Blocks) -> np.ndarray:
    """Return the difference between conditions (``Blocks``) under a fixed random sample of assignments."""
    random, total = np.random.default_rng(SEED), np.zeros(SAMPLED)
    for places in blocks.members:
        weights = np.tile(blocks.weights[places], (SAMPLED, 1))
        total += random.permuted(weights, axis=1) @ value[places]
    return total


def holm(p: Sequence[float]) -> list[float]:
    """Return the adjusted p values of several comparisons, in the order given. If comparisons with an adjusted p below
    0.05 are called significant, at most 5 of 100 experiments have any falsely significant comparison.
    """
    adjusted, largest = [0.0] * len(p), 0.0
    for rank, place in enumerate(sorted(range(len(p)), key=lambda k: p[k])):
        largest = max(largest, min(1.0, (len(p) - rank) * p[place]))
        adjusted[place] = largest
    return adjusted


def trials_needed(comparisons: int = 1) -> int:
    """Return the minimum number of trials of each condition, all in one block, with which p can fall below 0.05 divided
    by the number of comparisons; with n trials each, the smallest p is 2 / (2n choose n).
    """
    return next(n for n in count(1) if 2.0 / math.comb(2 * n, n) < ALPHA / comparisons)


def blocks_needed(blocks: Blocks, comparisons: int = 1) -> int:
    """Return the minimum number of blocks with which p can fall below the limit in ``trials_needed``, if every block
    has as many trials of each condition as the first of the given blocks; n pairs have 2^n assignments, so their
    smallest p is 2 / 2^n.
    """
    first = blocks.members[0]
    treated = int(blocks.treated[first].sum())
    each, sides = math.comb(len(first), treated), 2.0 if 2 * treated == len(first) else 1.0
    return next(n for n in count(1) if sides / each**n < ALPHA / comparisons)
