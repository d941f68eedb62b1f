"""Clocks: known answers in a room where people of cylinders move, laws of the fit, and refusals where nothing moves."""

from dataclasses import replace

import numpy as np
import pytest
from moving_room import FRONT, LEFT, MovingRoom, shown_s, standing
from room_builder import unposed

from anchorpose.calibration import clocks
from anchorpose.calibration.clock_lags import LEAST_PEAK, MotionSignal, PairLag, RoughLag, motion_signal, signal_lags
from anchorpose.calibration.clock_surfaces import make_clip, surface_lag
from anchorpose.calibration.clocks import ClockConfig, ClockSource, NoClock, clock_notes, estimate_clocks, fit_clocks
from anchorpose.calibration.first_frames import level_of_pose
from anchorpose.recording.recording import Clock

AHEAD_S = 0.613  # neither a whole number of frames nor half of one
LEVELS = (level_of_pose(FRONT.require_pose()), level_of_pose(LEFT.require_pose()))


@pytest.fixture(scope="module")
def room() -> MovingRoom:
    return MovingRoom((FRONT, LEFT), (Clock(), Clock(ahead_s=AHEAD_S)))


def clip(room: MovingRoom, camera: int):
    times_s = room.times_s[camera][10:55]
    return make_clip(room.cameras[camera], [(t, room.read(camera, k)) for k, t in enumerate(times_s, 10)])


def test_a_clock_and_its_inverse_are_one():
    clock = Clock(ahead_s=-1.2, drift=8e-5, at_s=300.0)
    for time_s in (0.0, 300.0, 600.0):
        assert clock.reference_s(np.array([shown_s(clock, time_s)]))[0] == pytest.approx(time_s, abs=1e-9)
    assert shown_s(clock, 600.0) - 600.0 == pytest.approx(-1.2 + 300 * 8e-5)


@pytest.mark.thorough
def test_shared_surfaces_give_the_lag_to_three_milliseconds_and_it_turns_its_sign_with_the_cameras(room):
    found = surface_lag(clip(room, 0), clip(room, 1), AHEAD_S + 0.05, 0.12)
    assert found.lag_s == pytest.approx(AHEAD_S, abs=0.003)
    assert abs(found.lag_s - AHEAD_S) < 4.0 * np.hypot(found.sigma_s, 0.001)
    there = surface_lag(clip(room, 0), clip(room, 1), AHEAD_S, 0.12)
    back = surface_lag(clip(room, 1), clip(room, 0), -AHEAD_S, 0.12)
    assert there.lag_s == pytest.approx(-back.lag_s, abs=3e-4)


def test_a_wrong_pose_of_centimetres_does_not_bias_the_lag(room):
    moved = room.cameras[1].T_world_camera.copy()
    moved[:3, 3] += [0.015, 0.0, -0.01]
    other = replace(clip(room, 1), camera=replace(room.cameras[1], T_world_camera=moved))
    found = surface_lag(clip(room, 0), other, AHEAD_S, 0.12)
    assert found.lag_s == pytest.approx(AHEAD_S, abs=0.008)


@pytest.mark.thorough
def test_signals_give_the_lag_without_any_pose(room):
    signals = [
        motion_signal(
            [(t, room.read(k, n)) for n, t in enumerate(room.times_s[k])], unposed(room.cameras[k]), level, 0.0012
        )
        for k, level in enumerate(LEVELS)
    ]
    best, *others = signal_lags(*signals, 0.0, 2.0)
    assert best.lag_s == pytest.approx(AHEAD_S, abs=0.06)
    assert best.peak > LEAST_PEAK > max(other.peak for other in others)


def test_a_signal_agrees_with_itself_where_it_was_shifted_to():
    rng = np.random.default_rng(1)
    time_s = np.arange(300) / 30.0
    speed = np.abs(np.cumsum(rng.normal(size=(300, 8)), axis=0))
    best = signal_lags(MotionSignal(time_s, speed), MotionSignal(time_s + 3.217, speed), 3.0, 1.0)[0]
    assert (best.lag_s, best.peak) == (pytest.approx(3.217, abs=0.002), pytest.approx(1.0, abs=0.01))
    assert best.is_certain


