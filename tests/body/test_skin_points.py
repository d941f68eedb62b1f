"""The sampled skin: where it lies, how it moves with pose and shape, both implementations of its equations."""

import numpy as np
import pytest
from body_builder import (
    adult,
    adult_body,
    asset,
    points,
    random_pose,
    shape_jacobian,
    standing,
    turned_about_y,
    winding_numbers,
)
from scipy.spatial import cKDTree

from anchorpose.body.asset import joint_bones
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.pose_accumulation import accumulate_pose
from anchorpose.body.skin_points import (
    CLOTHES,
    OFFSETS,
    PATCH_M,
    PATCHES,
    POINT_COUNT,
    Body,
    FittedShape,
    build_body,
    even_clothes,
    joint_jacobian,
    pose_jacobian,
    pose_points,
    skin_points,
)

STEP = 1e-6
CLOTHED = adult_body(1.72, 0.008)
POSES = [random_pose(1), random_pose(2, 0.8), standing()]


def rows(seed: int, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    return rng.integers(0, POINT_COUNT, count), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def moved_along(body: Body, pose: Pose, index: np.ndarray, direction: np.ndarray, change: np.ndarray) -> np.ndarray:
    posed = pose_points(body, pose.moved(change, points().moving))
    return (posed.points_m[index] * direction).sum(axis=1)


@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "standing"])
def test_the_pose_jacobian_is_the_derivative_of_the_skin(pose):
    index, direction = rows(1)
    jacobian = pose_jacobian(CLOTHED, pose_points(CLOTHED, pose), index, direction)
    numeric = np.stack(
        [
            (moved_along(CLOTHED, pose, index, direction, d) - moved_along(CLOTHED, pose, index, direction, -d))
            / (2 * STEP)
            for d in STEP * np.eye(POSE_SIZE)
        ],
        axis=1,
    )
    np.testing.assert_allclose(jacobian, numeric, atol=1e-7)


@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "standing"])
def test_the_shape_jacobian_is_the_derivative_of_the_naked_skin(pose):
    index, direction = rows(2)
    count, shape = asset().shape_count, adult(1.66)

    def along(change: np.ndarray) -> np.ndarray:
        body = build_body(points(), FittedShape(shape.coefficients + change, even_clothes(0.0)))
        return (pose_points(body, pose).points_m[index] * direction).sum(axis=1)

    body = build_body(points(), shape)
    jacobian = shape_jacobian(body, pose_points(body, pose), index, direction, count)
    numeric = np.stack([(along(d) - along(-d)) / (2 * STEP) for d in STEP * np.eye(count)], axis=1)
    np.testing.assert_allclose(jacobian[:, :count], numeric, atol=1e-7)


def test_the_last_columns_of_the_shape_jacobian_are_the_pieces_of_clothing_and_the_patches():
    index, direction = rows(3)
    pose, shape = POSES[0], adult(1.72, 0.008)

    def along(change: np.ndarray) -> np.ndarray:
        body = build_body(points(), FittedShape(shape.coefficients, shape.offset_m + change))
        return (pose_points(body, pose).points_m[index] * direction).sum(axis=1)

    jacobian = shape_jacobian(CLOTHED, pose_points(CLOTHED, pose), index, direction, 3)
    numeric = np.stack([(along(d) - along(-d)) / (2 * STEP) for d in STEP * np.eye(OFFSETS)], axis=1)
    assert jacobian.shape == (len(index), 3 + OFFSETS)
    # linear blending shortens the offset at bent joints by up to a tenth, which the normal does not follow
    np.testing.assert_allclose(jacobian[:, 3:], numeric, atol=0.12)
    assert np.abs(jacobian[:, 3:] - numeric).mean(axis=0).max() < 0.003


@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "standing"])
def test_the_joint_jacobian_is_the_derivative_of_the_joints(pose):
    def joints(change: np.ndarray) -> np.ndarray:
        return CLOTHED.mesh.joints(pose_points(CLOTHED, pose.moved(change, points().moving)).transforms)

    at = joints(np.zeros(POSE_SIZE))
    transforms = CLOTHED.transforms(pose)
    jacobian = joint_jacobian(CLOTHED, transforms, joint_bones(asset()), at)
    numeric = np.stack([(joints(d) - joints(-d)) / (2 * STEP) for d in STEP * np.eye(POSE_SIZE)], axis=2)
    np.testing.assert_allclose(jacobian, numeric, atol=1e-7)


@pytest.mark.parametrize("pose", POSES, ids=["random", "wide", "standing"])
def test_accumulation_is_the_plain_jacobian_multiplied_out(pose):
    index, direction = rows(4, 700)
    rng = np.random.default_rng(5)
    residual, weight = rng.normal(size=700), rng.uniform(0.0, 3.0, 700)
    posed = pose_points(CLOTHED, pose)
    plain = pose_jacobian(CLOTHED, posed, index, direction)
    hessian, gradient = accumulate_pose(CLOTHED, posed, index, direction, residual, weight)
    np.testing.assert_allclose(hessian, plain.T @ (weight[:, None] * plain), atol=1e-9)
    np.testing.assert_allclose(gradient, plain.T @ (weight * residual), atol=1e-9)
    np.testing.assert_array_equal(hessian, hessian.T)


