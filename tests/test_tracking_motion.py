"""Scaled motion dynamics: known movements, invariance to place and heading, honest fallbacks, real skeletons."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.tracking.joint_motion import heading_rad, joint_database, joints_after, pose_vectors, predict_joints
from anchorpose.tracking.motion import MotionConfig, PredictionSource, best_match, build_database, predict

UIPRMD = Path(__file__).parents[2] / "shared" / "data" / "uiprmd_kinect" / "skeletons.npz"
REST = np.random.default_rng(4).normal(0, 0.4, (21, 3))
REST[JOINT_INDEX["HipLeft"]], REST[JOINT_INDEX["HipRight"]] = (0, 0.9, -0.12), (0, 0.9, 0.12)
REST[JOINT_INDEX["ShoulderLeft"]], REST[JOINT_INDEX["ShoulderRight"]] = (0, 1.4, -0.2), (0, 1.4, 0.2)


def swing(frames: int, period: float = 40.0, size_m: float = 0.3) -> np.ndarray:
    """(frames, 21, 3): one hand goes up and down as a sine, the body moves sideways."""
    joints = np.repeat(REST[None], frames, axis=0)
    phase = 2 * np.pi * np.arange(frames) / period
    joints[:, JOINT_INDEX["HandLeft"], 1] += size_m * np.sin(phase)
    return joints + 0.02 * np.sin(phase)[:, None, None] * np.array([0, 0, 1.0])


def turned(joints_m: np.ndarray, angle_rad: float, shift_m: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return joints_m @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T + shift_m


def test_a_movement_of_the_database_is_continued_exactly():
    clip = swing(120)
    database = joint_database([clip], 30, 30, MotionConfig(speeds=(1.0,)))
    ahead = predict_joints(clip[40:50], 5, database, MotionConfig(speeds=(1.0,)))
    assert ahead.source == PredictionSource.DATABASE
    assert ahead.joints_m == pytest.approx(clip[50:55], abs=1e-5)


def test_the_same_movement_at_double_speed_finds_the_scaled_copy():
    config = MotionConfig(speeds=(0.5, 1.0, 2.0))
    fast = swing(60, period=20)
    database = joint_database([swing(200)], 30, 30, config)
    match = best_match(pose_vectors(fast[20:25]), database, 3, config.displacement_weight)
    assert match is not None
    assert match.speed == 2.0
    assert predict_joints(fast[20:25], 3, database, config).joints_m == pytest.approx(fast[25:28], abs=2e-3)


def test_a_database_at_another_rate_is_resampled():
    config = MotionConfig(speeds=(1.0,))
    at_15_hz = swing(100)[::2]
    database = joint_database([swing(200)], 30, 15, config)
    assert predict_joints(at_15_hz[10:16], 2, database, config).joints_m == pytest.approx(at_15_hz[16:18], abs=1e-4)


@pytest.mark.parametrize("angle", [0.7, -2.9, 3.1])
def test_a_prediction_turns_and_moves_with_the_patient(angle):
    config, clip, shift = MotionConfig(speeds=(1.0,)), swing(120), np.array([3.0, 0.2, -1.0])
    database = joint_database([clip], 30, 30, config)
    here = predict_joints(clip[40:50], 4, database, config).joints_m
    there = predict_joints(turned(clip[40:50], angle, shift), 4, database, config).joints_m
    assert there == pytest.approx(turned(here, angle, shift), abs=1e-5)


def test_pose_vectors_and_joints_are_a_round_trip():
    joints = turned(swing(30), 1.1, np.zeros(3)) + np.linspace(0, 0.5, 30)[:, None, None]
    vectors = pose_vectors(joints)
    assert joints_after(joints[9], vectors[9], vectors[10:]) == pytest.approx(joints[10:], abs=1e-9)


def test_heading_is_zero_towards_x_and_survives_missing_hips():
    joints = swing(2)
    joints[:, [JOINT_INDEX["HipLeft"]]] = np.nan
    assert heading_rad(joints) == pytest.approx(0.0)
    assert heading_rad(turned(joints, 0.5, np.zeros(3))) == pytest.approx(0.5)


def test_an_unknown_movement_falls_back_to_damped_velocity_and_says_so():
    config = MotionConfig()
    database = joint_database([swing(120)], 30, 30, config)
    leap = np.repeat(REST[None], 8, axis=0)
    leap[:, JOINT_INDEX["FootLeft"], 0] += 0.1 * np.arange(8) + 2.0
    ahead = predict_joints(leap, 2, database, config)
    assert ahead.source == PredictionSource.CONSTANT_VELOCITY
    step = ahead.joints_m[0] - leap[-1]
    assert step[JOINT_INDEX["FootLeft"], 0] == pytest.approx(0.1 * config.damping)


def test_one_frame_stands_still_and_says_so():
    ahead = predict_joints(swing(1), 3, None, MotionConfig())
    assert ahead.source == PredictionSource.STANDSTILL
    assert ahead.joints_m == pytest.approx(np.repeat(swing(1), 3, axis=0))


def test_a_missing_joint_stays_missing_and_the_others_are_predicted():
    config, clip = MotionConfig(speeds=(1.0,)), swing(120)
    database = joint_database([clip], 30, 30, config)
    history = clip[40:50].copy()
    history[-2:, JOINT_INDEX["Head"]] = np.nan
    ahead = predict_joints(history, 2, database, config)
    assert ahead.source == PredictionSource.DATABASE
    assert np.isnan(ahead.joints_m[:, JOINT_INDEX["Head"]]).all()
    others = np.arange(21) != JOINT_INDEX["Head"]
    assert ahead.joints_m[:, others] == pytest.approx(clip[50:52, others], abs=1e-5)


def test_the_search_is_that_of_brute_force():
    rng = np.random.default_rng(9)
    config = MotionConfig(history=4, speeds=(1.0,))
    clips = [np.cumsum(rng.normal(0, 0.1, (n, 6)), axis=0) for n in (30, 9, 50)]
    database = build_database(clips, 30, 30, 6, config)
    across_two_clips = database.theta[database.start[1] - 1 : database.start[1] + 3]
    walks = [np.cumsum(rng.normal(0, 0.1, (4, 6)), axis=0) for _ in range(3)]
    for steps, history in product((1, 3), [*walks, across_two_clips]):
        costs = {}
        for start, end in zip(database.start[:-1], database.start[1:], strict=True):
            for row in range(start + 3, end - steps):
                apart = database.theta[row - 3 : row + 1] - history
                moved = np.linalg.norm(apart[-1] - apart[0])
                costs[row] = np.linalg.norm(apart, axis=1).sum() + config.displacement_weight * 4 * moved
        match = best_match(history, database, steps, config.displacement_weight)
        assert match is not None
        assert match.row == min(costs, key=costs.__getitem__)


def test_a_match_is_followed_by_enough_frames_of_its_own_clip():
    config, rng = MotionConfig(history=4, speeds=(1.0,), worst_match_m=9.0), np.random.default_rng(3)
    clips = [np.cumsum(rng.normal(0, 0.1, (20, 6)), axis=0) for _ in range(3)]
    database = build_database(clips, 30, 30, 6, config)
    for clip in range(3):
        for cut in range(5):
            history = clips[clip][16 - cut : 20 - cut]
            match = best_match(history, database, 3, config.displacement_weight)
            end = database.start[np.searchsorted(database.start, match.row, side="right")]
            assert match.row + 3 < end
            assert predict(history, 3, database, config).theta.shape == (3, 6)
            if cut >= 3:
                assert match.distance_m == pytest.approx(0.0, abs=1e-6)


def test_input_that_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least one pose"):
        predict(np.empty((0, 6)), 1, None, MotionConfig())
    with pytest.raises(ValueError, match="no clip"):
        build_database([np.zeros((3, 6))], 30, 30, 6, MotionConfig())
    with pytest.raises(ValueError, match="missing values"):
        build_database([np.full((30, 6), np.nan)], 30, 30, 6, MotionConfig())
    with pytest.raises(ValueError, match="history"):
        MotionConfig(history=1)


def test_on_real_skeletons_an_earlier_repetition_beats_constant_velocity_ten_frames_ahead():
    """0.33 s ahead, seven rehabilitation movements: 40 to 50 mm instead of 75 (noise of the tracker included)."""
    if not UIPRMD.exists():
        pytest.skip(f"{UIPRMD} is absent: the UI-PRMD skeletons are not part of this project")
    stored = np.load(UIPRMD)
    columns = [list(stored["joint_names"]).index(name) for name in _UIPRMD_JOINTS]
    joints = stored["joints_mm"][:, columns].astype(np.float64) / 1000

    def clip(name: str) -> np.ndarray:
        k = list(stored["names"]).index(name)
        return joints[stored["offsets"][k] : stored["offsets"][k + 1]]

    config, known, unknown = MotionConfig(), [], []
    database = joint_database([clip(f"c_m{m:02d}_s02_e02") for m in range(1, 8)], 30, 30, config)
    for movement in range(1, 8):
        test = clip(f"c_m{movement:02d}_s02_e06")
        for k in range(8, len(test) - 10, 5):
            for errors, motions in ((known, database), (unknown, None)):
                ahead = predict_joints(test[:k], 10, motions, config).joints_m[-1]
                errors.append(np.linalg.norm(ahead - test[k + 9], axis=1).mean())
    assert np.mean(known) < 0.85 * np.mean(unknown)


_SIDES = {"Left": "L", "Right": "R"}
_LIMB_PARTS = {
    "Shoulder": "UpperArm", "Elbow": "Forearm", "Wrist": "Hand", "Hand": "Hand",
    "Hip": "UpperLeg", "Knee": "LowerLeg", "Ankle": "Foot", "Foot": "Toes",
}  # fmt: skip
_TRUNK = {"SpineBase": "Waist", "SpineMid": "Spine", "SpineShoulder": "Chest", "Neck": "Neck", "Head": "Head"}
_UIPRMD_JOINTS = [
    _TRUNK.get(name) or next(
        _SIDES[side] + part
        for side in _SIDES
        for stem, part in _LIMB_PARTS.items()
        if name == stem + side
    )
    for name in JOINT_NAMES
]  # fmt: skip
