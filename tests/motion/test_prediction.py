"""Scaled motion dynamics: known movements, invariance to place and heading, exact search, fallbacks, real skeletons."""

from pathlib import Path

import numpy as np
import pytest
from results_builder import standing_joints
from scipy.spatial.transform import Rotation

from anchorpose.joints import JOINT_INDEX
from anchorpose.motion.database import (
    COMPARED,
    SHIPPED,
    heading_rad,
    joints_after,
    pose_vectors,
    poses_at,
    read_skeletons,
)
from anchorpose.motion.prediction import (
    DAMPING,
    SPANS,
    MotionConfig,
    MotionRule,
    PredictionSource,
    best_sublists,
    joint_database,
    load_motions,
    predict,
    predict_joints,
    reference_motions,
    span_shares,
    velocity,
)

UIPRMD = Path(__file__).parents[3] / "shared" / "data" / "uiprmd_kinect" / "skeletons.npz"
BODY = np.random.default_rng(4).normal(0, 0.4, (21, 3))
BODY[JOINT_INDEX["HipLeft"]], BODY[JOINT_INDEX["HipRight"]] = (0, 0.9, -0.12), (0, 0.9, 0.12)
BODY[JOINT_INDEX["ShoulderLeft"]], BODY[JOINT_INDEX["ShoulderRight"]] = (0, 1.4, -0.2), (0, 1.4, 0.2)


def swing(frames: int, period: float = 40.0, size_m: float = 0.3) -> np.ndarray:
    """(frames, 21, 3): one hand goes up and down as a sine, the body moves sideways."""
    joints = np.repeat(BODY[None], frames, axis=0)
    phase = 2 * np.pi * np.arange(frames) / period
    joints[:, JOINT_INDEX["HandLeft"], 1] += size_m * np.sin(phase)
    return joints + 0.02 * np.sin(phase)[:, None, None] * np.array([0, 0, 1.0])


