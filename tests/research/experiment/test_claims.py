"""Verdicts on the paper's claims: outcomes for which each of them is right."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from experiment_builder import METHODS, as_the_paper_says, make_results, matches_as_the_paper_says

from anchorpose.joints import JOINT_NAMES
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.method import Family
from anchorpose.research.experiment.page.form_tables import FORM_NAMES
from anchorpose.research.experiment.page.page import judge_claims
from anchorpose.research.experiment.page.tables import Estimate
from anchorpose.research.experiment.page.tracking_claims import below_zero
from anchorpose.research.experiment.page.verdict import (
    Answer,
    Claim,
    Verdict,
    at_least,
    at_most,
    between,
    judge,
    measured,
)
from anchorpose.research.experiment.results import ExperimentResults, PaperTimes

FAMILY = {one.key: one.family for one in METHODS}
YES, NO, OPEN = Answer.YES, Answer.NO, Answer.OPEN


def claim(results: ExperimentResults, key: str) -> Claim:
    return next(one for one in judge_claims(results) if one.key == key)


def tracking_but(change: Callable[[str, float, bool], float | np.ndarray | None]) -> ExperimentResults:
    """As the paper says, but where ``change`` gives another mean."""

    def mean(key: str, hole_m: float, occluded: bool) -> float | np.ndarray:
        changed = change(key, hole_m, occluded)
        return as_the_paper_says(key, hole_m, occluded) if changed is None else changed

    return make_results(tracking=mean)


def matching_but(change: Callable[[str, str], tuple[float, float] | None]) -> ExperimentResults:
    return make_results(matching=lambda key, region: change(key, region) or matches_as_the_paper_says(key, region))


@pytest.mark.parametrize(
    ("answers", "verdict"),
    [
        ([], Verdict.UNKNOWN),
        ([OPEN, OPEN], Verdict.UNKNOWN),
        ([YES, YES], Verdict.HOLDS),
        ([YES, OPEN], Verdict.IN_PART),
        ([YES, NO], Verdict.IN_PART),
        ([YES, YES, NO], Verdict.IN_PART),
        ([YES, NO, NO], Verdict.NOT),
        ([NO, OPEN, OPEN], Verdict.NOT),
        ([YES, OPEN, OPEN], Verdict.UNKNOWN),
        ([YES, YES, NO, OPEN, OPEN, OPEN], Verdict.IN_PART),
        ([YES, NO, OPEN, OPEN], Verdict.NOT),
        ([NO], Verdict.NOT),
    ],
)
def test_all_comparisons_together_make_the_verdict(answers: list[Answer], verdict: Verdict) -> None:
    assert judge(answers) is verdict
    assert judge(answers[::-1]) is verdict


def test_only_a_whole_interval_decides() -> None:
    inside, across, above = (Estimate(1.0, low, high, 5) for low, high in ((0.9, 1.1), (1.0, 1.2), (1.11, 1.3)))
    assert [at_most(value, 1.1) for value in (inside, across, above)] == [YES, OPEN, NO]
    assert [at_least(value, 1.1) for value in (inside, across, above)] == [OPEN, OPEN, YES]
    assert [between(value, 0.8, 1.1) for value in (inside, across, above)] == [YES, OPEN, NO]
    assert between(Estimate(0.5, 0.4, 0.6, 5), 0.8, 1.1) is NO
    alone = Estimate(0.5, np.nan, np.nan, 1)
    assert {at_most(alone, 1.0), at_least(alone, 0.1), between(alone, 0.1, 1.0)} == {OPEN}
    assert [measured(value, 1.0) for value in (0.5, 1.5, np.nan)] == [YES, NO, OPEN]
    values = [Estimate(-1.0, low, high, 5) for low, high in ((-2.0, -0.1), (-2.0, 0.1), (0.0, 1.0))]
    assert [below_zero(value) for value in values] == [YES, OPEN, NO]
    assert below_zero(Estimate(-1.0, np.nan, np.nan, 1)) is OPEN


def test_everything_holds_where_the_data_are_as_the_paper_says() -> None:
    claims = judge_claims(make_results())
    assert {one.key: one.verdict for one in claims if one.verdict is not Verdict.HOLDS} == {}
    assert len({one.key for one in claims}) == len(claims) == 20
    assert all(one.checks and one.rule and one.place for one in claims)


def test_the_literal_method_is_judged_where_nothing_is_rejected() -> None:
    """Its errors are the repaired one's there, and a filter's; with rejection they would deny every claim."""
    results, keys = make_results(), {"anchors": "paper", "anchors-filter": "paper-kalman"}
    methods = [replace(one, key=keys[one.key]) for one in results.methods if one.key in keys]
    runs = [replace(run, method=keys[run.method]) for run in results.tracked if run.method in keys]
    runs = [run if run.form is Form.REFINED_ALL else replace(run, error_mm=5.0 * run.error_mm) for run in runs]
    both = replace(results, methods=(*results.methods, *methods), tracked=(*results.tracked, *runs))
    literal = {one.key: one.verdict for one in judge_claims(both) if one.key.startswith("literal-")}
    assert len(literal) == 7
    assert set(literal.values()) == {Verdict.HOLDS}


def test_one_recording_decides_nothing_but_the_time_and_none_nothing() -> None:
    verdicts = {one.key: one.verdict for one in judge_claims(make_results(recordings=1))}
    assert verdicts.pop("times") is Verdict.HOLDS
    assert set(verdicts.values()) == {Verdict.UNKNOWN}
    empty = replace(make_results(recordings=1), tracked=(), matched=(), times=None)
    assert {one.verdict for one in judge_claims(empty)} == {Verdict.UNKNOWN}


def of_family(family: Family, key: str) -> bool:
    return FAMILY.get(key) is family


REFUTED_BY_TRACKING = {
    "proposed-constant": lambda key, hole, hidden: 100.0 if key == "anchors" and hidden and hole == 0.15 else None,
    "proposed-below-local": lambda key, hole, hidden: (
        70.0 if of_family(Family.PROPOSED, key) else (40.0 if of_family(Family.LOCAL, key) else None)
    ),
    "proposed-below-spectral": lambda key, hole, hidden: 40.0 if of_family(Family.SPECTRAL, key) else None,
    "local-constant": lambda key, hole, hidden: 150.0 if of_family(Family.LOCAL, key) and hidden else None,
    "proposed-similar": lambda key, hole, hidden: (
        np.array([150.0 if "Hand" in name else 40.0 for name in JOINT_NAMES]) if key == "anchors" else None
    ),
    "proposed-adequate": lambda key, hole, hidden: 150.0 if key == "anchors" else None,
    "tree-helps": lambda key, hole, hidden: 45.0 if key == "anchors-no-tree" else None,
    "helps-at-all": lambda key, hole, hidden: 30.0 if of_family(Family.NONE, key) else None,
    "tree-below-filter": lambda key, hole, hidden: 20.0 if key == "anchors-filter" else None,
    "next-below-all": lambda key, hole, hidden: 150.0 if key == "next" else None,
    "next-constant": lambda key, hole, hidden: 90.0 if key == "next" and hidden else None,
    "own-below-all": lambda key, hole, hidden: 200.0 if key == "own" else None,
    "dijkstra-suffices": lambda key, hole, hidden: 80.0 if key == "anchors-dijkstra" else None,
    "like-gmds": lambda key, hole, hidden: 20.0 if key == "gmds" else None,
}


IN_PART = ("dijkstra-suffices", "like-gmds")  # of joints and of matches, and the matches agree


@pytest.mark.parametrize("key", list(REFUTED_BY_TRACKING))
def test_a_claim_about_joints_does_not_hold_where_the_data_say_otherwise(key: str) -> None:
    refuted = claim(tracking_but(REFUTED_BY_TRACKING[key]), key)
    assert refuted.verdict is (Verdict.IN_PART if key in IN_PART else Verdict.NOT)
    assert any(check.answer is NO for check in refuted.checks)


REFUTED_BY_MATCHES = {
    "local-distinctive": lambda key, region: (240.0, 0.1) if of_family(Family.LOCAL, key) else None,
    "best-in-head": lambda key, region: (400.0, 0.1) if region == "head" else None,
    "swapped": lambda key, region: (240.0, 0.02),
    "inaccurate-elsewhere": lambda key, region: (30.0, 0.1),
    "spectral-inaccurate": lambda key, region: (30.0, 0.1) if of_family(Family.SPECTRAL, key) else None,
}


@pytest.mark.thorough
@pytest.mark.parametrize("key", list(REFUTED_BY_MATCHES))
def test_a_claim_about_matches_does_not_hold_where_the_data_say_otherwise(key: str) -> None:
    assert claim(matching_but(REFUTED_BY_MATCHES[key]), key).verdict is Verdict.NOT


def test_the_next_generation_must_win_in_every_form() -> None:
    """It is bad in one form of the framework only."""
    results = make_results()
    spoilt = [
        replace(run, error_mm=run.error_mm + 200.0) if run.method == "next" and run.form is Form.MATCHES_ALL else run
        for run in results.tracked
    ]
    found = claim(replace(results, tracked=tuple(spoilt)), "next-below-all")
    assert found.verdict is Verdict.IN_PART
    assert {FORM_NAMES[Form.MATCHES_ALL] in check.what for check in found.checks if check.answer is NO} == {True}


@pytest.mark.parametrize(
    ("times", "verdict"),
    [
        (PaperTimes("512 x 424", 15549, 40000, 0.5, 0.2, 0.2), Verdict.HOLDS),
        (PaperTimes("512 x 424", 15549, 40000, 0.5, 0.3, 0.2), Verdict.IN_PART),
        (PaperTimes("512 x 424", 15549, 40000, 2.0, 2.0, 2.0), Verdict.NOT),
        (PaperTimes("512 x 424", 3000, 9000, 0.01, 0.01, 0.01), Verdict.UNKNOWN),
        (None, Verdict.UNKNOWN),
    ],
)
def test_times_are_held_to_the_papers_on_a_mesh_as_large(times: PaperTimes | None, verdict: Verdict) -> None:
    assert claim(replace(make_results(recordings=1), times=times), "times").verdict is verdict
