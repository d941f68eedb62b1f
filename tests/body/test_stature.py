"""How tall people are by age and sex."""

from __future__ import annotations

import numpy as np
import pytest

from anchorpose.tracker.prior_shape import stature_m


def test_children_grow_and_adults_do_not():
    for sex in ("female", "male", None):
        heights = [stature_m(years, sex)[0] for years in np.arange(3.0, 19.0, 0.5)]
        assert (np.diff(heights) > 0.0).all()
        assert stature_m(40.0, sex) == stature_m(70.0, sex) == stature_m(None, sex)


def test_medians_are_those_of_the_world_health_organization():
    assert stature_m(10.0, "female")[0] == pytest.approx(1.386)
    assert stature_m(10.0, "male")[0] == pytest.approx(1.378)
    assert stature_m(5.5, "male")[0] == pytest.approx((1.100 + 1.160) / 2.0)


def test_of_an_unknown_sex_heights_spread_wider():
    assert stature_m(30.0, None)[1] > stature_m(30.0, "male")[1]
    assert stature_m(30.0, "female")[0] < stature_m(30.0, None)[0] < stature_m(30.0, "male")[0]


def test_below_three_years_it_is_that_of_three():
    assert stature_m(1.0, "male") == stature_m(3.0, "male")
