"""Smoothing and filling: no delay, gaps stay gaps unless asked for, and sigma says what was made up."""

import json
from dataclasses import replace

import numpy as np
import pytest
from results_builder import standing_joints

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, LOST
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.parquet import read_parquet_schema
from anchorpose.results.processing import (
    FILLED,
    FIRST_ACCELERATION_M_S2,
    FIRST_SPEED_M_S,
    MEASURED,
    SMOOTHED,
    ProcessingConfig,
    fill_gaps,
    low_pass,
    process_angles,
    process_joints,
    shortest_frames,
    smooth_stretch,
)
from anchorpose.results.tables import (
    POLICY_KEY,
    PROCESSING,
    JointTable,
    read_processed_angles,
    write_angles,
    write_processed_angles,
)
from anchorpose.results.uncertainty import JOINT_SHARE, random_sigma, systematic_sigma

RATE = 30.0


def wave(time_s: np.ndarray, hz: float = 0.5) -> np.ndarray:
    angle = 2 * np.pi * hz * time_s
    return np.stack([0.2 * np.sin(angle), 0.1 * np.cos(angle), 0.0 * time_s], axis=1)


def moving(frames: int = 240, gap: slice | None = None, joint: str = "WristLeft", noise_m: float = 0.0) -> JointTable:
    """Everybody's joints move along; one joint is lost in the gap."""
    time_s = np.arange(frames) / RATE
    position = standing_joints() + wave(time_s)[:, None]
    position = position + noise_m * np.random.default_rng(3).normal(size=position.shape)
    state_code, sigma = np.zeros((frames, JOINT_COUNT), np.int8), np.full((frames, JOINT_COUNT), 0.01)
    if gap is not None:
        position[gap, JOINT_INDEX[joint]], sigma[gap, JOINT_INDEX[joint]] = np.nan, np.nan
        state_code[gap, JOINT_INDEX[joint]] = LOST
    return JointTable(np.arange(frames, dtype=np.int32), time_s, position, state_code, sigma)


def test_slow_movement_passes_unchanged_and_undelayed_and_the_cutoff_is_where_it_is_said_to_be():
    time_s = np.arange(600) / RATE
    for hz, kept in ((0.5, 1.0), (6.0, np.sqrt(0.5)), (13.0, 0.0)):
        before = np.sin(2 * np.pi * hz * time_s)
        after = low_pass(before, RATE, 6.0)
        inside = slice(60, -60)
        assert np.std(after[inside]) / np.std(before[inside]) == pytest.approx(kept, abs=0.03)
        if kept > 0.5:
            lags = np.correlate(after[inside], before[inside], mode="full")
            assert int(lags.argmax()) == len(before[inside]) - 1  # no lag


def test_the_gain_is_that_of_two_passes_of_a_butterworth_filter():
    """1 / (1 + (f / f_c)^4 (sqrt 2 - 1)) with f as tangents: the text-book's magnitude, squared by the second pass."""
    impulse = np.zeros(601)
    impulse[300] = 1.0
    gain = np.abs(np.fft.rfft(low_pass(impulse, RATE, 3.0)))
    ratio = np.tan(np.pi * np.fft.rfftfreq(601)) / np.tan(np.pi * 3.0 / RATE)
    np.testing.assert_allclose(gain, 1.0 / (1.0 + ratio**4 * (np.sqrt(2.0) - 1.0)), atol=1e-6)


@pytest.mark.parametrize("smooth", ["butterworth", "kalman"])
def test_smoothing_alone_leaves_every_gap_and_does_not_look_across_it(smooth):
    config = ProcessingConfig(smooth=smooth)
    table = moving(gap=slice(100, 110), noise_m=0.005)
    done = process_joints(table, config)
    wrist = JOINT_INDEX["WristLeft"]
    assert np.isnan(done.joints.position_m[100:110, wrist]).all()
    assert np.isnan(done.joints.sigma_m[100:110, wrist]).all()
    assert (done.joints.state_code[100:110, wrist] == LOST).all()
    assert (done.processing[100:110, wrist] == MEASURED).all()
    alone = JointTable(*(getattr(table, name)[:100] for name in JointTable.__slots__))
    np.testing.assert_array_equal(
        process_joints(alone, config).joints.position_m[:, wrist], done.joints.position_m[:100, wrist]
    )
    rough = np.abs(np.diff(table.position_m[:100, wrist], 2, axis=0)).mean()
    assert np.abs(np.diff(done.joints.position_m[:100, wrist], 2, axis=0)).mean() < 0.4 * rough


