"""The report of a session with trials: every condition in a row, differences with intervals, curves, and refusals."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from event_builder import still, tracked
from page_reader import PageReader
from ratings_builder import write_scores
from results_builder import make_frame, standing_joints, write_results
from trials_builder import trials_in_turn, write_trial_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.events import Trial, Trials
from anchorpose.report.condition_section import _effects, condition_section
from anchorpose.report.page import write_report
from anchorpose.report.parameter_curves import levels_of
from anchorpose.report.session import Session, read_session
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.ratings import rated_session
from anchorpose.results.records import Measure, read_trial_measures
from anchorpose.results.run_record import read_run

IN_TURN = [None, 40.0, None, 20.0] * 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_trial_results(tmp_path_factory.mktemp("conditions") / "r", IN_TURN)


@pytest.fixture(scope="module")
def page(folder: Path) -> PageReader:
    return PageReader(write_report(folder))


def table_of(page: PageReader) -> dict[str, dict[str, list[str]]]:
    """Of each measure the cells of each condition."""
    table = next(t for t in page.find("table") if t.children[0].text == "Measures under each condition")
    found: dict[str, dict[str, list[str]]] = {}
    for row in (row for row in page.find("tr") if table in row.ancestors):
        cells = [cell.text.strip() for cell in row.children]
        if len(cells) == 1:
            name = cells[0]
        elif row.ancestors[-1].tag == "tbody":
            found.setdefault(name, {})[cells[0]] = cells[1:]
    return found


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"[-\d.]+", text.replace("\u2212", "-"))]


def test_every_condition_has_a_row_with_the_mean_of_its_trials(folder, page):
    rows = table_of(page)["knee flexion while upright, mean, left"]
    assert list(rows) == ["off", "on"]
    measured = [
        row
        for row in read_trial_measures(folder / "measures.parquet")
        if row.measure == "knee_flexion_upright_mean" and row.side == "left" and row.trial is not None
    ]
    for name in ("off", "on"):
        own = [row.value for row in measured if row.condition == name]
        assert rows[name][0] == "6 of 6"
        assert numbers(rows[name][1])[0] == pytest.approx(np.mean(own), abs=0.06)
    assert rows["off"][2] == "reference"


def test_a_difference_is_shown_with_its_interval_and_p(page):
    _, difference, verdict = table_of(page)["knee flexion while upright, mean, left"]["on"][1:]
    value, low, high = numbers(difference)
    assert low < value < high < 0
    assert value == pytest.approx(-6.0, abs=1.0)
    assert verdict == "a difference: p 0.031"  # 2 of 64 assignments
    assert "a difference" not in table_of(page)["estimated share of the load, left"]["on"][3]


def test_the_page_says_how_trials_were_compared_and_how_many_differences_were_tested(folder, page):
    text = next(section.text for section in page.find("section", id="conditions"))
    assert "12 trials: 6 of off and 6 of on. Differences are to off" in text
    assert "Neighbouring trials of two conditions are compared in pairs" in text
    section = condition_section(read_session(folder))
    verdicts = [row.verdict for group in section.groups for row in group.rows]
    tested = sum("p " in verdict and "not tested" not in verdict for verdict in verdicts)
    assert f"{tested} differences are tested" in " ".join(text.split())
    assert page.find("a", href="#conditions")


def test_a_measure_is_drawn_over_the_amplitude_with_every_trial_and_its_numbers_in_a_table(page):
    (chart,) = page.find("figure", id="parameter-knee_flexion_upright_mean-0")
    paths = [path for path in page.find("path") if chart in path.ancestors]
    dots = [path.attributes["d"] for path in paths if path.attributes["class"].startswith("dot")]
    assert [each.count("M") for each in dots] == [6, 6]  # left and right; trials that were off have no amplitude
    assert "NaN" not in "".join(path.attributes["d"] for path in paths)
    assert "nan" not in "".join(path.attributes["d"] for path in paths)
    rows = [row.text for row in page.find("tr") if chart in row.ancestors]
    assert [row.split(",")[0] for row in rows[1:]] == ["20", "40", "20", "40"]
    assert page.find("figure", id="parameter-knee_flexion_upright_mean-1") == []  # electrodes are no number


def test_chosen_measures_alone_are_compared_and_drawn(folder, tmp_path, capsys, refusal):
    assert main(["report", str(folder), "--measure", "hip_flexion_upright_mean"]) == 0
    page = PageReader(folder / "report.html")
    assert set(table_of(page)) == {f"hip flexion while upright, mean, {side}" for side in ("left", "right")}
    assert [one.attributes["id"] for one in page.find("figure", **{"class": "still"})] == [
        "parameter-hip_flexion_upright_mean-0"
    ]
    assert "has no measure 'gait_speed' of trials" in refusal(["report", str(folder), "--measure", "gait_speed"])
    assert "leave out --measure" in refusal(["report", str(folder), str(folder), "-o", "c.html", "--measure", "x"])


def test_below_the_minimal_detectable_change_nothing_is_shown(folder, tmp_path):
    table = tmp_path / "reliability.csv"
    table.write_text("measure,side,unit,mdc95\nknee_flexion_upright_mean,left,deg,9.5\n")
    page = PageReader(write_report(folder, table))
    rows = table_of(page)
    verdict = rows["knee flexion while upright, mean, left"]["on"][3]
    assert verdict == "not shown: below the minimal detectable change (± 9.5°), p 0.031"
    assert rows["knee flexion while upright, mean, right"]["on"][3] == "a difference: p 0.031"


def test_a_minimal_detectable_change_of_no_side_is_refused_for_trials_too(folder, tmp_path):
    table = tmp_path / "reliability.csv"
    table.write_text("measure,side,unit,mdc95\nknee_flexion_upright_mean,,deg,9.5\n")
    with pytest.raises(InputError, match=r"has knee_flexion_upright_mean \(no side, deg\)"):
        write_report(folder, table)


def test_the_minimal_detectable_change_of_a_session_s_time_is_not_that_of_a_trial(tmp_path):
    session = with_trials(write_trial_results(tmp_path / "r", IN_TURN), trials_in_turn(IN_TURN))
    shorter = {row.trial: 0.02 * row.trial for row in session.trial_measures if row.condition == "off" and row.trial}
    rows = [
        replace(row, value=row.value - shorter[row.trial])
        if row.measure == "upright_time" and row.trial in shorter
        else row
        for row in session.trial_measures
    ]
    section = condition_section(replace(session, trial_measures=tuple(rows)), {("upright_time", None, "s"): 100.0})
    verdicts = {group.title: str(group.rows[1].verdict) for group in section.groups}
    assert "p 0.031" in verdicts["time upright"]
    assert "minimal detectable change" not in verdicts["time upright"]


def test_without_trials_there_is_no_section_and_the_options_are_refused(tmp_path, refusal):
    folder = write_results(tmp_path / "r", [make_frame(k, k / 10, standing_joints()) for k in range(30)])
    write_measured(folder, ProcessingConfig(), MeasureConfig())
    page = PageReader(write_report(folder))
    assert page.find("section", id="conditions") == []
    assert "has no trials whose conditions" in refusal(["report", str(folder), "--measure", "upright_share"])


def with_trials(folder: Path, trials: Trials) -> Session:
    write_measured(folder, ProcessingConfig(), MeasureConfig(), trials)
    return read_session(folder)


def test_trials_that_last_differently_are_not_tested_by_what_grows_with_time(tmp_path):
    folder = write_trial_results(tmp_path / "r", IN_TURN)
    trials = trials_in_turn(IN_TURN)
    short = tuple(replace(row, duration_s=3.0 if row.condition == "off" else 4.0) for row in trials.rows)
    section = condition_section(with_trials(folder, replace(trials, rows=short)))
    verdicts = {group.title: str(group.rows[1].verdict) for group in section.groups}
    assert "it grows with time, and trials last 3 to 4 s" in verdicts["time upright"]
    assert "a difference" in verdicts["knee flexion while upright, mean, left"]


def test_a_condition_in_which_the_patient_is_hidden_for_longer_is_not_tested_by_what_grows_with_time(tmp_path):
    session = with_trials(write_trial_results(tmp_path / "r", IN_TURN), trials_in_turn(IN_TURN))

    def hidden(row: Measure) -> Measure:
        # therapists who help without stimulation hide the patient for about a second of four
        lost_s = {"unknown_time": 1.0 + 0.01 * (row.trial or 0), "upright_time": -1.0 - 0.01 * (row.trial or 0)}
        return replace(row, value=row.value + lost_s[row.measure]) if row.measure in lost_s else row

    rows = [hidden(row) if row.condition == "off" else row for row in session.trial_measures]
    section = condition_section(replace(session, trial_measures=tuple(rows)))
    verdicts = {group.title: str(group.rows[1].verdict) for group in section.groups}
    assert "not tested: it grows with time (more time with posture known)" in verdicts["time upright"]
    assert "not tested" not in verdicts["knee flexion while upright, mean, left"]


def test_too_few_trials_say_how_many_are_needed_and_one_condition_has_nothing_to_compare(tmp_path):
    folder = write_trial_results(tmp_path / "r", IN_TURN)
    few = Trials((), tuple(Trial(k + 1, name, 4.0 * k, 4.0, 4.0 * k) for k, name in enumerate("ABAB")))
    section = condition_section(with_trials(folder, few), chosen=("knee_flexion_upright_mean",))
    assert "6 pairs are needed" in section.groups[0].rows[1].verdict
    assert section.tested == 0
    assert section.charts == []
    one = Trials((), (Trial(1, "on", 0.0, 8.0, 0.0),))
    section = condition_section(with_trials(folder, one))
    assert "With a single condition there is nothing to compare." in section.about
    assert [row.condition for row in section.groups[0].rows] == ["on"]


def test_names_of_conditions_cannot_become_markup(tmp_path):
    folder = write_trial_results(tmp_path / "r", IN_TURN)
    trials = trials_in_turn(IN_TURN)
    renamed = tuple(replace(row, condition=f"<b>{row.condition}") for row in trials.rows)
    with_trials(folder, replace(trials, rows=renamed))
    text = write_report(folder).read_text(encoding="utf-8")
    assert "<b>off" not in text
    assert "&lt;b&gt;off" in text


def test_levels_have_the_interval_of_their_scatter_and_at_least_of_their_random_error():
    at, sigma = np.array([10.0, 10.0, 10.0, 20.0]), np.full(4, 2.0)
    low, high = levels_of(at, np.array([1.0, 2.0, 3.0, 7.0]), np.full(4, 0.1), 0.7)
    assert (low.at, low.trials, low.mean) == (10.0, 3, 2.0)
    assert low.half == pytest.approx(4.3026527 * 1.0 / np.sqrt(3), rel=1e-6)  # t of two degrees of freedom
    assert np.isnan(high.half)  # a single trial shows no scatter
    counts, _ = levels_of(at, np.array([2.0, 2.0, 2.0, 7.0]), np.full(4, np.nan), 0.7)
    assert np.isnan(counts.half)
    same, _ = levels_of(at, np.array([2.0, 2.0, 2.0, 7.0]), sigma, 0.7)
    assert same.half == pytest.approx(4.3026527 * np.sqrt(0.3 * 4.0 / 3), rel=1e-6)
    unknown, alone = levels_of(at, np.array([1.0, 2.0, 3.0, 7.0]), np.full(4, np.nan), 0.7)
    assert unknown.half == pytest.approx(4.3026527 / np.sqrt(3), rel=1e-6)
    assert np.isnan(alone.half)


def test_a_damaged_table_of_trials_is_refused(tmp_path):
    folder = write_trial_results(tmp_path / "r", IN_TURN)
    (folder / "trials.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"trials\.parquet"):
        write_report(folder)


def test_the_timeline_shows_when_each_condition_was_given(folder, page):
    (chart,) = page.find("figure", id="timeline")
    rows = {
        row.children[0].text: [path.attributes["d"] for path in page.find("path") if row in path.ancestors]
        for row in page.find("div")
        if row.attributes.get("class") == "row state" and chart in row.ancestors
    }
    for name in ("off", "on"):
        assert rows[name][-1].count("M") == 6
    (link,) = [each for each in page.find("a", **{"class": "csv"}) if chart in each.ancestors]
    assert "1 (off)" in unquote(link.attributes["href"])


def test_the_reference_can_be_chosen_and_turns_the_differences_round(folder, page):
    path = write_report(folder, reference="on")
    turned = PageReader(path)
    assert "Differences are to on, which was chosen as the reference." in path.read_text(encoding="utf-8")
    before, after = (table_of(each)["knee flexion while upright, mean, left"] for each in (page, turned))
    assert list(after) == ["on", "off"]
    assert after["on"][2] == before["off"][2] == "reference"
    assert numbers(after["off"][2])[0] == -numbers(before["on"][2])[0]
    assert after["off"][3] == before["on"][3]
    assert [after[name][1] for name in ("on", "off")] == [before[name][1] for name in ("on", "off")]
    assert "off, which stands first in the events file" in write_report(folder).read_text(encoding="utf-8")


def test_a_reference_that_is_no_condition_is_refused_with_all_conditions(folder, tmp_path, refusal):
    assert "choose from 'off', 'on'" in refusal(["report", str(folder), "--reference", "On"])
    plain = write_results(tmp_path / "plain", [make_frame(k, k / 30, standing_joints()) for k in range(4)])
    write_measured(plain, ProcessingConfig(), MeasureConfig())
    assert "leave out --reliability, --measure and --reference" in " ".join(
        refusal(["report", str(plain), "--reference", "off"]).split()
    )
    several = ["report", str(folder), str(plain), "-o", str(tmp_path / "c.html"), "--reference", "off"]
    assert "leave out --measure and --reference" in " ".join(refusal(several).split())


def test_scores_of_blinded_raters_are_a_measure_of_the_conditions(tmp_path):
    folder = write_trial_results(tmp_path / "r", IN_TURN)
    session = rated_session(read_run(folder / "run.json"), read_session(folder).trials)
    better = [2 if amplitude is None else 5 for amplitude in IN_TURN]
    write_scores(tmp_path / "r.rating_AB.tsv", "AB", better, session)
    write_scores(tmp_path / "r.rating_CD.tsv", "CD", [*(score + 2 for score in better[:-1]), None], session)
    rows = table_of(PageReader(write_report(folder)))["blinded rating, mean of the raters"]
    assert (rows["off"][:2], rows["on"][:2]) == (["6 of 6", "3"], ["5 of 6", "6"])
    assert rows["on"][2].startswith("+3")
    write_scores(tmp_path / "r.rating_CD.tsv", "CD", better, "another")
    with pytest.raises(InputError, match="scores of another session"):
        write_report(folder)


@pytest.mark.thorough
@pytest.mark.parametrize("width", [390, 1280])
def test_what_a_difference_shows_can_be_read_without_scrolling_aside(folder, chromium, width):
    context = chromium.new_context(viewport={"width": width, "height": 800})
    opened = context.new_page()
    opened.goto(write_report(folder).as_uri())
    boxes = [box.bounding_box() for box in opened.locator("#conditions .change").all()]
    assert boxes
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= width for box in boxes)
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    context.close()


def test_slightly_longer_trials_of_a_patient_who_always_stands_show_no_difference():
    """Trials with stimulation last 0.6 s longer: every time grows by that, and not by the stimulation."""
    rng, rows, onset_s = np.random.default_rng(4), list[Trial](), 1.0
    for number in range(12):
        name = ("off", "on")[(number + (number // 2) % 2) % 2]
        length_s = 20.0 + 0.6 * (name == "on") + rng.uniform(0.0, 0.2)
        rows.append(Trial(number + 1, name, onset_s, length_s, onset_s))
        onset_s += length_s + 3.0
    trials, joints = Trials((), tuple(rows)), tracked(still(onset_s), 0.004, 1, fast_m=0.0005)
    _, found = measure_session(joints, joint_angles(joints), (), MeasureConfig(), trials, ("bar",))
    session = SimpleNamespace(trial_measures=tuple(row for row in found if row.condition))
    for name in ("upright_time", "longest_upright_bout", "trunk_extended_alone_time"):
        own = [row for row in session.trial_measures if row.measure == name and row.trial]
        (effect,) = _effects(own, session, trials, {})
        assert effect.difference > 0.5, name
        assert not effect.shown, name
