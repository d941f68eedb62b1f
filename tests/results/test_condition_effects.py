"""Conditions within a session: exact tests with known answers, intervals, refusals, and how often they err."""

import math
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results import permutation
from anchorpose.results.condition_effect import Spread, _interval, effects, scatter_of, spread_of
from anchorpose.results.permutation import (
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

ABAB = "ABABABABABAB"


def trials_of(order: str, block: str = "") -> Trials:
    """A trial of ten seconds per letter, its condition; block: a letter each."""
    columns = (TrialColumn("block", None),) if block else ()
    rows = [
        Trial(k, name, 10.0 * k, 10.0, 10.0 * k, (block[k - 1],) if block else ()) for k, name in enumerate(order, 1)
    ]
    return Trials(columns, tuple(rows))


def rows_of(order: str, values: list[float | None] | np.ndarray, sigma: float | None = 0.5) -> list[Measure]:
    return [
        Measure(
            measure="knee_flexion_upright_mean",
            side="left",
            unit="deg",
            value=None if value is None else float(value),
            sigma=None if value is None else sigma,
            why="lost" if value is None else None,
            frames=100,
            condition=name,
            trial=k,
        )
        for k, (name, value) in enumerate(zip(order, values, strict=True), 1)
    ]


def one_block(treated: list[int]) -> Blocks:
    return Blocks(np.array(treated, dtype=bool), np.zeros(len(treated), dtype=int))


DARWIN = (49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48)
"""Darwin's pairs of maize, cross- minus self-fertilised, eighths of an inch: Fisher 1935, The Design of Experiments,
section 21. Of the 32,768 ways in which the signs could have fallen, 863 have a sum of 314 or more."""


def test_darwin_s_maize_has_the_p_that_fisher_counted():
    pairs = np.array([[0.0, difference] for difference in DARWIN])
    blocks = Blocks(np.tile([False, True], 15), np.repeat(np.arange(15), 2))
    p, exact = permutation_p(pairs.ravel(), blocks)
    assert exact
    assert p == pytest.approx(2 * 863 / 2**15, abs=1e-12)  # 5.27 %: Student's t says 4.97 %
    mean = float(blocks.weights @ pairs.ravel())
    assert mean == pytest.approx(314 / 15)


def test_eight_trials_that_do_not_overlap_are_the_most_extreme_of_seventy():
    """By hand: 8 choose 4 is 70, and only the observed assignment and its mirror image are 4 apart."""
    p, exact = permutation_p(np.arange(1.0, 9.0), one_block([0, 0, 0, 0, 1, 1, 1, 1]))
    assert exact
    assert p == pytest.approx(2 / 70)


def test_three_trials_by_hand():
    """Values 1, 2, 6, the last treated: the three differences are 4.5, -1.5 and -3; only its own is as large."""
    p, _ = permutation_p(np.array([1.0, 2.0, 6.0]), one_block([0, 0, 1]))
    assert p == pytest.approx(1 / 3)


def difference_of(a, b, axis):
    return np.abs(np.mean(a, axis=axis) - np.mean(b, axis=axis))


def errors_apart(a, b, axis):
    """Welch's t, for conditions with different numbers of trials."""
    return np.abs(stats.ttest_ind(a, b, axis=axis, equal_var=False).statistic)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("order", "statistic"), [("ABAABBABA", errors_apart), ("ABAABBAB", difference_of)])
def test_the_exact_p_is_that_of_scipy(seed, order, statistic):
    random = np.random.default_rng(seed)
    value, treated = random.normal(size=len(order)), np.array([letter == "B" for letter in order])
    found, _ = permutation_p(value, one_block(treated))
    other = stats.permutation_test(
        (value[treated], value[~treated]), statistic, n_resamples=np.inf, alternative="greater", vectorized=True
    )
    assert found == pytest.approx(other.pvalue)


def test_a_condition_that_only_steadies_the_trials_does_not_change_their_mean():
    """5 of 100 unchanged means may be called changed; without standard errors, it was 16 of 100 here."""
    random, blocks = np.random.default_rng(2), one_block([0] * 5 + [1] * 10)
    values = random.normal(size=(200, 15)) * np.where(blocks.treated, 1.0, 3.0)
    assert np.mean([permutation_p(value, blocks)[0] < 0.05 for value in values]) < 0.1


