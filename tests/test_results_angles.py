"""Angles from joint centres: known poses, invariance, the worst state, and sigmas that noise bears out."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, standing_joints, write_results
from scipy.spatial.transform import Rotation

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.angles import ANGLES, joint_angles
from anchorpose.results.joint_frame import LOST
from anchorpose.results.tables import JointTable

NAMES = [definition.name for definition in ANGLES]
RIGHT = np.array([0.0, 0.0, 1.0])  # turning about it lifts what points forward, and what hangs swings forward


def _table(position_m: np.ndarray, sigma_m: float = 0.01, severity: np.ndarray | None = None) -> JointTable:
    frames = len(position_m)
    severity = np.zeros((frames, JOINT_COUNT), np.int8) if severity is None else severity
    sigma = np.full((frames, JOINT_COUNT), sigma_m)
    return JointTable(np.arange(frames, dtype=np.int32), np.arange(frames) / 30, position_m, severity, sigma)


def _turn(joints: np.ndarray, about: str, moved: list[str], degrees: float, axis: np.ndarray = RIGHT) -> np.ndarray:
    turned, rows = joints.copy(), [JOINT_INDEX[name] for name in moved]
    centre = joints[JOINT_INDEX[about]]
    turned[rows] = (joints[rows] - centre) @ Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix().T + centre
    return turned


def _angle(joints: np.ndarray, name: str) -> float:
    return float(joint_angles(_table(joints[None])).degrees[0, NAMES.index(name)])


def test_a_person_standing_straight_has_no_flexion_anywhere():
    angles = joint_angles(_table(standing_joints()[None])).degrees[0]
    shoulders = [NAMES.index(f"shoulder_elevation_{side}") for side in ("left", "right")]
    np.testing.assert_allclose(angles, 0.0, atol=1e-9)
    assert angles[shoulders] == pytest.approx([0.0, 0.0])


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


def test_a_thigh_that_points_back_is_extended():
    back = _turn(standing_joints(), "HipLeft", ["KneeLeft", "AnkleLeft", "FootLeft"], -15.0)
    assert _angle(back, "hip_flexion_left") == pytest.approx(-15.0)


def test_leaning_forward_is_trunk_flexion_and_hip_flexion_of_both_sides():
    trunk = ["SpineMid", "SpineShoulder", "Neck", "Head", "ShoulderLeft", "ShoulderRight"]
    lean = _turn(standing_joints(), "SpineBase", trunk, -20.0)
    assert _angle(lean, "trunk_flexion") == pytest.approx(20.0)
    assert _angle(lean, "hip_flexion_left") == pytest.approx(20.0)


def test_angles_do_not_depend_on_where_the_patient_stands_or_faces():
    joints = standing_joints() + np.random.default_rng(1).normal(size=(JOINT_COUNT, 3)) * 0.05
    moved = joints @ Rotation.from_euler("y", 1.2).as_matrix().T + [2.0, 0.1, -3.0]
    before, after = (joint_angles(_table(pose[None])).degrees for pose in (joints, moved))
    np.testing.assert_allclose(before, after, atol=1e-9)


def test_a_mirrored_patient_has_left_and_right_exchanged():
    joints = standing_joints() + np.random.default_rng(2).normal(size=(JOINT_COUNT, 3)) * 0.05
    mirrored = joints * [1, 1, -1]
    swap = [name.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for name in JOINT_INDEX]
    mirrored = mirrored[[JOINT_INDEX[name] for name in swap]]
    for name in NAMES:
        twin = name.replace("left", "*").replace("right", "left").replace("*", "right")
        assert _angle(joints, name) == pytest.approx(_angle(mirrored, twin))


def test_an_angle_is_as_poorly_known_as_its_worst_joint_and_gone_with_a_lost_one():
    severity = np.zeros((1, JOINT_COUNT), np.int8)
    severity[0, JOINT_INDEX["AnkleLeft"]] = 2
    angles = joint_angles(_table(standing_joints()[None], severity=severity))
    assert angles.severity[0, NAMES.index("knee_flexion_left")] == 2
    assert angles.severity[0, NAMES.index("knee_flexion_right")] == 0
    lost = standing_joints()
    lost[JOINT_INDEX["HipLeft"]] = np.nan
    severity[0, JOINT_INDEX["HipLeft"]] = LOST
    angles = joint_angles(_table(lost[None], severity=severity))
    gone = {name for name, value in zip(NAMES, angles.degrees[0], strict=True) if np.isnan(value)}
    assert gone == {"knee_flexion_left", "hip_flexion_left", "hip_flexion_right", "trunk_flexion"}
    assert {name for name, s in zip(NAMES, angles.sigma_deg[0], strict=True) if np.isnan(s)} == gone
    assert (angles.severity[0, [NAMES.index(name) for name in gone]] == LOST).all()


def test_sigma_is_the_spread_that_noise_makes():
    bent = _turn(standing_joints(), "KneeLeft", ["AnkleLeft", "FootLeft"], -50.0)
    bent = _turn(bent, "ElbowRight", ["WristRight", "HandRight"], 70.0)
    noisy = bent + 0.01 * np.random.default_rng(3).normal(size=(20000, JOINT_COUNT, 3))
    spread = joint_angles(_table(noisy[:, :])).degrees.std(axis=0)
    sigma = joint_angles(_table(bent[None])).sigma_deg[0]
    for name in ("knee_flexion_left", "elbow_flexion_right", "trunk_flexion", "hip_flexion_left", "hip_flexion_right"):
        assert sigma[NAMES.index(name)] == pytest.approx(spread[NAMES.index(name)], rel=0.1), name


def test_a_straight_knee_is_not_certain():
    sigma = joint_angles(_table(standing_joints()[None])).sigma_deg[0, NAMES.index("knee_flexion_left")]
    assert sigma > np.degrees(0.01 / 0.42)  # a joint off by its sigma bends the knee by that over the shank


def test_joints_in_one_place_have_no_angle():
    collapsed = standing_joints()
    collapsed[JOINT_INDEX["AnkleLeft"]] = collapsed[JOINT_INDEX["KneeLeft"]]
    assert np.isnan(_angle(collapsed, "knee_flexion_left"))


def test_the_table_holds_every_angle_of_every_frame_twice_the_same(tmp_path):
    frames = [make_frame(i, i / 15, standing_joints() + i, lost=("HipLeft",) if i == 1 else ()) for i in range(3)]
    paths = [write_results(tmp_path / name, frames) / "angles.parquet" for name in "ab"]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    rows = pq.read_table(paths[0]).to_pylist()
    assert [row["angle"] for row in rows] == NAMES * 3
    assert list(rows[0]) == ["frame", "time_s", "angle", "degrees", "state", "sigma_deg"]
    lost = next(row for row in rows if row["frame"] == 1 and row["angle"] == "knee_flexion_left")
    assert (lost["degrees"], lost["state"], lost["sigma_deg"]) == (None, "lost", None)
