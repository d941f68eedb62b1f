"""The patient's own shape, bone lengths and clothing, from several frames."""

import numpy as np
import pytest
from body_builder import (
    FRONT,
    asset,
    before_wall,
    dressed_in,
    evidence_of,
    hide_bones,
    joints_of,
    photograph,
    points,
    random_pose,
    seen_body,
    shaken,
    standing,
)
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import ADULT_COMPONENTS
from anchorpose.body.config import LearningConfig, RegistrationConfig
from anchorpose.body.evidence import Evidence
from anchorpose.body.joint_ranges import joint_range, joint_range_at
from anchorpose.body.learning import LearnedBody, bone_lengths, learn_body, most_different
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, shape_of_height
from anchorpose.body.skin_points import CLOTHES, FittedShape, build_body, even_clothes
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES


def with_raised_shoulders(pose: Pose) -> Pose:
    """The pose of a person whose raised arms take the shoulders up."""
    rotations, raised = pose.rotations.copy(), joint_range_at(asset(), pose).mean - joint_range(asset()).mean
    for name in ("LeftShoulder", "RightShoulder"):
        turn = Rotation.from_rotvec(raised[MOVING_BONES.index(name)]).as_matrix()
        rotations[asset().bone(name)] = turn @ rotations[asset().bone(name)]
    return Pose(rotations, pose.root_m)


POSES = [  # 23 puts a hand through the groin
    with_raised_shoulders(random_pose(seed, 0.5)) for seed in (20, 21, 22, 24, 25, 26)
]
LEFT_THIGH, RIGHT_THIGH = ((JOINT_INDEX[f"Hip{side}"], JOINT_INDEX[f"Knee{side}"]) for side in ("Left", "Right"))
LIMBS = [
    (JOINT_INDEX[start + side], JOINT_INDEX[end + side])
    for start, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
    for side in ("Left", "Right")
]
NOTHING = adult_belief(asset())  # is known but that the patient is an adult


def like_others() -> np.ndarray:
    """Coefficients of a person in whom nothing is unlike other adults of the same statistical components."""
    coefficients = np.zeros(asset().shape_count)
    coefficients[:ADULT_COMPONENTS] = np.random.default_rng(3).normal(0.0, 0.7, ADULT_COMPONENTS).clip(-1.5, 1.5)
    return coefficients


def unlike_others() -> np.ndarray:
    """The same with segments of this person's own."""
    coefficients, count = like_others(), asset().common_count
    covariance = np.linalg.inv(NOTHING.prior)[count : asset().shape_count, count : asset().shape_count]
    rng = np.random.default_rng(7)
    coefficients[count:] = 0.8 * np.linalg.cholesky(covariance) @ rng.normal(size=len(covariance))
    return coefficients


NAKED, DRESSED, OWN = (
    FittedShape(coefficients, even_clothes(thickness_m))
    for coefficients, thickness_m in ((like_others(), 0.0), (like_others(), 0.008), (unlike_others(), 0.008))
)


def pictures_of(shape: FittedShape, poses: list[Pose]) -> list[Evidence]:
    return [evidence_of((before_wall(photograph(dressed_in(pose, shape), FRONT), FRONT),), (FRONT,)) for pose in poses]


def learnt(shape: FittedShape, poses: list[Pose]) -> LearnedBody:
    """From the adult of the same height, and poses that are a few centimetres off."""
    height_m = float(np.ptp(shape.mesh(asset()).vertices[:, 1]))
    start = shape_of_height(asset(), height_m)
    rough = [shaken(pose, 40 + k, turn_deg=2.0, shift_m=0.015) for k, pose in enumerate(poses)]
    return learn_body(points(), start, rough, pictures_of(shape, poses), NOTHING, RegistrationConfig())


def limb_lengths_m(shape: FittedShape) -> np.ndarray:
    joints = shape.mesh(asset()).rest_joints()
    start, end = np.array(LIMBS).T
    return np.linalg.norm(joints[start] - joints[end], axis=1)


def from_the_pelvis_m(shape: FittedShape) -> np.ndarray:
    """(21, 3) joints at rest: own segments grow away from the pelvis, whatever is below the feet then."""
    joints = shape.mesh(asset()).rest_joints()
    return joints - joints[JOINT_INDEX["SpineBase"]]


