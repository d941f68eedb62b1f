"""Missing frames, lost joints, and trials that cut a recording: measures neither lose nor invent time."""

import numpy as np
import pytest
from event_builder import HZ, buckling, ease, legs, tracked
from results_builder import standing_joints
from session_builder import measured, value, why

from anchorpose.joints import JOINT_INDEX, LOST
from anchorpose.recording.events import Trial, Trials
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import Measure
from anchorpose.results.stand_training.event import NO_ONSET
from anchorpose.results.tables import JointTable


def kept(joints: JointTable, rows: np.ndarray) -> JointTable:
    """The frames of a recorder that drops the others; its times are rounded to milliseconds."""
    return JointTable(
        joints.frame[rows],
        np.round(joints.time_s[rows], 3),
        joints.position_m[rows],
        joints.state_code[rows],
        joints.sigma_m[rows],
    )


def without(joints: JointTable, names: tuple[str, ...], rows: np.ndarray | list[int]) -> JointTable:
    """The joints, some of them lost in the given rows."""
    position, sigma, codes = joints.position_m.copy(), joints.sigma_m.copy(), joints.state_code.copy()
    for name in names:
        position[rows, JOINT_INDEX[name]] = sigma[rows, JOINT_INDEX[name]] = np.nan
        codes[rows, JOINT_INDEX[name]] = LOST
    return JointTable(joints.frame, joints.time_s, position, codes, sigma)


def of_trials(joints: JointTable, trials: Trials, name: str) -> list[Measure]:
    """The left measure of the whole recording, then of each trial."""
    _, rows = measure_session(joints, joint_angles(joints), (), MeasureConfig(), trials, ("bar",))
    own = [row for row in rows if row.measure == name and row.side == "left"]
    return [own[0], *(row for row in own if row.trial is not None)]


def test_a_knee_extended_before_a_trial_is_extended_in_it():
    """The knee is straight between the trials, and bent in them by less than what ends an extension."""
    time_s = np.arange(0.0, 33.0, 1.0 / HZ)
    pause = (time_s < 3.0) | (time_s % 10.0 > 8.0)
    bend = np.where(pause, 15.0, 22.5)
    joints = tracked(legs(bend, bend), 0.001, 3, fast_m=0.0002)
    trials = Trials((), tuple(Trial(k, "on", s, 4.0, s) for k, s in enumerate((4.0, 12.0, 22.0), 1)))
    whole, *each = of_trials(joints, trials, "knee_extended_alone_time")
    assert whole.value == pytest.approx(33.0, abs=0.1)
    assert [row.value for row in each] == pytest.approx([4.0, 4.0, 4.0], abs=0.05)


def test_a_trial_whose_onset_no_frame_shows_has_no_latency():
    time_s = np.arange(0.0, 40.0, 1.0 / HZ)
    bend = 35.0 - 30.0 * ease(time_s - 13.0)
    joints, trials = tracked(legs(bend, bend), 0.003, 3, fast_m=0.0003), Trials((), (Trial(1, "on", 10.0, 20.0, 10.0),))
    _, seen = of_trials(joints, trials, "knee_extended_latency")
    assert seen.value == pytest.approx(3.5, abs=0.1)
    silent = kept(joints, np.flatnonzero((time_s < 9.5) | (time_s > 12.5)))
    _, unseen = of_trials(silent, trials, "knee_extended_latency")
    assert unseen.value is None
    assert unseen.why == NO_ONSET
    late = kept(joints, np.flatnonzero((time_s < 9.5) | (time_s > 10.3)))
    _, soon = of_trials(late, trials, "knee_extended_latency")
    assert soon.value == pytest.approx(3.5, abs=0.1)


ONSETS_S = [3.0, 8.0, 13.0, 18.0, 23.0, 28.0]


def test_single_dropped_frames_hide_no_buckle():
    """The recorder drops a frame of twenty, at random; two in a row are rare."""
    count = 0.0
    for seed in range(6):
        joints = tracked(buckling(33.0, ONSETS_S, 40.0, 0.35), 0.004, seed)
        rows = np.flatnonzero(np.random.default_rng(seed).random(len(joints.frame)) >= 0.05)
        found = measured(kept(joints, rows))[1]
        count += value(found, "knee_buckle_count", "left")
        assert value(found, "knee_buckle_unseen_share", "left") < 0.1
    assert count == 6 * len(ONSETS_S)