@pytest.mark.parametrize("fill", ["linear", "spline"])
def test_short_gaps_are_filled_marked_and_least_sure_in_their_middle_and_longer_ones_stay(fill):
    wrist = JOINT_INDEX["WristLeft"]
    config = ProcessingConfig(fill=fill, longest_gap_s=0.4)
    done = process_joints(moving(gap=slice(100, 109), noise_m=0.002), config)
    assert (done.processing[100:109, wrist] == FILLED).all()
    assert (np.delete(done.processing[:, wrist], np.arange(100, 109)) == MEASURED).all()
    sigma = done.joints.sigma_m[99:110, wrist]
    assert sigma[5] > sigma[1] > sigma[0] == 0.01
    assert (done.joints.state_code[100:109, wrist] > 0).all()
    assert (np.abs(done.joints.position_m - moving().position_m)[104, wrist] < 2.5 * sigma[5]).all()
    for gap in (slice(100, 125), slice(0, 5), slice(235, 240)):  # too long; at the start; at the end
        left = process_joints(moving(gap=gap), config)
        assert np.isnan(left.joints.position_m[gap, wrist]).all()
        assert (left.processing == MEASURED).all()


def test_what_is_filled_lies_within_its_sigma():
    """The sigma of a filling is measured where the joint is known; over many gaps it must hold."""
    rng, errors = np.random.default_rng(5), []
    time_s = np.arange(600) / RATE
    for _ in range(60):
        walk = np.cumsum(np.cumsum(rng.normal(size=(600, 3)), axis=0), axis=0) * 2e-4
        start = int(rng.integers(50, 540))
        gapped = walk.copy()
        gapped[start : start + 8] = np.nan
        sigma = np.where(np.isnan(gapped[:, 0]), np.nan, 1e-6)
        filled = fill_gaps(time_s, gapped, sigma, "linear", 0.5)
        assert filled.filled.sum() == 8
        errors.append((filled.position_m - walk)[filled.filled] / filled.sigma_m[filled.filled][:, None])
    assert np.mean(np.abs(errors) <= 1.96) == pytest.approx(0.95, abs=0.03)


def test_a_spline_follows_a_curve_that_a_line_cuts_and_nothing_is_filled_where_too_little_is_known():
    time_s = np.arange(240) / RATE
    gapped = wave(time_s)
    gapped[100:106] = np.nan
    sigma = np.where(np.isnan(gapped[:, 0]), np.nan, 0.001)
    far = [
        np.abs(fill_gaps(time_s, gapped, sigma, fill, 0.5).position_m - wave(time_s)).max()
        for fill in ("linear", "spline")
    ]
    assert far[1] < 0.2 * far[0]
    gapped = wave(np.arange(24) / RATE)
    gapped[11:14] = np.nan
    sigma = np.where(np.isnan(gapped[:, 0]), np.nan, 0.001)
    assert not fill_gaps(np.arange(24) / RATE, gapped, sigma, "linear", 0.5).filled.any()


def test_the_kalman_smoother_is_the_least_squares_solution():
    """The most likely course of a linear Gaussian model minimises a sum of squares; here it is solved at once."""
    rng = np.random.default_rng(7)
    time_s, jerk = np.cumsum(rng.uniform(0.02, 0.08, 12)), 20.0
    seen, sigma = rng.normal(size=(12, 3)), rng.uniform(0.2, 0.5, 12)
    rows, right = [], []
    first = np.diag(1.0 / np.array([random_sigma(sigma, JOINT_SHARE)[0], FIRST_SPEED_M_S, FIRST_ACCELERATION_M_S2]))
    for k in range(12):
        place = np.zeros((1, 36))
        if k:
            place[0, 3 * k] = 1.0 / random_sigma(sigma, JOINT_SHARE)[k]
            rows.append(place)
            right.append(seen[k][None] / random_sigma(sigma, JOINT_SHARE)[k])
            h = time_s[k] - time_s[k - 1]
            noise = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
            white = np.linalg.inv(np.linalg.cholesky(jerk**2 * noise))
            step = np.zeros((3, 36))
            step[:, 3 * k : 3 * k + 3] = white
            step[:, 3 * k - 3 : 3 * k] = -white @ np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])
            rows.append(step)
            right.append(np.zeros((3, 3)))
    start = np.zeros((3, 36))
    start[:, :3] = first
    rows.append(start)
    right.append(first @ np.vstack([seen[0], np.zeros((2, 3))]))
    system = np.vstack(rows)
    expected = np.linalg.lstsq(system, np.vstack(right), rcond=None)[0][::3]
    spread = np.sqrt(np.diag(np.linalg.inv(system.T @ system))[::3] + systematic_sigma(sigma, JOINT_SHARE) ** 2)
    course, found = smooth_stretch(time_s, seen, sigma, jerk)
    np.testing.assert_allclose(course, expected, atol=1e-8)
    np.testing.assert_allclose(found, spread, rtol=1e-6)


