"""Independence: times, bouts and hands of hand-made sessions, worked out by hand, and what is hidden or unknown."""

from dataclasses import replace

import numpy as np
import pytest
from results_builder import standing_joints
from session_builder import RATE, contact, measured, squatting_joints, support, table, value, why

from anchorpose.joints import JOINT_INDEX, STATE_CODE, JointState
from anchorpose.recording.events import Trial, Trials
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.stand_training.independence import HOLDING, IndependenceConfig
from anchorpose.results.stand_training.touch import NO_CONTACTS, NO_EQUIPMENT
from anchorpose.results.tables import JointTable

RAILS = ("rail-left", "rail-right", "knee-pad")
FRAMES = 200


def standing(frames: int = FRAMES, hidden: tuple[str, ...] = (), lost: dict[str, slice] | None = None) -> JointTable:
    joints = table(np.repeat(standing_joints()[None], frames, axis=0), lost=lost)
    state_code = joints.state_code.copy()
    state_code[:, [JOINT_INDEX[name] for name in hidden]] = STATE_CODE[JointState.HIDDEN_BY_EQUIPMENT]
    return replace(joints, state_code=state_code)


def seconds(frames: int) -> float:
    return frames / RATE


def sigma(found: dict, name: str, side: str | None = None) -> float:
    number = found[name, side, None, None].sigma
    assert number is not None
    return number


def test_whoever_stands_untouched_is_extended_alone_all_the_time():
    found = measured(standing(), (), RAILS)[1]
    for name, side in (("knee", "left"), ("knee", "right"), ("hip", "left"), ("hip", "right"), ("trunk", None)):
        for what in ("time", "hands_off_time", "alone_time", "alone_longest"):
            assert value(found, f"{name}_extended_{what}", side) == pytest.approx(seconds(FRAMES))
        assert value(found, f"{name}_extended_alone_bouts", side) == 1
    assert value(found, "hands_free_upright_bouts") == 1
    assert value(found, "hands_free_upright_longest") == pytest.approx(seconds(FRAMES))


def test_a_hand_on_one_knee_and_a_pad_against_it_cut_its_bouts_and_no_other():
    contacts = (contact("knee_left", "person 1", 40, 59), support("knee_left", "knee-pad", 120, 129))
    found = measured(standing(), contacts, RAILS)[1]
    assert value(found, "knee_extended_time", "left") == pytest.approx(seconds(200))
    assert value(found, "knee_extended_hands_off_time", "left") == pytest.approx(seconds(180))
    assert value(found, "knee_extended_alone_time", "left") == pytest.approx(seconds(170))
    assert value(found, "knee_extended_alone_bouts", "left") == 3
    assert value(found, "knee_extended_alone_longest", "left") == pytest.approx(seconds(70))
    for name, side in (("knee", "right"), ("hip", "left"), ("hip", "right"), ("trunk", None)):
        assert value(found, f"{name}_extended_alone_time", side) == pytest.approx(seconds(200))
    assert value(found, "hands_free_upright_bouts") == 2
    assert value(found, "hands_free_upright_longest") == pytest.approx(seconds(140))
    assert value(found, "hands_free_upright_time") == pytest.approx(seconds(180))  # a pad is nobody's hand


def test_a_hand_on_the_pelvis_holds_both_hips_and_neither_knee():
    found = measured(standing(), (contact("pelvis", "person 1", 0, 99),), RAILS)[1]
    for side in ("left", "right"):
        assert value(found, "hip_extended_alone_time", side) == pytest.approx(seconds(100))
        assert value(found, "knee_extended_alone_time", side) == pytest.approx(seconds(200))


def test_hands_on_the_rails_are_counted():
    contacts = (
        support("hand_left", "rail-left", 0, 99),
        support("hand_right", "rail-right", 0, 49),
        support("forearm_right", "rail-right", 30, 59),
        contact("hand_left", "person 1", 150, 159),
    )
    found = measured(standing(), contacts, RAILS)[1]
    two, one, none = (value(found, name) for name in HOLDING)
    assert (two, one, none) == (pytest.approx(seconds(60)), pytest.approx(seconds(40)), pytest.approx(seconds(100)))
    assert sigma(found, HOLDING[0]) == pytest.approx(np.sqrt(2) / RATE)


def test_bent_knees_are_not_extended_and_a_sway_between_the_limits_ends_nothing():
    shank = np.concatenate([np.zeros(60), np.full(40, 24.0), np.full(40, 30.0), np.full(60, 5.0)])
    joints = table(squatting_joints(np.zeros(200), shank))
    found = measured(joints, (), RAILS)[1]
    assert value(found, "knee_extended_time", "left") == pytest.approx(seconds(160))
    assert value(found, "knee_extended_alone_bouts", "left") == 2
    assert value(found, "knee_extended_alone_longest", "left") == pytest.approx(seconds(100))
    assert value(found, "trunk_extended_time") == pytest.approx(seconds(200))


def test_whoever_sits_is_not_extended():
    found = measured(table(squatting_joints(np.full(100, 88.0))), (), RAILS)[1]
    assert "upright" in why(found, "knee_extended_time", "left")
    assert "upright" in why(found, HOLDING[0])


