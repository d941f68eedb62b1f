"""Compare a measure between a condition of an experiment and its reference condition: difference, interval and p value,
or the reason why the difference is not tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from anchorpose.recording.events import BLOCK_COLUMN, Trials
from anchorpose.results.permutation import (
    ALPHA,
    Blocks,
    blocks_needed,
    holm,
    neighbours,
    permutation_interval,
    permutation_p,
    trials_needed,
    usable,
)
from anchorpose.results.records import Measure
from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95, systematic_share

PAIRS, BLOCKS, FREE = "pairs", "blocks", "free"
"""Names of the ways in which the order of conditions can have been randomised: within pairs of successive trials,
within blocks of trials (stated in the events file), or over all trials.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """The effect of a condition on a measure, compared with the reference condition.

    reference, condition: names of the two conditions; counts: how many trials of each condition were compared.
    difference: condition minus reference; low, high: the ends of its 95 % interval, None with too few trials. p: p
    value of the permutation test, adjusted for the number of conditions; exact: whether p was computed from all
    possible assignments of conditions to trials, not from a random sample of them. detectable: smallest difference that
    counts as real; None if none of its three parts is known. It is the larger of the error limit and the MDC95, plus
    the difference that trials of different length alone can cause. The error limit is the difference that errors of
    measurement alone exceed only 5 times in 100. The MDC95 is the minimal detectable change that repeated sessions have
    shown. repeated: whether the MDC95 is at least as large as the error limit. design: how the order of conditions was
    drawn: within pairs of trials (``PAIRS``), within blocks of trials (``BLOCKS``), or over all trials (``FREE``). why:
    the reason why the difference is not tested, if p is None.
    """

    reference: str
    condition: str
    counts: tuple[int, int]
    difference: float | None = None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    exact: bool = True
    detectable: float | None = None
    repeated: bool = False
    design: str = FREE
    why: str | None = None

    @property
    def shown(self) -> bool:
        """Return whether the effect counts as shown: p is below 0.05, the difference exceeds ``detectable`` (if known),
        and its interval (if known) excludes 0.
        """
        if self.p is None or self.difference is None or self.p >= ALPHA or self.open:
            return False
        return self.detectable is None or abs(self.difference) > self.detectable

    @property
    def open(self) -> bool:
        """Return whether the interval of the difference is known and includes 0."""
        return self.low is not None and self.high is not None and self.low <= 0.0 <= self.high


def effects(
    rows: Sequence[Measure],
    trials: Trials,
    repeated: float | None = None,
    untested: Mapping[str, str] | None = None,
    allowed: Mapping[str, float] | None = None,
) -> list[Effect]:
    """Return, for one measure, the effect of every condition except the reference.

    rows: the measure in each trial. The reference is the first of ``trials.conditions``. repeated: the measure's MDC95
    if it is known from repeated sessions. untested: by condition, the reason why the effect of this condition on the
    measure is not tested. allowed: by condition, the difference that trials of different length alone can cause; it is
    added to the smallest difference that counts as real.
    """
    by_number = {row.trial: row for row in rows}
    reference, *others = trials.conditions
    found = list[Effect]()
    for name in others:
        each = _effect(by_number, trials, (reference, name), len(others))
        if repeated is not None and (each.detectable or 0.0) <= repeated:
            each = replace(each, detectable=repeated, repeated=True)
        if more := (allowed or {}).get(name, 0.0):
            each = replace(each, detectable=(each.detectable or 0.0) + more)
        if why := (untested or {}).get(name):
            each = replace(each, p=None, why=each.why or why)
        found.append(each)
    p_of = {each.condition: each.p for each in found if each.p is not None}
    adjusted = dict(zip(p_of, holm(list(p_of.values())), strict=True))
    return [replace(each, p=adjusted.get(each.condition)) for each in found]


