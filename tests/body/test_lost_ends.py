"""A wrist whose hand is not where it puts it is not called seen, and says that it may be far off."""

import numpy as np
import pytest
from body_builder import adult_body, joints_of, standing

from anchorpose.body.uncertainty import before_lost_ends, lost_ends
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState

JOINTS_M = joints_of(adult_body(), standing())
SIGMA_M = np.full(JOINT_COUNT, 0.01)


def told(**states: JointState):
    """States and sigma of joints that are all observed but those named."""
    every = [JointState.OBSERVED] * JOINT_COUNT
    for name, state in states.items():
        every[JOINT_INDEX[name]] = state
    return before_lost_ends(JOINTS_M, every, SIGMA_M, lost_ends(every))


@pytest.mark.parametrize(
    ("end", "before", "middle"), [("HandLeft", "WristLeft", "ElbowLeft"), ("FootRight", "AnkleRight", "KneeRight")]
)
def test_a_lost_end_and_the_joint_before_it_cover_half_of_its_segment(end, before, middle):
    states, sigma = told(**{end: JointState.LOST})
    length_m = np.linalg.norm(JOINTS_M[JOINT_INDEX[before]] - JOINTS_M[JOINT_INDEX[middle]])
    assert states[JOINT_INDEX[before]] is JointState.HIDDEN
    moved = [JOINT_INDEX[before], JOINT_INDEX[end]]
    np.testing.assert_allclose(sigma[moved], np.hypot(0.01, length_m / 2.0))
    others = ~np.isin(np.arange(JOINT_COUNT), moved)
    np.testing.assert_array_equal(sigma[others], SIGMA_M[others])


def test_what_hides_the_joint_stays_the_reason():
    states, _ = told(HandLeft=JointState.LOST, WristLeft=JointState.HIDDEN_BY_PERSON)
    assert states[JOINT_INDEX["WristLeft"]] is JointState.HIDDEN_BY_PERSON


@pytest.mark.parametrize("state", [one for one in JointState if one is not JointState.LOST])
def test_an_end_that_is_only_out_of_sight_says_nothing(state):
    states, sigma = told(HandRight=state)
    assert states[JOINT_INDEX["WristRight"]] is JointState.OBSERVED
    np.testing.assert_array_equal(sigma, SIGMA_M)


def test_a_hand_that_is_hidden_after_it_was_lost_is_no_more_certain_than_its_wrist():
    every = [JointState.OBSERVED] * JOINT_COUNT
    hand, wrist = JOINT_INDEX["HandLeft"], JOINT_INDEX["WristLeft"]
    every[hand] = JointState.HIDDEN_BY_PERSON
    _, sigma = before_lost_ends(JOINTS_M, every, SIGMA_M, lost_ends(every, frozenset({hand})))
    assert sigma[hand] >= sigma[wrist] > 0.1


@pytest.mark.parametrize("then", JointState)
def test_a_lost_hand_stays_lost_until_it_is_seen(then):
    hand = JOINT_INDEX["HandLeft"]
    every = [JointState.OBSERVED] * JOINT_COUNT
    every[hand] = then
    assert (hand in lost_ends(every, frozenset({hand}))) == (then is not JointState.OBSERVED)
