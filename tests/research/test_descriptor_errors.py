"""The error model against errors that were put in, its laws, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from anchorpose.research.descriptor_errors import ErrorModel, NoErrorModel, estimate_errors

ANCHOR_M = np.array([0.006, 0.020, 0.030, 0.012, 0.010])
OFFSET_M, PER_M = 0.003, 0.008


def matches(seed=0, pairs=60, nodes=250, outliers=0.0):
    """Descriptors before and after with known errors; outliers: share of distances that an occlusion lengthened."""
    rng = np.random.default_rng(seed)
    before = rng.uniform(0.05, 1.6, (pairs, nodes, 5))
    e_1 = rng.normal(0, 1, (pairs, 1, 5)) * ANCHOR_M
    e_2 = rng.normal(0, 1, before.shape) * (OFFSET_M + PER_M * before)
    e_3 = np.where(rng.random(before.shape) < outliers, rng.uniform(0.05, 0.3, before.shape), 0.0)
    after = before + e_1 + e_2 + e_3
    return before.reshape(-1, 5), after.reshape(-1, 5), np.repeat(np.arange(pairs), nodes)


@pytest.mark.parametrize(("outliers", "within"), [(0.0, 0.25), (0.10, 0.30)])
def test_it_finds_the_errors_that_were_put_in(outliers, within):
    model = estimate_errors(*matches(outliers=outliers))
    assert isinstance(model, ErrorModel)
    np.testing.assert_allclose(model.anchor_m, ANCHOR_M, rtol=within)  # sixty pairs: a median is good to 16 %
    assert pytest.approx(OFFSET_M, abs=0.001) == model.surface_offset_m
    assert pytest.approx(PER_M, abs=0.002) == model.surface_per_m
    assert model.pairs == 60


def test_its_bound_holds_for_as_many_as_it_says():
    before, after, pair = matches(seed=1)
    model = estimate_errors(before, after, pair)
    later_before, later_after, _ = matches(seed=2)
    within = np.abs(later_after - later_before) < model.e_max_m(later_before)
    assert 0.95 < within.mean() < 0.999


def test_numbers_of_the_gate_are_the_bound_of_a_typical_anchor():
    model = estimate_errors(*matches())
    typical = int(np.argsort(model.anchor_m)[2])
    bound = model.e_max_m(np.full((1, 5), 0.7))[0, typical]
    assert model.anchor_bound_m + 0.7 * model.surface_bound_per_m == pytest.approx(bound)


def test_it_does_not_depend_on_the_order_of_matches_or_anchors_and_scales_with_the_lengths():
    before, after, pair = matches(pairs=20)
    model = estimate_errors(before, after, pair)
    order = np.random.default_rng(3).permutation(len(pair))
    turn = np.array([3, 0, 4, 1, 2])
    shuffled = estimate_errors(before[order][:, turn], after[order][:, turn], 7 - 2 * pair[order])
    np.testing.assert_allclose(shuffled.anchor_m, model.anchor_m[turn])
    assert shuffled.surface_per_m == pytest.approx(model.surface_per_m)
    larger = estimate_errors(2 * before, 2 * after, pair)
    np.testing.assert_allclose(larger.anchor_m, 2 * model.anchor_m)
    assert larger.surface_offset_m == pytest.approx(2 * model.surface_offset_m)
    assert larger.surface_per_m == pytest.approx(model.surface_per_m)


def test_which_frame_is_called_the_first_changes_nothing():
    before, after, pair = matches(pairs=20)
    one, other = estimate_errors(before, after, pair), estimate_errors(after, before, pair)
    np.testing.assert_allclose(one.anchor_m, other.anchor_m, rtol=1e-3)
    assert one.surface_per_m == pytest.approx(other.surface_per_m, rel=1e-3)


def test_without_errors_it_finds_none():
    before, _, pair = matches(pairs=5)
    model = estimate_errors(before, before.copy(), pair)
    assert model.anchor_m.max() < 1e-12
    assert model.surface_offset_m + model.surface_per_m < 1e-9


def test_a_missed_anchor_has_no_error_and_no_bound():
    before, after, pair = matches(pairs=20)
    before[:, 1], after[:, 4] = np.nan, np.inf
    model = estimate_errors(before, after, pair)
    np.testing.assert_array_equal(np.isnan(model.anchor_m), [False, True, False, False, True])
    np.testing.assert_array_equal(np.isnan(model.e_max_m(np.ones((2, 5)))[0]), [False, True, False, False, True])
    assert np.isfinite(model.anchor_bound_m)


def test_too_little_to_go_by_is_a_named_result():
    before, after, pair = matches(pairs=3)
    assert estimate_errors(before[:20], after[:20]) is NoErrorModel.FEW
    assert estimate_errors(np.full_like(before, np.nan), after, pair) is NoErrorModel.FEW
    assert estimate_errors(before[:0], after[:0]) is NoErrorModel.FEW
    near = 0.5 + 0.01 * before
    assert estimate_errors(near, near + 0.001, pair) is NoErrorModel.NARROW


def test_what_are_no_matches_is_refused():
    before, after, pair = matches(pairs=2)
    for wrong in ((before[1:], after, pair), (before, after, pair[1:]), (before[:, 0], after[:, 0], pair)):
        with pytest.raises(ValueError, match="are not matches"):
            estimate_errors(*wrong)
