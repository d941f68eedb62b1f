"""Bodies that lack limbs: what is gone, and that no pose brings it back."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from body_builder import adult, asset, points, random_pose

from anchorpose.body.evidence import separation_rows
from anchorpose.body.kinematics import missing_anchors, missing_joints, missing_points, stump_of
from anchorpose.body.learning import bone_lengths
from anchorpose.body.shape_prior import adult_belief
from anchorpose.body.skin_points import build_body, pose_points, skin_points
from anchorpose.body.standing_off import patches_of
from anchorpose.joints import ANCHOR_NAMES, JOINT_NAMES
from anchorpose.recording.recording import CoveredPart, MissingPart

PARTS = get_args(MissingPart)


def names_of(parts: tuple[str, ...]) -> set[str]:
    return {name for name, gone in zip(JOINT_NAMES, missing_joints(asset(), parts), strict=True) if gone}


def test_joints_beyond_the_stump_are_missing_and_the_stump_is_not():
    assert names_of(()) == set()
    assert names_of(("shank_left",)) == {"AnkleLeft", "FootLeft"}
    assert names_of(("arm_right",)) == {"ElbowRight", "WristRight", "HandRight"}
    assert names_of(("hand_left", "foot_right")) == {"HandLeft", "FootRight"}
    assert names_of(("leg_left", "foot_left")) == names_of(("leg_left",))


def test_hands_and_feet_that_are_missing_are_no_anchors():
    gone = missing_anchors(("forearm_left", "foot_right"))
    assert [name for name, lost in zip(ANCHOR_NAMES, gone, strict=True) if lost] == ["HandLeft", "FootRight"]
    assert not missing_anchors(()).any()


@pytest.mark.parametrize("part", PARTS)
def test_in_every_pose_all_of_a_missing_part_lies_in_the_joint_where_it_would_begin(part):
    body = build_body(points(), replace(adult(), missing=(part,)))
    gone, stump = missing_points(asset(), points().part, (part,)), stump_of(asset(), part)
    assert gone.any()
    for seed in range(3):
        pose = random_pose(seed)
        posed = pose_points(body, pose)
        T = posed.transforms[stump]
        place = T[:3, :3] @ body.mesh.bone_heads[stump] + T[:3, 3]
        # a few points at the stump also follow bones above the parent, from which the joint moves a little
        away_m = np.linalg.norm(posed.points_m[gone] - place, axis=1)
        assert away_m.max() < 0.03
        assert np.median(away_m) < 1e-6
        assert np.isfinite(posed.normals).all()


def test_what_is_left_is_as_it_was():
    whole, lacking = build_body(points(), adult()), build_body(points(), replace(adult(), missing=("leg_left",)))
    kept = ~missing_points(asset(), points().part, ("leg_left",))
    np.testing.assert_array_equal(lacking.rest_m[kept], whole.rest_m[kept])


def test_a_missing_arm_is_not_pushed_out_of_the_trunk():
    body = build_body(points(), replace(adult(), missing=("arm_left", "arm_right")))
    assert len(separation_rows(body, pose_points(body, random_pose(1)))) == 0


def test_missing_bones_have_no_length():
    bones = {bone.bone for bone in bone_lengths(asset(), adult_belief(asset()).lacking(("shank_left",)))}
    assert "shank_left" not in bones
    assert {"thigh_left", "shank_right"} <= bones


@pytest.mark.parametrize("part", get_args(CoveredPart))
def test_a_covered_segment_may_be_of_any_thickness_and_the_others_are_as_before(part):
    plain = adult_belief(asset())
    covered = plain.covering(asset(), (part,))
    wider = np.diag(np.linalg.inv(covered.prior)) / np.diag(np.linalg.inv(plain.prior))
    assert wider.max() == pytest.approx(16.0)
    patches = len(patches_of(skin_points(asset()), part))
    assert np.isclose(wider, 1.0).sum() >= len(wider) - 5 - patches
    assert patches < 40