def skin_errors_m(shape: FittedShape, truth: FittedShape) -> np.ndarray:
    """(p,) between the outer surfaces, clothes and all, along the normals at rest."""
    own, true = build_body(points(), shape), build_body(points(), truth)
    shift = own.mesh.bone_heads[0] - true.mesh.bone_heads[0]
    return ((own.rest_m - shift - true.rest_m) * true.rest_normals).sum(axis=1)


@pytest.fixture(scope="module")
def naked() -> LearnedBody:
    return learnt(NAKED, POSES)


@pytest.fixture(scope="module")
def dressed() -> LearnedBody:
    return learnt(DRESSED, POSES)


@pytest.fixture(scope="module")
def unlike() -> LearnedBody:
    return learnt(OWN, POSES)


@pytest.mark.thorough
def test_limbs_get_their_length_from_six_poses(naked):
    # noise-free depth: what remains is the prior, which keeps 1 % of a length that one camera sees only from the front
    np.testing.assert_allclose(limb_lengths_m(naked.belief.shape), limb_lengths_m(NAKED), rtol=0.012)


@pytest.mark.thorough
def test_limbs_unlike_those_of_others_get_their_length_too(unlike):
    height_m = float(np.ptp(OWN.mesh(asset()).vertices[:, 1]))
    before, after = (
        np.abs(limb_lengths_m(shape) / limb_lengths_m(OWN) - 1.0)
        for shape in (shape_of_height(asset(), height_m), unlike.belief.shape)
    )
    assert before.max() > 0.05
    assert after.max() < 0.016
    assert after.mean() < 0.25 * before.mean()


@pytest.mark.thorough
def test_a_thigh_longer_than_the_other_is_learnt_as_such():
    left, right = (asset().common_count + asset().own_names.index(f"thigh_length_{side}") for side in ("left", "right"))
    uneven = like_others()
    uneven[left], uneven[right] = 0.8, -0.8
    shape = FittedShape(uneven, even_clothes(0.0))
    found, truth = (
        lengths[LIMBS.index(LEFT_THIGH)] / lengths[LIMBS.index(RIGHT_THIGH)]
        for lengths in (limb_lengths_m(learnt(shape, POSES).belief.shape), limb_lengths_m(shape))
    )
    assert truth > 1.05
    # the prior holds that sides are alike, and patches of skin that lie off the body explain a part of the difference:
    # six pictures of one camera show 30 % of it
    assert found - 1.0 > (truth - 1.0) / 4.0


def test_trunk_and_neck_are_learnt_too(naked):
    height_m = float(np.ptp(NAKED.mesh(asset()).vertices[:, 1]))
    before, after = (
        np.abs(from_the_pelvis_m(shape) - from_the_pelvis_m(NAKED)).max()
        for shape in (shape_of_height(asset(), height_m), naked.belief.shape)
    )
    assert before > 0.015
    assert after < 0.6 * before


@pytest.mark.thorough
def test_joints_of_the_learnt_poses_are_those_of_the_body_that_was_seen(naked, unlike):
    for learned, shape in ((naked, NAKED), (unlike, OWN)):
        true_rest, own_rest = build_body(points(), shape), build_body(points(), learned.belief.shape)
        for pose, truth in zip(learned.poses, POSES, strict=True):
            errors = np.linalg.norm(joints_of(own_rest, pose) - joints_of(true_rest, truth), axis=1)
            assert errors.mean() < 0.006
            assert errors.max() < 0.02, JOINT_NAMES[errors.argmax()]


@pytest.mark.thorough
def test_the_outer_surface_is_learnt_to_millimetres(naked, dressed, unlike):
    for learned, shape in ((naked, NAKED), (dressed, DRESSED), (unlike, OWN)):
        assert np.abs(skin_errors_m(learned.belief.shape, shape)).mean() < 0.003
        assert abs(np.median(skin_errors_m(learned.belief.shape, shape))) < 0.0025