def test_unequal_blocks_are_scaled_together():
    """Two blocks: every pair of their assignments counts; a sample of assignments comes near the exact p."""
    random = np.random.default_rng(8)
    blocks = Blocks(np.array([0, 0, 1, 1, 1] * 2, dtype=bool), np.repeat([0, 1], 5))
    value = random.normal(size=10) + 1.5 * blocks.treated
    sizes = []
    for one in combinations(range(5), 3):
        for other in combinations(range(5, 10), 3):
            treated = np.isin(np.arange(10), one + other)
            assigned = Blocks(treated, blocks.block)
            sizes.append(abs(assigned.weights @ value) / math.sqrt(scatter_of(value, assigned)[0]))
    own = abs(blocks.weights @ value) / math.sqrt(scatter_of(value, blocks)[0])
    assert permutation_p(value, blocks) == (pytest.approx(np.mean(np.array(sizes) >= own - 1e-9)), True)


def test_a_sample_of_assignments_comes_near_the_exact_p_and_is_the_same_each_time(monkeypatch):
    random = np.random.default_rng(4)
    blocks = one_block([0, 1] * 6)
    value = random.normal(size=12) + blocks.treated
    exact, whole = permutation_p(value, blocks)
    monkeypatch.setattr(permutation, "MOST_EXACT", 10)
    sampled, all_of_them = permutation_p(value, blocks)
    assert (whole, all_of_them) == (True, False)
    assert sampled == pytest.approx(exact, abs=3 * math.sqrt(exact * (1 - exact) / 9999))
    assert permutation_p(value, blocks)[0] == sampled


def test_equal_values_differ_in_no_assignment():
    assert permutation_p(np.full(8, 3.7), one_block([0, 1] * 4))[0] == 1.0


def test_p_does_not_depend_on_scale_place_or_which_condition_is_which():
    value = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.3, 5.8])
    blocks = one_block([0, 1, 1, 0, 1, 0, 0, 1])
    p, _ = permutation_p(value, blocks)
    assert permutation_p(1000.0 - 7.0 * value, blocks)[0] == pytest.approx(p)
    assert permutation_p(value, Blocks(~blocks.treated, blocks.block))[0] == pytest.approx(p)


def test_holm_s_adjustment_of_four():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5]) == [0.5]
    assert holm([]) == []


SLEEP = ((0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0), (1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4))
"""Student 1908 (doi:10.1093/biomet/6.1.1): hours of sleep gained with two drugs. Welch's interval of the difference is
-0.205 to 3.365, that of the pairs 0.700 to 2.460."""


def test_student_s_sleep_has_the_intervals_of_the_textbooks():
    value = np.array(SLEEP).ravel()
    treated = np.repeat([False, True], 10)
    free, paired = Blocks(treated, np.zeros(20, dtype=int)), Blocks(treated, np.tile(np.arange(10), 2))
    none = np.full(20, np.nan)
    assert scatter_of(value, free)[1] == pytest.approx(17.776, abs=1e-3)
    assert free.weights @ value == pytest.approx(1.58)
    assert spread_of(value, none, free, 0.7).half == pytest.approx((3.3654832 + 0.2054832) / 2, abs=1e-6)
    assert spread_of(value, none, paired, 0.7).half == pytest.approx((2.4598858 - 0.7001142) / 2, abs=1e-6)


THREE_BLOCKS = Blocks(np.array([0, 0, 1, 1] * 3, dtype=bool), np.repeat([0, 1, 2], 4))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blocks", [one_block([0, 1] * 5), THREE_BLOCKS])
def test_the_interval_holds_the_differences_that_the_permutation_test_does_not_reject(seed, blocks):
    value = np.random.default_rng(seed).normal(size=len(blocks.treated)) + blocks.treated
    low, high = permutation_interval(value, blocks)
    for end, inward in ((low, 1.0), (high, -1.0)):
        inside, outside = (value - (end + step * inward * 1e-6) * blocks.treated for step in (1.0, -1.0))
        assert permutation_p(inside, blocks)[0] >= 0.05 > permutation_p(outside, blocks)[0]
    mirrored = permutation_interval(-value, blocks)
    assert mirrored == pytest.approx((-high, -low))


