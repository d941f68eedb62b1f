"""The shipped body and its forward kinematics: skinning, symmetry, bone lengths, joints inside the skin."""

import numpy as np
import pytest
from body_builder import adult, asset, random_pose, turned_about_y, winding_numbers
from scipy.spatial import cKDTree

from anchorpose.body.asset import joint_bones, stored_asset
from anchorpose.body.kinematics import BodyMesh, shape_body
from anchorpose.body.shape_prior import shape_of_height
from anchorpose.camera import transform_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LIMBS

MEAN = shape_body(asset(), np.zeros(0))
REST = np.tile(np.eye(3), (len(asset().bone_names), 1, 1))
MIRROR = np.array([1.0, 1.0, -1.0])


def some_shape(seed: int) -> BodyMesh:
    return shape_body(asset(), np.random.default_rng(seed).normal(0.0, 1.0, asset().shape_count).clip(-2, 2))


def swap_sides(name: str) -> str:
    return name.replace("Left", "Other").replace("Right", "Left").replace("Other", "Right")


def test_the_shares_of_the_bones_in_every_vertex_are_shares():
    weights = asset().skin_weights
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)


def test_parents_stand_before_their_children():
    assert asset().bone_parents[0] == -1
    assert (asset().bone_parents[1:] >= 0).all()
    assert (asset().bone_parents < np.arange(len(asset().bone_names))).all()


def test_every_joint_has_its_own_bone():
    assert len(set(joint_bones(asset()).tolist())) == JOINT_COUNT


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_no_turn_gives_back_the_rest_skin_and_joints(seed):
    body = MEAN if seed is None else some_shape(seed)
    transforms = body.bone_transforms(REST, body.bone_heads[0])
    np.testing.assert_allclose(body.skin(transforms), body.vertices, atol=1e-12)
    np.testing.assert_allclose(body.joints(transforms), body.rest_joints(), atol=1e-12)