def test_clothes_are_distinguished_from_flesh(naked, dressed):
    """Of each piece half: a thicker sleeve looks like a thicker arm, now that each arm has a girth of its own."""
    worn, bare = (learned.belief.shape.offset_m[: len(CLOTHES)] for learned in (dressed, naked))
    assert worn.min() > 0.005
    assert (worn - bare).min() > 0.0025
    assert bare.max() < 0.0045
    np.testing.assert_allclose(limb_lengths_m(dressed.belief.shape), limb_lengths_m(NAKED), rtol=0.02)


@pytest.mark.thorough
def test_the_learnt_shape_is_an_adults(naked, dressed, unlike):
    for body in (naked, dressed, unlike):
        assert np.isfinite(body.belief.shape.coefficients).all()
        assert NOTHING.deviations(body.belief.shape).max() < 3.0


@pytest.mark.thorough
def test_the_same_frames_give_the_same_bits():
    first, again = (learnt(NAKED, POSES[:2]) for _ in range(2))
    np.testing.assert_array_equal(first.belief.shape.coefficients, again.belief.shape.coefficients)
    np.testing.assert_array_equal(first.belief.shape.offset_m, again.belief.shape.offset_m)


@pytest.mark.thorough
def test_the_order_of_the_frames_does_not_matter():
    evidence, start = pictures_of(NAKED, POSES[:3]), shape_of_height(asset(), 1.75)
    one = learn_body(points(), start, POSES[:3], evidence, NOTHING, RegistrationConfig())
    other = learn_body(points(), start, POSES[2::-1], evidence[::-1], NOTHING, RegistrationConfig())
    np.testing.assert_allclose(one.belief.shape.coefficients, other.belief.shape.coefficients, atol=1e-5)


def test_a_body_without_frames_is_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        learn_body(points(), NAKED, [], [], NOTHING, RegistrationConfig())


@pytest.mark.parametrize("wrong", [{"window_s": 0.0}, {"frame_count": 0}, {"longest_s": -1.0}, {"height_sigma_m": 0.0}])
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LearningConfig(**wrong)


LEGS = [number for number, (start, _) in enumerate(LIMBS) if JOINT_NAMES[start].startswith(("Hip", "Knee"))]
WITHOUT_LEGS = hide_bones(
    "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase"
)


def windows_of(coefficients: np.ndarray) -> tuple[ShapeBelief, ShapeBelief]:
    """After frames that hide the legs, and after some more that show them."""
    body = build_body(points(), FittedShape(coefficients, even_clothes(0.0)))
    known, shape, after = NOTHING, shape_of_height(asset(), 1.70), []
    for poses, change in ((POSES[:3], WITHOUT_LEGS), (POSES[3:], None)):
        evidence = [seen_body(pose, body, change=change) if change else seen_body(pose, body) for pose in poses]
        rough = [shaken(pose, 60 + k, turn_deg=2.0, shift_m=0.015) for k, pose in enumerate(poses)]
        known = learn_body(points(), shape, rough, evidence, known, RegistrationConfig()).belief
        shape = known.shape
        after.append(known)
    return after[0], after[1]


@pytest.fixture(scope="module")
def windows() -> tuple[ShapeBelief, ShapeBelief]:
    """Of a person whose thighs are unlike those of others: hidden, they cannot be guessed from the rest."""
    return windows_of(unlike_others())


def leg_errors_m(belief: ShapeBelief, shape: FittedShape) -> np.ndarray:
    return np.abs(limb_lengths_m(belief.shape) - limb_lengths_m(shape))[LEGS]


@pytest.mark.thorough
def test_what_was_hidden_is_uncertain_and_settles_when_it_is_seen(windows):
    before, after = (leg_errors_m(belief, OWN) for belief in windows)
    sigma = [np.array([bone.sigma_m for bone in bone_lengths(asset(), belief)])[LEGS] for belief in windows]
    assert (sigma[0] > 1.3 * sigma[1]).all()
    assert (before < 3.0 * sigma[0]).all()  # it was known how little was known
    assert (after < 2.0 * sigma[1]).all()
    assert before.max() > 0.02
    assert after.max() < min(0.012, 0.5 * before.max())


