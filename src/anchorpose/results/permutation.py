"""Test by permutation whether a measure differs between two conditions. The observed difference is compared with the
differences under all other assignments of conditions to trials that could have been drawn.

Frames of a recording are not independent, but trials are exchangeable if their condition was drawn at random. If the
conditions have no effect, all assignments of the conditions to the trials of a block would have given the same values,
and each assignment is equally probable. The p value is the share of assignments whose difference, in either direction,
is at least as large as the observed difference (Fisher 1935, The Design of Experiments, section 21; Edgington and
Onghena 2007, Randomization Tests, doi:10.1201/9781420011814). If some block has different numbers of trials of the two
conditions, and every block has at least two of each, each difference is divided by its standard error, since a
condition that only reduces the scatter of the trials would otherwise seem to change their mean (Janssen 1997,
doi:10.1016/S0167-7152(97)00043-6). For several conditions, p is
adjusted as in Holm 1979 (Scandinavian Journal of Statistics 6:65-70).
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
"""Maximum number of possible assignments of conditions to trials for which all assignments are examined, which takes a
fraction of a second. If more assignments are possible, a random sample of them is examined.
"""

SAMPLED: Final = 9_999
SEED: Final = 20_240_611
"""Seed of the random sample of assignments, fixed so that equal trials give equal p values. A sample has 10,000
assignments, including the observed one.
"""

TIE: Final = 1e-9
"""Relative tolerance within which two differences count as equal, since sums of the same values in another order differ
by rounding errors.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Trials of the reference condition and of another condition, and the blocks within which the order of the
    conditions was drawn at random.

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
        """Return the weights (n,) with which the trials' values are summed to the difference between conditions."""
        found = np.zeros(len(self.treated))
        for places in self.members:
            treated = self.treated[places]
            some, others = int(treated.sum()), int((~treated).sum())
            found[places] = np.where(treated, others, -some) / (some + others)
        total = float(found[self.treated].sum())
        return found / total

    @property
    def cells(self) -> list[np.ndarray]:
        """Return the indices of the trials of each block and condition."""
        return [places[self.treated[places] == other] for places in self.members for other in (False, True)]

    @property
    def scaled(self) -> bool:
        """Return whether differences are divided by their standard errors. They are divided if some block has more
        trials of one condition than of the other, and every block has at least two trials of each condition, so that
        standard errors are known.
        """
        sizes = np.array([len(cell) for cell in self.cells]).reshape(-1, 2)
        return bool((sizes[:, 0] != sizes[:, 1]).any() and (sizes > 1).all())

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
    value = value - value.mean()
    own = [blocks.weights[places][None] for places in blocks.members]
    observed = _size(np.sum(_parts(value, blocks, own), axis=0), blocks)[0]
    limit = observed - TIE * max(float(np.abs(value).max()), observed)
    if blocks.assignments > MOST_EXACT:
        drawn = _size(np.sum(_parts(value, blocks, _drawn_weights(blocks)), axis=0), blocks)
        return float((1 + np.sum(drawn >= limit)) / (1 + len(drawn))), False
    total = _sum_of_parts(_parts(value, blocks, _all_weights(blocks)))
    return float(np.mean(_size(total, blocks) >= limit)), True


