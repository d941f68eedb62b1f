"""Simulated sessions of trials: knees bend as planned, events lie where the joints show them, help comes in time."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from anchorpose.body.contact_regions import REGIONS
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.events import RecordedSpan, read_trials
from anchorpose.rotations import unit
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.movements import GivingWay
from anchorpose.simulate.sessions.plan import BLOCK, RESTING_DEG, SessionConfig, draw_plan
from anchorpose.simulate.sessions.preset import stimulation
from anchorpose.simulate.sessions.truth import TrueEvent, true_events
from anchorpose.simulate.timeline import Movement
from anchorpose.simulate.touches import touches
from anchorpose.simulate.write import simulate_recording

HZ = 100.0
SIDES = ("left", "right")


@cache
def clinic(seed: int = 5, **session: object) -> Clinic:
    return draw_clinic(stimulation(seed, SessionConfig(**{"trials": 8, "trial_s": 12.0} | session)))


def joints(drawn: Clinic, times_s: np.ndarray) -> dict[str, np.ndarray]:
    body = drawn.patient.person.body
    found = np.array([body.joints(bones) for bones in drawn.patient.bones(times_s)])
    return {name: found[:, index] for name, index in JOINT_INDEX.items()}


def knee_deg(drawn: Clinic, side: str, times_s: np.ndarray) -> np.ndarray:
    at = joints(drawn, times_s)
    hip, knee, ankle = (at[f"{name}{side.capitalize()}"] for name in ("Hip", "Knee", "Ankle"))
    return np.degrees(np.arccos(np.clip((unit(knee - hip) * unit(ankle - knee)).sum(axis=1), -1.0, 1.0)))


def events(kind: str, seeds: range = range(5, 8)) -> list[tuple[Clinic, TrueEvent]]:
    drawn = [clinic(seed, incidents=2) for seed in seeds]
    found = [(one, event) for one in drawn for event in true_events(one.patient) if event.kind.startswith(kind)]
    assert len(found) == 2 * len(drawn)
    return found


def test_knees_hold_as_planned_and_straighten_fully():
    drawn = clinic(effect_deg=10.0, incidents=0)
    straightest = 90.0
    for trial in drawn.plan:
        held_s, rests_s = np.linspace(*trial.holds_s, 20), np.array([trial.onset_s])
        for side, held_deg in zip(SIDES, trial.held_deg, strict=True):
            assert knee_deg(drawn, side, held_s) == pytest.approx(held_deg, abs=0.05)
            assert knee_deg(drawn, side, rests_s) == pytest.approx(RESTING_DEG, abs=0.05)
            straightest = min(straightest, held_deg)
    assert straightest < 3.0  # which other patients never reach: their knees stay bent by 20 degrees


def test_feet_of_a_carried_pelvis_stay_where_they_are():
    drawn = clinic(incidents=0)
    at = joints(drawn, np.arange(0.0, 60.0, 0.1))
    for side in ("Left", "Right"):
        assert np.ptp(at[f"Ankle{side}"], axis=0) == pytest.approx(0.0, abs=1e-6)


def test_without_an_effect_both_conditions_have_the_same_truth():
    """Whatever the amplitude: nothing but the effect ties the knees to it."""
    times_s = np.arange(0.0, 132.0, 0.5)
    none, strong, changed = (
        clinic(effect_deg=0.0),
        clinic(effect_deg=0.0, amplitude_v=9.0, helped="none"),
        clinic(effect_deg=5.0),
    )
    assert [trial.held_deg for trial in none.plan] == [trial.held_deg for trial in strong.plan]
    same, other = joints(none, times_s), joints(changed, times_s)
    for name, place in joints(strong, times_s).items():
        assert np.array_equal(place, same[name])
    for trial, of_none in zip(changed.plan, none.plan, strict=True):
        inside = (times_s >= trial.onset_s) & (times_s < trial.end_s)
        alike = np.allclose(same["KneeLeft"][inside], other["KneeLeft"][inside])
        assert alike == (trial.condition == "off")
        straighter = np.subtract(of_none.held_deg, trial.held_deg)
        assert straighter == pytest.approx(5.0 if trial.condition == "on" else 0.0)


@pytest.mark.parametrize("trials", [2, 6, 12])
def test_conditions_are_balanced_in_every_block_and_the_reference_comes_first(trials):
    for seed in range(20):
        plan = draw_plan(np.random.default_rng(seed), SessionConfig(trials=trials, incidents=0))
        assert plan[0].condition == "off"
        for block in {trial.block for trial in plan}:
            conditions = [trial.condition for trial in plan if trial.block == block]
            assert conditions.count("on") == conditions.count("off") <= BLOCK
        assert all(before.end_s < after.onset_s for before, after in pairwise(plan))
        assert all(trial.lets_go_s <= trial.end_s for trial in plan)
    orders = {
        tuple(t.condition for t in draw_plan(np.random.default_rng(seed), SessionConfig(trials=12)))
        for seed in range(20)
    }
    assert len(orders) > 10


def test_a_stimulated_knee_holds_longer_by_so_much():
    longer, same = clinic(effect_s=1.0), clinic()
    for late, early in zip(longer.plan, same.plan, strict=True):
        assert late.lets_go_s - early.lets_go_s == pytest.approx(1.0 if late.condition == "on" else 0.0)


def test_a_buckle_lies_where_its_knee_gives_way():
    for drawn, event in events("knee_buckle"):
        side = event.kind.removeprefix("knee_buckle_")
        other = "right" if side == "left" else "left"
        times_s = np.arange(event.start_s - 0.3, event.end_s + 0.2, 1.0 / HZ)
        own_deg, other_deg = knee_deg(drawn, side, times_s), knee_deg(drawn, other, times_s)
        before = times_s < event.start_s
        assert own_deg[before] == pytest.approx(own_deg[0], abs=0.1)
        deepest = int(np.argmax(own_deg > own_deg.max() - 0.1))
        assert times_s[deepest] == pytest.approx(event.end_s, abs=0.03)
        assert own_deg.max() - own_deg[0] == pytest.approx(event.depth, abs=0.2)
        assert np.ptp(other_deg) < 0.5 * event.depth


def test_a_stand_fails_where_the_pelvis_is_highest():
    for drawn, event in events("failed_stand"):
        times_s = np.arange(event.start_s - 1.0, event.end_s + 0.7, 1.0 / HZ)
        height_m = joints(drawn, times_s)["SpineBase"][:, 1]
        assert times_s[int(np.argmax(height_m))] == pytest.approx(event.end_s, abs=0.02)
        assert height_m[times_s < event.start_s] == pytest.approx(height_m[0], abs=0.01)
        assert height_m[-1] == pytest.approx(height_m[0], abs=0.01)
        assert 0.3 < event.depth < 0.7


def test_a_recovery_step_begins_before_the_foot_leaves_the_floor_and_ends_as_it_strikes():
    for drawn, event in events("recovery_step"):
        side, times_s = event.kind.removeprefix("recovery_step_").capitalize(), np.arange(-1.0, 0.3, 1.0 / HZ)
        ankle_m = joints(drawn, event.end_s + times_s)[f"Ankle{side}"]
        moved_m = np.linalg.norm(ankle_m - ankle_m[0], axis=1)
        lifts_s = event.end_s + times_s[int(np.argmax(moved_m > 0.005))]
        assert event.start_s < lifts_s < event.end_s
        assert ankle_m[times_s >= 0.0] == pytest.approx(np.broadcast_to(ankle_m[-1], (30, 3)), abs=1e-3)
        assert 50.0 < event.depth < 400.0


def test_clonus_shakes_knee_and_ankle_at_its_frequency():
    for drawn, event in events("clonus"):
        side, times_s = event.kind.removeprefix("clonus_"), np.arange(event.start_s, event.end_s, 1.0 / HZ)
        at = joints(drawn, times_s)
        knee, ankle, foot = (at[f"{name}{side.capitalize()}"] for name in ("Knee", "Ankle", "Foot"))
        ankle_deg = np.degrees(np.arccos((unit(knee - ankle) * unit(foot - ankle)).sum(axis=1)))
        for degrees, least in ((knee_deg(drawn, side, times_s), 0.9), (ankle_deg, 0.3)):
            power = np.abs(np.fft.rfft(degrees - degrees.mean()))
            assert 3.0 <= np.fft.rfftfreq(len(times_s), 1.0 / HZ)[int(np.argmax(power))] <= 8.0
            assert 0.5 * np.ptp(degrees) > least * event.depth


def test_contacts_begin_and_end_with_the_trials_with_help():
    drawn = clinic(incidents=0, hands_off="none")
    helped = next(trial for trial in drawn.plan if trial.helped)
    alone = next(trial for trial in drawn.plan if not trial.helped)
    free = [helped.onset_s - 1.3, alone.onset_s + 6.0, helped.end_s + 1.3]
    held = [helped.onset_s + after_s for after_s in (0.05, 6.0, 11.9)]
    performance = drawn.act(np.array(free + held))
    hands, rails = performance.held_joints(), [part.name.startswith("rail") for part in drawn.parts]
    for frame in range(len(free + held)):
        touch = touches(drawn, performance, performance.figures(frame), frame)
        assert touch.on_equipment[rails].any(axis=1).all()
        if frame < len(free):
            assert not touch.regions.any()
            assert (hands[frame] < 0).all()
        else:
            assert touch.regions[0, REGIONS.index("knee_left")]
            assert touch.regions[1, REGIONS.index("knee_right")]
            assert touch.regions[:, REGIONS.index("pelvis")].all()
            assert (hands[frame] >= 0).all()


def test_hands_are_off_the_rails_in_the_trials_that_ask_for_it():
    drawn = clinic(incidents=0)
    times_s = np.array([trial.onset_s + 5.0 for trial in drawn.plan])
    performance = drawn.act(times_s)
    for frame, trial in enumerate(drawn.plan):
        touch = touches(drawn, performance, performance.figures(frame), frame)
        hands = [row for row, part in enumerate(drawn.parts) if part.name.startswith("rail")]
        assert touch.on_equipment[hands].any(axis=1).all() != trial.hands_off


def test_a_fall_accelerates_evenly_and_is_caught():
    x = np.linspace(0.0, 1.0, 301)
    course = GivingWay((), 0.0, 1.0, 1.0, 1.0).coming(x)
    acceleration = np.diff(course, 2) * 300.0**2
    assert acceleration[:198] == pytest.approx(3.0)
    assert acceleration[202:] == pytest.approx(-6.0)
    assert (course[0], course[-1]) == (0.0, 1.0)
    assert Movement((), 0.0, 1.0, 1.0, 1.0).coming(x)[150] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"trials": 7}, "multiple of 2"),
        ({"trial_s": 9.0}, "trial_s"),
        ({"trials": 4, "incidents": 2}, "room for 1"),
        ({"effect_deg": 30.0}, "effect_deg"),
    ],
)
def test_sessions_that_cannot_be_are_refused(given, problem):
    with pytest.raises(ValueError, match=problem):
        SessionConfig(**given)


@pytest.mark.parametrize("change", [{"equipment": "standing-frame"}, {"motions": ("squat",)}, {"chest_pad": True}])
def test_a_session_has_its_own_movements_and_place(change):
    with pytest.raises(ValueError, match="a session needs parallel bars"):
        replace(stimulation(1, SessionConfig()), **change)


@pytest.mark.thorough
def test_a_session_on_disk_has_its_trials_and_truth_and_other_recordings_have_none(tmp_path):
    session = SessionConfig(trials=4, trial_s=10.0)
    config = replace(stimulation(3, session, fps=1.0), cameras=1)
    simulate_recording(tmp_path / "session", config)
    trials = read_trials(tmp_path / "session/recording/events.tsv", RecordedSpan(0.0, config.seconds))
    assert [column.unit for column in trials.columns] == ["V", None]
    plan = draw_clinic(config).plan
    assert [(t.condition, t.onset_s, t.cells[0]) for t in trials.rows] == [
        (t.condition, t.onset_s, t.amplitude_v) for t in plan
    ]
    with np.load(tmp_path / "session/truth/truth.npz") as truth:
        assert truth["touched_regions"].shape == (config.frames, 2, len(REGIONS))
        assert len(truth["event_kind"]) == 4
        assert truth["trial_held_deg"].shape == (4, 2)
    simulate_recording(tmp_path / "other", SimulationConfig(seed=1, seconds=0.4, fps=5.0, cameras=1))
    with np.load(tmp_path / "other/truth/truth.npz") as truth:
        assert not [name for name in truth.files if name.startswith(("event", "trial", "touched_regions"))]
    assert not (tmp_path / "other/recording/events.tsv").exists()
