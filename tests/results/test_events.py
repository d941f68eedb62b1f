"""Events: buckles, failed stands, recovery steps and tremor of made-up sessions with errors like tracked ones.

Every figure is over seeds: at least 95 of 100 found, onset within 0.1 s, nothing found where nothing happens.
"""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from event_builder import HZ, buckling, ease, falling, legs, rising, still, tracked
from session_builder import measured, squatting_joints, value, why

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.recording.events import Trial, Trials
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import EVENT_KINDS, Episode, read_episodes, write_episodes
from anchorpose.results.stand_training.event import TOO_SLOW, EventConfig
from anchorpose.results.tables import JointTable
from anchorpose.simulate.config import single
from anchorpose.simulate.patient import draw_patient
from anchorpose.simulate.person import draw_person

SIGMA_M = 0.006
FOUND = 0.95
ONSET_S = 0.1


def events(joints: JointTable, kind: str) -> list[Episode]:
    return [episode for episode in measured(joints)[0].episodes if episode.kind == kind]


def all_events(joints: JointTable) -> list[str]:
    return [episode.kind for episode in measured(joints)[0].episodes if episode.kind in EVENT_KINDS]


def onsets(seed: int, count: int = 6, apart_s: float = 5.0) -> list[float]:
    return (3.0 + apart_s * np.arange(count) + np.random.default_rng(seed).uniform(0.0, 1.0, count)).tolist()


@pytest.mark.parametrize("sigma_m", [0.003, 0.006, 0.010])
@pytest.mark.parametrize(("depth_deg", "fall_s"), [(25.0, 0.45), (30.0, 0.3), (60.0, 0.2)])
def test_a_knee_that_gives_way_is_found_with_its_onset_side_and_depth(depth_deg, fall_s, sigma_m):
    matched, total, within, others = 0, 0, [], []
    for seed in range(4):
        times_s = onsets(seed)
        joints = tracked(buckling(35.0, times_s, depth_deg, fall_s), sigma_m, seed)
        found = events(joints, "knee_buckle_left")
        others += [kind for kind in all_events(joints) if kind != "knee_buckle_left"]
        total += len(times_s)
        for onset_s in times_s:
            near = [event for event in found if abs(event.start_s - onset_s) <= ONSET_S]
            matched += len(near) == 1
            within += [abs(event.depth - depth_deg) <= 1.96 * event.sigma for event in near]
            assert all((event.side, event.unit) == ("left", "deg") for event in near)
        assert len(found) <= len(times_s)
    assert matched >= FOUND * total
    assert np.mean(within) >= 0.9
    assert others == []


def test_the_stated_sigma_of_a_depth_is_that_of_the_errors():
    """Errors change slowly, so that both ends of a fast flexion share most of them: sigma is on the safe side."""
    depths = [
        event.depth - 30.0
        for seed in range(8)
        for event in events(tracked(buckling(35.0, onsets(seed), 30.0, 0.3), 0.010, seed), "knee_buckle_left")
    ]
    stated = events(tracked(buckling(35.0, onsets(0), 30.0, 0.3), 0.010, 0), "knee_buckle_left")[0].sigma
    assert np.mean(np.abs(depths) < 1.96 * stated) >= 0.95
    assert stated < 10.0 * np.std(depths)


def test_a_mirror_exchanges_the_sides_of_a_buckle():
    joints = buckling(12.0, [4.0], 35.0, 0.3) * [1, 1, -1]
    swap = [name.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for name in JOINT_NAMES]
    found = all_events(tracked(joints[:, [JOINT_INDEX[name] for name in swap]], SIGMA_M, 1))
    assert found == ["knee_buckle_right"]


def test_what_is_no_buckle():
    """A squat, a knee that is lowered slowly, a foot that is raised, and sitting down."""
    time_s = np.arange(0.0, 60.0, 1.0 / HZ)
    squat = 6.0 + 80.0 * (0.5 - 0.5 * np.cos(2.0 * np.pi * time_s / 2.0))
    assert all_events(tracked(legs(squat, squat), SIGMA_M, 1)) == []
    slow = 6.0 + 25.0 * ease((time_s - 5.0) / 2.0)
    assert all_events(tracked(legs(slow, 6.0 + 0.4 * (slow - 6.0)), SIGMA_M, 2)) == []
    raised = 60.0 * (ease((time_s % 4.0) / 0.4) - ease((time_s % 4.0 - 1.0) / 0.4))
    joints = legs(6.0 + 0.0 * raised, 6.0 + 0.0 * raised)
    half = np.radians(raised) / 2.0
    joints[:, JOINT_INDEX["KneeLeft"], 0] += 0.42 * np.sin(half)
    joints[:, [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["FootLeft"]], 1] += (0.84 * (1.0 - np.cos(half)))[:, None]
    assert all_events(tracked(joints, SIGMA_M, 3)) == []
    sits = np.concatenate([np.zeros(150), 85.0 * ease(np.linspace(0.0, 1.0, 15)), np.full(150, 85.0)])
    found = measured(tracked(squatting_joints(sits), SIGMA_M, 4))[0].episodes
    assert "stand_to_sit" in [episode.kind for episode in found]
    assert not {episode.kind for episode in found} & set(EVENT_KINDS)