def test_accumulation_of_no_rows_is_zero():
    nothing, posed = np.zeros(0), pose_points(CLOTHED, POSES[0])
    hessian, gradient = accumulate_pose(CLOTHED, posed, np.zeros(0, np.int64), np.zeros((0, 3)), nothing, nothing)
    assert not hessian.any()
    assert not gradient.any()


def test_the_sample_is_the_same_each_time():
    skin_points.cache_clear()
    first = skin_points(asset())
    skin_points.cache_clear()
    again = skin_points(asset())
    np.testing.assert_array_equal(first.vertex, again.vertex)
    np.testing.assert_array_equal(first.faces_of, again.faces_of)


def test_the_sample_is_even_and_leaves_no_patch_of_skin_without_a_point():
    rest = asset().vertices
    sample = rest[points().vertex]
    assert len(np.unique(points().vertex)) == POINT_COUNT
    spacing = cKDTree(sample).query(sample, k=2)[0][:, 1]
    assert spacing.min() > 0.010
    corners = rest[np.unique(asset().faces)]
    # no part of the outer skin is farther from the sample than the sample is from itself
    reach = cKDTree(sample).query(corners)[0]
    assert np.percentile(reach, 99) < 0.025


def test_the_sample_of_the_skin_is_the_skin():
    pose, body = POSES[1], adult_body(1.72, 0.0)
    skin = body.mesh.skin(body.transforms(pose))
    np.testing.assert_allclose(pose_points(body, pose).points_m, skin[points().vertex], atol=1e-12)


def test_normals_are_unit_and_point_out_of_the_body():
    body = adult_body(1.72, 0.0)
    for pose in POSES:
        posed = pose_points(body, pose)
        np.testing.assert_allclose(np.linalg.norm(posed.normals, axis=1), 1.0, atol=1e-12)
    some = np.linspace(0, POINT_COUNT - 1, 150).astype(int)
    skin, faces, off = body.mesh.vertices, asset().faces, 0.002 * body.rest_normals[some]
    outside = winding_numbers(skin, faces, body.rest_m[some] + off) < 0.5
    inside = winding_numbers(skin, faces, body.rest_m[some] - off) > 0.5
    assert np.mean(outside & inside) > 0.97  # 2 mm may cross the fold of an ear or between two toes


def test_clothes_stand_off_covered_skin_and_off_nothing_else():
    naked, dressed = adult_body(1.72, 0.0), CLOTHED
    off = np.linalg.norm(dressed.rest_m - naked.rest_m, axis=1)
    covered = points().covered[:, : len(CLOTHES)].sum(axis=1)
    np.testing.assert_allclose(off, 0.008 * covered, atol=1e-12)
    names = {asset().bone_names[part] for part in points().part[covered == 0.0]}
    assert {"Head", "LeftHand", "RightHand"} <= names
    worn = {asset().bone_names[part] for part in points().part[covered == 1.0]}
    # shoes are clothes too
    assert {"Spine1", "Hips", "LeftLeg", "RightForeArm", "LeftUpLeg", "RightArm", "LeftFoot", "RightToeBase"} <= worn
    assert not names & worn


def test_each_piece_of_clothing_covers_its_own_bones_and_no_other_piece_does():
    names = np.array(asset().bone_names)[points().part]
    for column, (piece, bones) in enumerate(CLOTHES.items()):
        shape = FittedShape(adult().coefficients, 0.01 * (np.arange(OFFSETS) == column))
        off = np.linalg.norm(build_body(points(), shape).rest_m - adult_body().rest_m, axis=1)
        np.testing.assert_allclose(off, np.where(np.isin(names, bones), 0.01, 0.0), atol=1e-12, err_msg=piece)
    assert even_clothes(0.01).tolist() == [0.01] * len(CLOTHES) + [0.0] * PATCHES


def test_patches_lie_all_over_the_skin_and_move_only_what_is_near_and_faces_the_same_way():
    patches = points().covered[:, len(CLOTHES) :]
    assert patches.shape == (POINT_COUNT, PATCHES)
    assert patches.min() == 0.0
    np.testing.assert_allclose(patches.max(axis=0), 1.0)  # in its middle
    middles = patches.argmax(axis=0)
    assert len(set(middles.tolist())) == PATCHES
    normals = build_body(points(), FittedShape(np.zeros(0), even_clothes(0.0))).rest_normals
    place = asset().vertices[points().vertex]
    away = np.linalg.norm(place[:, None] - place[middles], axis=2)
    assert away[patches > 0.0].max() < 3.0 * PATCH_M
    assert (normals @ normals[middles].T)[patches > 0.0].min() > 0.0
    assert away.min(axis=1).max() < 2.0 * PATCH_M  # no skin is far from all of them
    # some skin of hands and feet faces away from all middles near it
    assert (patches.max(axis=1) > 0.2).mean() > 0.9


def test_a_rigid_motion_of_the_pose_moves_points_and_turns_normals():
    motion, pose = turned_about_y(115.0, (0.3, 0.1, -2.0)), POSES[1]
    before, after = (pose_points(CLOTHED, p) for p in (pose, motion.of_pose(pose)))
    turn, shift = motion.T[:3, :3], motion.T[:3, 3]
    np.testing.assert_allclose(after.points_m, before.points_m @ turn.T + shift, atol=1e-12)
    np.testing.assert_allclose(after.normals, before.normals @ turn.T, atol=1e-12)