def turned(joints_m: np.ndarray, angle_rad: float, shift_m: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return joints_m @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T + shift_m


def database_of(*clips_m: np.ndarray, rate_hz: float = 30.0, at_hz: float = 30.0, config: MotionConfig | None = None):
    return joint_database(clips_m, [rate_hz] * len(clips_m), at_hz, config or MotionConfig())


@pytest.mark.parametrize("rule", [MotionRule.BLEND, MotionRule.BEST_SUBLIST])
def test_a_movement_of_the_database_is_continued_exactly(rule):
    clip, config = swing(120), MotionConfig(speeds=(1.0,), rule=rule)
    ahead = predict_joints(clip[38:50], 5, database_of(clip, config=config), config)
    assert ahead.source == PredictionSource.DATABASE
    assert ahead.trust > 0.999
    assert ahead.joints_m == pytest.approx(clip[50:55], abs=1e-4)


@pytest.mark.parametrize("rule", [MotionRule.BLEND, MotionRule.BEST_SUBLIST])
def test_the_same_movement_at_double_speed_finds_the_scaled_copy(rule):
    config = MotionConfig(speeds=(0.5, 1.0, 2.0), rule=rule)
    fast, database = swing(60, period=20), database_of(swing(200), config=config)
    matches = best_sublists(pose_vectors(fast[20:25]), database, 3, 1, config.displacement_weight)
    assert matches.stride == pytest.approx(2.0)
    assert predict_joints(fast[13:25], 3, database, config).joints_m == pytest.approx(fast[25:28], abs=2e-3)


def test_the_papers_rule_is_its_equation():
    """theta^(t+h) = theta^t + theta_s^(j+h) - theta_s^j of the one best sub-list, the way moved not weighed."""
    config = MotionConfig(rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0, speeds=(1.0,))
    clip = pose_vectors(swing(120))
    history = clip[30:42] + np.random.default_rng(0).normal(0, 0.01, clip[30:42].shape)
    cost = [np.linalg.norm((clip[j - 4 : j + 1] - history[-5:])[:, :COMPARED], axis=1).sum() for j in range(7, 117)]
    j = 7 + int(np.argmin(cost))
    ahead = predict(history, 3, COMPARED, reference_motions([clip], [30], 30, COMPARED, config), config)
    assert ahead.theta == pytest.approx(history[-1] + clip[j + 1 : j + 4] - clip[j], abs=1e-5)
    assert ahead.matches.distance_m[0] == pytest.approx(min(cost) / 5 / np.sqrt(21), rel=1e-4)


def test_a_database_at_another_rate_is_resampled():
    config = MotionConfig(speeds=(1.0,))
    at_15_hz = swing(200)[::2]
    database = database_of(swing(200), at_hz=15, config=config)
    assert predict_joints(at_15_hz[10:22], 2, database, config).joints_m == pytest.approx(at_15_hz[22:24], abs=1e-4)


@pytest.mark.parametrize("angle", [0.7, -2.9, 3.1])
@pytest.mark.parametrize("rule", list(MotionRule))
def test_a_prediction_turns_and_moves_with_the_patient(angle, rule):
    config, clip, shift = MotionConfig(speeds=(1.0,), rule=rule), swing(120), np.array([3.0, 0.2, -1.0])
    database = database_of(clip, config=config)
    here = predict_joints(clip[38:50], 4, database, config).joints_m
    there = predict_joints(turned(clip[38:50], angle, shift), 4, database, config).joints_m
    assert there == pytest.approx(turned(here, angle, shift), abs=1e-5)


def test_pose_vectors_and_joints_are_a_round_trip():
    joints = turned(swing(30), 1.1, np.zeros(3)) + np.linspace(0, 0.5, 30)[:, None, None]
    vectors = pose_vectors(joints)
    assert joints_after(joints[9], vectors[9], vectors[10:]) == pytest.approx(joints[10:], abs=1e-9)


def test_heading_is_zero_towards_x_and_survives_missing_hips():
    joints = swing(2)
    joints[:, [JOINT_INDEX["HipLeft"]]] = np.nan
    assert (heading_rad(joints), heading_rad(turned(joints, 0.5, np.zeros(3)))) == pytest.approx((0.0, 0.5))


def test_a_movement_unlike_all_of_the_database_is_left_to_its_own_velocity():
    leap = np.repeat(BODY[None], 12, axis=0)
    leap[:, JOINT_INDEX["FootLeft"], 0] += 0.1 * np.arange(12) + 2.0
    ahead = predict_joints(leap, 2, database_of(swing(120)), MotionConfig())
    assert ahead.trust < 0.2  # not nothing: the damped velocity falls short of a leap too
    step = ahead.joints_m[0] - leap[-1]
    assert step[JOINT_INDEX["FootLeft"], 0] == pytest.approx(0.1, abs=0.01)


def test_without_a_database_or_with_a_short_history_the_velocity_is_damped_and_the_prediction_says_so():
    config, clip = MotionConfig(), swing(120)
    for history, database in ((clip[30:42], None), (clip[39:42], database_of(clip))):
        ahead = predict_joints(history, 3, database, config)
        assert (ahead.source, ahead.trust) == (PredictionSource.OWN_VELOCITY, 0.0)
        steps = np.diff(ahead.joints_m[:, JOINT_INDEX["HandLeft"], 1], prepend=history[-1, JOINT_INDEX["HandLeft"], 1])
        assert steps[1:] / steps[:-1] == pytest.approx(DAMPING, rel=1e-6)


def test_one_frame_stands_still_and_says_so():
    ahead = predict_joints(swing(1), 3, None, MotionConfig())
    assert ahead.source == PredictionSource.STANDSTILL
    assert ahead.joints_m == pytest.approx(np.repeat(swing(1), 3, axis=0))


def test_each_rule_does_what_it_says():
    clip, ahead = swing(120), {}
    database = database_of(clip)
    for rule in MotionRule:
        ahead[rule] = predict_joints(clip[30:42], 3, database, MotionConfig(rule=rule))
    assert ahead[MotionRule.STANDSTILL].joints_m == pytest.approx(np.repeat(clip[41:42], 3, axis=0))
    assert ahead[MotionRule.VELOCITY].joints_m == pytest.approx(
        predict_joints(clip[30:42], 3, None, MotionConfig()).joints_m
    )
    assert not MotionConfig(rule=MotionRule.VELOCITY).uses_database


@pytest.mark.parametrize("length", range(2, 16))
def test_every_length_of_history_has_a_finite_prediction(length):
    clip = swing(120) + np.random.default_rng(2).normal(0, 0.005, (120, 21, 3))
    ahead = predict_joints(clip[50 - length : 50], 3, database_of(clip), MotionConfig())
    assert np.isfinite(ahead.joints_m).all()
    assert np.linalg.norm(ahead.joints_m[0] - clip[50], axis=1).mean() < 0.05


def test_a_missing_joint_stays_missing_and_the_others_are_predicted():
    config, clip = MotionConfig(speeds=(1.0,)), swing(120)
    history = clip[38:50].copy()
    history[-2:, JOINT_INDEX["Head"]] = np.nan
    ahead = predict_joints(history, 2, database_of(clip, config=config), config)
    assert ahead.source == PredictionSource.DATABASE
    assert np.isnan(ahead.joints_m[:, JOINT_INDEX["Head"]]).all()
    others = np.arange(21) != JOINT_INDEX["Head"]
    assert ahead.joints_m[:, others] == pytest.approx(clip[50:52, others], abs=1e-4)


def test_noise_makes_the_velocity_be_taken_over_more_frames():
    spans, smooth = SPANS, pose_vectors(swing(60, period=25))[20:32, :COMPARED]
    noisy = smooth + np.random.default_rng(5).normal(0, 0.02, smooth.shape)
    assert span_shares(smooth, spans)[0] > 0.8
    assert span_shares(noisy, spans)[2] > 0.7
    assert span_shares(smooth[:2], spans) == pytest.approx([1, 0, 0])
    assert velocity(np.arange(12.0)[:, None] * [1, -2], spans, np.full(3, 1 / 3)) == pytest.approx([1, -2])


def random_database(rng: np.random.Generator, columns: int, config: MotionConfig):
    clips = [np.cumsum(rng.normal(0, 0.1, (n, columns)), axis=0) for n in (60, 14, 11, 90)]
    return clips, reference_motions(clips, [30, 30, 30, 15], 30, columns, config)


def by_brute_force(history, clips, config, steps, count, weight):
    """Costs of all sub-lists in order, one at a time: (cost, row of the newest pose), the ``count`` best."""
    k, found, first = len(history), [], 0
    for clip, rate in zip(clips, (30, 30, 30, 15), strict=True):
        for speed in config.speeds:
            stride = speed * rate / 30
            for j in range(config.past, 1000):
                rows = (j - np.arange(k)[::-1]) * stride
                if (j + steps) * stride > len(clip) - 1 + 1e-9:
                    break
                poses = np.stack([np.interp(rows, np.arange(len(clip)), column) for column in clip.T], axis=1)
                apart = (poses - history)[:, np.isfinite(history).all(axis=0)]
                cost = np.linalg.norm(apart, axis=1).sum() + weight * k * np.linalg.norm(apart[-1] - apart[0])
                found.append((cost, first + j * stride))
        first += len(clip)
    return sorted(found)[:count]


@pytest.mark.parametrize("columns", [6, 20])
@pytest.mark.parametrize("missing", [False, True])
def test_the_search_is_that_of_brute_force(columns, missing):
    rng, config = np.random.default_rng(9), MotionConfig(history=4, speeds=(0.7, 1.0, 2.0), checked=5)
    clips, database = random_database(rng, columns, config)
    walks = [np.cumsum(rng.normal(0, 0.1, (4, columns)), axis=0) for _ in range(2)]
    copies = [clips[0][20:24] + rng.normal(0, noise, (4, columns)) for noise in (0.0, 0.05)]
    across_two_clips = np.concatenate([clips[0][-2:], clips[1][:2]])
    for steps, count, weight in ((1, 1, 0.0), (3, 8, 2.0), (2, 1000, 4.0)):
        for history in (*walks, *copies, across_two_clips):
            asked = history.copy()
            if missing:
                asked[1, 2] = np.nan
            matches = best_sublists(asked, database, steps, count, weight)
            expected = by_brute_force(asked, clips, config, steps, count, weight)
            assert len(matches.place) == len(expected)
            compared = columns - missing
            cost = matches.distance_m * 4 * np.sqrt(compared / 3)
            assert cost == pytest.approx([cost for cost, _ in expected], rel=1e-4, abs=1e-5)
            assert matches.place[0] == pytest.approx(expected[0][1], abs=1e-6)


def test_bounds_leave_out_nothing_that_belongs_to_the_best_of_noisy_skeletons():
    config, rng = MotionConfig(), np.random.default_rng(1)
    clips = [swing(150, period=period) + rng.normal(0, 0.006, (150, 21, 3)) for period in (23.0, 31.0, 44.0)]
    database = database_of(*clips, config=config)
    listed, back = database.sublists, np.arange(4, -1, -1)
    poses = poses_at(database.theta[:, :COMPARED], listed.place[:, None] - back * listed.stride[:, None])
    vectors = pose_vectors(swing(60, period=37.0) + rng.normal(0, 0.006, (60, 21, 3)))
    for k in range(0, 50, 5):
        apart = poses - vectors[k : k + 5, :COMPARED]
        cost = np.linalg.norm(apart, axis=2).sum(axis=1) + 4.0 * 5 * np.linalg.norm(apart[:, -1] - apart[:, 0], axis=1)
        cost = np.sort(cost[listed.followed >= 3])[:32]
        matches = best_sublists(vectors[k : k + 5], database, 3, 32, 4.0)
        assert matches.distance_m == pytest.approx(cost / 5 / np.sqrt(21), rel=1e-5)


def test_a_match_has_a_past_and_a_future_in_its_own_clip():
    rng, config = np.random.default_rng(3), MotionConfig(history=4)
    clips, database = random_database(rng, 6, config)
    ends = np.cumsum([0, *(len(clip) for clip in clips)])
    for _ in range(10):
        matches = best_sublists(np.cumsum(rng.normal(0, 0.1, (4, 6)), axis=0), database, 3, 50, 2.0)
        clip = np.searchsorted(ends, matches.place + 1e-6, side="right") - 1
        assert (matches.place - config.past * matches.stride >= ends[clip] - 1e-6).all()
        assert (matches.place + 3 * matches.stride <= ends[clip + 1] - 1 + 1e-6).all()


def test_input_that_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least one pose"):
        predict(np.empty((0, 6)), 1, 6, None, MotionConfig())
    with pytest.raises(ValueError, match="no clip"):
        reference_motions([np.zeros((8, 6))], [30], 30, 6, MotionConfig(speeds=(1.0,)))
    with pytest.raises(ValueError, match="missing values"):
        reference_motions([np.full((30, 6), np.nan)], [30], 30, 6, MotionConfig())
    for wrong in ({"history": 1}, {"speeds": ()}, {"displacement_weight": -1.0}, {"neighbours": 0}, {"checked": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            MotionConfig(**wrong)


def test_on_real_skeletons_of_another_subject_the_database_beats_velocity_and_standstill_at_every_horizon():
    """One of the subjects that took no part in choosing the numbers of ``MotionConfig``."""
    if not UIPRMD.exists():
        pytest.skip(f"{UIPRMD} is absent: the UI-PRMD skeletons are not part of this project")
    clips = read_skeletons(UIPRMD, 30.0)
    of = {name: number for number, name in enumerate(clips.names)}

    def of_subject(subject: int, repetitions: tuple[int, ...]) -> list[np.ndarray]:
        names = [f"c_m{m:02d}_s{subject:02d}_e{e:02d}" for m in range(1, 11) for e in repetitions]
        return [clips.joints_m[of[name]] for name in names if name in of]

    config = MotionConfig()
    database = database_of(
        *(clip for subject in (1, 2, 3, 4) for clip in of_subject(subject, (1, 4, 7))), config=config
    )
    errors: dict[str, list[np.ndarray]] = {"ours": [], "velocity": [], "standstill": []}
    for test in of_subject(6, (3, 8)):
        for k in range(12, len(test) - 10, 9):
            past, future = test[k - 12 : k], test[[k, k + 2, k + 9]]
            constant = past[-1] + np.array([1, 3, 10])[:, None, None] * (past[-1] - past[-5]) / 4
            ours = predict_joints(past, 10, database, config).joints_m[[0, 2, 9]]
            for name, ahead in (("ours", ours), ("velocity", constant), ("standstill", past[-1:])):
                errors[name].append(np.linalg.norm(ahead - future, axis=2).mean(axis=1))
    mean = {name: np.mean(of_name, axis=0) for name, of_name in errors.items()}
    assert (mean["ours"] < mean["velocity"]).all()
    assert (mean["ours"] < mean["standstill"]).all()


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 30.0])
def test_a_person_who_rolls_over_on_the_side_is_predicted_where_the_movement_leads(rate_hz):
    """The line between the shoulders turns vertical on the way, and its heading jumps by half a turn."""
    time_s = np.arange(0.0, 4.0, 1.0 / rate_hz)
    lying = standing_joints() @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T
    turns = [Rotation.from_rotvec([np.radians(40.0 + 30.0 * at), 0.0, 0.0]).as_matrix() for at in time_s]
    joints = np.array([lying @ turn.T for turn in turns])
    config = MotionConfig()
    motions = load_motions(SHIPPED, rate_hz, config)
    for last in range(11, len(joints) - 1):
        found = predict_joints(joints[last - 11 : last + 1], 1, motions, config).joints_m[0]
        assert np.linalg.norm(found - joints[last + 1], axis=1).mean() < 0.08