def test_time_in_which_a_buckle_could_not_be_found_is_stated():
    joints = tracked(buckling(33.0, ONSETS_S, 40.0, 0.35), 0.004, 1)
    lost = measured(without(joints, ("KneeLeft",), np.flatnonzero((joints.time_s > 1.0) & (joints.time_s < 16.0))))[1]
    assert value(lost, "knee_buckle_count", "left") == 3
    assert value(lost, "knee_buckle_unseen_share", "left") == pytest.approx(15.0 / 33.0, abs=0.03)
    assert value(lost, "knee_buckle_unseen_share", "right") == pytest.approx(15.0 / 33.0, abs=0.03)
    rows = np.arange(len(joints.frame))
    found = measured(kept(joints, rows[rows % 8 < 5]))[1]  # never 0.4 s without a gap of three frames
    assert value(found, "knee_buckle_unseen_share", "left") > 0.9


def on_one_leg() -> JointTable:
    """The left foot is lifted for ten seconds."""
    joints = np.repeat(standing_joints()[None], round(16 * HZ), axis=0)
    lifted = slice(round(3 * HZ), round(13 * HZ))
    for name, by_m in (("Ankle", (-0.1, 0.2, 0.0)), ("Foot", (-0.1, 0.2, 0.0)), ("Knee", (0.15, 0.08, 0.0))):
        joints[lifted, JOINT_INDEX[f"{name}Left"]] += by_m
    return tracked(joints, 0.004, 0)


@pytest.mark.parametrize("gap", ["a lost ankle", "two dropped frames"])
def test_a_moment_without_the_raised_foot_does_not_halve_the_stance_on_one_leg(gap):
    joints, middle = on_one_leg(), round(8 * HZ)
    rows = np.arange(len(joints.frame))
    gone = without(joints, ("AnkleLeft",), [middle]) if gap == "a lost ankle" else kept(joints, rows[rows // 2 != 120])
    assert value(measured(gone)[1], "single_leg_stance", "right") == pytest.approx(10.0, abs=0.1)


def test_a_mean_over_time_does_not_depend_on_how_many_frames_were_kept():
    time_s = np.arange(0.0, 60.0, 1.0 / HZ)
    bend = np.where(time_s < 30.0, 5.0, 25.0)
    joints = tracked(legs(bend, bend), 0.003, 3, fast_m=0.0003)
    rows = np.arange(len(time_s))
    every, third = (measured(kept(joints, rows[some]))[1] for some in (rows >= 0, (time_s < 30.0) | (rows % 3 == 0)))
    for name in ("mean", "least", "greatest"):
        own, other = (value(found, f"knee_flexion_upright_{name}", "left") for found in (every, third))
        assert own == pytest.approx(other, abs=0.2), name


def test_a_step_that_was_not_seen_is_not_skipped_over():
    """Stepping in place, a step every 0.6 s; the left ankle is lost for 0.8 s of every 4 s."""
    time_s = np.arange(0.0, 40.0, 1.0 / HZ)
    joints = np.repeat(standing_joints()[None], len(time_s), axis=0)
    for side, phase_s in (("Left", 0.0), ("Right", 0.6)):
        swing = ((time_s - phase_s) % 1.2) / 0.4
        lift = np.where((swing < 1.0) & (time_s > 2.0) & (time_s < 38.0), 0.15 * np.sin(np.pi * swing) ** 2, 0.0)
        for name, share in (("Ankle", 1.0), ("Foot", 1.0), ("Knee", 0.5)):
            joints[:, JOINT_INDEX[f"{name}{side}"], 1] += share * lift
    seen = tracked(joints, 0.003, 0, fast_m=0.0005)
    hidden = without(seen, ("AnkleLeft",), np.flatnonzero(time_s % 4.0 < 0.8))
    for session in (seen, hidden):
        assert value(measured(session)[1], "step_time_mean") == pytest.approx(0.6, abs=0.03)


def test_a_recording_of_one_frame_has_reasons_and_no_error():
    one = measured(kept(tracked(legs(np.full(3, 8.0), np.full(3, 8.0)), 0.003, 1), np.arange(1)))[1]
    assert why(one, "upright_time")