def _effect(by_number: dict[int | None, Measure], trials: Trials, names: tuple[str, str], comparisons: int) -> Effect:
    design, order, block = _design(trials, names)
    rows = [by_number.get(trials.rows[place].number) for place in order]
    known = np.array([row is not None and row.value is not None for row in rows])
    treated = np.array([trials.rows[place].condition == names[1] for place in order])
    chosen = known.copy()
    chosen[known] = usable(treated[known], block[known])
    counts = (int((chosen & ~treated).sum()), int((chosen & treated).sum()))
    empty = Effect(reference=names[0], condition=names[1], counts=counts, design=design)
    if not chosen.any():
        return replace(empty, why="no trials with a value can be compared")
    used = [row for row, here in zip(rows, chosen, strict=True) if here and row is not None]
    value = np.array([row.value for row in used], dtype=np.float64)
    sigma = np.array([np.nan if row.sigma is None else row.sigma for row in used])
    blocks = Blocks(treated[chosen], block[chosen])
    spread = spread_of(value, sigma, blocks, systematic_share(used[0].unit))
    difference = float(blocks.weights @ value)
    low, high = _interval(difference, spread, permutation_interval(value, blocks))
    effect = replace(empty, difference=difference, low=low, high=high, detectable=spread.detectable)
    if np.ptp(value) == 0.0:
        return replace(effect, why="all trials have the same value")
    if blocks.smallest_p >= ALPHA / comparisons:
        return replace(effect, why=_too_few(design, blocks, comparisons))
    p, exact = permutation_p(value, blocks)
    return replace(effect, p=p, exact=exact)


def _interval(
    difference: float, spread: Spread, by_test: tuple[float, float] | None
) -> tuple[float | None, float | None]:
    """Return the ends of the 95 % interval of a difference between conditions, None if they are unknown.

    by_test: the interval that agrees with the p value of a single comparison (``permutation_interval``). It includes
    the scatter of the trials but not their systematic errors, so it is widened by these errors. It is at least as wide
    as the errors of measurement alone. If it is None, the interval is computed from Student's t distribution
    (``Spread.half``).
    """
    if spread.half is None:
        return None, None
    if by_test is None:
        return difference - spread.half, difference + spread.half
    below, above = (
        max(float(np.hypot(away, NORMAL_95 * spread.systematic)), spread.detectable or 0.0)
        for away in (difference - by_test[0], by_test[1] - difference)
    )
    return difference - below, difference + above


def _design(trials: Trials, names: tuple[str, str]) -> tuple[str, np.ndarray, np.ndarray]:
    """Return how the order of conditions was drawn: within pairs of successive trials (``PAIRS``), within the blocks
    that the events file states (``BLOCKS``), or over all trials (``FREE``). Also return the indices of the two
    conditions' trials, in the order of time, and the block of each of these trials.

    A trial for which the events file leaves the block empty forms a block by itself, so it is not compared with any
    other trial.
    """
    order = np.array(sorted(range(len(trials.rows)), key=lambda place: trials.rows[place].onset_s))
    order = np.array([place for place in order.tolist() if trials.rows[place].condition in names])
    if any(column.name == BLOCK_COLUMN for column in trials.columns):
        texts = trials.column(BLOCK_COLUMN)
        numbers = {text: number for number, text in enumerate(dict.fromkeys(texts)) if text is not None}
        return BLOCKS, order, np.array([numbers.get(texts[place], -1 - place) for place in order.tolist()])
    treated = np.array([trials.rows[place].condition == names[1] for place in order.tolist()])
    pairs = neighbours(treated)
    return (FREE, order, np.zeros(len(order), dtype=int)) if pairs is None else (PAIRS, order, pairs)


