"""Range of motion, five times sit to stand, functional reach, one-leg stance and steps, against what was simulated."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from results_builder import standing_joints
from scipy.ndimage import gaussian_filter1d
from session_builder import RATE, measured, squatting_joints, table, value, why

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.results.records import Measure
from anchorpose.results.tables import JointTable
from anchorpose.results.uncertainty import ANGLE_SHARE, JOINT_SHARE, random_sigma, sigma_of_difference, systematic_share
from anchorpose.simulate.config import single
from anchorpose.simulate.movements import REST_ELBOW, STRAIGHT_ELBOW
from anchorpose.simulate.patient import Actor, draw_patient, draw_waves, resting_channels, seated_offsets
from anchorpose.simulate.person import Person, draw_person
from anchorpose.simulate.timeline import Footwork, Movement, Step, foot_track, stand


def cycles(times: int, seated_s: float, move_s: float = 0.8, stood_s: float = 0.4) -> np.ndarray:
    """Joints of so many rises from a seat and as many sittings, thighs at 85 degrees when seated."""
    rise = 85.0 * (0.5 + 0.5 * np.cos(np.linspace(0.0, np.pi, round(move_s * RATE))))
    one = np.concatenate([rise, np.zeros(round(stood_s * RATE)), rise[::-1], np.full(round(seated_s * RATE), 85.0)])
    return squatting_joints(np.concatenate([np.full(60, 85.0), np.tile(one, times), np.full(40, 85.0)]))


def test_five_rises_are_timed_from_leaving_the_seat_to_standing():
    """Four cycles of 2.3 s and a rise of 0.8 s, less the 0.15 s in which its first and its last 5 % are slow."""
    found = measured(table(cycles(6, seated_s=0.3)))[1]
    assert value(found, "five_times_sit_to_stand") == pytest.approx(4 * 2.3 + 0.8 - 2 * 0.15, abs=0.1)
    row = found["five_times_sit_to_stand", None, None, None]
    assert 0 < row.sigma < 0.3


def test_a_slow_patient_who_stands_steady_before_sitting_down_is_timed_too():
    found = measured(table(cycles(6, seated_s=0.3, stood_s=3.5)))[1]
    assert value(found, "five_times_sit_to_stand") == pytest.approx(4 * (2.3 + 3.1) + 0.8 - 2 * 0.15, abs=0.1)


def test_four_rises_or_rises_with_pauses_are_no_such_test():
    assert "4 were" in why(measured(table(cycles(4, seated_s=0.3)))[1], "five_times_sit_to_stand")
    assert "were not seen" in why(measured(table(cycles(6, seated_s=4.0)))[1], "five_times_sit_to_stand")
    assert "1 were" in why(measured(table(cycles(6, seated_s=0.3, stood_s=7.0)))[1], "five_times_sit_to_stand")
    standing = np.repeat(standing_joints()[None], 100, axis=0)
    assert "0 were" in why(measured(table(standing))[1], "five_times_sit_to_stand")


def test_squats_and_legs_raised_high_are_no_rises_from_a_seat():
    """With shanks leant forward the centre of mass is over the feet: nobody sits. A raised leg is no seat either."""
    down = 85.0 * (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(6 * 40) / 40.0))
    squats = measured(table(squatting_joints(down, shank_deg=0.7 * down)))[1]
    assert "0 were" in why(squats, "five_times_sit_to_stand")
    joints = np.repeat(standing_joints()[None], 400, axis=0)
    for first in range(40, 360, 60):
        joints[first : first + 30, JOINT_INDEX["KneeLeft"]] += [0.4, 0.45, 0.0]
        joints[first : first + 30, JOINT_INDEX["AnkleLeft"]] += [0.4, 0.45, 0.0]
    found = measured(table(joints))[1]
    assert "0 were" in why(found, "five_times_sit_to_stand")
    assert value(found, "upright_share") == 1.0
    assert value(found, "single_leg_stance", "right") == pytest.approx(1.5, abs=0.1)


def test_what_lasts_cancels_in_a_difference():
    for share in (ANGLE_SHARE, JOINT_SHARE):
        assert sigma_of_difference(2.0, 2.0, share) == pytest.approx(np.sqrt(2.0) * random_sigma(np.array(2.0), share))
        assert sigma_of_difference(0.0, 3.0, share) == sigma_of_difference(3.0, 0.0, share) == pytest.approx(3.0)


def test_of_an_angle_s_error_as_much_cancels_as_was_measured():
    page = (Path(__file__).parents[2] / "docs/angles.md").read_text(encoding="utf-8")
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| measures: angle ")]
    assert len(rows) > 10
    assert np.mean([float(row[5]) for row in rows]) == pytest.approx(ANGLE_SHARE, abs=0.1)  # the column "lasting share"
    assert systematic_share("deg") == ANGLE_SHARE < systematic_share("mm") == JOINT_SHARE


def test_a_range_of_motion_is_that_of_the_movement_and_a_single_jump_does_not_count():
    thighs = 20.0 + 15.0 * np.sin(np.linspace(0, 4 * np.pi, 200))
    joints = squatting_joints(thighs)
    joints[50, JOINT_INDEX["KneeLeft"], 0] += 0.2
    found = measured(table(joints))[1]
    assert value(found, "knee_flexion_range", "right") == pytest.approx(30.0, abs=1.0)
    assert value(found, "knee_flexion_range", "left") == pytest.approx(30.0, abs=1.0)
    assert "no more than the errors" in why(found, "elbow_flexion_range", "left")
    lost = measured(table(joints, lost={"KneeLeft": slice(0, None)}))[1]
    assert "never known" in why(lost, "knee_flexion_range", "left")


def reaching(reach_m: float, step_m: float = 0.0) -> np.ndarray:
    """The right arm is raised forward, then the trunk leans so that the arm goes forward; the feet stay, or do not."""
    rest, arm = standing_joints(), {"ElbowRight": 0.3, "WristRight": 0.55, "HandRight": 0.63}
    for name, along in arm.items():
        rest[JOINT_INDEX[name]] = rest[JOINT_INDEX["ShoulderRight"]] + [along, 0.0, 0.0]
    gone = reach_m * np.concatenate([np.zeros(20), 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 40)), np.ones(20)])
    joints = np.repeat(rest[None], len(gone), axis=0)
    for row, name in enumerate(JOINT_NAMES):
        if name.startswith(("Shoulder", "Elbow", "Wrist", "Hand", "SpineShoulder", "Neck", "Head")):
            joints[:, row, 0] += gone
    for name in ("AnkleLeft", "AnkleRight"):
        joints[:, JOINT_INDEX[name], 0] += step_m * np.linspace(0, 1, len(gone))
    return joints


def test_a_reach_is_how_far_the_wrist_goes_with_the_feet_in_place():
    found = measured(table(reaching(0.30)))[1]
    assert value(found, "functional_reach", "right") == pytest.approx(300.0, abs=2.0)
    assert "no arm was raised" in why(found, "functional_reach", "left")
    turned = reaching(0.30) @ np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    assert value(measured(table(turned))[1], "functional_reach", "right") == pytest.approx(300.0, abs=2.0)
    assert "no more than the errors" in why(measured(table(reaching(0.005)))[1], "functional_reach", "right")


def test_a_reach_ends_where_a_foot_moves():
    found = measured(table(reaching(0.30, step_m=0.4)))[1]["functional_reach", "right", None, None]
    assert found.value is None or found.value < 50.0


def on_one_leg(seconds: float, lift_m: float = 0.12) -> np.ndarray:
    """The left foot is lifted for so long while the patient stands on the right one."""
    joints = np.repeat(standing_joints()[None], round((4.0 + seconds) * RATE), axis=0)
    lifted = slice(round(2.0 * RATE), round((2.0 + seconds) * RATE))
    for name in ("AnkleLeft", "FootLeft"):
        joints[lifted, JOINT_INDEX[name], 1] += lift_m
    joints[lifted, JOINT_INDEX["KneeLeft"]] += [0.15, 0.08, 0.0]
    return joints


def test_standing_on_one_leg_is_timed_and_a_foot_hardly_lifted_is_not():
    found = measured(table(on_one_leg(5.0)))[1]
    assert value(found, "single_leg_stance", "right") == pytest.approx(5.0, abs=0.1)
    assert "off the floor" in why(found, "single_leg_stance", "left")
    assert "off the floor" in why(measured(table(on_one_leg(5.0, lift_m=0.03)))[1], "single_leg_stance", "right")
    assert "off the floor" in why(measured(table(on_one_leg(0.5)))[1], "single_leg_stance", "right")


OFF_FLOOR_M = 0.002


def stepping(seed: int, noise_m: float = 0.0) -> tuple[JointTable, list[tuple[str, float, float]]]:
    """A simulated patient who steps for 20 s, and each step: side, and when the ball of the foot is off the floor.

    The programmed course itself begins and ends so slowly that for a tenth of a second no foot has moved by 3 mm.
    """
    rng, times_s = np.random.default_rng(seed), np.arange(600) / 30.0
    config = replace(single(seed, seconds=20.0, fps=30.0), motions=("steps",))
    person = draw_person(rng, 0.0)
    actor = draw_patient(rng, config, person, None)
    joints = np.array([person.body.joints(bones) for bones in actor.bones(times_s)])
    joints = joints + noise_m * rng.normal(size=joints.shape)
    done = [step for step in actor.footwork.steps if step.start_s + step.duration_s < 19.5]
    shape = joints.shape[:2]
    found = JointTable(np.arange(600, dtype=np.int32), times_s, joints, np.zeros(shape, np.int8), np.full(shape, 0.006))
    return found, [(("left", "right")[step.side], *_off_floor(actor.footwork, step)) for step in done]


def _off_floor(footwork: Footwork, step: Step) -> tuple[float, float]:
    fine_s = step.start_s + np.arange(0.0, step.duration_s, 0.002)
    up = fine_s[foot_track(footwork, fine_s).ball_m[:, step.side, 1] > OFF_FLOOR_M]
    return float(up[0]), float(up[-1])


@pytest.mark.parametrize(("seed", "noise_m"), [(0, 0.0), (1, 0.004), (2, 0.004), (11, 0.0)])
def test_steps_are_those_of_the_simulated_patient(seed, noise_m):
    """The ankle leaves its place with the heel, just before the ball of the foot; seed 11 has slow steps in place."""
    joints, steps = stepping(seed, noise_m)
    session, found = measured(joints)
    events = [each for each in session.episodes if each.kind.startswith("step_") and each.end_s < 19.5]
    assert [each.kind.removeprefix("step_") for each in events] == [side for side, _, _ in steps]
    late = np.array([[e.start_s - s[1], e.end_s - s[2]] for e, s in zip(events, steps, strict=True)])
    assert late.mean(axis=0) == pytest.approx([-0.04, -0.02], abs=0.035)
    assert (late.std(axis=0) < 0.05).all()
    swings = [e.end_s - e.start_s for e in events if e.kind == "step_left"]
    assert value(found, "swing_time_mean", "left") == pytest.approx(np.mean(swings), abs=0.15)
    assert value(found, "step_count", "left") >= len(swings)


def test_who_stands_or_sways_takes_no_step():
    time_s = np.arange(200) / RATE
    joints = np.repeat(standing_joints()[None], 200, axis=0)
    joints[:, 3:, 0] += 0.03 * np.sin(2 * np.pi * 0.3 * time_s)[:, None]
    found = measured(table(joints))[1]
    assert value(found, "step_count", "left") == 0.0
    assert "no step" in why(found, "swing_time_mean", "left")
    assert "no step was followed" in why(found, "step_time_mean")
    lost = measured(table(joints, lost={"AnkleLeft": slice(0, None)}))[1]
    assert "never both known" in why(lost, "step_count", "left")


RISE_S, STAND_S, SIT_S = 1.2, 0.8, 0.5
SIGMA_M = 0.006


def programmed(
    movements: Callable[[Person], list[Movement]], steps: tuple[Step, ...] = (), seconds: float = 12.0
) -> tuple[JointTable, np.ndarray]:
    """A simulated person who does that, with slow errors of 6 mm per axis; and the true joints (n, 21, 3). 30 Hz."""
    rng, times_s = np.random.default_rng(3), np.arange(0.0, seconds, 1.0 / 30.0)
    person = draw_person(rng, 0.0)
    footwork = replace(stand(np.zeros(2), 0.0, 0.2), steps=steps)
    actor = Actor(person, resting_channels(person, False), movements(person), footwork, draw_waves(rng))
    true_m = np.array([person.body.joints(bones) for bones in actor.bones(times_s)])
    noise = gaussian_filter1d(rng.normal(size=true_m.shape), 6.0, axis=0)
    shape, frames = true_m.shape[:2], np.arange(len(times_s), dtype=np.int32)
    joints_m = true_m + SIGMA_M * noise / noise.std(axis=0)
    return JointTable(frames, times_s, joints_m, np.zeros(shape, np.int8), np.full(shape, SIGMA_M)), true_m


def of_measure(joints: JointTable, name: str, side: str | None) -> Measure:
    row = measured(joints)[1][name, side, None, None]
    assert row.value is not None
    assert row.sigma is not None
    return row


@pytest.mark.slow
def test_five_rises_of_a_simulated_person_are_timed_as_programmed():
    """Each takes 1.2 s on a minimum-jerk course, of which the first and the last 5 % of the way take 0.23 s."""
    cycle_s = RISE_S + STAND_S + RISE_S + SIT_S

    def rises(person: Person) -> list[Movement]:
        seated = seated_offsets(person)
        sits = [Movement(seated, -10.0, RISE_S, 13.0 - RISE_S, RISE_S)]
        down_s = [3.0 + RISE_S + STAND_S + k * cycle_s for k in range(4)]
        return [*sits, *(Movement(seated, start_s, RISE_S, SIT_S, RISE_S) for start_s in down_s)]

    found = of_measure(programmed(rises, seconds=22.0)[0], "five_times_sit_to_stand", None)
    assert found.value == pytest.approx(4 * cycle_s + RISE_S - 2 * 0.23, abs=min(1.96 * found.sigma, 0.25))


@pytest.mark.slow
def test_a_simulated_reach_is_how_far_the_true_wrist_goes_when_the_programme_leans():
    """The arm is up from 2 s on; the trunk leans from 4 to 5 s and stays for one."""

    def reach(person: Person) -> list[Movement]:
        arm = (
            ("shoulder_flex_right", 1.5),
            ("elbow_right", STRAIGHT_ELBOW - REST_ELBOW),
            ("shoulder_abduct_right", -0.2),
        )
        lean = (("trunk_flex", 0.4), ("pelvis_flex", 0.2), ("pelvis_forward", -0.06), ("shoulder_flex_right", 0.5))
        return [Movement(arm, 1.0, 1.0, 7.0, 1.0), Movement(lean, 4.0, 1.0, 1.0, 1.0)]

    joints, true_m = programmed(reach)
    wrist_m = true_m[:, JOINT_INDEX["WristRight"], 0]
    gone_mm = 1000.0 * (wrist_m[150:180].max() - wrist_m[60:80].mean())
    found = of_measure(joints, "functional_reach", "right")
    assert gone_mm > 120.0
    assert found.value == pytest.approx(gone_mm, abs=1.96 * found.sigma)
    assert why(measured(joints)[1], "functional_reach", "left")


@pytest.mark.slow
def test_a_simulated_stance_lasts_while_the_true_ankle_is_up():
    joints, true_m = programmed(lambda _person: [], (Step(0, 1.5, 8.0, (0.0, -0.1), 0.0),))
    ankles_m = true_m[:, [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["AnkleRight"]], 1]
    up_s = (ankles_m[:, 0] - ankles_m[:, 1] > 0.04).sum() / 30.0
    found = of_measure(joints, "single_leg_stance", "right")
    assert up_s > 3.0
    assert found.value == pytest.approx(up_s, abs=1.96 * found.sigma)
