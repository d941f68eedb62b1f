"""Frames before a limb was found again: of two ways through them, the one that sees more."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState
from anchorpose.tracker import looking_back
from anchorpose.tracker.looking_back import AGREEING, IN_VAIN, Passed, Waiting, look_back
from anchorpose.tracker.smoothing import PassResult

POSE = object()
ARM = [JOINT_INDEX[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")]


def answer(arm_m=0.0, state=JointState.OBSERVED, pose=POSE) -> PassResult:
    """All joints seen at the origin, but for an arm."""
    joints_m, states = np.zeros((JOINT_COUNT, 3)), [JointState.OBSERVED] * JOINT_COUNT
    joints_m[ARM] = arm_m
    for joint in ARM:
        states[joint] = state
    return PassResult(pose, joints_m, np.full(JOINT_COUNT, 0.01), tuple(states))


LOST_ARM = answer(0.4, JointState.HIDDEN_BY_PERSON)


@pytest.fixture
def seen_back(monkeypatch):
    """look_back with given answers of the way back, the latest frame first; returns positions that were read, too."""

    def run_it(before, back):
        read, answers = [], iter(back)
        tracker = SimpleNamespace(body=None, has_left=False, finish=lambda: iter(()))
        tracker.step = lambda frame_set: SimpleNamespace(frame_set=frame_set, result=next(answers))
        monkeypatch.setattr(looking_back, "turn_round", lambda *_: POSE)
        monkeypatch.setattr(looking_back, "PatientTracker", lambda *_: tracker)
        monkeypatch.setattr(looking_back, "pass_result", lambda body, estimate, usable: estimate.result)
        run = SimpleNamespace(config=None, room=SimpleNamespace(review=SimpleNamespace(why_unusable=lambda _: None)))

        def frame(position):
            read.append(position)
            return SimpleNamespace(frame=position)

        passed = [Passed(10 + k, result, "there") for k, result in enumerate(before)]
        found = look_back(SimpleNamespace(), passed, frame, run, lambda _: "back")
        assert [one.position for one in found] == [one.position for one in passed]
        return [one.kept for one in found], read

    return run_it


def test_a_limb_that_was_lost_is_where_the_way_back_sees_it(seen_back):
    kept, read = seen_back([answer()] * 10 + [LOST_ARM] * 4, [answer()] * 14)
    assert kept == ["there"] * 10 + ["back"] * 4
    assert read == list(range(23, 23 - 4 - AGREEING, -1))  # then both ways agree


def test_where_the_way_back_sees_less_nothing_changes(seen_back):
    assert seen_back([answer()] * 8, [LOST_ARM] * 8)[0] == ["there"] * 8


def test_where_both_ways_see_as_much_nothing_changes(seen_back):
    assert seen_back([answer()] * 5, [answer(0.4)] * 5)[0] == ["there"] * 5


NOWHERE = np.full((JOINT_COUNT, 3), np.nan)
LOST = PassResult(None, NOWHERE, NOWHERE[:, 0], (JointState.LOST,) * JOINT_COUNT)


def test_a_patient_who_was_lost_is_where_the_way_back_sees_them(seen_back):
    kept, _ = seen_back([answer()] * 6 + [LOST] * 5, [answer()] * 11)
    assert kept == ["there"] * 6 + ["back"] * 5


@pytest.mark.parametrize("nothing", [LOST, replace(answer(), states=(JointState.HIDDEN,) * JOINT_COUNT)])
def test_the_way_back_ends_where_nothing_is_seen(seen_back, nothing):
    kept, read = seen_back([LOST] * 5, [answer(), answer(), nothing, answer(), answer()])
    assert kept == ["there", "there", "there", "back", "back"]
    assert read == [14, 13, 12]


FAR = answer(0.5)


@pytest.mark.parametrize(
    ("moved", "before", "now", "expected"),
    [
        (True, answer(), FAR, True),
        (True, answer(), answer(0.05), False),  # a small correction
        (False, answer(), FAR, False),  # a fast arm
        (False, LOST, answer(), True),
        (False, answer(), LOST, False),
        (True, None, None, False),
    ],
)
def test_what_is_found_again_is_looked_for_in_the_frames_before(monkeypatch, moved, before, now, expected):
    asked = []
    monkeypatch.setattr(looking_back, "look_back", lambda found, before, *_: asked.append(found) or list(before))
    waiting = Waiting([Passed(0, before, "a")])
    waiting.add(SimpleNamespace(moved=moved), Passed(1, now, "b"), None, None, None)
    assert bool(asked) is expected
    assert waiting.take_but(5) == []
    assert waiting.take_but(1) == ["a"]
    assert waiting.take_but(0) == ["b"]
    assert waiting.frames == []


def test_ways_back_that_change_nothing_become_rare(monkeypatch):
    asked = []
    monkeypatch.setattr(looking_back, "look_back", lambda found, before, *_: asked.append(len(before)) or list(before))
    waiting = Waiting()
    for k in range(200):
        waiting.add(SimpleNamespace(moved=True), Passed(k, answer(0.5 * (k % 2)), k), None, None, None)
    assert asked[0] == 1
    assert len(asked) < 8
    assert waiting.take_but(0) == list(range(200))


def moved(result: PassResult, shift_m: float) -> PassResult:
    return replace(result, joints_m=result.joints_m + np.array([shift_m, 0.0, 0.0]))


@pytest.mark.parametrize(("shift_m", "taken"), [(2.0, False), (0.2, True)])
def test_nobody_is_in_two_places_at_once(seen_back, shift_m, taken):
    """Who is found again elsewhere than the patient was seen is another person, however much of them is seen."""
    kept, _ = seen_back([LOST_ARM] * 6 + [LOST] * 5, [moved(answer(), shift_m)] * 11)
    assert ("back" in kept) == taken


def test_a_trunk_that_no_camera_saw_proves_no_second_person(seen_back):
    hidden = replace(LOST_ARM, states=(JointState.HIDDEN_BY_PERSON,) * JOINT_COUNT)
    kept, _ = seen_back([hidden] * 6 + [LOST] * 5, [moved(answer(), 2.0)] * 11)
    assert kept[-5:] == ["back"] * 5


def test_a_limb_found_again_on_another_person_changes_nothing_either(seen_back):
    """The pass followed the patient from the first frame, so the person in the other place is someone else."""
    kept, _ = seen_back([LOST_ARM] * 6, [moved(answer(), 2.0)] * 6)
    assert kept == ["there"] * 6


def test_a_way_back_that_sees_no_more_ends_after_a_second(seen_back):
    kept, read = seen_back([answer()] * 40, [answer(0.4)] * 40)
    assert kept == ["there"] * 40
    assert len(read) == IN_VAIN


def test_without_a_start_all_stays(seen_back, monkeypatch):
    monkeypatch.setattr(looking_back, "turn_round", lambda *_: None)
    passed = [Passed(0, LOST_ARM, "there")]
    assert look_back(SimpleNamespace(), passed, None, SimpleNamespace(config=None), None) == passed