def test_the_interval_by_permutation_holds_the_truth_as_often_as_it_says_and_is_narrower_than_welchs():
    random, blocks = np.random.default_rng(6), THREE_BLOCKS
    values = random.normal(size=(400, 12)) + 2.0 * blocks.treated
    intervals = np.array([permutation_interval(value, blocks) for value in values])
    welch = [2.0 * spread_of(value, np.full(12, np.nan), blocks, 0.7).half for value in values]
    assert 0.92 < np.mean((intervals[:, 0] <= 2.0) & (intervals[:, 1] >= 2.0)) < 0.98
    assert np.ptp(intervals, axis=1).mean() < 0.75 * np.mean(welch)


def test_the_interval_by_permutation_is_widened_by_systematic_errors():
    low, high = _interval(5.0, Spread(9.0, 0.5, 1.0), (3.0, 6.0))
    assert (low, high) == pytest.approx((5.0 - math.hypot(2.0, 1.96), 5.0 + math.hypot(1.0, 1.96)), abs=1e-3)
    assert _interval(5.0, Spread(9.0, 0.5, 1.0), None) == (-4.0, 14.0)


def test_no_interval_by_permutation_without_a_significant_p_or_with_standard_errors():
    assert permutation_interval(np.arange(6.0), one_block([0, 1] * 3)) is None
    assert permutation_interval(np.arange(9.0), one_block([0, 1] * 4 + [0])) is None
    assert permutation_interval(np.arange(24.0), one_block([0, 1] * 12)) is None  # too many assignments


def test_an_effect_with_a_small_p_has_an_interval_without_zero():
    order, block = "ABABBABAABBA", "xxxxyyyyzzzz"
    values = np.array([9.0, 13.1, 11.2, 15.4, 14.2, 10.1, 12.0, 9.2, 10.9, 12.1, 13.4, 9.1])
    (effect,) = effects(rows_of(order, values, sigma=0.1), trials_of(order, block))
    assert effect.p < 0.05
    assert 0.0 < effect.low < effect.difference < effect.high
    (coarse,) = effects(rows_of(order, values, sigma=9.0), trials_of(order, block))
    assert coarse.low < 0.0 < coarse.high  # the errors of measurement alone could be as large


def test_the_interval_of_blocks_holds_where_one_condition_scatters_more():
    """The interval of 300 experiments, 95 of 100 of which hold the true difference; 77 did with one common scatter."""
    random = np.random.default_rng(5)
    blocks = Blocks(np.tile(np.array([0, 0] + [1] * 6, bool), 3), np.repeat([0, 1, 2], 8))
    values = random.normal(size=(300, 24)) * np.where(blocks.treated, 1.0, 3.0)
    none = np.full(24, np.nan)
    held = [abs(blocks.weights @ value) <= spread_of(value, none, blocks, 0.7).half for value in values]
    assert 0.92 < np.mean(held) < 0.99


def test_blocks_that_repeat_both_conditions_pool_their_scatter():
    value = np.array([1.0, 3.0, 6.0, 8.0, 11.0, 13.0, 16.0, 18.0])
    blocks = Blocks(np.array([0, 0, 1, 1] * 2, dtype=bool), np.repeat([0, 1], 4))
    variance, freedom = scatter_of(value, blocks)
    assert freedom == 4  # every cell has a sum of squares of 2 with one degree of freedom
    assert variance == pytest.approx(2.0 * 8 * (1 / 4) ** 2)
    assert blocks.weights @ value == pytest.approx(5.0)


