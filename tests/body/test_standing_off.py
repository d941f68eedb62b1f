"""Segments that stand off the learnt body: found, named as in recording.json, and less certain."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import asset

from anchorpose.body.learning import bone_lengths
from anchorpose.body.segments import SIDES
from anchorpose.body.shape_prior import adult_belief
from anchorpose.body.skin_points import CLOTHES, FittedShape, even_clothes, skin_points
from anchorpose.body.standing_off import BONE_SHARE, JOINT_SHARE, standing_off, standing_off_sigma_m
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES


def worn_over(part_name: str, away_m: float) -> FittedShape:
    """The mean adult with all patches of a bone's skin standing off as far, by least squares."""
    points = skin_points(asset())
    wanted = np.where(points.part == asset().bone(part_name), away_m, 0.0)
    patches = np.linalg.lstsq(points.covered[:, len(CLOTHES) :], wanted, rcond=None)[0]
    offset = even_clothes(0.006)
    offset[len(CLOTHES) :] = patches
    return FittedShape(np.zeros(asset().shape_count), offset)


def test_clothes_however_thick_stand_off_nothing():
    shape = FittedShape(np.zeros(asset().shape_count), even_clothes(0.03))
    assert standing_off(skin_points(asset()), shape) == {}
    assert not standing_off_sigma_m(skin_points(asset()), shape).any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_braced_shank_is_named_and_its_joints_are_less_certain(sign):
    points, shape = skin_points(asset()), worn_over("LeftLeg", sign * 0.06)
    found = standing_off(points, shape)
    assert "shank_left" in found
    assert found["shank_left"] == max(found.values()) > 0.03
    assert not [name for name in found if name.endswith("right") or "arm" in name]
    sigma = standing_off_sigma_m(points, shape)
    assert sigma[JOINT_INDEX["AnkleLeft"]] == pytest.approx(JOINT_SHARE * found["shank_left"])
    assert {JOINT_NAMES[k] for k in np.flatnonzero(sigma)} <= {"HipLeft", "KneeLeft", "AnkleLeft", "FootLeft"}


def with_girth(**deviations: float) -> FittedShape:
    """The mean adult with some limbs thicker or thinner, in deviations among people."""
    coefficients = np.zeros(asset().shape_count)
    for name, value in deviations.items():
        segment, side = name.rsplit("_", 1)
        coefficients[asset().own_row(f"{segment}_girth_{side}")] = value
    return FittedShape(coefficients, even_clothes(0.006))


def test_a_limb_much_thicker_than_the_other_is_named():
    found = standing_off(skin_points(asset()), with_girth(shank_left=4.0, shank_right=0.3))
    assert list(found) == ["shank_left"]
    assert 0.012 < found["shank_left"] < 0.030  # 36 % of a radius of 50 mm is 18 mm


@pytest.mark.parametrize(
    "girths",
    [
        {"shank_left": -3.0, "shank_right": -0.5, "thigh_left": -2.5},  # one leg wasted: the other is a healthy one
        {f"{segment}_{side}": 2.2 for segment in ("upper_arm", "forearm", "thigh", "shank") for side in SIDES},  # heavy
        {"forearm_right": 1.5},
    ],
)
def test_thin_and_heavy_people_stand_off_nothing(girths):
    assert standing_off(skin_points(asset()), with_girth(**girths)) == {}


def test_braces_on_both_sides_are_thicker_than_people_are():
    assert set(standing_off(skin_points(asset()), with_girth(shank_left=4.0, shank_right=4.0))) == {
        "shank_left",
        "shank_right",
    }


def test_the_bone_under_it_is_less_certain_and_no_other():
    worn, bare = (
        {
            bone.bone: bone.sigma_m
            for bone in bone_lengths(asset(), replace(adult_belief(asset()), shape=worn_over("RightForeArm", away_m)))
        }
        for away_m in (0.06, 0.0)
    )
    off_m = standing_off(skin_points(asset()), worn_over("RightForeArm", 0.06))["forearm_right"]
    assert worn["forearm_right"] == pytest.approx(np.hypot(bare["forearm_right"], BONE_SHARE * off_m), rel=1e-3)
    assert worn["forearm_left"] == pytest.approx(bare["forearm_left"])
