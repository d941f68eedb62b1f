"""Tables of an experiment: known answers, the same frames for whom is compared, and the files."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from experiment_builder import make_results, method

from anchorpose.joints import JOINT_COUNT
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.method import Family
from anchorpose.research.experiment.page.form_tables import form_tables
from anchorpose.research.experiment.page.matching_tables import matching_tables, time_tables
from anchorpose.research.experiment.page.selection import HANDS, MOVED_MM, Matching, Tracking
from anchorpose.research.experiment.page.tables import Column, Estimate, Row, Table, Unit, csv_text, format_estimate
from anchorpose.research.experiment.page.tracking_tables import tracking_tables
from anchorpose.research.experiment.results import ExperimentResults, Tracked

FAST = method("anchors", "fast", Family.PROPOSED)
SLOW = method("fpfh", "slow", Family.LOCAL)


def tracked(
    key: str,
    error: np.ndarray,
    recording: str = "paper-1",
    hole_m: float = 0.0,
    first: int = 1,
    occluded: np.ndarray | None = None,
    scene: Scene = Scene.PAPER,
) -> Tracked:
    """All joints have the frame's error."""
    hidden = np.zeros(len(error), bool) if occluded is None else occluded
    joints = np.repeat(np.asarray(error, float)[:, None], JOINT_COUNT, axis=1)
    return Tracked(scene, recording, hole_m, key, np.arange(first, first + len(error)), hidden, joints)


def results_of(*runs: Tracked, methods=(FAST, SLOW)) -> ExperimentResults:
    config = ExperimentConfig(resamples=100)
    return ExperimentResults(config, methods, (), tuple(runs), (), None, (), None)


def tables(results: ExperimentResults) -> dict[str, Table]:
    every = (*tracking_tables(results), *form_tables(results), *matching_tables(results), *time_tables(results))
    return {one.key: one for one in every}


def table(results: ExperimentResults, key: str) -> Table:
    return tables(results)[key]


def test_methods_are_compared_in_the_frames_that_all_of_them_that_tracked_ran_on() -> None:
    easy, hard = np.full(3, 10.0), np.full(6, 100.0)
    results = results_of(
        tracked("anchors", np.concatenate([easy, hard])),
        tracked("fpfh", np.full(3, 20.0)),
        tracked("anchors", hard, "paper-2"),
    )
    same = table(results, "result1")
    assert (same.value("anchors", "0").mean, same.value("fpfh", "0").mean) == (10.0, 20.0)
    assert "3 frames" in same.note
    results = results_of(tracked("anchors", np.array([7.0])), methods=(FAST, SLOW))
    assert table(results, "result1").value("anchors", "0").mean == 7.0


def test_the_deviation_is_over_frames_of_the_frames_mean() -> None:
    error = np.array([10.0, 20.0, 60.0])
    run = tracked("anchors", error)
    run.error_mm[:, 0] += 5.0  # joints that differ from each other within a frame count for nothing
    run.error_mm[:, 1] -= 5.0
    results = results_of(run)
    assert table(results, "sd1").value("anchors", "0").mean == pytest.approx(error.std())


def test_per_joint_all_sizes_count_alike() -> None:
    first, second = tracked("anchors", np.array([10.0, 20.0])), tracked("anchors", np.array([60.0, 70.0]), hole_m=0.15)
    first.error_mm[:, 4] = [1.0, np.nan]
    results = results_of(first, second)
    means, deviations = table(results, "result2"), table(results, "sd2")
    assert means.value("anchors", "Neck").mean == 40.0
    assert means.value("anchors", "Head").mean == pytest.approx(np.mean([1.0, 60.0, 70.0]))
    assert deviations.value("anchors", "Neck").mean == pytest.approx(np.std([10, 20, 60, 70]))


def test_what_a_hole_costs_is_given_for_the() -> None:
    hidden = np.array([True, False, True])
    without, with_hole = np.array([10.0, 100.0, 30.0]), np.array([20.0, 100.0, 60.0])
    results = results_of(
        tracked("anchors", np.append(without, 999.0)), tracked("anchors", with_hole, hole_m=0.15, occluded=hidden)
    )
    assert table(results, "ratio").value("anchors", "0.15").mean == pytest.approx(180 / 140)
    assert table(results, "ratio_occluded").value("anchors", "0.15").mean == pytest.approx(2.0)
    assert table(results, "result1_occluded").value("anchors", "0.15").mean == 40.0


