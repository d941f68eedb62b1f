"""The simulated patients do the tests that they are asked for, and measures are compared as stated."""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from session_builder import measured

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from measure_scores import compare, compare_swings
from tasks import reaches, rises, stances

from anchorpose.results.records import STEP_LEFT, STEP_RIGHT, UPRIGHT_EPISODE, Episode, Measure
from anchorpose.results.tables import JointTable
from anchorpose.simulate.clinic import Programme
from anchorpose.simulate.person import Person, draw_person

RATE_HZ = 10.0


@pytest.fixture(scope="module")
def person() -> Person:
    return draw_person(np.random.default_rng(5), 0.0)


def values(person: Person, programme: Programme, seconds: float) -> dict[tuple[str, str | None], Measure]:
    """Measures of the true joints of a person who does that."""
    times_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    bones = programme(np.random.default_rng(8), person).bones(times_s)
    joints_m = np.array([person.body.joints(moment) for moment in bones])
    shape, frames = joints_m.shape[:2], np.arange(len(times_s), dtype=np.int32)
    rows = measured(JointTable(frames, times_s, joints_m, np.zeros(shape, np.int8), np.full(shape, 1e-6)))[1]
    return {key[:2]: row for key, row in rows.items()}


def test_five_rises_are_a_test_and_three_and_two_halves_are_none(person):
    assert rises(np.random.default_rng(8), person).sits()  # so that there is a stool
    assert 10.0 < values(person, rises, 26.0)["five_times_sit_to_stand", None].value < 20.0
    half = values(person, partial(rises, whole=3), 26.0)["five_times_sit_to_stand", None]
    assert half.value is None
    assert "3 were" in half.why


def test_both_arms_reach_in_turn_and_a_small_reach_is_small(person):
    usual, small = values(person, reaches, 18.0), values(person, partial(reaches, share=0.1), 18.0)
    for side in ("left", "right"):
        assert usual["functional_reach", side].value > 100.0
        assert small["functional_reach", side].value < 0.3 * usual["functional_reach", side].value


def test_both_legs_are_stood_on_and_not_for_a_second_when_short(person):
    long, short = values(person, stances, 26.0), values(person, partial(stances, seconds=1.2), 8.0)
    for side in ("left", "right"):
        assert 3.0 < long["single_leg_stance", side].value < 8.0
        assert short["single_leg_stance", side].value is None


def swing(kind: str, start_s: float, end_s: float) -> Episode:
    return Episode(kind=kind, first_frame=0, last_frame=0, start_s=start_s, end_s=end_s, state="observed")


def test_swings_are_paired_by_foot_and_time():
    true = [swing(STEP_LEFT, 1.0, 1.5), swing(STEP_RIGHT, 2.0, 2.5), swing(STEP_LEFT, 3.0, 3.5)]
    found = [swing(STEP_LEFT, *times) for times in ((1.1, 1.4), (2.0, 2.5), (3.0, 3.6))]
    found.append(swing(UPRIGHT_EPISODE, 0.0, 4.0))
    scores = compare_swings(found, true)
    assert (scores["swings"], scores["missed"], scores["extra"]) == (2, 1, 1)
    assert (scores["foot_off_late_s"], scores["foot_strike_late_s"]) == pytest.approx((0.05, 0.0))


def row(value: float | None, sigma: float | None = None) -> Measure:
    why = None if value else "unseen"
    return Measure(measure="swing_time_mean", value=value, unit="s", sigma=sigma, frames=1, why=why)


def test_a_measure_is_in_band_when_it_is_no_farther_than_its_range_and_a_count_when_equal():
    assert compare(row(1.1, 0.06), row(1.0))["in_band"] == 1.0
    assert compare(row(1.2, 0.06), row(1.0))["in_band"] == 0.0
    assert (compare(row(3.0), row(3.0))["in_band"], compare(row(3.0), row(4.0))["in_band"]) == (1.0, 0.0)


def test_a_measure_that_one_of_the_two_refuses_has_no_error():
    assert compare(row(None), row(1.0)) == compare(row(1.0, 0.1), row(None)) == {"one_refuses": 1.0}
    assert compare(row(None), row(None)) == {}