@pytest.mark.thorough
def test_standing_for_ten_minutes_has_no_event_whatever_the_errors():
    for sigma_m in (0.006, 0.012, 0.025):
        assert len(all_events(tracked(still(600.0), sigma_m, 5))) == 0


def simulated(seed: int, motions: tuple[str, ...], speed: str, seconds: float = 50.0) -> np.ndarray:
    """Joints (n, 21, 3) of a simulated patient who does the motions."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / HZ)
    config = replace(single(seed, seconds=seconds, fps=HZ), motions=motions, speed=speed)
    person = draw_person(rng, 0.0)
    actor = draw_patient(rng, config, person, None)
    parts = [actor.bones(time_s[first : first + 300]) for first in range(0, len(time_s), 300)]
    return np.concatenate([np.array([person.body.joints(bones) for bones in part]) for part in parts])


@pytest.mark.slow
@pytest.mark.parametrize("speed", ["slow", "normal", "fast"])
@pytest.mark.parametrize("motions", [("squat",), ("steps",), ("sit-to-stand", "squat", "reach"), ("mixed",)])
def test_ten_simulated_minutes_without_an_event_have_at_most_one(motions, speed):
    """50 s of each of the twelve kinds of session, so that all of them together are ten minutes."""
    joints = tracked(simulated(1, motions, speed), SIGMA_M, 1)
    assert all_events(joints) == []
    found = measured(joints)[1]
    assert [row.value for (name, *_), row in found.items() if name.startswith("tremor") and row.value] == []


def test_a_knee_that_is_not_known_well_has_no_event_but_time_unseen():
    joints = tracked(buckling(30.0, [5.0, 15.0], 35.0, 0.3), SIGMA_M, 1)
    unsure = joints.sigma_m.copy()
    unsure[300:, JOINT_INDEX["KneeLeft"]] = 0.08
    hidden = joints.state_code.copy()
    hidden[300:, JOINT_INDEX["KneeLeft"]] = STATE_CODE[JointState.HIDDEN_BY_EQUIPMENT]
    session, found = measured(replace(joints, sigma_m=unsure, state_code=hidden))
    assert [e.kind for e in session.episodes if e.kind in EVENT_KINDS] == ["knee_buckle_left"]
    assert value(found, "knee_buckle_unseen_share", "left") == pytest.approx(2 / 3, abs=0.02)
    assert value(found, "knee_buckle_rate", "left") == pytest.approx(600.0 / 10.0, rel=0.05)
    assert value(measured(joints)[1], "knee_buckle_unseen_share", "left") == 0.0
    unknown = measured(replace(joints, sigma_m=np.full_like(unsure, 0.2)))[1]
    assert "in no frame" in why(unknown, "knee_buckle_count", "left")


def test_frames_too_far_apart_are_refused():
    joints = tracked(buckling(30.0, [5.0], 35.0, 0.3), SIGMA_M, 1).frames(slice(None, None, 4))
    found = measured(joints)[1]
    for name, side in (("knee_buckle_count", "left"), ("failed_stand_rate", None), ("recovery_step_latency", "right")):
        assert why(found, name, side) == TOO_SLOW
    assert "20 frames a second" in why(found, "tremor_knee_time", "left")


@pytest.mark.parametrize("sigma_m", [0.006, 0.015])
@pytest.mark.parametrize("lowest_deg", [60.0, 50.0, 45.0])
def test_a_stand_that_fails_is_found_with_its_onset_and_how_far_it_went(lowest_deg, sigma_m):
    late, total = list[float](), 0
    for seed in range(4):
        thigh_deg, times_s = rising([lowest_deg] * 6)
        joints = squatting_joints(thigh_deg)
        height = joints[:, JOINT_INDEX["HipLeft"], 1] - 0.08
        truth = (height.max() / 0.84 - height.min() / 0.84) / (1.0 - height.min() / 0.84)
        found = events(tracked(joints, sigma_m, seed), "failed_stand")
        total += len(times_s)
        late += [min((event.start_s - onset_s for onset_s in times_s), key=abs) for event in found]
        assert [abs(event.depth - truth) <= 1.96 * event.sigma + 0.03 for event in found].count(False) <= 1
        assert {(event.side, event.unit) for event in found} == {(None, "1")}
    assert (np.abs(late) <= ONSET_S).sum() >= FOUND * total
    assert len(late) <= total


def test_who_stands_up_or_shifts_in_the_seat_does_not_fail_to_stand():
    assert events(tracked(squatting_joints(rising([0.0, 0.0, 0.0])[0]), SIGMA_M, 1), "failed_stand") == []
    assert events(tracked(squatting_joints(rising([80.0, 75.0, 80.0])[0]), SIGMA_M, 1), "failed_stand") == []
    quick = rising([0.0, 0.0], stood_s=3.0)[0]
    found = measured(tracked(squatting_joints(quick), SIGMA_M, 1))[1]
    assert value(found, "failed_stand_count") == 0.0
    assert value(found, "sit_to_stand_count") == 2.0


@pytest.mark.parametrize(("ahead", "aside", "body_m"), [(1.0, 0.0, 0.3), (0.0, -1.0, 0.2), (-1.0, 0.0, 0.15)])
def test_a_step_that_catches_the_body_is_a_recovery_step(ahead, aside, body_m):
    """The truth of the onset is when the extrapolated centre of mass of the exact joints leaves the feet."""
    times_s, matched = [4.0, 12.0, 20.0, 28.0], 0
    exact_m = falling(36.0, times_s, (ahead, aside), body_m)
    truth = [event.start_s for event in events(tracked(exact_m, 1e-6, 0, fast_m=0.0), "recovery_step_left")]
    assert len(truth) == len(times_s)
    assert all(0.0 < start_s - onset_s < 0.5 for start_s, onset_s in zip(truth, times_s, strict=True))
    for seed in range(5):
        found = events(tracked(exact_m, SIGMA_M, seed), "recovery_step_left")
        matched += sum(any(abs(event.start_s - start_s) <= ONSET_S for event in found) for start_s in truth)
        assert len(found) <= len(truth)
    assert matched >= FOUND * 5 * len(truth)


def test_a_slow_step_and_leaning_on_a_rail_are_no_recovery():
    assert all_events(tracked(falling(20.0, [4.0, 12.0], (1.0, 0.0), 0.08), SIGMA_M, 1)) == []
    leant = falling(20.0, [6.0], (1.0, 0.0), 0.08)
    above = [row for row, name in enumerate(JOINT_NAMES) if not name.startswith(("Ankle", "Foot", "Knee"))]
    leant[:, above, 0] += 0.28  # beyond the toes all the time
    assert all_events(tracked(leant, SIGMA_M, 1)) == []


@pytest.mark.parametrize("hz", [20.0, 30.0])
@pytest.mark.parametrize("tremor_hz", [3.3, 5.0, 7.5])
def test_clonus_is_found_with_its_time_frequency_and_amplitude(tremor_hz, hz):
    time_s = np.arange(0.0, 40.0, 1.0 / hz)
    shaking = 2.0 * np.sin(2.0 * np.pi * tremor_hz * time_s) * ((time_s > 10.0) & (time_s < 20.0))
    sway = 3.0 * np.sin(2.0 * np.pi * 0.3 * time_s)
    joints = tracked(legs(6.0 + shaking + sway, 6.0 + sway), SIGMA_M, 1, hz)
    found = measured(joints)[1]
    assert value(found, "tremor_knee_time", "left") == pytest.approx(10.0, abs=2.0)
    row = found["tremor_knee_frequency", "left", None, None]
    assert row.value == pytest.approx(tremor_hz, abs=1.96 * row.sigma)
    row = found["tremor_knee_amplitude", "left", None, None]
    assert row.value == pytest.approx(2.0, abs=1.96 * row.sigma)
    assert value(found, "tremor_knee_time", "right") == 0.0
    assert "no such oscillation" in why(found, "tremor_knee_frequency", "right")


def test_errors_are_no_tremor_and_what_is_not_seen_has_none():
    joints = tracked(still(120.0), 0.015, 3)
    found = measured(joints)[1]
    assert [value(found, f"tremor_{joint}_time", s) for joint in ("knee", "ankle") for s in ("left", "right")] == [
        0.0
    ] * 4
    hidden = joints.state_code.copy()
    hidden[:, JOINT_INDEX["KneeLeft"]] = STATE_CODE[JointState.HIDDEN]
    found = measured(replace(joints, state_code=hidden))[1]
    assert "never seen" in why(found, "tremor_knee_time", "left")
    assert value(found, "tremor_knee_time", "right") == 0.0


def test_a_trial_has_the_events_that_begin_in_it_and_its_latencies():
    """The second trial begins with both knees bent by 35 degrees, which straighten after 2 s."""
    joints = buckling(40.0, [4.0, 19.8, 33.0], 35.0, 0.4)
    time_s = np.arange(0.0, 40.0, 1.0 / HZ)
    bent = 35.0 * (ease((time_s - 8.0) / 1.0) - ease((time_s - 12.0) / 0.5))
    joints[240:400] = legs(6.0 + bent, 6.0 + bent)[240:400]
    table = tracked(joints, SIGMA_M, 1)
    rows = [Trial(k + 1, "off" if k % 2 else "on", 10.0 * k, 10.0, 10.0 * k) for k in range(4)]
    _, measures = measure_session(table, joint_angles(table), (), MeasureConfig(), Trials((), tuple(rows)))
    found = {(row.trial or row.condition, *row.key): row for row in measures}
    counts = [found[k, "knee_buckle_count", "left", None, None].value for k in (1, 2, 3, 4, "on", "off")]
    assert counts == [1.0, 1.0, 0.0, 1.0, 0.5, 1.0]
    latencies = [found[k, "knee_buckle_latency", "left", None, None] for k in (1, 2, 3, 4)]
    assert [row.value for row in latencies] == [pytest.approx(t, abs=0.1) if t else None for t in (4.0, 9.8, None, 3.0)]
    assert latencies[2].why == "no such event was seen"
    extended = found[2, "knee_extended_latency", "right", None, None]
    assert extended.value == pytest.approx(2.2, abs=0.15)
    assert 0.0 < extended.sigma < 0.5
    assert "from the first frame" in found[1, "knee_extended_latency", "right", None, None].why


def test_events_are_written_with_side_depth_and_sigma_and_older_files_have_none(tmp_path):
    session = measured(tracked(buckling(12.0, [4.0], 35.0, 0.3), SIGMA_M, 1))[0]
    write_episodes(tmp_path / "episodes.parquet", session.episodes)
    back = read_episodes(tmp_path / "episodes.parquet")
    assert set(back) == set(session.episodes)
    assert [(e.side, e.depth is None) for e in back] == [(None, True), ("left", False)]
    older = pq.read_table(tmp_path / "episodes.parquet").drop_columns(["side", "depth", "sigma", "unit"])
    pq.write_table(older, tmp_path / "older.parquet")
    nothing = {"side": None, "depth": None, "sigma": None, "unit": None}
    assert read_episodes(tmp_path / "older.parquet") == tuple(replace(episode, **nothing) for episode in back)


def test_a_smaller_limit_finds_smaller_buckles():
    joints = tracked(buckling(12.0, [4.0], 14.0, 0.3), 0.003, 1)
    assert all_events(joints) == []
    config = MeasureConfig(events=EventConfig(buckle_deg=10.0, lead_deg=5.0))
    session, _ = measure_session(joints, joint_angles(joints), (), config)
    assert [e.kind for e in session.episodes if e.kind in EVENT_KINDS] == ["knee_buckle_left"]


@pytest.mark.slow
def test_knees_of_simulated_patients_that_give_way_are_found_as_in_the_exact_joints():
    """The truth is that of the exact joints; a simulated pelvis sinks on both sides, so that both knees bend."""
    exact, total, matched = [], 0, 0
    for seed in range(6):
        joints_m = simulated(seed, ("buckle",), "normal")
        exact = [
            (event.kind, event.start_s)
            for event in measured(tracked(joints_m, 1e-6, 0, fast_m=0.0))[0].episodes
            if event.kind in EVENT_KINDS
        ]
        found = [e for e in measured(tracked(joints_m, SIGMA_M, seed))[0].episodes if e.kind in EVENT_KINDS]
        near = [any(e.kind == kind and abs(e.start_s - start_s) <= ONSET_S for e in found) for kind, start_s in exact]
        total, matched = total + len(near), matched + sum(near)
        assert {kind for kind, _ in exact} <= {"knee_buckle_left", "knee_buckle_right"}
    assert total > 60
    assert matched >= FOUND * total
