"""Angles from joint centres: known poses, invariance, the worst state, and sigmas that noise bears out."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, standing_joints, write_results
from scipy.spatial.transform import Rotation

from anchorpose.body.kinematics import shape_body
from anchorpose.body.segments import load_body_asset
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, LOST
from anchorpose.results.joint_angles import (
    ANGLE_GROUPS,
    ANGLE_NAMES,
    AT_ONCE,
    SOLE_SLOPE_DEG,
    angles_with_sigma,
    joint_angles,
)
from anchorpose.results.tables import JointTable, read_angles

NAMES = list(ANGLE_NAMES)
RIGHT = np.array([0.0, 0.0, 1.0])  # turning about it lifts what points forward, and what hangs swings forward


def _table(position_m: np.ndarray, sigma_m: float = 0.01, state_code: np.ndarray | None = None) -> JointTable:
    frames = len(position_m)
    state_code = np.zeros((frames, JOINT_COUNT), np.int8) if state_code is None else state_code
    sigma = np.full((frames, JOINT_COUNT), sigma_m)
    return JointTable(np.arange(frames, dtype=np.int32), np.arange(frames) / 30, position_m, state_code, sigma)


def _turn(joints: np.ndarray, about: str, moved: list[str], degrees: float, axis: np.ndarray = RIGHT) -> np.ndarray:
    turned, rows = joints.copy(), [JOINT_INDEX[name] for name in moved]
    centre = joints[JOINT_INDEX[about]]
    turned[rows] = (joints[rows] - centre) @ Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix().T + centre
    return turned


def _angle(joints: np.ndarray, name: str) -> float:
    return float(joint_angles(_table(joints[None])).degrees[0, NAMES.index(name)])


def _mirrored(joints: np.ndarray) -> np.ndarray:
    swap = [name.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for name in JOINT_INDEX]
    return (joints * [1, 1, -1])[[JOINT_INDEX[name] for name in swap]]


def test_a_person_standing_straight_reads_zero_everywhere():
    for name in NAMES:
        if name.startswith(("shoulder_plane", "shoulder_rotation", "hip_rotation")):
            # arms that hang are raised in no direction, straight limbs are bent in no plane
            assert np.isnan(_angle(standing_joints(), name))
        elif name.startswith("ankle"):  # the stick figure's foot falls by 18.4 degrees, a mean one by 19.3
            assert _angle(standing_joints(), name) == pytest.approx(FOOT_DEG)
        else:
            assert _angle(standing_joints(), name) == pytest.approx(0.0, abs=1e-9), name


@pytest.mark.parametrize("degrees", [5.0, 60.0, 120.0])
@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_limb_bent_by_an_angle_is_measured_as_that_angle(side, degrees):
    joints, end = standing_joints(), side.lower()
    shank_back = _turn(joints, f"Knee{side}", [f"Ankle{side}", f"Foot{side}"], -degrees)
    assert _angle(shank_back, f"knee_flexion_{end}") == pytest.approx(degrees)
    thigh_forward = _turn(joints, f"Hip{side}", [f"Knee{side}", f"Ankle{side}", f"Foot{side}"], degrees)
    assert _angle(thigh_forward, f"hip_flexion_{end}") == pytest.approx(degrees)
    assert _angle(thigh_forward, f"knee_flexion_{end}") == pytest.approx(0.0, abs=1e-6)
    forearm = _turn(joints, f"Elbow{side}", [f"Wrist{side}", f"Hand{side}"], degrees)
    assert _angle(forearm, f"elbow_flexion_{end}") == pytest.approx(degrees)
    for axis in (RIGHT, np.array([1.0, 0.0, 0.0])):  # forwards and sideways
        arm = _turn(joints, f"Shoulder{side}", [f"Elbow{side}", f"Wrist{side}", f"Hand{side}"], degrees, axis)
        assert _angle(arm, f"shoulder_elevation_{end}") == pytest.approx(degrees)


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("degrees", [3.0, 8.0, 20.0, 29.0])
def test_a_knee_that_bends_backwards_is_negative_and_shows_no_turn_of_the_thigh(side, degrees):
    shank_ahead = _turn(standing_joints(), f"Knee{side}", [f"Ankle{side}", f"Foot{side}"], degrees)
    assert _angle(shank_ahead, f"knee_flexion_{side.lower()}") == pytest.approx(-degrees)
    assert np.isnan(_angle(shank_ahead, f"hip_rotation_{side.lower()}"))


@pytest.mark.parametrize("true_deg", [-6.0, 0.0, 4.0, 15.0, 22.0, 45.0])
def test_the_mean_of_noisy_knees_is_the_knee(true_deg):
    bent = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -true_deg)
    noisy = bent + 0.01 * np.random.default_rng(11).normal(size=(6000, JOINT_COUNT, 3))
    found = joint_angles(_table(noisy)).degrees[:, NAMES.index("knee_flexion_left")]
    assert found.mean() == pytest.approx(true_deg, abs=0.25)


def test_of_a_thigh_along_the_line_of_the_hips_only_a_clear_bend_is_given():
    for degrees, told in ((10.0, False), (60.0, True)):
        leg = _turn(standing_joints(), "KneeRight", ["AnkleRight", "FootRight"], -degrees)
        leg = _turn(leg, "HipRight", ["KneeRight", "AnkleRight", "FootRight"], 85.0, np.array([-1.0, 0.0, 0.0]))
        assert np.isfinite(_angle(leg, "knee_flexion_right")) == told


TRUNK = ["SpineMid", "SpineShoulder", "Neck", "Head", "ShoulderLeft", "ShoulderRight"]
FORWARD, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
FOOT_DEG = 19.3 - np.degrees(np.arctan2(0.05, 0.15))  # of the stick figure


@pytest.mark.parametrize(
    ("about", "moved", "degrees", "axis", "expected"),
    [
        ("SpineBase", TRUNK, -20.0, RIGHT, {"trunk_flexion": 20.0, "hip_flexion_left": 20.0}),
        ("SpineBase", TRUNK, 12.0, FORWARD, {"trunk_side_bend": 12.0, "trunk_flexion": 0.0}),
        ("SpineMid", TRUNK[1:], 25.0, UP, {"trunk_pelvis_rotation": 25.0, "trunk_rotation": 25.0}),
        ("SpineMid", TRUNK[1:], -40.0, RIGHT, {"trunk_pelvis_flexion": 40.0}),
        ("SpineMid", TRUNK[1:], 18.0, FORWARD, {"trunk_pelvis_side_bend": 18.0}),
        ("Neck", ["Head"], -30.0, RIGHT, {"neck_flexion": 30.0}),
        ("Neck", ["Head"], 15.0, FORWARD, {"neck_side_bend": 15.0}),
        ("HipLeft", ["KneeLeft", "AnkleLeft", "FootLeft"], -15.0, RIGHT, {"hip_flexion_left": -15.0}),
        ("AnkleRight", ["FootRight"], 12.0, RIGHT, {"ankle_dorsiflexion_right": 12.0 + FOOT_DEG}),
    ],
)
def test_leaning_and_turning_read_as_the_angle_and_sign_that_is_written(about, moved, degrees, axis, expected):
    turned = _turn(standing_joints(), about, moved, degrees, axis)
    assert {name: _angle(turned, name) for name in expected} == pytest.approx(expected, abs=1e-9)


def test_the_lean_of_the_thorax_turns_with_a_trunk_that_only_rotates():
    below = ("SpineBase", "SpineMid", "Hip", "Knee", "Ankle", "Foot")
    upper = [name for name in JOINT_NAMES if not name.startswith(below)]
    standing = shape_body(load_body_asset(), np.zeros(0)).rest_joints()
    turned = _turn(standing, "SpineMid", upper, 30.0, np.array([0.0, 1.0, 0.0]))
    found = [_angle(turned, f"trunk_pelvis_{name}") for name in ("flexion", "side_bend", "rotation")]
    assert found == pytest.approx([8.8, -2.6, 29.9], abs=0.1)  # docs/angles.md and docs/export.md state this


def test_the_slope_of_a_level_sole_varies_between_adults_as_the_docs_say():
    asset, rng = load_body_asset(), np.random.default_rng(0)
    shapes = rng.normal(size=(400, len(asset.adult_sigma))) * asset.adult_sigma
    joints = np.array([shape_body(asset, shape).rest_joints() for shape in shapes])
    foot = joints[:, JOINT_INDEX["FootLeft"]] - joints[:, JOINT_INDEX["AnkleLeft"]]
    slope_deg = np.degrees(np.arctan2(-foot[:, 1], np.hypot(foot[:, 0], foot[:, 2])))
    assert slope_deg.mean() == pytest.approx(SOLE_SLOPE_DEG, abs=0.2)
    assert slope_deg.std() == pytest.approx(1.5, abs=0.1)


def test_the_pelvis_in_the_world_is_turned_raised_and_tilted_in_that_order():
    turned = Rotation.from_euler("YXZ", [35.0, -8.0, -20.0], degrees=True).as_matrix()
    joints = standing_joints()
    middle = 0.5 * (joints[JOINT_INDEX["HipLeft"]] + joints[JOINT_INDEX["HipRight"]])
    joints = (joints - middle) @ turned.T + middle
    found = [_angle(joints, f"pelvis_{name}") for name in ("rotation", "obliquity", "tilt")]
    np.testing.assert_allclose(found, [35.0, 8.0, 20.0], atol=1e-9)


@pytest.mark.parametrize(("side", "inwards"), [("Left", 1.0), ("Right", -1.0)])
def test_a_thigh_forward_and_inward_reads_as_flexion_then_adduction(side, inwards):
    joints = _turn(standing_joints(), f"Hip{side}", [f"Knee{side}"], 10.0 * inwards, np.array([-1.0, 0.0, 0.0]))
    joints = _turn(joints, f"Hip{side}", [f"Knee{side}"], 30.0)
    end = side.lower()
    assert _angle(joints, f"hip_adduction_{end}") == pytest.approx(10.0)
    assert _angle(joints, f"hip_pelvis_flexion_{end}") == pytest.approx(30.0)
    assert _angle(joints, f"hip_flexion_{end}") == pytest.approx(30.0)


def test_a_squat_of_ninety_degrees():
    """Thighs level, shanks upright, trunk upright: 90 at hips and knees, nothing at ankles, no side differs."""
    joints = standing_joints()
    down = joints[JOINT_INDEX["HipLeft"]] - joints[JOINT_INDEX["KneeLeft"]]
    above = [name for name in JOINT_INDEX if not name.startswith(("Knee", "Ankle", "Foot"))]
    joints[[JOINT_INDEX[name] for name in above]] -= down + np.array([np.linalg.norm(down), 0.0, 0.0])
    upright = standing_joints()
    for side in ("left", "right"):
        for name in ("hip_flexion", "hip_pelvis_flexion", "knee_flexion"):
            assert _angle(joints, f"{name}_{side}") == pytest.approx(90.0)
        assert _angle(joints, f"ankle_dorsiflexion_{side}") == _angle(upright, f"ankle_dorsiflexion_{side}")
    assert _angle(joints, "trunk_flexion") == pytest.approx(0.0, abs=1e-9)


def test_a_t_pose_is_raised_sideways_and_an_arm_in_front_forwards():
    for side, out in (("Left", -1.0), ("Right", 1.0)):
        arm, end = [f"Elbow{side}", f"Wrist{side}", f"Hand{side}"], side.lower()
        t_pose = _turn(standing_joints(), f"Shoulder{side}", arm, 90.0 * out, np.array([-1.0, 0.0, 0.0]))
        in_front = _turn(standing_joints(), f"Shoulder{side}", arm, 90.0)
        for pose, plane in ((t_pose, 0.0), (in_front, 90.0)):
            assert _angle(pose, f"shoulder_elevation_{end}") == pytest.approx(90.0)
            assert _angle(pose, f"shoulder_plane_{end}") == pytest.approx(plane, abs=1e-9)


@pytest.mark.parametrize(("side", "inwards"), [("Left", -1.0), ("Right", 1.0)])
def test_a_bent_limb_shows_how_it_is_turned_about_its_own_axis(side, inwards):
    up, end = np.array([0.0, 1.0, 0.0]), side.lower()
    bent = _turn(standing_joints(), f"Knee{side}", [f"Ankle{side}", f"Foot{side}"], -50.0)
    turned = _turn(bent, f"Hip{side}", [f"Knee{side}", f"Ankle{side}", f"Foot{side}"], 20.0 * inwards, up)
    raised = _turn(turned, f"Hip{side}", [f"Knee{side}", f"Ankle{side}", f"Foot{side}"], 70.0)
    for leg in (turned, raised):
        assert _angle(leg, f"hip_rotation_{end}") == pytest.approx(20.0)
    arm = _turn(standing_joints(), f"Elbow{side}", [f"Wrist{side}", f"Hand{side}"], 90.0)
    arm = _turn(arm, f"Shoulder{side}", [f"Elbow{side}", f"Wrist{side}", f"Hand{side}"], 35.0 * inwards, up)
    assert _angle(arm, f"shoulder_rotation_{end}") == pytest.approx(35.0)
    out = _turn(
        arm, f"Shoulder{side}", [f"Elbow{side}", f"Wrist{side}", f"Hand{side}"], 80.0, np.array([-inwards, 0, 0])
    )
    assert _angle(out, f"shoulder_rotation_{end}") == pytest.approx(35.0)


@pytest.mark.parametrize("bend_deg", [31.0, 60.0])
def test_the_turn_of_a_thigh_whose_knee_is_bowed_lies_within_its_range_however_sure_the_joints_are(bend_deg):
    shank = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -bend_deg)
    bowed = _turn(shank, "KneeLeft", ["AnkleLeft", "FootLeft"], 3.0, np.array([1.0, 0.0, 0.0]))
    angles, column = joint_angles(_table(bowed[None], 1e-6)), NAMES.index("hip_rotation_left")
    assert abs(angles.degrees[0, column]) > 1.0
    assert abs(angles.degrees[0, column]) <= 1.96 * angles.sigma_deg[0, column]


def test_a_limb_that_is_hardly_bent_does_not_show_how_it_is_turned():
    for degrees, known in ((25.0, False), (35.0, True)):
        leg = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -degrees)
        arm = _turn(standing_joints(), "ElbowLeft", ["WristLeft", "HandLeft"], degrees)
        assert np.isfinite(_angle(leg, "hip_rotation_left")) == known
        assert np.isfinite(_angle(arm, "shoulder_rotation_left")) == known


@pytest.mark.parametrize(
    ("bend_deg", "raised_deg"), [(31.0, 119.5), (35.0, 126.4), (90.0, 150.0), (145.0, 126.4), (149.0, 119.5)]
)
def test_how_far_a_bent_arm_may_be_raised_depends_on_its_bend_as_the_page_states(bend_deg, raised_deg):
    """The limit is sin(bend) cos(raised / 2) = sin 15 degrees."""
    arm = _turn(standing_joints(), "ElbowLeft", ["WristLeft", "HandLeft"], bend_deg)
    for degrees, known in ((raised_deg - 1.0, True), (raised_deg + 1.0, False)):
        raised = _turn(arm, "ShoulderLeft", ["ElbowLeft", "WristLeft", "HandLeft"], degrees)
        assert np.isfinite(_angle(raised, "shoulder_rotation_left")) == known


@pytest.mark.parametrize(("bend_deg", "least_deg"), [(35.0, 26.8), (90.0, 15.0), (145.0, 26.8)])
def test_how_near_a_thigh_may_come_to_the_line_of_the_hips_depends_on_the_bend_as_the_page_states(bend_deg, least_deg):
    """The limit is sin(bend) sin(angle to the line of the hips) = sin 15 degrees."""
    leg = _turn(standing_joints(), "KneeRight", ["AnkleRight", "FootRight"], -bend_deg)
    for degrees, known in ((least_deg + 1.0, True), (least_deg - 1.0, False)):
        aside = _turn(leg, "HipRight", ["KneeRight", "AnkleRight"], 90.0 - degrees, np.array([-1.0, 0.0, 0.0]))
        assert np.isfinite(_angle(aside, "hip_rotation_right")) == known


@pytest.mark.parametrize(("bend_deg", "known"), [(149.0, True), (151.0, False)])
def test_a_folded_limb_does_not_show_how_it_is_turned(bend_deg, known):
    leg = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -bend_deg)
    arm = _turn(standing_joints(), "ElbowLeft", ["WristLeft", "HandLeft"], bend_deg)
    assert np.isfinite(_angle(leg, "hip_rotation_left")) == known
    assert np.isfinite(_angle(arm, "shoulder_rotation_left")) == known


def test_near_the_axis_that_it_turns_about_an_angle_is_not_given_though_its_joints_are_seen():
    for degrees, told in ((10.0, False), (20.0, True)):
        arm = ["ElbowLeft", "WristLeft", "HandLeft"]
        angles = joint_angles(_table(_turn(standing_joints(), "ShoulderLeft", arm, degrees)[None]))
        column = angles.column("shoulder_plane_left")
        assert np.isfinite([angles.degrees[0, column], angles.sigma_deg[0, column]]).tolist() == [told, told]
        assert angles.state_code[0, column] == 0
        split = _turn(standing_joints(), "HipRight", ["KneeRight"], 90.0 - degrees, np.array([-1.0, 0.0, 0.0]))
        assert np.isfinite(_angle(split, "hip_pelvis_flexion_right")) == told
        assert np.isfinite(_angle(split, "hip_adduction_right"))


def test_the_trunk_of_who_lies_on_a_side_leans_neither_forwards_nor_sideways():
    for degrees, told in ((80.0, False), (60.0, True)):
        lying = standing_joints() @ Rotation.from_euler("x", degrees, degrees=True).as_matrix().T
        assert np.isfinite(_angle(lying, "trunk_side_bend")) == told
        assert np.isfinite(_angle(lying, "trunk_flexion")) == told


def test_where_the_patient_stands_or_faces_changes_only_the_angles_of_facing():
    joints = standing_joints() + np.random.default_rng(1).normal(size=(JOINT_COUNT, 3)) * 0.05
    moved = joints @ Rotation.from_euler("y", 1.2).as_matrix().T + [2.0, 0.1, -3.0]
    before, after = (joint_angles(_table(pose[None])).degrees[0] for pose in (joints, moved))
    after[[NAMES.index(name) for name in ("pelvis_rotation", "trunk_rotation")]] -= np.degrees(1.2)
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_a_mirrored_patient_has_left_and_right_exchanged():
    joints = standing_joints() + np.random.default_rng(2).normal(size=(JOINT_COUNT, 3)) * 0.05
    turned_over = ("side_bend", "rotation", "obliquity")  # positive to one side of the patient
    for name in NAMES:
        twin = name.replace("left", "*").replace("right", "left").replace("*", "right")
        sign = -1.0 if name.endswith(turned_over) else 1.0
        expected = sign * _angle(_mirrored(joints), twin)
        assert _angle(joints, name) == pytest.approx(expected, nan_ok=True), name


def test_an_angle_is_as_poorly_known_as_its_worst_joint_and_gone_with_a_lost_one():
    state_code = np.zeros((1, JOINT_COUNT), np.int8)
    state_code[0, JOINT_INDEX["AnkleLeft"]] = 2
    angles = joint_angles(_table(standing_joints()[None], state_code=state_code))
    assert angles.state_code[0, NAMES.index("knee_flexion_left")] == 2
    assert angles.state_code[0, NAMES.index("knee_flexion_right")] == 0
    lost = standing_joints()
    lost[JOINT_INDEX["HipLeft"]] = np.nan
    state_code[0, JOINT_INDEX["HipLeft"]] = LOST
    angles = joint_angles(_table(lost[None], state_code=state_code))
    gone = {name for name, value in zip(NAMES, angles.degrees[0], strict=True) if np.isnan(value)}
    gone -= {f"shoulder_{name}_{side}" for name in ("plane", "rotation") for side in ("left", "right")}  # undetermined
    of_the_pelvis = {name for name in NAMES if name.startswith(("pelvis", "trunk_pelvis", "hip"))}
    assert gone == {"knee_flexion_left", "knee_flexion_right", "trunk_flexion", "trunk_side_bend", *of_the_pelvis}
    assert np.isnan(angles.sigma_deg[0, [NAMES.index(name) for name in gone]]).all()
    assert (angles.state_code[0, [NAMES.index(name) for name in gone]] == LOST).all()


@pytest.mark.parametrize("degrees", [20.0, 34.0, 90.0])
def test_a_bent_knee_has_no_angle_where_the_other_hip_is_lost(degrees):
    """The formula needs that hip for a knee that is hardly bent only; the angle's error is unknown without it."""
    joints = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -degrees)
    joints[JOINT_INDEX["HipRight"]] = np.nan
    state_code = np.zeros((1, JOINT_COUNT), np.int8)
    state_code[0, JOINT_INDEX["HipRight"]] = LOST
    angles = joint_angles(_table(joints[None], state_code=state_code))
    column = angles.column("knee_flexion_left")
    assert np.isnan(angles.degrees[0, column])
    assert np.isnan(angles.sigma_deg[0, column])


