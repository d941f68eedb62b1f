"""The nearest descriptor, against every distance written out."""

import numpy as np
import pytest

from anchorpose.research.features.nearest import Metric, nearest_descriptor

METRICS = list(Metric)


def written_out(source: np.ndarray, target: np.ndarray, metric: str) -> np.ndarray:
    """(m, n) float64 distances."""
    a, b = source[:, None, :].astype(np.float64), target[None].astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        terms = {
            "euclidean": lambda: (a - b) ** 2,
            "hellinger": lambda: (np.sqrt(a) - np.sqrt(b)) ** 2,
            "manhattan": lambda: np.abs(a - b),
        }[metric]()
    return terms.sum(axis=2)


def histograms(count: int, width: int, seed: int) -> np.ndarray:
    """Rows with many zeros, as histograms have them."""
    rng = np.random.default_rng(seed)
    return (rng.gamma(0.3, size=(count, width)) * (rng.random((count, width)) > 0.3)).astype(np.float32)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(("m", "n", "d"), [(300, 217, 33), (5, 1, 1), (270, 400, 135)])
def test_every_metric_finds_what_all_distances_written_out_find(metric: Metric, m: int, n: int, d: int) -> None:
    source, target = histograms(m, d, 1), histograms(n, d, 2)
    distance = written_out(source, target, metric)
    found = nearest_descriptor(source, target, metric)
    assert found.dtype == np.int32
    if d > 1:
        np.testing.assert_array_equal(found, distance.argmin(axis=1))
    np.testing.assert_allclose(distance[np.arange(m), found], distance.min(axis=1), rtol=1e-6)


@pytest.mark.parametrize("metric", METRICS)
def test_of_rows_equally_near_one_is_taken_wherever_it_stands(metric: Metric) -> None:
    target = np.tile(histograms(13, 40, 3), (20, 1))
    order = np.random.default_rng(4).permutation(len(target))
    source = np.concatenate([histograms(13, 40, 3), histograms(50, 40, 5)])
    distance = written_out(source, target[order], metric)
    found = nearest_descriptor(source, target[order], metric)
    np.testing.assert_allclose(distance[np.arange(len(source)), found], distance.min(axis=1), atol=1e-5)


@pytest.mark.parametrize("metric", METRICS)
def test_rows_with_a_nan_get_no_match_and_are_no_match(metric: Metric) -> None:
    source, target = histograms(40, 20, 6), histograms(60, 20, 7)
    source[::4, 3], target[::3, 0], target[1, 5] = np.nan, np.nan, np.inf
    found = nearest_descriptor(source, target, metric)
    assert (found[::4] == -1).all()
    usable = np.flatnonzero(np.isfinite(target).all(axis=1))
    known = np.arange(40) % 4 > 0
    best = usable[written_out(source[known], target[usable], metric).argmin(axis=1)]
    np.testing.assert_array_equal(found[known], best)


@pytest.mark.parametrize("metric", METRICS)
def test_an_empty_table_is_no_error(metric: Metric) -> None:
    some, none = np.ones((3, 4), np.float32), np.empty((0, 4), np.float32)
    np.testing.assert_array_equal(nearest_descriptor(some, none, metric), [-1, -1, -1])
    np.testing.assert_array_equal(nearest_descriptor(some, np.full((2, 4), np.nan), metric), [-1, -1, -1])
    assert nearest_descriptor(none, some, metric).shape == (0,)


@pytest.mark.parametrize("metric", [Metric.EUCLIDEAN, Metric.HELLINGER])
def test_a_large_common_part_does_not_blur_small_differences(metric: Metric) -> None:
    rng = np.random.default_rng(8)
    base = 1000.0 + rng.random(50)
    source, target = (base + 0.01 * rng.random((count, 50)) for count in (80, 120))
    distance = written_out(source.astype(np.float32), target.astype(np.float32), metric)
    np.testing.assert_array_equal(nearest_descriptor(source, target, metric), distance.argmin(axis=1))


def test_huge_and_tiny_values_neither_overflow_nor_vanish() -> None:
    rng = np.random.default_rng(9)
    source, target = rng.normal(size=(30, 12)), rng.normal(size=(40, 12))
    expected = nearest_descriptor(source, target)
    np.testing.assert_array_equal(nearest_descriptor(source * 1e25, target * 1e25), expected)
    np.testing.assert_array_equal(nearest_descriptor(source * 1e-25, target * 1e-25), expected)


@pytest.mark.parametrize("metric", METRICS)
def test_rows_that_the_sums_of_float32_confuse_are_told_apart(metric: Metric) -> None:
    rng = np.random.default_rng(13)
    row = rng.gamma(0.3, size=500).astype(np.float32)
    target = np.tile(row, (40, 1))
    target[np.arange(40), rng.permutation(500)[:40]] += np.float32(1e-4) * rng.permutation(np.arange(1, 41))
    source = (row + rng.gamma(0.3, size=(30, 500))).astype(np.float32)
    distance = written_out(source, target, metric)
    found = nearest_descriptor(source, target, metric)
    np.testing.assert_allclose(distance[np.arange(30), found], distance.min(axis=1), rtol=1e-13)


def test_signed_descriptors_have_a_euclidean_and_a_manhattan_distance() -> None:
    rng = np.random.default_rng(10)
    source, target = rng.normal(size=(50, 9)), rng.normal(size=(70, 9))
    for metric in ("euclidean", "manhattan"):
        np.testing.assert_array_equal(
            nearest_descriptor(source, target, metric), written_out(source, target, metric).argmin(axis=1)
        )


@pytest.mark.parametrize(
    ("source", "target", "metric", "message"),
    [
        (np.ones((2, 3)), np.ones((2, 4)), "euclidean", "same width"),
        (np.ones(3), np.ones((2, 3)), "euclidean", "same width"),
        (np.ones((2, 3)), np.ones((2, 3)), "cosine", "cosine"),
        (-np.ones((2, 3)), np.ones((2, 3)), "hellinger", "below 0"),
        (np.ones((2, 3)), -np.ones((2, 3)), "hellinger", "below 0"),
    ],
)
def test_what_cannot_be_compared_is_refused(source: np.ndarray, target: np.ndarray, metric: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        nearest_descriptor(source, target, metric)