@pytest.mark.thorough
def test_legs_like_those_of_others_are_a_centimetre_off_at_most_however_late_they_are_seen():
    assert leg_errors_m(windows_of(like_others())[1], NAKED).max() < 0.010


@pytest.mark.thorough
def test_more_frames_never_make_the_shape_less_certain(windows):
    first, second = windows
    # of what was seen; the prior alone may weigh less where the shape turns out to be unusual
    assert np.linalg.eigvalsh(second.seen - first.seen).min() > -1e-6
    gained = [np.linalg.eigvalsh(belief.seen).min() for belief in windows]
    assert min(gained) > -1e-6


@pytest.mark.thorough
def test_frames_hardly_change_what_is_well_known():
    """Frames of a person a hand taller hardly change a shape of which much was seen before."""
    stranger = like_others()
    stranger[0] += 0.5
    body = build_body(points(), FittedShape(stranger, even_clothes(0.0)))
    much = 1e6 * NOTHING.prior
    known = NOTHING.having_seen(NAKED, much, much @ NOTHING.vector(NAKED))
    evidence = [seen_body(pose, body) for pose in POSES[:2]]
    learned = learn_body(points(), NAKED, POSES[:2], evidence, known, RegistrationConfig())
    np.testing.assert_allclose(limb_lengths_m(learned.belief.shape), limb_lengths_m(NAKED), atol=0.003)
    # and of which nothing was seen, they change
    free = learn_body(points(), NAKED, POSES[:2], evidence, NOTHING, RegistrationConfig())
    assert np.abs(limb_lengths_m(free.belief.shape) - limb_lengths_m(NAKED)).max() > 0.006


def bent(degrees: float) -> Pose:
    return standing(LeftLeg=(0.0, 0.0, -degrees), RightForeArm=(0.0, degrees / 2.0, 0.0))


def test_the_most_different_poses_are_the_extremes_and_then_those_between():
    poses = [bent(degrees) for degrees in (25.0, 31.0, 90.0, 32.0, 0.0, 46.0, 60.0)]
    assert most_different(points(), poses, 2) == [2, 4]
    assert most_different(points(), poses, 3) == [2, 4, 5]
    assert most_different(points(), poses, 4) == [0, 2, 4, 5]


def test_each_next_pose_is_as_far_as_possible_from_those_before():
    """The oracle is the definition, over poses in any order."""
    poses = [random_pose(seed) for seed in range(30, 50)]
    limbs = [f"{side}{part}" for side in ("Left", "Right") for part in ("Arm", "ForeArm", "UpLeg", "Leg")]
    rows = [[*MOVING_BONES].index(bone) for bone in limbs]
    turns = [pose.rotation_vectors(points().moving)[rows].ravel() for pose in poses]
    for count in (1, 4, 9):
        chosen = most_different(points(), poses, count)
        assert len(set(chosen)) == count
        assert chosen == sorted(chosen)
    farthest, more = (most_different(points(), poses, count) for count in (9, 10))
    (added,) = set(more) - set(farthest)
    away = [min(np.linalg.norm(turn - turns[k]) for k in farthest) for turn in turns]
    assert int(np.argmax(away)) == added


def test_turning_round_head_and_trunk_make_no_pose_different():
    still = [bent(20.0), bent(25.0), bent(20.0)]
    turned = standing(Hips=(0.0, 170.0, 0.0), Head=(30.0, 20.0, 0.0), Spine=(10.0, 10.0, 0.0))
    turned.rotations[asset().bone("LeftLeg")] = still[0].rotations[asset().bone("LeftLeg")]
    turned.rotations[asset().bone("RightForeArm")] = still[0].rotations[asset().bone("RightForeArm")]
    assert 1 in most_different(points(), [*still, turned], 2)


@pytest.mark.parametrize("count", [3, 4, 100])
def test_of_fewer_poses_than_asked_for_all_are_taken(count):
    assert most_different(points(), [bent(10.0), bent(80.0), bent(40.0)], count) == [0, 1, 2]


def test_poses_that_are_all_the_same_are_each_taken_once():
    assert most_different(points(), [bent(10.0)] * 4, 4) == [0, 1, 2, 3]