def test_joints_without_an_error_are_counted_and_not_taken_for_zero() -> None:
    run = tracked("anchors", np.array([10.0, 10.0]))
    run.error_mm[0, :] = np.nan
    results = results_of(run)
    assert table(results, "known").value("anchors", "0").mean == 0.5
    assert table(results, "result1").value("anchors", "0").mean == 10.0
    assert table(results, "sd1").value("anchors", "0").mean == 0.0


def test_frames_may_come_in_any_order_but_not_twice() -> None:
    run = tracked("anchors", np.array([1.0, 2.0, 3.0]))
    turned = replace(run, frame=run.frame[::-1], error_mm=run.error_mm[::-1], occluded=run.occluded[::-1])
    kept = Tracking(results_of(turned)).runs(Scene.PAPER, "anchors", 0.0)["paper-1"]
    assert kept.error_mm[:, 0].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="twice"):
        Tracking(results_of(replace(run, frame=np.array([1, 1, 2]))))


def test_a_variant_that_refuses_a_hard_recording_is_not_better_for_it() -> None:
    own, variant = (method(key, key, Family.TRACKER) for key in ("own", "own-mean-body"))
    easy, hard, refused = np.full(3, 10.0), np.full(3, 100.0), np.full(3, np.nan)
    results = results_of(
        tracked("own", easy, "clinic-1", scene=Scene.CLINIC),
        tracked("own", hard, "clinic-2", scene=Scene.CLINIC),
        tracked("own-mean-body", easy + 2.0, "clinic-1", scene=Scene.CLINIC),
        tracked("own-mean-body", refused, "clinic-2", scene=Scene.CLINIC),
        methods=(own, variant),
    )
    ablation = table(results, "ablation")
    assert [ablation.value(key, "clinic 0").mean for key in ("own", "own-mean-body")] == [10.0, 12.0]
    assert [ablation.value(key, "clinic 0 known").mean for key in ("own", "own-mean-body")] == [1.0, 0.5]
    assert [column.unit for column in ablation.columns] == [Unit.MM, Unit.SHARE]


@pytest.mark.thorough
def test_matches_are_given_overall_by_region_and_as_a_curve() -> None:
    results = make_results(recordings=3)
    found = tables(results)
    matched = [one for one in results.matched if one.method == "fpfh" and one.gap_s == 0.1]
    together = np.concatenate([one.direct_mm for one in matched])
    overall = found["matching"]
    assert overall.value("fpfh", "direct mean").mean == pytest.approx(np.nanmean(together))
    assert overall.value("fpfh", "direct median").mean == pytest.approx(np.nanmedian(together))
    assert overall.value("fpfh", "direct matched").mean == pytest.approx(np.isfinite(together).mean())
    mirrored = np.concatenate([one.mirrored for one in matched])[np.isfinite(together)]
    assert overall.value("fpfh", "mirrored").mean == pytest.approx(mirrored.mean())
    head = np.concatenate([one.direct_mm[one.region == 0] for one in matched])
    assert found["matching_by_region"].value("fpfh", "head").mean == pytest.approx(np.nanmedian(head))
    skin = np.concatenate([one.direct_skin_mm for one in matched])
    assert found["princeton_mm"].value("fpfh", "300").mean == pytest.approx((skin <= 300).mean())
    share = skin / (1000 * 1.7)
    assert found["princeton_height"].value("fpfh", "0.17").mean == pytest.approx((share <= 0.17).mean())


def test_forms_are_told_apart_and_this_projects_tracker_is_the_same_in_all() -> None:
    gross = replace(tracked("anchors", np.array([40.0, 50.0])), form=Form.MATCHES_ALL)
    own = method("own", "anchorpose", Family.TRACKER)
    results = results_of(
        tracked("anchors", np.array([10.0, 12.0])), gross, tracked("own", np.array([5.0, 7.0])), methods=(FAST, own)
    )
    forms = table(results, "forms")
    assert forms.value("anchors", "surface 0").mean == 11.0
    assert forms.value("anchors", "matches-all 0").mean == 45.0
    assert forms.value("own", "matches-all 0").mean == forms.value("own", "surface 0").mean == 6.0
    assert table(results, "result1").value("anchors", "0").mean == 11.0