def test_the_error_of_measurement_widens_the_interval_but_its_shared_part_cancels():
    value, blocks = np.array([1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]), one_block([0] * 4 + [1] * 4)
    alone = spread_of(value, np.full(8, np.nan), blocks, 0.7)
    assert (alone.half, alone.detectable) == (None, None)  # equal trials without sigma: the interval is unknown
    same = spread_of(value, np.full(8, 2.0), blocks, 0.7)
    random = 0.3 * 4.0 * 2 / 4
    assert same.detectable == pytest.approx(1.96 * math.sqrt(random))
    assert same.half == pytest.approx(stats.t.ppf(0.975, 6) * math.sqrt(random))
    unlike = spread_of(value, np.array([1.0] * 4 + [3.0] * 4), blocks, 0.7)
    assert unlike.detectable == pytest.approx(1.96 * math.sqrt(0.3 * (1 + 9) / 4 + 0.7 * 4))


def test_which_trials_are_neighbours():
    def pairs(order: str) -> list[int] | None:
        found = neighbours(np.array([letter == "B" for letter in order]))
        return None if found is None else found.tolist()

    assert pairs("ABAB") == [0, 0, 1, 1]
    assert pairs("ABBA") == [0, 0, 1, 1]
    assert pairs("ABABA") == [0, 0, 1, 1, 2]
    assert pairs("AABB") is None
    assert pairs("A") is None
    assert usable(np.array([0, 1, 0, 1, 0], dtype=bool), np.array([0, 0, 1, 1, 2])).tolist() == [True] * 4 + [False]


def test_a_clear_effect_of_bouts_in_turn_is_shown_with_its_interval():
    values = [10, 15, 10.5, 15.2, 9.8, 15.1, 10.2, 14.9, 10.1, 15.3, 9.9, 15.0]
    (effect,) = effects(rows_of(ABAB, values), trials_of(ABAB))
    assert (effect.reference, effect.condition, effect.counts, effect.design) == ("A", "B", (6, 6), "pairs")
    assert effect.difference == pytest.approx(5.0)
    assert effect.low < 5.0 < effect.high
    assert effect.p == pytest.approx(2 / 2**6)
    assert effect.shown


def test_a_difference_within_the_errors_of_measurement_is_not_shown():
    values = [10, 11, 10, 11, 10, 11.01, 10, 11, 10, 11.02, 10, 11]
    (precise,) = effects(rows_of(ABAB, values, sigma=0.5), trials_of(ABAB))
    assert precise.shown
    (coarse,) = effects(rows_of(ABAB, values, sigma=3.0), trials_of(ABAB))
    assert coarse.p < 0.05
    assert coarse.detectable > 1.0
    assert not coarse.shown
    (by_days,) = effects(rows_of(ABAB, values, sigma=0.5), trials_of(ABAB), repeated=4.0)
    assert by_days.repeated
    assert not by_days.shown
    (coarser,) = effects(rows_of(ABAB, values, sigma=3.0), trials_of(ABAB), repeated=0.5)
    assert (coarser.detectable, coarser.repeated, coarser.shown) == (coarse.detectable, False, False)


def test_a_named_block_decides_even_where_trials_could_be_paired():
    order, block = "ABBAABBAABBA", "xxxxyyyyzzzz"
    values = np.array([10, 15, 15, 10, 20, 25, 25, 20, 0, 5, 5, 0]) + 0.1 * np.arange(12)
    (effect,) = effects(rows_of(order, values), trials_of(order, block))
    assert effect.design == "blocks"
    assert effect.difference == pytest.approx(5.0)
    assert effect.p == pytest.approx(2 / math.comb(4, 2) ** 3)  # the blocks' own levels do not count


def test_a_trial_without_a_value_takes_its_pair_with_it():
    values = [10, 15, 10, None, 10, 15, 10, 15, 10, 15, 10, 15]
    (effect,) = effects(rows_of(ABAB, values), trials_of(ABAB))
    assert effect.counts == (5, 5)
    assert effect.p is None
    assert "too few trials: with 5 pairs p cannot be below 0.062; 6 pairs are needed for p below 0.05" in effect.why


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ("AB", "1 pairs p cannot be below 1; 6 pairs are needed"),
        ("AABB", "2 and 2 trials p cannot be below 0.33; 4 of each condition are needed"),
        ("AAABBB", "3 and 3 trials p cannot be below 0.1; 4 of each condition are needed for p below 0.05"),
        (
            "AAAABBBBCCCC",
            "4 and 4 trials p cannot be below 0.029; 5 of each condition are needed for p below 0.025 of 2",
        ),
    ],
)
def test_too_few_trials_are_refused_with_the_number_needed(order, words):
    found = effects(rows_of(order, np.arange(len(order))), trials_of(order))
    assert all(words in each.why for each in found)
    assert all(each.p is None and each.difference is not None for each in found)