@pytest.mark.parametrize("epoch_s", [0.0, 1.7e9])
def test_clocks_are_found_whatever_their_epoch(room, epoch_s):
    other = MovingRoom(room.cameras, (Clock(), Clock(ahead_s=AHEAD_S + epoch_s)))
    other.made = room.made
    found = estimate_clocks(other, LEVELS, ClockConfig()).cameras[1]
    assert found.source is ClockSource.SURFACES
    assert found.clock.ahead_s - epoch_s == pytest.approx(AHEAD_S, abs=0.005)
    assert abs(found.clock.drift) < 2e-4
    assert found.sigma_s < 0.005


def test_where_nobody_moves_no_clock_is_touched():
    still = MovingRoom((FRONT, LEFT), (Clock(), Clock(ahead_s=0.2)), scene=standing, seconds=3.0)
    found = estimate_clocks(still, LEVELS, ClockConfig())
    assert found.cameras[1].clock == Clock()
    assert found.cameras[1].source is ClockSource.KEPT
    assert found.cameras[1].doubt in (NoClock.NO_MOTION, NoClock.UNSURE)
    assert "used as it is" in clock_notes(found)[0]


def test_with_a_few_frames_no_clock_is_estimated_and_nothing_is_read():
    short = MovingRoom((FRONT, LEFT), (Clock(), Clock()), seconds=0.3)
    assert estimate_clocks(short, LEVELS, ClockConfig()).cameras[1].doubt is NoClock.FEW_FRAMES
    assert short.reads == 0


OFFSETS_S, DRIFTS = np.array([0.0, 1.3, -0.4]), np.array([0.0, 9e-5, -4e-5])


def lags_of(ahead_s, drift, noise_s, seed=0):
    rng = np.random.default_rng(seed)
    return [
        PairLag(a, b, t, ahead_s[b] - ahead_s[a] + (drift[b] - drift[a]) * (t - 300.0) + rng.normal(0, noise_s), 0.002)
        for t in (50.0, 150.0, 250.0, 350.0, 450.0, 550.0)
        for a, b in ((0, 1), (0, 2), (1, 2))
    ]


def test_offsets_and_drifts_come_back_from_the_lags_and_a_camera_that_none_reaches_has_no_clock():
    fit = fit_clocks(lags_of(OFFSETS_S, DRIFTS, 0.0), 3)
    assert (fit.at_s, fit.ahead_s) == (pytest.approx(300.0), pytest.approx(OFFSETS_S, abs=1e-5))
    assert fit.drift == pytest.approx(DRIFTS, abs=1e-6)
    fit = fit_clocks([lag for lag in lags_of(np.zeros(3), np.zeros(3), 0.001) if lag.second == 1], 3)
    assert np.isfinite(fit.ahead_s[1])
    assert np.isnan(fit.ahead_s[2])


def test_the_stated_error_of_the_fit_is_calibrated():
    off = []
    for seed in range(40):
        fit = fit_clocks(lags_of(OFFSETS_S, DRIFTS, 0.002, seed), 3)
        off.append((fit.ahead_s[1] - OFFSETS_S[1]) / fit.sigma_s(1, fit.at_s))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_one_wrong_window_is_left_out():
    lags = lags_of(OFFSETS_S, DRIFTS, 0.001)
    lags[4] = replace(lags[4], lag_s=lags[4].lag_s + 0.1)
    fit = fit_clocks(lags, 3)
    assert (len(fit.used), fit.ahead_s) == (len(lags) - 1, pytest.approx(OFFSETS_S, abs=0.003))


@pytest.mark.parametrize(("scatter_s", "ahead_s"), [(0.0005, 0.0), (0.03, -2.95)])
def test_time_stamps_win_over_a_lag_of_signals_only_if_surfaces_agree_at_them(room, monkeypatch, scatter_s, ahead_s):
    def measured(_, rough, times_s):
        off_s = scatter_s if rough[1].lag_s == 0.0 else 0.03
        return [PairLag(0, 1, at_s, sign * off_s, 0.001) for at_s, sign in ((2.0, 1.0), (2.0, -1.0))]

    repeating = [RoughLag(0.0, 0.0, certain=True), RoughLag(-2.95, 5.0, certain=True)]
    monkeypatch.setattr(clocks, "fine_lags", measured)
    monkeypatch.setattr(clocks, "rough_lags", lambda *_: repeating)
    found = estimate_clocks(room, LEVELS, ClockConfig()).cameras[1]
    assert found.clock.ahead_s == pytest.approx(ahead_s, abs=0.02)