def test_without_hands_is_without_hands_and_wrists() -> None:
    run = tracked("anchors", np.array([10.0, 12.0]))
    run.error_mm[:, HANDS] = 500.0
    results = results_of(run)
    assert len(HANDS) == 4
    assert table(results, "body").value("anchors", "0").mean == 11.0
    assert table(results, "forms_body").value("anchors", "surface 0").mean == 11.0
    assert table(results, "result1").value("anchors", "0").mean > 100.0
    assert table(results, "median").value("anchors", "0").mean == 12.0


def test_the_next_generation_is_compared_with_every_row_in_the_same_frames() -> None:
    nextg = method("next", "next", Family.PROPOSED)
    results = results_of(
        tracked("next", np.array([8.0, 9.0, 99.0])), tracked("anchors", np.array([10.0, 13.0])), methods=(FAST, nextg)
    )
    minus = table(results, "next_joints")
    assert minus.value("anchors", "surface 0").mean == -3.0
    assert [one.key for one in minus.methods] == ["anchors"]


@pytest.mark.thorough
def test_matches_over_longer_gaps_and_of_nodes_that_moved_stand_apart() -> None:
    results = make_results(recordings=2)
    found = tables(results)
    chosen = [one for one in results.matched if (one.method, one.gap_s, one.hole_m) == ("fpfh", 1.0, 0.15)]
    every = np.concatenate([one.every_mm for one in chosen])
    moved = np.concatenate([one.every_mm[one.moved_mm > MOVED_MM] for one in chosen])
    assert len(moved) < len(every)
    assert found["gaps_median"].value("fpfh", "1 0.15").mean == pytest.approx(np.nanmedian(every))
    assert found["moved_mean"].value("fpfh", "1 0.15").mean == pytest.approx(np.nanmean(moved))
    assert found["gaps_within"].value("fpfh", "1 0.15").mean == pytest.approx((every < 50.0).mean())
    pairs = [
        (one, other)
        for one in results.matched
        for other in results.matched
        if one.method == "next"
        and other.method == "fpfh"
        and one.recording == other.recording
        and one.gap_s == other.gap_s == 1.0
        and one.hole_m == other.hole_m == 0.15
    ]
    less = np.mean([np.nanmean(one.every_mm) - np.nanmean(other.every_mm) for one, other in pairs])
    assert found["next_matches"].value("fpfh", "1 0.15").mean == pytest.approx(less)


def test_matches_are_compared_in_the_windows_that_all_methods_were_asked_in() -> None:
    results = make_results(recordings=2)
    fewer = [one for one in results.matched if not (one.method == "gmds" and one.recording == "paper-500")]
    assert {window[0] for window in Matching(replace(results, matched=tuple(fewer))).windows} == {"paper-501"}


def test_an_results_of_nothing_has_no_tables() -> None:
    nothing = results_of()
    assert [*tracking_tables(nothing), *matching_tables(nothing), *time_tables(nothing)] == []


def test_a_file_has_a_line_for_each_figure_and_nothing_for_what_is_not_known() -> None:
    column = Column("0.15", "0.15 m")
    rows = (Row(FAST, column, Estimate(1.23456789, 1.0, 2.0, 4)), Row(SLOW, column, Estimate(5.0, np.nan, np.nan, 1)))
    lines = list(csv.DictReader(io.StringIO(csv_text(Table("key", "title", "hole_m", "note", rows)))))
    assert lines[0] == {
        "method": "anchors",
        "title": "fast",
        "family": "proposed",
        "hole_m": "0.15",
        "unit": "mm",
        "mean": "1.23457",
        "low": "1",
        "high": "2",
        "recordings": "4",
    }
    assert (lines[1]["mean"], lines[1]["low"], lines[1]["high"]) == ("5", "", "")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (Estimate(48.24, 45.0, 51.26, 9), Unit.MM, "48.2 (45.0 to 51.3)"),
        (Estimate(0.5, 0.25, 0.75, 9), Unit.SHARE, "50.0 % (25.0 to 75.0)"),
        (Estimate(1.05, np.nan, np.nan, 1), Unit.RATIO, "1.05"),
        (Estimate(np.nan, np.nan, np.nan, 0), Unit.SECONDS, "–"),
    ],
)
def test_figures_are_given_with_their_interval(value: Estimate, unit: Unit, text: str) -> None:
    assert format_estimate(value, unit) == text
