"""A regular time: what lies on a grid is not touched, nothing is put into a gap, and what is between is linear."""

import numpy as np
import pytest
from exports_builder import make_samples, times
from hypothesis import given
from hypothesis import strategies as st

from anchorpose.errors import AnchorposeError
from anchorpose.exports.regular_time import NEAR_SHARE, TimeBase, near_in_time, regular_samples


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 29.97, 30.0])
@pytest.mark.parametrize("start_s", [0.0, 12345.678])
def test_stamps_to_the_microsecond_are_regular_and_pass_bit_for_bit(rate_hz, start_s):
    time_s = np.round(start_s + np.arange(9000) / rate_hz, 6)
    samples = make_samples(time_s)
    regular = regular_samples(samples)
    assert regular.base is TimeBase.AS_RECORDED
    assert regular.rate_hz == rate_hz
    assert np.array_equal(regular.samples.time_s, time_s)
    assert np.array_equal(regular.samples.position_m, samples.position_m)
    assert np.array_equal(regular.samples.angle_state_code, samples.angle_state_code)


@given(st.sets(st.integers(1, 58), min_size=1, max_size=30))
def test_frames_that_were_dropped_come_back_empty_and_the_others_stay(dropped):
    kept = np.array([row for row in range(60) if row not in dropped])
    samples = make_samples(times(60)[kept])
    regular = regular_samples(samples)
    slow = (np.diff(kept) > 1) & near_in_time(samples.time_s)  # every second frame or more was dropped for a while
    if regular.rate_hz == 15.0 and not slow.any():
        assert regular.base is TimeBase.GAPS_FILLED_UP
        assert np.array_equal(np.flatnonzero(regular.interpolation.recorded), kept)
        assert np.array_equal(regular.samples.time_s[kept], samples.time_s)
        assert np.array_equal(regular.samples.position_m[kept], samples.position_m)
    empty = ~regular.interpolation.bridged  # with every second frame dropped, the rest may have to be resampled
    assert np.isnan(regular.samples.position_m[empty]).all()
    assert (regular.samples.joint_state_code[empty] == 6).all()
    assert np.allclose(np.diff(regular.samples.time_s), 1.0 / regular.rate_hz, atol=2e-6)


def test_jitter_is_resampled_to_the_round_rate_and_straight_motion_stays_straight():
    rng = np.random.default_rng(5)
    time_s = np.arange(300) / 30.0 + rng.uniform(-0.004, 0.004, 300)
    regular = regular_samples(make_samples(time_s))
    assert regular.base is TimeBase.RESAMPLED
    assert regular.rate_hz == 30.0
    assert np.allclose(np.diff(regular.samples.time_s), 1.0 / 30.0)
    off = np.abs(regular.samples.position_m[:, 4, 1] - regular.samples.time_s)
    assert np.nanmax(off) < NEAR_SHARE / 30.0  # those that are taken as they are
    assert not np.isnan(off).any()
    assert np.allclose(regular.samples.degrees[:, 0], 10.0 * regular.samples.time_s, atol=0.01)


@pytest.mark.parametrize("seed", range(10))
def test_the_rate_of_a_short_recording_that_jitters_is_that_of_its_camera(seed):
    rng = np.random.default_rng(seed)
    kept = np.delete(np.arange(75), rng.choice(np.arange(1, 74), 3, replace=False))
    regular = regular_samples(make_samples((np.arange(75) / 15.0 + rng.normal(0.0, 0.004, 75))[kept]))
    assert regular.rate_hz == 15.0
    assert len(regular.samples.time_s) in (74, 75)  # from the first stamp to the last


def test_nothing_is_put_into_a_gap_when_resampling():
    rng = np.random.default_rng(6)
    time_s = np.arange(300) / 30.0 + rng.uniform(-0.004, 0.004, 300)
    time_s = np.delete(time_s, slice(100, 103))
    regular = regular_samples(make_samples(time_s))
    inside = (regular.samples.time_s > time_s[99] + 0.001) & (regular.samples.time_s < time_s[100] - 0.001)
    assert inside.sum() >= 3
    assert np.isnan(regular.samples.position_m[inside]).all()
    assert np.isnan(regular.samples.degrees[inside]).all()
    assert (regular.samples.joint_state_code[inside] == 6).all()
    assert not np.isnan(regular.samples.position_m[~inside]).any()