def _too_few(design: str, blocks: Blocks, comparisons: int) -> str:
    """Return a sentence that states the number of recorded trials, and the number needed for a significant p."""
    reference, treated = int((~blocks.treated).sum()), int(blocks.treated.sum())
    several = "" if comparisons == 1 else f" of {comparisons} comparisons"
    if design == PAIRS:
        there, needed = f"{len(blocks.members)} pairs", f"{blocks_needed(blocks, comparisons)} pairs are"
    elif design == BLOCKS:
        there, needed = f"{len(blocks.members)} blocks", f"{blocks_needed(blocks, comparisons)} like the first are"
    else:
        there = f"{reference} and {treated} trials"
        needed = f"{trials_needed(comparisons)} of each condition are"
    return (
        f"too few trials: with {there} p cannot be below {blocks.smallest_p:.2g}; {needed} needed for p below "
        f"{ALPHA / comparisons:.2g}{several}"
    )


@dataclass(frozen=True, slots=True)
class Spread:
    """The uncertainty of a difference. half: half the width of its 95 % interval by Student's t distribution;
    detectable: the difference that errors of measurement alone exceed only 5 times in 100. Each of the two is None if
    it is unknown. systematic: standard deviation of the difference due to systematic errors; 0 if unknown.
    """

    half: float | None
    detectable: float | None
    systematic: float = 0.0


def spread_of(value: np.ndarray, sigma: np.ndarray, blocks: Blocks, share: float) -> Spread:
    """Return the uncertainty of the difference between conditions. value (n,): the measure in each trial; sigma (n,):
    the standard deviations of these values, NaN where unknown; share: share of their variance that is due to systematic
    errors.

    The scatter of the trials includes their random errors of measurement. So if the observed scatter has a smaller
    variance than these errors, the variance of the errors is used. The systematic errors of all trials of a session are
    fully correlated. These errors cancel in the difference if they are equally large; if a part of them remains, its
    variance is added to the variance of the scatter. If the scatter is 0, as it may be for counts, and the sigma of a
    trial is unknown, the interval is unknown.
    """
    weights = blocks.weights
    random = (1.0 - share) * float(np.sum((weights * sigma) ** 2))
    systematic = share * float(weights @ sigma) ** 2
    stated = bool(np.isfinite(sigma).all())
    detectable = NORMAL_95 * float(np.sqrt(random + systematic)) if stated else None
    scatter, freedom = scatter_of(value, blocks)
    if not np.isfinite(scatter) or (scatter == 0.0 and not stated):
        return Spread(None, detectable)
    variance = max(scatter, random) + systematic if stated else scatter
    half = float(stdtrit(freedom, 0.5 + CONFIDENCE / 2.0) * np.sqrt(variance))
    return Spread(half, detectable, float(np.sqrt(systematic)) if stated else 0.0)


def scatter_of(value: np.ndarray, blocks: Blocks) -> tuple[float, float]:
    """Return the variance of the difference between conditions, estimated from the scatter of the trials, and its
    degrees of freedom; NaN for too few trials.

    If every block has each condition at least twice, the scatter among trials of the same block and condition is used.
    This scatter may differ between blocks and conditions, so the degrees of freedom are those of Welch 1947
    (doi:10.1093/biomet/34.1-2.28). Otherwise, the difference between the conditions is computed in each block, and the
    scatter of these differences is used.
    """
    sizes = np.array([len(cell) for cell in blocks.cells])
    if sizes.min() > 1:
        weights = blocks.weights
        parts = np.array([float(np.sum(weights[cell] ** 2)) * value[cell].var(ddof=1) for cell in blocks.cells])
        total = float(parts.sum())
        return total, total**2 / float(np.sum(parts**2 / (sizes - 1))) if total > 0 else float(np.sum(sizes - 1))
    if len(blocks.members) == 1:
        return float("nan"), float("nan")
    cells = [(value[p][~blocks.treated[p]], value[p][blocks.treated[p]]) for p in blocks.members]
    share = np.array([blocks.weights[p][blocks.treated[p]].sum() for p in blocks.members])
    differences = np.array([treated.mean() - reference.mean() for reference, treated in cells])
    off = differences - float(share @ differences)
    freedom = len(cells) - 1
    return float(np.sum(share * off**2) * np.sum(share**2) / (1.0 - np.sum(share**2))), float(freedom)