def test_sigma_is_the_spread_that_noise_makes():
    bent = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -50.0)
    bent = _turn(bent, "ElbowRight", ["WristRight", "HandRight"], 70.0)
    bent = _turn(bent, "ShoulderRight", ["ElbowRight", "WristRight", "HandRight"], 60.0)
    noisy = bent + 0.005 * np.random.default_rng(3).normal(size=(6000, JOINT_COUNT, 3))
    spread = joint_angles(_table(noisy)).degrees.std(axis=0)
    sigma = joint_angles(_table(bent[None], 0.005)).sigma_deg[0]
    # unsigned bends of straight limbs are folded there, and arms that hang have no plane
    folded = {"elbow_flexion_left", "shoulder_elevation_left", "shoulder_plane_left"}
    folded |= {"shoulder_rotation_left", "hip_rotation_right"}
    # of how a limb is turned, sigma also holds that limbs are bowed, which noise of the joints does not
    own = {"hip_rotation_left": np.degrees(np.arctan(np.tan(np.radians(3.0)) / np.sin(np.radians(50.0))))}
    own["shoulder_rotation_right"] = np.degrees(np.arctan(np.tan(np.radians(5.0)) / np.sin(np.radians(70.0))))
    for name, bowed in own.items():
        sigma[NAMES.index(name)] = np.sqrt(sigma[NAMES.index(name)] ** 2 - bowed**2)
    for name in set(NAMES) - folded:
        assert sigma[NAMES.index(name)] == pytest.approx(spread[NAMES.index(name)], rel=0.1), name