def _sum_of_parts(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return (2, k): the differences and their variances under all k combinations of the blocks' assignments. parts:
    for each block, an array as in ``_parts``.
    """
    total = np.zeros((2, 1))
    for part in parts:
        total = (total[:, :, None] + part[:, None, :]).reshape(2, -1)
    return total


def permutation_interval(value: np.ndarray, blocks: Blocks) -> tuple[float, float] | None:
    """Return the 95 % interval of the difference between conditions in ``value`` (n,): all differences that, after they
    are subtracted from the trials of the condition, leave a p (of a single comparison) of at least 0.05 (Edgington and
    Onghena 2007, chapter 3). Return None if the smallest possible p is not below 0.05, if there are more than
    ``MOST_EXACT`` assignments, or if differences are divided by their standard errors (``Blocks.scaled``).
    """
    if blocks.scaled or blocks.assignments > MOST_EXACT or blocks.smallest_p >= ALPHA:
        return None
    weights = _all_weights(blocks)
    sums = [_sum_of_parts(_parts(each, blocks, weights))[0] for each in (value, blocks.treated.astype(np.float64))]
    difference = float(blocks.weights @ value)
    return -_upper_limit(-sums[0], sums[1], -difference), _upper_limit(sums[0], sums[1], difference)


def _upper_limit(differences: np.ndarray, shares: np.ndarray, observed: float) -> float:
    """Return the largest difference that, subtracted from the trials of the condition, leaves a p of at least 0.05.

    differences (k,): the difference under each assignment. shares (k,): how much the difference under each assignment
    falls when 1 is subtracted from the condition's trials; 1 for the ``observed`` assignment.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        # the subtracted difference up to which an assignment counts as at least as extreme as the observed one, in the
        # same or in the other direction
        same, other = (observed + differences) / (1.0 + shares), (observed - differences) / (1.0 - shares)
    tied, mirrored = 1.0 - shares < TIE, 1.0 + shares < TIE  # these two are as extreme at every difference
    until = np.maximum(np.where(mirrored, np.inf, same), np.where(tied, np.inf, other))
    return float(np.sort(until)[::-1][math.ceil(ALPHA * len(until)) - 1])


def _size(total: np.ndarray, blocks: Blocks) -> np.ndarray:
    """Return the absolute size (k,) of k differences between conditions: in standard errors if ``Blocks.scaled``, else
    in the unit of the measure. total (2, k): differences and their variances.
    """
    size = np.abs(total[0])
    if not blocks.scaled:
        return np.asarray(size)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(size > 0.0, size / np.sqrt(total[1]), 0.0)


def _parts(value: np.ndarray, blocks: Blocks, weights: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return an array (2, k) for each block: the block's part of the difference between conditions, and its part of the
    variance of this difference, under each of k assignments of conditions to the block's trials. weights: for each
    block, the weights (k, trials) of its trials under these assignments.
    """
    found = list[np.ndarray]()
    for places, of_block in zip(blocks.members, weights, strict=True):
        variance = _variance(value[places], of_block) if blocks.scaled else np.zeros(len(of_block))
        found.append(np.stack([of_block @ value[places], variance]))
    return found


def _variance(value: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the variance (k,) of a block's difference between conditions, estimated from the scatter among the block's
    trials of the same condition. value (trials,); weights (k, trials), one row per assignment.
    """
    total = np.zeros(len(weights))
    for cell in (weights > 0.0, weights < 0.0):
        count = cell.sum(axis=1)
        off = np.where(cell, value - (cell @ value / count)[:, None], 0.0)
        total += (np.where(cell, weights, 0.0) ** 2).sum(axis=1) * (off**2).sum(axis=1) / (count - 1)
    return total


def _all_weights(blocks: Blocks) -> list[np.ndarray]:
    """Return, for each block, the weights (k, trials) of its trials under every assignment of conditions to trials."""
    weights, found = blocks.weights, list[np.ndarray]()
    for places in blocks.members:
        treated = blocks.treated[places]
        chosen = _choices(len(places), int(treated.sum()))
        found.append(np.where(chosen, weights[places][treated][0], weights[places][~treated][0]))
    return found


@lru_cache(8)
def _choices(trials: int, treated: int) -> np.ndarray:
    """Return (assignments, trials) bool: one row for each way of choosing ``treated`` of the trials."""
    places = np.array(list(combinations(range(trials), treated)))
    chosen = np.zeros((len(places), trials), dtype=bool)
    np.put_along_axis(chosen, places, True, axis=1)
    chosen.setflags(write=False)
    return chosen


def _drawn_weights(blocks: Blocks) -> list[np.ndarray]:
    """Return, for each block, the weights (k, trials) of its trials under a fixed random sample of assignments."""
    random = np.random.default_rng(SEED)
    return [random.permuted(np.tile(blocks.weights[p], (SAMPLED, 1)), axis=1) for p in blocks.members]


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
    by the number of comparisons. With n trials of each condition, the smallest p is 2 / (2n choose n).
    """
    return next(n for n in count(1) if 2.0 / math.comb(2 * n, n) < ALPHA / comparisons)


def blocks_needed(blocks: Blocks, comparisons: int = 1) -> int:
    """Return the minimum number of blocks with which p can fall below 0.05 divided by the number of comparisons, if
    every block has as many trials of each condition as the first of the given blocks. For example, n pairs have 2^n
    assignments, so their smallest p is 2 / 2^n.
    """
    first = blocks.members[0]
    treated = int(blocks.treated[first].sum())
    each, sides = math.comb(len(first), treated), 2.0 if 2 * treated == len(first) else 1.0
    return next(n for n in count(1) if sides / each**n < ALPHA / comparisons)