def test_a_value_between_a_known_and_a_lost_one_is_not_made_up_and_the_state_is_the_worse():
    time_s = np.array([0.0, 0.1, 0.2, 0.3, 0.44, 0.5, 0.6, 0.7, 0.8, 0.9])  # a late frame: 0.4 is between
    samples = make_samples(time_s)
    samples.position_m[3, 7] = np.nan
    samples.joint_state_code[3, 7] = 6
    samples.joint_state_code[4, 8] = 2
    regular = regular_samples(samples)
    assert regular.base is TimeBase.RESAMPLED
    row = int(np.argmin(np.abs(regular.samples.time_s - 0.4)))
    assert np.isnan(regular.samples.position_m[row, 7]).all()
    assert (regular.samples.joint_state_code[row, 7], regular.samples.joint_state_code[row, 8]) == (6, 2)
    assert regular.samples.position_m[row, 8, 0] == pytest.approx(0.4)


def test_angles_are_interpolated_the_short_way_round():
    time_s = np.array([0.0, 0.1, 0.2, 0.35, 0.45, 0.55])
    samples = make_samples(time_s)
    samples.degrees[:, 0] = [170.0, 172.0, 176.0, -176.0, -172.0, -170.0]
    regular = regular_samples(samples)
    row = int(np.argmin(np.abs(regular.samples.time_s - 0.3)))
    turned = np.radians(regular.samples.degrees[row, 0])
    assert np.cos(turned) < -0.99


SLOWED = np.cumsum([0.0] + [1 / 30] * 104 + [1 / 15] * 45)  # a camera that falls to half its rate in poor light


@pytest.mark.parametrize("jitter_s", [0.0, 0.0008])
def test_a_camera_that_slows_down_leaves_no_gaps_and_what_it_drops_is_one(jitter_s):
    stamps = SLOWED + np.random.default_rng(0).uniform(-jitter_s, jitter_s, len(SLOWED))
    regular = regular_samples(make_samples(stamps))
    assert (regular.base, regular.rate_hz, len(regular.samples.time_s)) == (TimeBase.RESAMPLED, 30.0, 195)
    assert np.abs(regular.samples.position_m[:, 4, 1] - regular.samples.time_s).max() < NEAR_SHARE / 30.0
    kept = np.delete(np.arange(len(stamps)), [40, 128])  # one frame of each part
    gaps = np.flatnonzero(~near_in_time(stamps[kept]))
    assert gaps.tolist() == [39, 126]
    empty = ~regular_samples(make_samples(stamps[kept])).interpolation.bridged
    assert 4 <= empty.sum() <= 6  # gaps of two and of four frame intervals of the grid


def test_what_a_slow_part_or_a_pause_leaves_unknown_is_not_bridged():
    pauses = np.concatenate([np.arange(60) / 30.0, 2.0 + 0.6 * np.arange(1, 40)])  # single frames 0.6 s apart
    assert np.flatnonzero(~near_in_time(pauses)).tolist() == list(range(59, 98))
    assert near_in_time(0.6 * np.arange(40)).all()  # the rate of the whole recording
    assert near_in_time(np.array([0.0, 0.1])).all()


def test_a_recorder_that_drops_every_third_frame_has_a_rate_and_no_gaps():
    assert near_in_time(np.delete(np.arange(150) / 30.0, np.arange(2, 150, 3))).all()


@pytest.mark.parametrize("time_s", [[0.0], [0.0, 0.1, 0.2, 0.3, 500.0]])
def test_one_frame_and_a_long_pause_are_refused(time_s):
    with pytest.raises(AnchorposeError, match="csv"):
        regular_samples(make_samples(np.array(time_s)))