def test_the_root_bone_goes_where_it_is_told():
    body, pose = some_shape(3), random_pose(3)
    transforms = body.bone_transforms(pose.rotations, pose.root_m)
    np.testing.assert_allclose(body.joints(transforms)[JOINT_INDEX["SpineBase"]], pose.root_m, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_a_rigid_motion_of_the_pose_moves_skin_and_joints_with_it(seed):
    body, pose, motion = some_shape(seed), random_pose(seed), turned_about_y(40.0 + 70.0 * seed, (0.4, -0.2, 1.5))
    moved = motion.of_pose(pose)
    before = body.bone_transforms(pose.rotations, pose.root_m)
    after = body.bone_transforms(moved.rotations, moved.root_m)
    np.testing.assert_allclose(body.skin(after), transform_points(motion.T, body.skin(before)), atol=1e-12)
    np.testing.assert_allclose(body.joints(after), transform_points(motion.T, body.joints(before)), atol=1e-12)


def test_every_bone_moves_as_a_rigid_body():
    transforms = MEAN.bone_transforms(random_pose(4, 1.0).rotations, np.zeros(3))
    turns = transforms[:, :3, :3]
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (len(turns), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_no_pose_changes_a_bones_length(seed):
    body, pose = some_shape(seed), random_pose(seed, 1.0)
    transforms = body.bone_transforms(pose.rotations, pose.root_m)
    heads = np.einsum("bij,bj->bi", transforms[:, :3, :3], body.bone_heads) + transforms[:, :3, 3]
    parents = asset().bone_parents[1:]
    length = np.linalg.norm(heads[1:] - heads[parents], axis=1)
    np.testing.assert_allclose(
        length, np.linalg.norm(body.bone_heads[1:] - body.bone_heads[parents], axis=1), atol=1e-9
    )


def test_no_pose_changes_the_length_of_an_upper_arm_forearm_thigh_or_shank():
    limbs = [(a, b) for a, b in LIMBS if JOINT_NAMES[a][:-4].startswith(("Shoulder", "Elbow", "Hip", "Knee"))]
    start, end = np.array([*limbs, *[(a, b) for a, b in LIMBS if "Right" in JOINT_NAMES[a]]]).T
    lengths = [
        np.linalg.norm(joints[start] - joints[end], axis=1)
        for joints in (MEAN.joints(MEAN.bone_transforms(random_pose(seed).rotations, np.zeros(3))) for seed in range(6))
    ]
    assert np.ptp(lengths, axis=0).max() < 1e-9


def test_the_mean_body_is_its_own_mirror_image():
    away, _ = cKDTree(asset().vertices).query(asset().vertices * MIRROR)
    assert away.max() < 0.001
    joints = MEAN.rest_joints()
    swapped = [JOINT_INDEX[swap_sides(name)] for name in JOINT_NAMES]
    # the artist's neck is 1.2 mm off the middle, so its mirror image 2.4 mm off itself
    np.testing.assert_allclose(joints[swapped] * MIRROR, joints, atol=0.003)


def test_the_body_faces_x_stands_along_y_and_has_its_right_at_positive_z():
    joints = MEAN.rest_joints()
    for name in ("Shoulder", "Elbow", "Wrist", "Hand", "Hip", "Knee", "Ankle", "Foot"):
        assert joints[JOINT_INDEX[f"{name}Right"], 2] > 0 > joints[JOINT_INDEX[f"{name}Left"], 2]
    for side in ("Left", "Right"):
        assert joints[JOINT_INDEX[f"Foot{side}"], 0] > joints[JOINT_INDEX[f"Ankle{side}"], 0] + 0.05
    spine = [JOINT_INDEX[name] for name in ("SpineBase", "SpineMid", "SpineShoulder", "Neck", "Head")]
    assert (np.diff(joints[spine, 1]) > 0.02).all()


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_joints_lie_inside_the_skin(seed):
    body = MEAN if seed is None else some_shape(seed)
    wraps = winding_numbers(body.vertices, asset().faces, body.rest_joints())
    assert (wraps > 0.5).all(), dict(zip(JOINT_NAMES, wraps.round(2), strict=True))


def test_a_place_beside_the_body_is_not_inside():
    beside = np.add(MEAN.rest_joints(), [0.0, 0.0, 1.5])
    assert np.abs(winding_numbers(MEAN.vertices, asset().faces, beside)).max() < 0.05


@pytest.mark.parametrize("height_m", [1.50, 1.72, 1.95])
def test_the_shape_of_a_height_has_that_height(height_m):
    body = shape_of_height(asset(), height_m).mesh(asset())
    assert np.ptp(body.vertices[:, 1]) == pytest.approx(height_m, abs=0.002)


def test_a_taller_adult_has_longer_legs_and_arms():
    short, tall = (adult(height_m).mesh(asset()).rest_joints() for height_m in (1.55, 1.90))
    for upper, lower in (("HipLeft", "KneeLeft"), ("KneeRight", "AnkleRight"), ("ShoulderLeft", "ElbowLeft")):
        pair = JOINT_INDEX[upper], JOINT_INDEX[lower]
        length = [float(np.linalg.norm(joints[pair[0]] - joints[pair[1]])) for joints in (short, tall)]
        assert length[1] > 1.1 * length[0]  # stature is 1.23 times as much


def test_more_coefficients_than_the_asset_has_are_refused():
    with pytest.raises(ValueError, match=f"{asset().shape_count + 1} shape coefficients"):
        shape_body(asset(), np.zeros(asset().shape_count + 1))


@pytest.mark.parametrize(
    ("start", "end", "growth"),
    [("UpLeg", "Leg", 1.08), ("Leg", "Foot", 0.88), ("Arm", "ForeArm", 1.04), ("ForeArm", "Hand", 1.23)],
)
def test_limbs_grow_with_stature_as_among_measured_adults(start, end, growth):
    """Growth: percent of a segment's length per percent of stature, from 6,068 adults of ANSUR II."""
    model = stored_asset()
    drawn = np.random.default_rng(0).normal(0.0, model.adult_sigma, (500, model.shape_count))
    people = [shape_body(model, coefficients) for coefficients in drawn]
    stature = np.log([np.ptp(person.vertices[:, 1]) for person in people])
    first, last = model.bone(f"Left{start}"), model.bone(f"Left{end}")
    length = np.log([np.linalg.norm(person.bone_heads[last] - person.bone_heads[first]) for person in people])
    assert np.polyfit(stature, length, 1)[0] == pytest.approx(growth, abs=0.08)