def test_smoothing_does_not_promise_more_than_the_part_that_comes_and_goes():
    table = moving(noise_m=0.005)
    for smooth in ("butterworth", "kalman"):
        sigma = process_joints(table, ProcessingConfig(smooth=smooth)).joints.sigma_m
        assert (sigma >= systematic_sigma(table.sigma_m, JOINT_SHARE) - 1e-12).all()
        assert (sigma <= table.sigma_m + 1e-12).all()


def test_a_stretch_too_short_for_the_filter_stays_as_it_was_measured_and_says_so():
    shortest = shortest_frames(RATE, 6.0)
    table = moving(gap=slice(shortest - 1, 40), noise_m=0.005)
    done, wrist = process_joints(table, ProcessingConfig(smooth="butterworth")), JOINT_INDEX["WristLeft"]
    assert (done.processing[: shortest - 1, wrist] == MEASURED).all()
    np.testing.assert_array_equal(
        done.joints.position_m[: shortest - 1, wrist], table.position_m[: shortest - 1, wrist]
    )
    assert (done.processing[40:, wrist] == SMOOTHED).all()


def test_uneven_time_stamps_and_too_high_a_cutoff_are_refused_by_the_filter_and_borne_by_kalman():
    table = moving()
    uneven = replace(table, time_s=table.time_s + np.where(np.arange(240) % 2, 0.012, 0.0))
    with pytest.raises(AnchorposeError, match="--smooth kalman"):
        process_joints(uneven, ProcessingConfig(smooth="butterworth"))
    process_joints(uneven, ProcessingConfig(smooth="kalman"))
    with pytest.raises(AnchorposeError, match="too high for 30 frames"):
        process_joints(table, ProcessingConfig(smooth="butterworth", cutoff_hz=14.0))
    with pytest.raises(AnchorposeError, match="single frame"):
        process_joints(moving(1), ProcessingConfig(smooth="butterworth"))
    slow_s = np.arange(1, 61) / 25.0
    table = moving(240, gap=slice(170, 180))
    time_s = np.concatenate([np.arange(180) / RATE, 179 / RATE + slow_s])
    assert process_joints(replace(table, time_s=time_s), ProcessingConfig(smooth="butterworth", cutoff_hz=11.0))
    with pytest.raises(AnchorposeError, match="too high for 25 frames a second"):
        process_joints(replace(table, time_s=time_s), ProcessingConfig(smooth="butterworth", cutoff_hz=12.0))


def test_missing_frames_end_a_stretch():
    whole = moving(noise_m=0.005)
    kept = np.delete(np.arange(240), np.arange(120, 130))
    table = JointTable(*(getattr(whole, name)[kept] for name in JointTable.__slots__))
    alone = JointTable(*(getattr(whole, name)[:120] for name in JointTable.__slots__))
    config = ProcessingConfig(smooth="butterworth", fill="linear", longest_gap_s=1.0)
    np.testing.assert_array_equal(
        process_joints(table, config).joints.position_m[:120], process_joints(alone, config).joints.position_m
    )


@pytest.mark.parametrize(
    "wrong", [{"smooth": "median"}, {"fill": "guess"}, {"cutoff_hz": 0.0}, {"longest_gap_s": -1.0}, {"jerk": np.inf}]
)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ValueError, match=r"greater than|finite|should be"):
        ProcessingConfig(**wrong)


def test_an_angle_is_as_processed_as_its_joints_and_the_file_states_the_policy(tmp_path):
    table, config = moving(gap=slice(100, 104)), ProcessingConfig(smooth="butterworth", fill="linear")
    processed, policy_text = process_angles(table, config)
    elbow, knee = (processed.column(name) for name in ("elbow_flexion_left", "knee_flexion_left"))
    assert (processed.processing[100:104, elbow] == FILLED).all()
    assert (processed.processing[:, knee] == SMOOTHED).all()
    path = tmp_path / "angles_processed.parquet"
    write_processed_angles(path, processed, {POLICY_KEY: policy_text})
    back = read_processed_angles(path)
    np.testing.assert_array_equal(back.processing, processed.processing)
    np.testing.assert_array_equal(back.degrees, processed.degrees)
    policy = json.loads(read_parquet_schema(path).metadata[b"processing_policy"])
    assert (policy["smooth"], policy["cutoff_hz"], policy["fill"], policy["joint_frames_filled"]) == (
        "butterworth",
        6.0,
        "linear",
        4,
    )
    assert PROCESSING == ("measured", "smoothed", "filled")


def test_a_table_that_does_not_say_what_was_done_is_refused(tmp_path):
    write_angles(tmp_path / "angles.parquet", joint_angles(moving(2)))
    with pytest.raises(InputError, match="columns"):
        read_processed_angles(tmp_path / "angles.parquet")
    processed, _ = process_angles(moving(2), ProcessingConfig())
    write_processed_angles(tmp_path / "angles_processed.parquet", processed)
    with pytest.raises(InputError, match="has no 'processing_policy' in its metadata"):
        read_processed_angles(tmp_path / "angles_processed.parquet")
