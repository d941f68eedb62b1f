"""Means, ratios, deviations and medians over recordings, and whether their intervals hold what they should."""

from collections.abc import Callable

import numpy as np
import pytest

from anchorpose.research.experiment.page.tables import Estimate, deviation_over, mean_over, median_over, ratio_of

SUMMARIES = (mean_over, deviation_over, median_over)


def groups(*sizes: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.normal(10.0 + number, 2.0, size) for number, size in enumerate(sizes)]


@pytest.mark.parametrize(
    ("summarise", "plain"), [(mean_over, np.mean), (deviation_over, np.std), (median_over, np.median)]
)
def test_the_value_is_that_of_all_values_together(summarise, plain) -> None:
    values = groups(5, 50, 500)
    found = summarise(values, 100)
    assert found.mean == pytest.approx(plain(np.concatenate(values)))
    assert found.low <= found.high
    assert found.count == 3


@pytest.mark.parametrize("summarise", SUMMARIES)
def test_missing_values_and_empty_recordings_are_left_out(summarise) -> None:
    values = groups(20, 30)
    holed = [np.append(values[0], np.nan), np.full(4, np.nan), values[1], np.empty(0)]
    assert summarise(holed, 200) == summarise(values, 200)


@pytest.mark.parametrize("summarise", SUMMARIES)
def test_one_recording_gives_no_interval_and_none_gives_nothing(summarise) -> None:
    one = summarise(groups(30), 100)
    assert np.isfinite(one.mean)
    assert np.isnan([one.low, one.high]).all()
    assert one.count == 1
    nothing = summarise([np.full(3, np.nan)], 100)
    assert np.isnan([nothing.mean, nothing.low, nothing.high]).all()
    assert nothing.count == 0


def test_recordings_that_agree_leave_no_doubt_however_much_their_frames_differ() -> None:
    frames = np.array([0.0, 100.0, 20.0, 80.0])
    found = mean_over([frames, frames[::-1], frames], 200)
    assert (found.low, found.mean, found.high) == (50.0, 50.0, 50.0)


def widened(mean: float, drawn: list[float], count: int) -> tuple[float, float]:
    """Percentiles, farther off by what Student's distribution and the variance of so few ask for (from a table)."""
    factor = {3: 4.303, 4: 3.182}[count] / 1.960 * (count / (count - 1)) ** 0.5
    low, high = np.log(np.quantile(drawn, [0.025, 0.975]) / mean)
    return mean * np.exp(factor * low), mean * np.exp(factor * high)


def test_what_is_never_negative_has_no_interval_below_zero() -> None:
    found = mean_over([np.full(5, value) for value in (0.1, 0.2, 8.0)], 500)
    assert 0.0 < found.low < found.mean < found.high


def held_of(draws: int, truth: float, draw: Callable, summarise=mean_over) -> float:
    """The share of intervals that hold the truth."""
    found = [summarise(draw(), 200) for _ in range(draws)]
    return float(np.mean([one.low <= truth <= one.high for one in found]))


@pytest.mark.parametrize("count", [4, 6, 8])
def test_few_recordings_have_a_calibrated_interval_too_and_so_have_skewed_errors(count: int) -> None:
    rng, skewed = np.random.default_rng(3), np.random.default_rng(4)
    assert 0.9 < held_of(300, 0.0, lambda: [rng.normal(0.0, 0.1, 5) + rng.normal() for _ in range(count)]) < 0.99
    assert 0.90 <= held_of(300, 20.0, lambda: [skewed.gamma(4.0, 5.0, size=1) for _ in range(count)]) <= 1.0


def test_the_interval_is_that_of_a_plain_bootstrap() -> None:
    values = groups(3, 4, 5, 6)
    rng = np.random.default_rng(8)
    means = [np.concatenate([values[i] for i in rng.integers(0, 4, 4)]).mean() for _ in range(4000)]
    found = mean_over(values, 4000)
    assert (found.low, found.high) == pytest.approx(widened(found.mean, means, 4), abs=0.2)


@pytest.mark.thorough
@pytest.mark.parametrize("summarise", [mean_over, median_over])
def test_the_interval_holds_the_truth_about_as_often_as_it_says(summarise) -> None:
    """Frames of a recording resemble each other: an interval from single frames would hold the truth one time in three.

    Of 95 in 100, a percentile bootstrap over 20 recordings is known to miss a few.
    """
    rng = np.random.default_rng(5)
    held = held_of(200, 50.0, lambda: [rng.normal(rng.normal(50.0, 5.0), 3.0, 40) for _ in range(20)], summarise)
    assert 0.86 <= held <= 0.99


def test_a_ratio_is_of_the_means_of_recordings_that_both_sides_have() -> None:
    below = [np.array([10.0, 20.0]), np.array([100.0])]
    above = [2.0 * group for group in below]
    assert ratio_of(above, below, 200) == Estimate(2.0, 2.0, 2.0, 2)
    known = [np.array([4.0]), np.array([6.0])]
    found = ratio_of([*known, np.array([99.0])], [np.ones(1), np.ones(1), np.array([np.nan])], 100)
    assert (found.mean, found.count) == (5.0, 2)


def test_a_ratio_to_nothing_is_not_known_and_needs_the_same_recordings() -> None:
    found = ratio_of([np.ones(2), np.ones(2)], [np.zeros(2), np.zeros(2)], 20)
    assert np.isnan([found.mean, found.low, found.high]).all()
    with pytest.raises(ValueError, match="same recordings"):
        ratio_of([np.ones(2)], [], 10)
