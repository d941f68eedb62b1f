"""What is known of a patient beforehand: adults, children, and statements that the images contradict."""

import numpy as np
import pytest
from body_builder import adult, asset

from anchorpose.body.kinematics import shape_body
from anchorpose.body.shape_prior import adult_belief, child_belief, shape_of_height, standing_height
from anchorpose.recording.recording import UNKNOWN, Subject
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.prior_shape import contradiction, known_beliefs, likeliest, stature_m

CONFIG = TrackConfig()


def height_m(shape) -> float:
    return standing_height(asset(), shape)[0]


def test_without_a_statement_an_adult_or_a_child_is_expected_and_of_a_grown_person_only_an_adult():
    assert len(known_beliefs(UNKNOWN, CONFIG)) == 2
    assert len(known_beliefs(Subject(age_years=40.0), CONFIG)) == 1
    assert len(known_beliefs(Subject(birth_year=1970), CONFIG)) == 1
    assert len(known_beliefs(Subject(birth_year=2005), CONFIG)) == 2  # the year of the recording is not known
    assert len(known_beliefs(Subject(age_years=8.0), CONFIG)) == 2  # the images may show otherwise


@pytest.mark.thorough
@pytest.mark.parametrize("tall_m", [1.0, 1.15, 1.3, 1.45])
def test_a_child_of_any_height_is_likelier_a_child_and_an_adult_an_adult(tall_m):
    adults, children = known_beliefs(UNKNOWN, CONFIG)
    child = child_belief(asset()).standing(asset(), tall_m, 0.01).shape
    assert height_m(child) == pytest.approx(tall_m, abs=0.01)
    assert likeliest((adults, children), child) is children
    assert likeliest((adults, children), shape_of_height(asset(), tall_m + 0.5)) is adults


def test_children_have_larger_heads_for_their_height():
    child = child_belief(asset()).standing(asset(), 1.1, 0.01).shape

    def head_share(shape) -> float:
        up = shape.mesh(asset()).vertices[asset().main_bone() == asset().bone("Head"), 1]
        return float(np.ptp(up)) / height_m(shape)

    assert head_share(child) > 1.15 * head_share(adult())


@pytest.mark.thorough
def test_age_and_sex_move_the_height_and_the_images_may_move_it_back():
    (woman,) = known_beliefs(Subject(age_years=40.0, sex="female"), CONFIG)
    (man,) = known_beliefs(Subject(age_years=40.0, sex="male"), CONFIG)
    assert height_m(man.shape) - height_m(woman.shape) > 0.06
    row = standing_height(asset(), man.shape)[1]
    assert 0.04 < np.sqrt(man.variance(row[None])[0]) < 0.075


def seen(tall_m: float):
    return adult_belief(asset()).standing(asset(), tall_m, 0.005)


@pytest.mark.thorough
def test_what_contradicts_the_images_is_named_and_what_does_not_is_not():
    assert contradiction(UNKNOWN, seen(1.7), CONFIG) == ""
    assert contradiction(Subject(height_m=1.72), seen(1.70), CONFIG) == ""
    assert "stated height" in contradiction(Subject(height_m=1.9), seen(1.70), CONFIG)
    assert "stated age" in contradiction(Subject(age_years=6.0), seen(1.70), CONFIG)
    assert contradiction(Subject(age_years=40.0, sex="male"), seen(1.62), CONFIG) == ""


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


@pytest.mark.parametrize("missing", [("foot_left",), ("shank_left",), ("shank_left", "shank_right"), ("leg_left",)])
@pytest.mark.parametrize("stated", [{"height_m": 1.75}, {"age_years": 60.0, "sex": "male"}])
def test_a_missing_limb_does_not_change_what_a_statement_says_of_the_rest(missing, stated):
    """The stated height is that of the whole person; otherwise, the body would be stretched to make up for the leg."""
    whole, lacking = (
        known_beliefs(Subject(**({"age_years": 40.0} | stated), missing=gone), CONFIG) for gone in ((), missing)
    )
    own, other = (shape_body(asset(), beliefs[0].shape.coefficients) for beliefs in (whole, lacking))
    np.testing.assert_allclose(other.bone_heads, own.bone_heads, atol=0.01)
    assert height_m(lacking[0].shape) == pytest.approx(height_m(whole[0].shape), abs=0.005)
