"""Two passes put together and smoothed over time: what is kept, what is recovered, what stays lost."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import adult_body, standing

from anchorpose.body.pose import Pose
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, LIMBS, JointState
from anchorpose.tracker.config import FollowConfig
from anchorpose.tracker.smoothing import (
    PassResult,
    Smoothing,
    course_of,
    smooth,
    smooth_in_time,
    smoothed_result,
    trunk_of_back,
)

BODY, LOST_SIGMA_M = adult_body(), FollowConfig().lost_sigma_m
FRAMES, FPS = 16, 15.0
TIME_S = np.arange(FRAMES) / FPS
ARM = [JOINT_INDEX[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")]
OBSERVED, HIDDEN, LOST = JointState.OBSERVED, JointState.HIDDEN_BY_PERSON, JointState.LOST


def course_of_pass(swing: float = 20.0, sigma_m: float = 0.01) -> list[PassResult]:
    """An arm that is raised at an even speed, all of it seen."""
    return [answer(standing(LeftArm=(-swing - 2.0 * k, 0.0, 0.0)), sigma_m) for k in range(FRAMES)]


def answer(pose: Pose, sigma_m: float = 0.01, states: dict[int, JointState] | None = None) -> PassResult:
    joints = BODY.joints(pose)
    state = [(states or {}).get(joint, OBSERVED) for joint in range(JOINT_COUNT)]
    sigma = np.where([one is LOST for one in state], np.nan, sigma_m)
    return PassResult(pose, joints, sigma, tuple(state))


def nobody() -> PassResult:
    gone = np.full((JOINT_COUNT, 3), np.nan)
    return PassResult(None, gone, gone[:, 0], (LOST,) * JOINT_COUNT)


def smoothed(there: list[PassResult], back: list[PassResult], held: np.ndarray | None = None) -> list[PassResult]:
    both = smoothing_of(there, back, held)
    pairs = enumerate(zip(there, back, strict=True))
    return [smoothed_result(BODY, one, other, both, row) for row, (one, other) in pairs]


def smoothing_of(there: list[PassResult], back: list[PassResult], held: np.ndarray | None = None) -> Smoothing:
    held = np.zeros((len(there), 21), bool) if held is None else held
    return smooth(TIME_S, course_of(there, len(there)), course_of(back, len(back)), held, LOST_SIGMA_M)


def trunks_of_back(there: list[PassResult], back: list[PassResult]) -> list[bool]:
    both = smoothing_of(there, back)
    return [trunk_of_back(one, other, both, row) for row, (one, other) in enumerate(zip(there, back, strict=True))]


def off_m(found: list[PassResult], truth: list[PassResult]) -> np.ndarray:
    return np.array([np.linalg.norm(a.joints_m - b.joints_m, axis=1) for a, b in zip(found, truth, strict=True)])


def test_an_even_course_is_left_as_it_is():
    even = np.linspace(0.0, 1.0, FRAMES)[:, None, None] * np.ones((FRAMES, 4, 3))
    found = smooth_in_time(TIME_S, even, np.full((FRAMES, 4), 0.01), 2.0)
    assert np.abs(found - even).max() < 0.003  # only the first frames do not know the speed


def test_noise_is_smoothed_and_the_same_either_way_in_time():
    rng = np.random.default_rng(8)
    truth = 0.1 * np.sin(2.0 * TIME_S)[:, None, None] * np.ones((FRAMES, 6, 3))
    noisy, sigma = truth + rng.normal(0.0, 0.005, truth.shape), np.full((FRAMES, 6), 0.005)
    found = smooth_in_time(TIME_S, noisy, sigma, 0.5)
    assert np.std(found - truth) < 0.8 * np.std(noisy - truth)
    assert np.std(np.diff(found, 2, axis=0)) < 0.5 * np.std(np.diff(noisy, 2, axis=0))
    against = smooth_in_time(TIME_S[::-1], noisy[::-1], sigma[::-1], 0.5)[::-1]
    np.testing.assert_allclose(found, against, atol=1e-3)


def test_a_joint_that_is_not_known_follows_those_about_it():
    truth = (TIME_S**2)[:, None, None] * np.ones((FRAMES, 1, 3))
    seen, sigma = truth.copy(), np.full((FRAMES, 1), 0.005)
    seen[6:9] += 0.1
    sigma[6:9] = 0.2
    found = smooth_in_time(TIME_S, seen, sigma, 2.0)
    assert np.abs(found - truth).max() < 0.015


def test_two_equal_passes_are_one():
    there = course_of_pass()
    found = smoothed(there, course_of_pass())
    assert off_m(found, there).max() < 0.008
    assert [one.states for one in found] == [one.states for one in there]
    np.testing.assert_allclose([one.sigma_m for one in found], 0.01)


def wrong_arm(frames: range, state: JointState) -> list[PassResult]:
    """A pass in which the left arm is left behind, hanging, for some frames."""
    states = dict.fromkeys(ARM, state)
    return [
        answer(standing(LeftArm=(60.0, 0.0, 0.0)), states=states) if k in frames else one
        for k, one in enumerate(course_of_pass())
    ]


@pytest.mark.parametrize("state", [HIDDEN, LOST])
@pytest.mark.parametrize("first", [True, False])
def test_a_limb_that_one_pass_left_behind_is_taken_from_the_other(state, first):
    truth, poor = course_of_pass(), wrong_arm(range(5, 12), state)
    found = smoothed(poor, truth) if first else smoothed(truth, poor)
    assert off_m(poor, truth)[5:12, ARM].max() > 0.3
    assert off_m(found, truth).max() < 0.03
    assert all(one.states == (OBSERVED,) * JOINT_COUNT for one in found[7:10])


def test_the_trunk_is_taken_from_the_pass_with_more_weight_or_from_the_only_pass():
    there, back = course_of_pass(sigma_m=0.01), course_of_pass(sigma_m=0.02)
    assert trunks_of_back(there, back) == [False] * FRAMES
    assert trunks_of_back(back, there) == [True] * FRAMES
    gone = [nobody() if k < 4 else one for k, one in enumerate(there)]
    assert trunks_of_back(gone, back) == [True] * 4 + [False] * (FRAMES - 4)
    assert trunks_of_back(back, gone) == [False] * 4 + [True] * (FRAMES - 4)
    assert trunks_of_back([nobody()] * FRAMES, [nobody()] * FRAMES) == [False] * FRAMES


def test_bones_keep_their_lengths():
    found = smoothed(wrong_arm(range(5, 12), HIDDEN), course_of_pass(swing=23.0))
    start, end = np.array([pair for pair in LIMBS if min(pair) > JOINT_INDEX["Neck"]]).T
    length = np.array([np.linalg.norm(one.joints_m[start] - one.joints_m[end], axis=1) for one in found])
    assert np.ptp(length, axis=0).max() < 1e-9


def test_passes_that_disagree_are_less_sure():
    found = smoothed(course_of_pass(swing=20.0), course_of_pass(swing=24.0))
    sigma = np.array([one.sigma_m for one in found])
    assert (sigma[:, JOINT_INDEX["HandLeft"]] > 0.012).all()
    np.testing.assert_allclose(sigma[:, JOINT_INDEX["HandRight"]], 0.01, rtol=1e-6)


def test_who_is_surer_weighs_more():
    there, back = course_of_pass(swing=20.0, sigma_m=0.01), course_of_pass(swing=24.0, sigma_m=0.04)
    found = smoothed(there, back)
    assert off_m(found, there)[:, ARM].mean() < 0.3 * off_m(found, back)[:, ARM].mean()


def test_frames_that_both_lost_stay_lost_and_nothing_is_smoothed_across_them():
    there = [nobody() if 5 <= k < 9 else one for k, one in enumerate(course_of_pass())]
    found = smoothed(there, list(there))
    assert [one.pose is None for one in found] == [one.pose is None for one in there]
    assert all(one.states == (LOST,) * JOINT_COUNT and np.isnan(one.joints_m).all() for one in found[5:9])
    moved = [one if k < 9 else answer(standing(LeftArm=(-80.0, 0.0, 0.0))) for k, one in enumerate(there)]
    before = smoothed(moved, list(moved))[:5]
    np.testing.assert_array_equal(off_m(before, found[:5]), 0.0)


def test_frames_that_one_pass_lost_are_the_others():
    truth = course_of_pass()
    there = [nobody() if k < 4 else one for k, one in enumerate(truth)]
    found = smoothed(there, truth)
    assert off_m(found, truth).max() < 0.008
    assert all(one.pose is not None for one in found)


def test_a_joint_lost_in_both_passes_stays_lost():
    gone = [
        replace(
            one,
            states=tuple(LOST if k in ARM else OBSERVED for k in range(JOINT_COUNT)),
            sigma_m=np.where(np.isin(np.arange(JOINT_COUNT), ARM), np.nan, 0.01),
        )
        for one in course_of_pass()
    ]
    for one in smoothed(gone, list(gone)):
        assert [k for k, state in enumerate(one.states) if state is LOST] == ARM
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(one.sigma_m)), ARM)


def test_a_joint_that_a_reviewer_placed_stays_and_moves_no_other_frame():
    truth = course_of_pass()
    there, back = list(truth), list(truth)
    placed = answer(standing(LeftArm=(-90.0, 0.0, 0.0)))
    there[5] = back[5] = placed
    held = np.zeros((FRAMES, JOINT_COUNT), bool)
    held[5, ARM] = True
    found = smoothed(there, back, held=held)
    np.testing.assert_allclose(found[5].joints_m[ARM], placed.joints_m[ARM], atol=0.01)
    dragged = off_m(found, smoothed(list(truth), list(truth)))[:, ARM]
    assert np.delete(dragged, 5, axis=0).max() < 0.02
    assert np.delete(off_m(smoothed(there, back), truth)[:, ARM], 5, axis=0).max() > 0.03