def test_a_knee_that_nobody_sees_may_be_held_unseen():
    """Anything between no time and all of it is as likely, which is off by T / sqrt(3) from all of it."""
    clear = measured(standing(), (), RAILS)[1]
    hidden = measured(standing(hidden=("KneeLeft",)), (), RAILS)[1]
    assert value(hidden, "knee_extended_alone_time", "left") == pytest.approx(seconds(200))
    assert sigma(hidden, "knee_extended_alone_time", "left") == pytest.approx(seconds(200) / np.sqrt(3.0), rel=0.01)
    assert sigma(clear, "knee_extended_alone_time", "left") < 0.1
    assert sigma(hidden, "knee_extended_alone_time", "right") < 0.1
    assert hidden["knee_extended_alone_time", "left", None, None].inferred_share == 1.0


def test_a_hand_beside_a_part_may_be_on_it():
    found = measured(standing(), (contact("belly", "person 1", 0, 99),), RAILS)[1]
    for side in ("left", "right"):
        assert value(found, "hip_extended_alone_time", side) == pytest.approx(seconds(200))
        assert sigma(found, "hip_extended_alone_time", side) == pytest.approx(seconds(100) / np.sqrt(3.0), rel=0.01)
        assert sigma(found, "knee_extended_alone_time", side) < 0.1
    pad = measured(standing(), (support("belly", "belt", 0, 99),), RAILS)[1]
    assert sigma(pad, "hip_extended_alone_time", "left") < 0.1


def test_a_contact_that_was_not_seen_makes_the_time_without_it_uncertain():
    contacts = (contact("knee_left", "person 1", 50, 149, seen=0.0),)
    found = measured(standing(), contacts, RAILS)[1]
    assert value(found, "knee_extended_hands_off_time", "left") == pytest.approx(seconds(100))
    assert sigma(found, "knee_extended_hands_off_time", "left") == pytest.approx(seconds(100) / np.sqrt(3.0), rel=0.01)


def test_a_lost_hand_counts_for_no_number_of_hands_and_makes_all_uncertain():
    found = measured(standing(lost={"HandLeft": slice(0, 80)}), (support("hand_right", "rail-right", 0, 199),), RAILS)[
        1
    ]
    assert [value(found, name) for name in HOLDING] == [0.0, pytest.approx(seconds(120)), 0.0]
    assert all(sigma(found, name) > seconds(80) / 4.0 for name in HOLDING)


def test_an_angle_near_its_limit_makes_the_time_uncertain():
    steady = squatting_joints(np.zeros(200), np.full(200, 19.5))
    found = measured(table(steady, sigma_m=0.02), (), RAILS)[1]
    assert sigma(found, "knee_extended_time", "left") > seconds(200) / 3.0
    straight = measured(table(squatting_joints(np.zeros(200)), sigma_m=0.005), (), RAILS)[1]
    assert sigma(straight, "knee_extended_time", "left") < 0.1


def test_without_contacts_or_a_model_of_the_equipment_nothing_is_claimed():
    found = measured(standing(), None, ())[1]
    assert value(found, "knee_extended_time", "left") == pytest.approx(seconds(200))
    for name in ("knee_extended_hands_off_time", "knee_extended_alone_time"):
        assert why(found, name, "left") == NO_CONTACTS
    assert why(found, "hands_free_upright_bouts") == NO_CONTACTS
    found = measured(standing(), (contact("knee_left", "person 1", 0, 9),), ())[1]
    assert value(found, "knee_extended_hands_off_time", "left") == pytest.approx(seconds(190))
    assert why(found, "knee_extended_alone_time", "left") == NO_EQUIPMENT
    assert why(found, HOLDING[2]) == NO_EQUIPMENT


def test_mirrored_sessions_exchange_left_and_right():
    contacts = (contact("knee_left", "person 1", 40, 59), support("hand_left", "rail-left", 0, 99))
    mirrored = tuple(replace(each, part=each.part.replace("left", "right")) for each in contacts)
    one, other = measured(standing(), contacts, RAILS)[1], measured(standing(), mirrored, RAILS)[1]
    for name in ("knee_extended_alone_time", "knee_extended_alone_bouts", "hip_extended_alone_time"):
        assert value(one, name, "left") == pytest.approx(value(other, name, "right"))
        assert value(one, name, "right") == pytest.approx(value(other, name, "left"))
    assert [value(one, name) for name in HOLDING] == [value(other, name) for name in HOLDING]


def test_each_trial_has_measures_of_independence_of_its_own():
    contacts = (contact("knee_left", "person 1", 0, 49), support("hand_left", "rail-left", 100, 199))
    trials = Trials((), tuple(Trial(k, f"c{k}", 5.0 * (k - 1), 5.0, 5.0 * (k - 1)) for k in (1, 2)))
    joints = standing()
    _, rows = measure_session(joints, joint_angles(joints), contacts, MeasureConfig(), trials, RAILS)
    found = {(row.trial, row.measure, row.side): row.value for row in rows if row.part is None and row.person is None}
    assert found[1, "knee_extended_alone_time", "left"] == pytest.approx(seconds(50), abs=0.01)
    assert found[2, "knee_extended_alone_time", "left"] == pytest.approx(seconds(100), abs=0.06)
    assert found[1, "upright_one_hand_time", None] == pytest.approx(0.0, abs=0.06)
    assert found[2, "upright_one_hand_time", None] == pytest.approx(seconds(100), abs=0.06)


def test_limits_that_cannot_work_are_refused():
    with pytest.raises(ValueError, match="bent_deg"):
        IndependenceConfig(extended_deg=20.0, bent_deg=10.0)