def test_many_frames_give_what_each_gives_alone():
    """Frames are taken some at a time; in each, another joint is missing."""
    rng = np.random.default_rng(8)
    moving = standing_joints() + 0.05 * rng.normal(size=(2 * AT_ONCE + 3, JOINT_COUNT, 3))
    moving[np.arange(len(moving)), np.arange(len(moving)) % JOINT_COUNT] = np.nan
    together = joint_angles(_table(moving))
    for row in (0, 7, AT_ONCE - 1, AT_ONCE, len(moving) - 1):
        alone = joint_angles(_table(moving[row : row + 1]))
        np.testing.assert_allclose(together.degrees[row], alone.degrees[0], rtol=1e-12)
        np.testing.assert_allclose(together.sigma_deg[row], alone.sigma_deg[0], rtol=1e-9)


def test_each_coordinate_is_moved_by_its_own_sigma_both_ways():
    rng = np.random.default_rng(9)
    joints, sigma_m = standing_joints() + 0.1 * rng.normal(size=(JOINT_COUNT, 3)), rng.uniform(0.0, 0.05, JOINT_COUNT)
    (group,) = (one for one in ANGLE_GROUPS if one.names == ("knee_flexion_left",))
    ((angle,),), ((sigma,),) = angles_with_sigma(group, joints[..., None], sigma_m[:, None])
    squares = 0.0
    for name in group.joints:
        for axis in range(3):
            for way in (-1.0, 1.0):
                moved = joints.copy()
                moved[JOINT_INDEX[name], axis] += way * sigma_m[JOINT_INDEX[name]]
                squares += 0.5 * np.radians(_angle(moved, "knee_flexion_left") - np.degrees(angle)) ** 2
    assert sigma == pytest.approx(np.sqrt(squares))


