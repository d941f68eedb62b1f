"""Centre of mass, upright or not, standing up and sitting down: known answers and an independent body."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from session_builder import RATE, measured, squatting_joints, table, value, why

from anchorpose.body.asset import ADULT_COMPONENTS, joint_bones
from anchorpose.body.segments import load_body_asset
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import frame_seconds, recorded_seconds, unbroken_runs
from anchorpose.results.records import SIT_TO_STAND, STAND_TO_SIT, UPRIGHT_EPISODE
from anchorpose.results.stand_training.centre_of_mass import (
    PAIRED_SEGMENTS,
    SHARED_ERROR,
    SINGLE_SEGMENTS,
    centre_of_mass,
    joint_weights,
)
from anchorpose.results.stand_training.stance import UprightConfig, hold
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT


def still(thigh_deg: float, seconds: float) -> np.ndarray:
    return np.full(round(seconds * RATE), thigh_deg)


def move(start_deg: float, end_deg: float, seconds: float) -> np.ndarray:
    """Without a jerk at either end."""
    u = np.arange(round(seconds * RATE)) / (seconds * RATE)
    return start_deg + (end_deg - start_deg) * (10 * u**3 - 15 * u**4 + 6 * u**5)


def test_the_masses_of_all_segments_are_the_body():
    whole = sum(s.mass for s in SINGLE_SEGMENTS) + 2.0 * sum(s.mass for s in PAIRED_SEGMENTS)
    assert (whole, joint_weights().sum()) == (pytest.approx(1.0, abs=2e-3), pytest.approx(1.0))
    for name, row in JOINT_INDEX.items():
        assert joint_weights()[row] == pytest.approx(joint_weights()[JOINT_INDEX[name.replace("Left", "Right")]])


@pytest.mark.parametrize("seed", range(4))
def test_the_centre_of_mass_is_near_that_of_a_bodys_volume(seed):
    """A body of even density, summed over its skin: another way to the same point, which knows no table.

    Table and volume differ by where real bodies are light (lungs) and heavy (legs); on these bodies by about a
    centimetre. Of adults like those of the asset: that a longer trunk is heavier, the table does not know.
    """
    asset = load_body_asset()
    coefficients = np.zeros(asset.shape_count)
    coefficients[:ADULT_COMPONENTS] = np.random.default_rng(seed).normal(size=ADULT_COMPONENTS)
    vertices = asset.vertices + np.tensordot(coefficients, asset.vertex_basis, 1)
    a, b, c = (vertices[asset.faces[:, corner]] for corner in range(3))
    volume = np.einsum("fk,fk->f", a, np.cross(b, c)) / 6.0
    of_volume = (volume[:, None] * (a + b + c) / 4.0).sum(axis=0) / volume.sum()
    heads = asset.bone_heads + np.tensordot(coefficients, asset.bone_head_basis, 1)
    tails = asset.bone_tails + np.tensordot(coefficients, asset.bone_tail_basis, 1)
    joints = heads[joint_bones(asset)].copy()
    head = joint_bones(asset)[JOINT_INDEX["Head"]]
    joints[JOINT_INDEX["Head"]] = 0.5 * (heads[head] + tails[head])
    found = centre_of_mass(table(joints[None])).position_m[0]
    np.testing.assert_allclose(found, of_volume, atol=0.03)
    assert abs(found[2] - of_volume[2]) < 0.005


def test_the_centre_of_mass_moves_with_the_body_and_lies_in_its_middle():
    joints = squatting_joints(np.zeros(1))
    (found,) = centre_of_mass(table(joints)).position_m
    assert found[2] == pytest.approx(0.0, abs=1e-12)
    assert 0.9 < found[1] < 1.05
    (moved,) = centre_of_mass(table(joints + np.array([0.3, 0.1, -2.0]))).position_m
    np.testing.assert_allclose(moved, found + np.array([0.3, 0.1, -2.0]))


def test_sigma_of_the_centre_of_mass_is_that_of_partly_shared_errors():
    rng, sigma = np.random.default_rng(4), 0.01
    shared = np.sqrt(SHARED_ERROR) * rng.normal(size=(4000, 1, 3))
    own = np.sqrt(1.0 - SHARED_ERROR) * rng.normal(size=(4000, JOINT_COUNT, 3))
    noisy = squatting_joints(np.zeros(1)) + sigma * (shared + own)
    found = centre_of_mass(table(noisy, sigma))
    assert found.sigma_m[0] == pytest.approx(found.position_m.std(axis=0).mean(), rel=0.05)


def test_a_lost_hand_costs_nothing_and_a_lost_knee_the_centre_of_mass():
    joints = squatting_joints(np.zeros(2))
    hand, knee = (centre_of_mass(table(joints, lost={name: slice(1, 2)})) for name in ("HandLeft", "KneeLeft"))
    assert np.isfinite(hand.position_m).all()
    assert np.isfinite(hand.sigma_m).all()
    assert np.isnan(knee.position_m[1]).all()
    assert np.isnan(knee.sigma_m[1])


def test_it_holds_between_the_limits_and_is_forgotten_when_a_joint_was_lost():
    begins = np.array([0, 0, 1, 0, 0, 0, 0, 0, 1], dtype=bool)
    ends = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0], dtype=bool)
    known = np.array([1, 1, 1, 1, 1, 1, 0, 1, 1], dtype=bool)
    expected = [UNKNOWN, UNKNOWN, UPRIGHT, UPRIGHT, NOT_UPRIGHT, NOT_UPRIGHT, UNKNOWN, UNKNOWN, UPRIGHT]
    assert hold(begins, ends, known).tolist() == expected


@pytest.mark.parametrize(
    ("thigh_deg", "shank_deg", "upright"),
    [(0.0, 0.0, 1), (25.0, 15.0, 1), (85.0, 0.0, 0), (60.0, 20.0, 0), (0.0, -90.0, 0)],  # the last kneels
)
def test_standing_is_distinguished_from_sitting_squatting_and_kneeling(thigh_deg, shank_deg, upright):
    # the leg's length is that of the recording's median frame: bones do not change
    session, _ = measured(table(squatting_joints(np.full(3, thigh_deg), shank_deg)))
    assert session.posture.upright.tolist() == [upright] * 3


def test_a_patient_who_hangs_over_a_rail_is_not_upright():
    joints = squatting_joints(np.zeros(3))
    base, top = JOINT_INDEX["SpineBase"], JOINT_INDEX["SpineShoulder"]
    long = joints[0, top, 1] - joints[0, base, 1]
    joints[:, top] = joints[:, base] + long * np.array([np.sin(1.1), np.cos(1.1), 0.0])
    session, _ = measured(table(joints))
    assert session.posture.upright.tolist() == [0, 0, 0]


def test_time_upright_its_share_and_its_longest_bout():
    thighs = np.concatenate([still(0, 4.0), still(80, 2.0), still(0, 3.0), still(80, 1.0)])
    session, found = measured(table(squatting_joints(thighs)))
    expected = {
        "recorded_time": 10.0,
        "upright_time": 7.0,
        "upright_share": 0.7,
        "upright_bouts": 2.0,
        "longest_upright_bout": 4.0,
        "unknown_time": 0.0,
    }
    for name, number in expected.items():
        assert value(found, name) == pytest.approx(number, abs=1e-9)
    bouts = [e for e in session.episodes if e.kind == UPRIGHT_EPISODE]
    assert [(e.first_frame, e.last_frame) for e in bouts] == [(0, 79), (120, 179)]


def test_frames_without_a_leg_are_neither_upright_nor_not():
    joints = table(squatting_joints(still(0, 10.0)), lost={"KneeLeft": slice(100, 140)})
    session, found = measured(joints)
    assert (value(found, "unknown_time"), value(found, "upright_time")) == pytest.approx((2.0, 8.0))
    assert value(found, "upright_share") == pytest.approx(1.0)  # of the time in which it is known
    assert value(found, "longest_upright_bout") == pytest.approx(5.0)
    assert (session.posture.upright[100:140] == UNKNOWN).all()


def test_time_near_the_limit_has_a_wide_margin():
    sure = measured(table(squatting_joints(still(0, 5.0))))[1]["upright_time", None, None, None].sigma
    near = measured(table(squatting_joints(still(40.5, 5.0), 0.0), sigma_m=0.02))[1]["upright_time", None, None, None]
    assert sure < 0.1
    assert near.sigma is None or near.sigma > 2.0


def at_times(thigh_deg: np.ndarray, time_s: np.ndarray) -> dict:
    """The measures of a patient who squats so at these times."""
    return measured(replace(table(squatting_joints(thigh_deg)), time_s=time_s))[1]


def test_dropped_frames_and_cameras_that_slow_down_lose_no_time():
    time_s = np.arange(1800) / 30
    kept = np.sort(np.random.default_rng(0).choice(1800, 1600, replace=False))
    kept[[0, -1]] = 0, 1799
    found = at_times(np.zeros(len(kept)), time_s[kept])
    for name in ("recorded_time", "upright_time", "longest_upright_bout"):
        assert value(found, name) == pytest.approx(60.0, abs=0.05)
    assert value(found, "upright_bouts") == 1.0
    assert value(found, "unknown_time") == pytest.approx(0.0, abs=0.05)
    time_s = np.concatenate([np.arange(900) / 30, 30 + np.arange(600) / 15])
    found = at_times(np.zeros(1500), time_s)
    for name in ("recorded_time", "upright_time", "longest_upright_bout"):
        assert value(found, name) == pytest.approx(70.0, abs=0.1)
    assert value(found, "sway_time") == pytest.approx(70.0, abs=0.1)


def test_a_long_gap_is_time_of_which_nothing_is_known():
    time_s = np.concatenate([np.arange(200) / RATE, 15.0 + np.arange(100) / RATE])
    found = at_times(np.zeros(300), time_s)
    assert (value(found, "recorded_time"), value(found, "unknown_time")) == pytest.approx((20.0, 5.0))
    assert (value(found, "upright_time"), value(found, "upright_bouts")) == (pytest.approx(15.0), 2.0)


def test_standing_up_is_counted_though_frames_were_dropped():
    thigh_deg = np.concatenate([still(85, 4.0), move(85, 0, 2.0), still(0, 4.0)])
    whole = value(measured(table(squatting_joints(thigh_deg)))[1], f"{SIT_TO_STAND}_duration_mean")
    for seed in range(10):
        kept = np.flatnonzero(np.random.default_rng(seed).random(len(thigh_deg)) > 0.05)
        found = at_times(thigh_deg[kept], kept / RATE)
        assert value(found, f"{SIT_TO_STAND}_count") == 1.0
        assert value(found, f"{SIT_TO_STAND}_duration_mean") == pytest.approx(whole, abs=2.1 / RATE)


def test_missing_frames_count_for_nothing_and_break_a_run():
    time_s = np.array([0.0, 0.1, 0.2, 1.0, 1.1])
    assert (recorded_seconds(time_s), recorded_seconds(time_s[:1])) == (pytest.approx(1.2), 0.0)
    np.testing.assert_allclose(frame_seconds(time_s), 0.1)
    assert unbroken_runs(np.ones(5, dtype=bool), time_s) == [slice(0, 3), slice(3, 5)]
    assert unbroken_runs(np.array([1, 0, 1, 1, 0], dtype=bool), np.arange(5.0)) == [slice(0, 1), slice(2, 4)]
    assert frame_seconds(np.array([3.0])).tolist() == [0.0]


def test_standing_up_and_sitting_down_are_counted_and_timed():
    thighs = np.concatenate([still(85, 2.0), move(85, 0, 2.0), still(0, 3.0), move(0, 85, 3.0), still(85, 2.0)])
    joints = squatting_joints(thighs)
    session, found = measured(table(joints))
    height = joints[:, JOINT_INDEX["HipLeft"], 1]
    way = (height - height.min()) / np.ptp(height)
    for kind, part in ((SIT_TO_STAND, slice(40, 80)), (STAND_TO_SIT, slice(140, 200))):
        assert value(found, f"{kind}_count") == 1.0
        inside = way[part][(way[part] > 0.05) & (way[part] < 0.95)]
        assert value(found, f"{kind}_duration_mean") == pytest.approx((len(inside) + 1) / RATE, abs=1.5 / RATE)
        (episode,) = [e for e in session.episodes if e.kind == kind]
        assert part.start <= episode.first_frame < episode.last_frame <= part.stop


def test_a_squat_in_passing_is_no_sitting_and_a_rise_with_a_lost_leg_is_not_timed():
    squat = np.concatenate([still(0, 2.0), move(0, 85, 1.0), move(85, 0, 1.0), still(0, 2.0)])
    assert value(measured(table(squatting_joints(squat)))[1], f"{SIT_TO_STAND}_count") == 0.0
    rise = np.concatenate([still(85, 2.0), move(85, 0, 2.0), still(0, 3.0)])
    lost = {"HipLeft": slice(55, 60)}
    found = measured(table(squatting_joints(rise), lost=lost))[1]
    assert value(found, f"{SIT_TO_STAND}_count") == 0.0
    assert "from beginning to end" in why(found, f"{SIT_TO_STAND}_duration_mean")


def test_where_no_leg_is_ever_seen_there_is_a_reason_and_no_value():
    found = measured(table(squatting_joints(still(0, 1.0)), lost={"KneeLeft": slice(None)}))[1]
    for name in ("upright_time", "upright_share", "longest_upright_bout"):
        assert "in no frame" in why(found, name)
    assert value(found, "unknown_time") == pytest.approx(1.0)


def test_limits_in_the_wrong_order_are_refused():
    for wrong in ({"thigh_enter_deg": 50.0}, {"trunk_enter_deg": 60.0}, {"height_leave": 0.9}):
        with pytest.raises(ValueError, match=r"limits|height_leave"):
            UprightConfig(**wrong)


RISE = np.concatenate([still(85, 3.0), move(85, 0, 2.0), still(0, 3.0)])


def test_a_trunk_that_is_lost_for_a_moment_changes_neither_bout_nor_transition_nor_an_ankle_while_seated():
    joints, duration = squatting_joints(RISE), f"{SIT_TO_STAND}_duration_mean"
    whole = measured(table(joints))[1]
    ankle = measured(table(joints, lost={"AnkleLeft": slice(20, 30)}))[1]  # while seated
    assert value(ankle, duration) == pytest.approx(value(whole, duration))
    for first, frames in ((85, 1), (90, 1), (90, 5), (120, 3)):
        found = measured(table(joints, lost={"SpineBase": slice(first, first + frames)}))[1]
        assert value(found, f"{SIT_TO_STAND}_count") == 1.0
        assert value(found, duration) == pytest.approx(value(whole, duration), abs=1e-9)
        assert value(found, "upright_bouts") == 1.0
        assert value(found, "longest_upright_bout") == pytest.approx(value(found, "upright_time"))
        assert value(found, "unknown_time") > 0.0


def test_the_poorer_the_joints_the_less_sure_how_long_standing_up_took():
    joints = squatting_joints(RISE)
    rows = [
        measured(table(joints, sigma))[1][f"{SIT_TO_STAND}_duration_mean", None, None, None]
        for sigma in (0.005, 0.02, 0.03, 0.06)
    ]
    sigmas = [row.sigma or 0.0 for row in rows]
    assert all(late > 1.1 * early for early, late in pairwise(sigmas))


def test_who_comes_near_to_standing_and_sinks_back_has_not_stood_up():
    thighs = np.concatenate([still(85, 4.0), np.linspace(85, 20, 30), np.linspace(20, 85, 30), still(85, 4.0)])
    found = measured(table(squatting_joints(thighs)))[1]
    for kind in (SIT_TO_STAND, STAND_TO_SIT):
        assert value(found, f"{kind}_count") == 0.0
    assert value(found, "upright_time") > 0.5  # upright for a moment all the same


def test_a_lifted_foot_does_not_sit_the_patient_down():
    joints = np.repeat(squatting_joints(np.zeros(1)), 20, axis=0)
    joints[10:, JOINT_INDEX["KneeLeft"]] += [0.36, 0.2, 0.0]  # thigh 59 degrees forward, shank nearly level
    joints[10:, [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["FootLeft"]]] += [-0.054, 0.547, 0.0]
    assert measured(table(joints))[0].posture.upright.tolist() == [1] * 20
