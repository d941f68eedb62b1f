"""The axes of knees and elbows: known answers, laws, what is missing, and a sigma that fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, LOST, STATE_CODE, JointState
from anchorpose.results.evaluate import axis_errors
from anchorpose.results.revolute_joints import LIMBS, REVOLUTE_JOINTS, read_axes, revolute_axes, write_axes
from anchorpose.results.tables import JointTable

KNEE = REVOLUTE_JOINTS.index("KneeRight")


def sitting(frames: int = 1, bend_deg: float = 90.0, sigma_m: float = 0.01) -> JointTable:
    """Limbs bent in the sagittal plane: knees backwards, elbows forwards; X is forward, Y up, Z to the right."""
    place = np.random.default_rng(3).normal(size=(JOINT_COUNT, 3))
    for name, (above, at, below) in zip(REVOLUTE_JOINTS, LIMBS, strict=True):
        ahead = np.radians(bend_deg) * (1.0 if name.startswith("Elbow") else -1.0)
        place[above], place[at] = (0.0, 1.0, 0.2), (0.0, 0.6, 0.2)
        place[below] = place[at] + 0.35 * np.array([np.sin(ahead), -np.cos(ahead), 0.0])
    return JointTable(
        np.arange(frames, dtype=np.int32),
        np.arange(frames) / 10.0,
        np.tile(place, (frames, 1, 1)),
        np.full((frames, JOINT_COUNT), STATE_CODE[JointState.OBSERVED], np.int8),
        np.full((frames, JOINT_COUNT), sigma_m),
    )


@pytest.mark.parametrize("bend_deg", [20.0, 90.0, 150.0])
def test_knees_bend_about_an_axis_to_the_left_and_elbows_about_one_to_the_right(bend_deg: float) -> None:
    joints = sitting(bend_deg=bend_deg)
    axes = revolute_axes(joints)
    np.testing.assert_allclose(axes.axis[0, :, 2], [1.0, 1.0, -1.0, -1.0])
    np.testing.assert_allclose(axes.position_m[0, KNEE], joints.position_m[0, JOINT_INDEX["KneeRight"]])


def test_a_right_handed_turn_about_the_axis_bends_the_limb_further() -> None:
    joints = sitting(bend_deg=40.0)
    axes = revolute_axes(joints)
    above, at, below = joints.position_m[0, LIMBS[KNEE]]
    turned = Rotation.from_rotvec(0.2 * axes.axis[0, KNEE]).apply(below - at)
    assert turned @ (at - above) < (below - at) @ (at - above)


def test_axes_turn_with_the_body() -> None:
    turn, joints = Rotation.from_rotvec([0.3, -0.7, 0.4]), sitting(bend_deg=60.0)
    moved = replace(joints, position_m=turn.apply(joints.position_m[0])[None] + 0.5)
    one, other = revolute_axes(joints), revolute_axes(moved)
    np.testing.assert_allclose(turn.apply(one.axis[0]), other.axis[0], atol=1e-12)
    np.testing.assert_allclose(one.sigma_deg, other.sigma_deg)


def test_a_straight_limb_and_one_with_a_lost_joint_have_no_axis() -> None:
    assert np.isnan(revolute_axes(sitting(bend_deg=14.0)).axis).all()
    joints = sitting()
    ankle = JOINT_INDEX["AnkleRight"]
    joints.position_m[0, ankle], joints.sigma_m[0, ankle], joints.state_code[0, ankle] = np.nan, np.nan, LOST
    axes = revolute_axes(joints)
    assert np.isnan(axes.position_m[0, KNEE]).all()
    assert np.isfinite(axes.axis[0, :KNEE]).all()


@pytest.mark.parametrize("bend_deg", [20.0, 50.0, 100.0])
def test_sigma_is_that_of_axes_from_joints_with_such_errors(bend_deg: float) -> None:
    exact, rng = sitting(4000, bend_deg, sigma_m=0.006), np.random.default_rng(5)
    noisy = replace(exact, position_m=exact.position_m + rng.normal(0.0, 0.006, exact.position_m.shape))
    axes = revolute_axes(noisy)
    off = np.degrees(np.arcsin(axes.axis[:, KNEE, :2]))[np.isfinite(axes.axis[:, KNEE, 0])]
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(off.T))[-1])
    assert spread == pytest.approx(float(revolute_axes(exact).sigma_deg[0, KNEE]), rel=0.1)


def test_the_truth_of_the_same_joints_is_within_and_a_turned_one_is_as_far_off_as_it_is_turned() -> None:
    joints = sitting(20, 70.0)
    turned = Rotation.from_rotvec([0.0, np.radians(10.0), 0.0]).apply(joints.position_m.reshape(-1, 3))
    same, other = (dict(axis_errors(joints, m.reshape(joints.position_m.shape))) for m in (joints.position_m, turned))
    assert same["KneeLeft"].coverage_95 == 1.0
    assert other["KneeLeft"].mean_abs_deg == pytest.approx(10.0)
    assert other["KneeLeft"].frames == 20


def test_the_table_comes_back_and_half_an_axis_is_refused(tmp_path: Path) -> None:
    path, axes = tmp_path / "axes.parquet", revolute_axes(sitting(3))
    axes.axis[1, KNEE], axes.position_m[1, KNEE], axes.sigma_deg[1, KNEE] = np.nan, np.nan, np.nan
    write_axes(path, axes)
    back = read_axes(path)
    np.testing.assert_array_equal(back.axis, axes.axis)
    np.testing.assert_array_equal(back.sigma_deg, axes.sigma_deg)
    table = pq.read_table(path)
    halved = table.set_column(table.schema.get_field_index("axis_x"), "axis_x", [[0.5] * len(table)])
    pq.write_table(halved, path)
    with pytest.raises(InputError):
        read_axes(path)