def test_the_numbers_needed_are_the_smallest_ones():
    pairs = Blocks(np.array([False, True]), np.zeros(2, dtype=int))
    assert [blocks_needed(pairs, m) for m in (1, 2, 3)] == [6, 7, 7]
    assert [trials_needed(m) for m in (1, 2, 3)] == [4, 5, 5]
    for comparisons in (1, 2, 3, 5):
        n = trials_needed(comparisons)
        assert one_block([0] * n + [1] * n).smallest_p < 0.05 / comparisons
        assert one_block([0] * (n - 1) + [1] * (n - 1)).smallest_p >= 0.05 / comparisons


def test_without_values_there_is_no_difference_and_with_a_reason_no_test():
    (none,) = effects(rows_of("ABAB", [None] * 4), trials_of("ABAB"))
    assert (none.difference, none.p, none.why) == (None, None, "no trials with a value can be compared")
    (grown,) = effects(rows_of(ABAB, np.arange(12)), trials_of(ABAB), untested={"B": "trials last differently"})
    assert (grown.p, grown.why) == (None, "trials last differently")
    assert grown.difference is not None
    assert effects(rows_of("AAAA", range(4)), trials_of("AAAA")) == []


def simulated(order: str, effect: float, random: np.random.Generator, scatter: float = 2.0) -> list[Measure]:
    """A session of trials that scatter by 2 degrees, measured with a sigma of 2 of which 70 % is the session's own."""
    sigma = 2.0
    shared = math.sqrt(0.7) * sigma * random.normal()
    errors = shared + math.sqrt(0.3) * sigma * random.normal(size=len(order))
    truth = 12.0 + scatter * random.normal(size=len(order)) + effect * np.array([letter == "B" for letter in order])
    return rows_of(order, truth + errors, sigma)


def drawn(random: np.random.Generator, design: str) -> str:
    if design == "free":
        return "".join(random.permutation(list("A" * 6 + "B" * 6)))
    return "".join("".join(random.permutation(["A", "B"])) for _ in range(6))


@pytest.mark.parametrize("design", ["free", "pairs"])
def test_a_condition_that_changes_nothing_is_called_a_change_in_at_most_5_of_100_sessions(design):
    random, sessions = np.random.default_rng(11), 1500
    called, covered = 0, 0
    for _ in range(sessions):
        order = drawn(random, design)
        (effect,) = effects(simulated(order, 0.0, random), trials_of(order))
        called += effect.shown
        covered += effect.low <= 0.0 <= effect.high
    assert called / sessions <= 0.05 + 2 * math.sqrt(0.05 * 0.95 / sessions)
    assert covered / sessions >= 0.95 - 3 * math.sqrt(0.05 * 0.95 / sessions)


def test_five_degrees_in_twelve_trials_are_found_in_over_90_of_100_sessions():
    random, sessions = np.random.default_rng(12), 400
    found = 0
    for _ in range(sessions):
        order = drawn(random, "free")
        (effect,) = effects(simulated(order, 5.0, random), trials_of(order))
        found += effect.shown
    assert found / sessions > 0.9


def test_of_three_conditions_without_a_change_any_is_called_one_in_at_most_5_of_100_sessions():
    random, sessions = np.random.default_rng(13), 400
    called = 0
    for _ in range(sessions):
        order = "".join(random.permutation(list("AAAAAABBBBBBCCCCCC")))
        called += any(effect.shown for effect in effects(simulated(order, 0.0, random), trials_of(order)))
    assert called / sessions <= 0.05 + 2 * math.sqrt(0.05 * 0.95 / sessions)