def test_bow_legs_are_not_bent_one_turned_out_is_bent_as_far_as_it_is_and_one_without_a_shank_has_no_angle():
    collapsed = standing_joints()
    collapsed[JOINT_INDEX["AnkleLeft"]] = collapsed[JOINT_INDEX["KneeLeft"]]
    assert np.isnan(_angle(collapsed, "knee_flexion_left"))
    bowed = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], 5.0, np.array([1.0, 0.0, 0.0]))
    assert _angle(bowed, "knee_flexion_left") == pytest.approx(0.0, abs=1e-6)
    for degrees, allowed in ((10.0, 1.5), (20.0, 2.0), (40.0, 1e-6), (110.0, 1e-6)):
        leg = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -degrees)
        leg = _turn(leg, "HipLeft", ["KneeLeft", "AnkleLeft", "FootLeft"], 30.0, np.array([0.0, 1.0, 0.0]))
        assert _angle(leg, "knee_flexion_left") == pytest.approx(degrees, abs=allowed)


def test_the_table_holds_every_angle_of_every_frame_twice_the_same(tmp_path):
    frames = [make_frame(i, i / 15, standing_joints() + i, lost=("HipLeft",) if i == 1 else ()) for i in range(3)]
    paths = [write_results(tmp_path / name, frames) / "angles.parquet" for name in "ab"]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    rows = pq.read_table(paths[0]).to_pylist()
    assert [row["angle"] for row in rows] == NAMES * 3
    assert list(rows[0]) == ["frame", "time_s", "angle", "degrees", "state", "sigma_deg"]
    back, degrees = read_angles(paths[0]), [row["degrees"] for row in rows[:: len(NAMES)]]
    np.testing.assert_array_equal(back.degrees[:, 0], [np.nan if d is None else d for d in degrees])
    assert (back.names, back.state_code[1, NAMES.index("knee_flexion_left")]) == (ANGLE_NAMES, LOST)
    lost = next(row for row in rows if row["frame"] == 1 and row["angle"] == "knee_flexion_left")
    assert (lost["degrees"], lost["state"], lost["sigma_deg"]) == (None, "lost", None)
