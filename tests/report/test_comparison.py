"""Sessions side by side: what counts as a change, what is refused, and what is told of differences."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from event_builder import still, tracked
from page_reader import PageReader
from report_builder import MEASURES, squats, write_session
from session_builder import measured
from trials_builder import write_trial_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.report.comparable import grows_with_time
from anchorpose.report.comparison import _change, change_between, write_comparison
from anchorpose.report.detectable import read_detectable
from anchorpose.results.measuring import MeasureConfig, write_measured
from anchorpose.results.processing import ProcessingConfig
from anchorpose.results.records import Measure, write_measures
from anchorpose.results.stand_training.extension import ExtensionConfig

UPRIGHT = Measure(measure="upright_time", value=10.0, unit="s", sigma=3.0, frames=300)
BODY = {"learnt_from_s": 4.0, "height_m": 1.72, "height_sigma_m": 0.01, "clothes_m": {"trunk": 0.005}, "bones": []}
BODY |= {"coefficients": []}


def session(
    folder: Path, number: int, measures: tuple[Measure, ...] = MEASURES, frames: int = 30, **run: object
) -> Path:
    run = {"recording": f"week {number}", "inputs_sha256": {"recording.json": f"{number}" * 64}, "body": BODY} | run
    return write_session(folder / f"r{number}", squats(frames, seed=number), measures, **run)


def larger(times: float) -> tuple[Measure, ...]:
    """Of a patient who did so much more in the same time."""
    kept = ("recorded_time", "unknown_time", "sway_time")
    return tuple(m if m.value is None or m.measure in kept else replace(m, value=times * m.value) for m in MEASURES)


def lasting(seconds: float, unknown_s: float = 0.0, sway_s: float = 20.0) -> tuple[Measure, ...]:
    """The same training, twice as long in twice the time; means and shares stay, and are known well."""
    times = (seconds - unknown_s) / 60.0

    def row(measure: str, value: float, unit: str, sigma: float | None = None, side: str | None = None) -> Measure:
        return Measure(measure=measure, value=value, unit=unit, sigma=sigma, side=side, frames=900)

    return (
        row("recorded_time", seconds, "s"),
        row("unknown_time", unknown_s, "s"),
        row("upright_time", 40.0 * times, "s", 0.1),
        row("upright_share", 2.0 / 3.0, "1", 0.001),
        row("longest_upright_bout", 20.0 * times, "s", 0.1),
        row("upright_bouts", 3.0 * times, "count"),
        row("sway_time", sway_s, "s"),
        row("sway_path", 10.0 * sway_s, "mm", 1.0),
        row("sway_velocity", 10.0, "mm/s", 0.1),
        row("sway_ellipse_area", 0.1 * sway_s, "cm2", 0.01),
        row("hands_on_at_once_mean", 1.5, "count"),
    )


def changes_of(tmp_path: Path, *sessions: tuple[Measure, ...]) -> tuple[dict[str, str], str]:
    """Of the last session against the first: change by measure, and what is told of differences."""
    folders = [session(tmp_path, number, measures) for number, measures in enumerate(sessions, 1)]
    page = PageReader(write_comparison(folders, tmp_path / "c.html"))
    table = next(t for t in page.find("table") if t.children[0].text == "Measures side by side")
    rows = {row.children[0].text: row.children[-1].text for row in page.find("tr") if table in row.ancestors}
    return rows, " ".join(item.text for item in page.find("li"))


def row_of(page: PageReader, name: str) -> str:
    return next(row.text for row in page.find("tr") if row.children[0].text == name)


def test_a_change_must_exceed_both_errors_together():
    later = replace(UPRIGHT, value=19.9, sigma=4.0)
    change = change_between(UPRIGHT, later)
    assert change.detectable == pytest.approx(1.96 * 5.0)
    assert change.exceeds is True
    assert change_between(UPRIGHT, replace(later, value=19.7)).exceeds is False
    assert change_between(UPRIGHT, replace(later, value=0.1)).exceeds is True
    assert change_between(later, UPRIGHT).difference == pytest.approx(-change.difference)


def test_without_an_error_nothing_is_claimed_and_without_a_value_there_is_no_change():
    assert change_between(UPRIGHT, replace(UPRIGHT, sigma=None, value=99.0)).exceeds is None
    assert change_between(UPRIGHT, replace(UPRIGHT, value=None, why="lost")) is None
    with pytest.raises(ValueError, match="not the same measure"):
        change_between(UPRIGHT, replace(UPRIGHT, unit="min"))


def test_of_sessions_without_a_change_about_five_in_a_hundred_are_marked():
    random, sigma = np.random.default_rng(3), (0.7, 1.3)
    marked = [
        change_between(
            replace(UPRIGHT, value=5 + sigma[0] * random.normal(), sigma=sigma[0]),
            replace(UPRIGHT, value=5 + sigma[1] * random.normal(), sigma=sigma[1]),
        ).exceeds
        for _ in range(4000)
    ]
    assert np.mean(marked) == pytest.approx(0.05, abs=3 * math.sqrt(0.05 * 0.95 / 4000))


def test_the_page_shows_all_sessions_in_the_order_given_and_marks_what_exceeds(tmp_path):
    folders = [session(tmp_path, 1), session(tmp_path, 2, larger(1.02)), session(tmp_path, 3, larger(1.5))]
    page = PageReader(write_comparison(folders, tmp_path / "c.html"))
    heads = [head.text for head in page.find("th", scope="col")]
    assert heads[:6] == ["measure", "week 1", "week 2", "week 3", "change to week 2", "change to week 3"]
    told = row_of(page, "time upright")
    assert "3.25 s ± 0.24 s" in told
    assert "+0.06 snot shown: within the errors (± 0.33 s)" in told
    assert "▲ +1.62 smore than the errors (± 0.33 s)" in told
    assert "no error is stated" in row_of(page, "standing up: how often")
    assert "not comparable" in row_of(page, "knee flexion while upright, mean, right")
    assert not any(
        "by person" in row.text
        for row in page.find("tr")
        if row.ancestors[-1].tag == "tbody" and "measures" in row.ancestors[-2].attributes["class"]
    )


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (lasting(120.0), "not tested: more time recorded"),
        (lasting(30.0), "not tested: less time recorded"),
        (lasting(60.0, 24.0), "not tested: less time with posture known"),
    ],
)
def test_what_grows_with_the_time_is_not_tested_between_sessions_of_different_lengths(tmp_path, later, words):
    changes, told = changes_of(tmp_path, lasting(60.0), later)
    for name in ("time upright", "longest time upright without a break", "bouts of being upright"):
        assert words in changes[name]
        assert "▲" not in changes[name]
        assert "errors" not in changes[name]
    assert "within the errors" in changes["share of known time upright"]
    assert "no error is stated" in changes["contacts at once while upright, mean"]
    assert words.split("time ")[1] in told


def test_of_about_the_same_length_a_change_is_tested_beyond_what_the_length_explains(tmp_path):
    more = tuple(replace(m, value=45.0) if m.measure == "upright_time" else m for m in lasting(62.0))
    changes, told = changes_of(tmp_path, lasting(60.0), more)
    assert "more than the errors" in changes["time upright"]
    assert "within the errors" in changes["longest time upright without a break"]
    assert "the same version with the same settings and cameras" in told


def test_the_path_of_sway_goes_with_the_time_that_sway_is_taken_from(tmp_path):
    changes, told = changes_of(tmp_path, lasting(60.0), lasting(60.0, sway_s=35.0))
    assert "not tested: more time for sway" in changes["sway, path"]
    assert "not tested: more time for sway" in changes["sway, area of the 95 % ellipse"]
    assert "not tested: sway scatters" in changes["sway, mean speed"]
    assert "within the errors" in changes["time upright"]
    assert "for sway: 35.0 instead of 20.0 s" in told


def test_where_it_is_not_known_how_long_a_session_was_nothing_is_claimed(tmp_path):
    changes, _ = changes_of(tmp_path, lasting(60.0)[1:], lasting(120.0)[1:])
    assert "the time recorded is not known" in changes["time upright"]


@pytest.mark.parametrize(
    ("run", "sentence"),
    [
        ({"versions": {"anchorpose": "0.0.1"}}, "tracked by anchorpose 0.0.1 instead of"),
        ({"config": {"gate_m": 0.07, "deep": {"er": 1}}}, "other settings: gate_m, deep.er"),
        (
            {"cameras": [{"name": "side", "camera_to_world": None, "source": "x"}]},
            "other cameras: side instead of front",
        ),
        ({"body": BODY | {"height_m": 1.80}}, "heights differ by 8.0 cm, more than their errors: is it the same"),
        ({}, "the same version with the same settings and cameras"),
    ],
)
def test_what_was_not_recorded_or_computed_alike_is_reported(tmp_path, run, sentence):
    folders = [session(tmp_path, 1), session(tmp_path, 2, **run)]
    page = PageReader(write_comparison(folders, tmp_path / "c.html"))
    sentences = [item.text for item in page.find("li")]
    assert any(sentence in item for item in sentences)
    assert not any(item.endswith("?.") for item in sentences)


def with_stimulation(folder: Path, number: int, amplitudes: list[float | None] | None) -> Path:
    """A week with trials of 4 s in turn, or without trials."""
    written = write_trial_results(folder / f"r{number}", amplitudes or [None] * 10)
    if amplitudes is None:
        (written / "trials.parquet").unlink()
        write_measured(written, ProcessingConfig(), MeasureConfig())
    run = json.loads((written / "run.json").read_text(encoding="utf-8"))
    run |= {"recording": f"week {number}", "inputs_sha256": {"recording.json": f"{number}" * 64}}
    (written / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return written


@pytest.mark.parametrize(
    ("later", "sentence"),
    [
        (
            [None] + [40.0] * 9,
            "36.0 s of on and 4.0 s of off in 40.0 s instead of 4.0 s of on and 36.0 s of off in 40.0 s",
        ),
        (None, "no trials instead of 4.0 s of on and 36.0 s of off in 40.0 s: measures of the whole recording mix"),
        ([None] * 9 + [40.0], None),
    ],
)
def test_other_times_in_the_conditions_are_stated(tmp_path, later, sentence):
    """A patient who does not change seems to, if the second week has more stimulation; the order does not matter."""
    folders = [with_stimulation(tmp_path, 1, [40.0] + [None] * 9), with_stimulation(tmp_path, 2, later)]
    sentences = [item.text for item in PageReader(write_comparison(folders, tmp_path / "c.html")).find("li")]
    assert any("mix the conditions" in item for item in sentences) == (sentence is not None)
    assert sentence is None or any(sentence in item for item in sentences)


def test_measures_of_another_version_are_refused_with_the_remedy(tmp_path):
    one = session(tmp_path, 1)
    for number, measures, what in (
        (2, MEASURES[1:], "recorded_time is in only one of them"),
        (3, (replace(MEASURES[0], unit="min"), *MEASURES[1:]), "recorded_time has another unit"),
    ):
        with pytest.raises(InputError, match=rf"r{number}.measures.parquet: .*{what}.*anchorpose measure"):
            write_comparison([one, session(tmp_path, number, measures)], tmp_path / "c.html")
    assert not (tmp_path / "c.html").exists()


def test_measures_by_other_definitions_are_refused_though_their_names_are_the_same(tmp_path, monkeypatch):
    one, other = session(tmp_path, 1), session(tmp_path, 2)
    config = asdict(MeasureConfig(extension=ExtensionConfig(straight_deg=20.0)))
    write_measures(other / "measures.parquet", MEASURES, config)
    with pytest.raises(InputError, match=r"other definitions: extension.straight_deg.*anchorpose measure"):
        write_comparison([one, other], tmp_path / "c.html")
    monkeypatch.setattr("anchorpose.results.records.__version__", "0.0.1")
    write_measures(other / "measures.parquet", MEASURES, asdict(MeasureConfig()))
    with pytest.raises(InputError, match=r"measured by anchorpose 0\.0\.1 instead of .*anchorpose measure"):
        write_comparison([one, other], tmp_path / "c.html")
    for folder in (one, other):
        pq.write_table(
            pq.read_table(folder / "measures.parquet").replace_schema_metadata(), folder / "measures.parquet"
        )
    with pytest.raises(InputError, match="does not state how it was computed"):
        write_comparison([one, other], tmp_path / "c.html")
    assert not (tmp_path / "c.html").exists()


def test_the_same_session_twice_is_refused(tmp_path):
    one, same = session(tmp_path, 1), session(tmp_path / "copy", 1)
    with pytest.raises(InputError, match="is given twice"):
        write_comparison([one, one], tmp_path / "c.html")
    with pytest.raises(InputError, match="made from the same recording as"):
        write_comparison([one, same], tmp_path / "c.html")


def test_the_verb_makes_either_page_and_refuses_half_a_request(tmp_path, capsys, refusal):
    one, two = session(tmp_path, 1), session(tmp_path, 2)
    assert main(["report", str(one)]) == 0
    assert (one / "report.html").is_file()
    page = tmp_path / "c.html"
    assert main(["report", str(one), str(two), "-o", str(page), "--label", "before", "--label", "after"]) == 0
    assert "change to after" in page.read_text(encoding="utf-8")
    capsys.readouterr()
    for wrong, sentence in (
        ([str(one), str(two)], "give the page to write their comparison to"),
        ([str(one), "-o", str(page)], "is the only session"),
        ([str(one), str(two), "-o", str(page), "--label", "before"], "1 labels are given for 2 sessions"),
    ):
        error = refusal(["report", *wrong])
        assert sentence in error
        assert error.count("\n") == 1


RELIABILITY = "measure,side,unit,subjects,mdc95\nupright_time,,s,20,5.0\nsway_path,,mm,2,\n"


def test_repeated_sessions_decide_where_their_minimal_detectable_change_is_known(tmp_path):
    """A change of 1.62 s is more than the stated errors, and less than sessions differ by without a reason."""
    (tmp_path / "reliability.csv").write_text(RELIABILITY, encoding="utf-8")
    folders = [session(tmp_path, 1), session(tmp_path, 2, larger(1.5))]
    page = PageReader(write_comparison(folders, tmp_path / "c.html", (), tmp_path / "reliability.csv"))
    assert "not shown: below the minimal detectable change (± 5.00 s)" in row_of(page, "time upright")
    assert "no error is stated" in row_of(page, "standing up: how often")


def test_the_larger_limit_counts_where_two_sessions_are_less_certain_than_the_repeated_ones():
    first, later = (Measure(measure="upright_time", value=v, unit="s", sigma=3.0, frames=300) for v in (10.0, 17.0))
    assert change_between(first, later, 5.0) == change_between(first, later)
    assert change_between(first, later, 9.0).repeated
    assert change_between(first, replace(later, sigma=None), 5.0).exceeds


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a,b\n1,2\n", "does not have the columns"),
        ("measure,side,unit,mdc95\nupright_time,,s,often\n", "'often'"),
        ("measure,side,unit,mdc95\n", "holds no minimal"),
    ],
)
def test_another_table_of_reliability_is_refused(tmp_path, text, problem):
    (tmp_path / "reliability.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=problem):
        read_detectable(tmp_path / "reliability.csv", ())


@pytest.mark.parametrize(("side", "unit"), [("", ""), ("", "deg"), ("left", ""), ("left", "°")])
def test_a_minimal_detectable_change_without_the_side_or_unit_of_its_measure_is_refused(tmp_path, side, unit):
    text = f"measure,side,unit,mdc95\nof_another_program,,,1.0\nknee_flexion_upright_mean,{side},{unit},9.0\n"
    (tmp_path / "reliability.csv").write_text(text, encoding="utf-8")
    folders = [session(tmp_path, 1), session(tmp_path, 2)]
    named = rf"\({side or 'no side'}, {unit or 'no unit'}\)"
    problem = rf"has knee_flexion_upright_mean {named}, but .* \(left, deg\) and \(right, deg\); write the columns side"
    with pytest.raises(InputError, match=problem):
        write_comparison(folders, tmp_path / "c.html", reliability=tmp_path / "reliability.csv")
    assert not (tmp_path / "c.html").exists()


def test_every_measure_that_is_computed_grows_with_time_or_does_not(tmp_path):
    folder = session(tmp_path, 1)
    rows = write_measured(folder, ProcessingConfig(), MeasureConfig()).measures
    grown = {row.measure for row in rows if grows_with_time(row)}
    growing = "upright_time upright_bouts longest_upright_bout knee_straight_time sit_to_stand_count sway_path contacts"
    growing += " stand_to_sit_duration_longest assistance_time hands_free_upright_time sway_ellipse_area sway_rms_ap"
    growing += " sway_rms_ml knee_buckle_latency knee_extended_latency tremor_knee_amplitude"
    assert grown >= set(growing.split())
    steady = "upright_share sit_to_stand_duration_mean knee_flexion_upright_greatest sway_velocity load_share"
    steady += " tremor_knee_frequency knee_buckle_rate"
    assert not grown & {*steady.split(), "assistance_share_upright", "hands_on_at_once_mean"}


def test_other_events_do_not_make_another_recording(tmp_path):
    """The same recording, tracked with other trials, is still the same recording."""
    folders = [
        session(tmp_path, 1, inputs_sha256={"recording.json": "1" * 64, "events.tsv": "2" * 64}),
        session(tmp_path, 2, inputs_sha256={"recording.json": "1" * 64, "--events mine.tsv": "3" * 64}),
    ]
    with pytest.raises(InputError, match="same recording"):
        write_comparison(folders, tmp_path / "c.html")


@pytest.mark.parametrize("longer_s", [3.0, 12.0])
def test_a_slightly_longer_session_of_a_patient_who_always_stands_shows_no_change(longer_s):
    """Every measure of time grows by as much as the session; none grows by more than its errors and that."""
    found = [measured(tracked(still(seconds), 0.006, 1, fast_m=0.001))[1] for seconds in (300.0, 300.0 + longer_s)]
    first, later = (list(each.values()) for each in found)
    grown = 0
    for old in first:
        new = found[1].get(old.key)
        if old.value is None or new is None or new.value is None or old.unit != "s" or old.measure == "recorded_time":
            continue
        change = _change(old, new, first, later, None)
        assert "exceeds" not in change, (old.measure, change)
        grown += new.value - old.value > 0.9 * longer_s
    assert grown >= 6


def test_sway_is_tested_by_repeated_sessions_only(tmp_path):
    """The sway of an unchanged patient differs from minute to minute by far more than errors of measurement."""
    more = tuple(replace(m, value=2.0 * m.value) if m.measure == "sway_velocity" else m for m in lasting(60.0))
    changes, _ = changes_of(tmp_path, lasting(60.0), more)
    assert "not tested: sway scatters" in changes["sway, mean speed"]
    velocity, later = (next(m for m in session if m.measure == "sway_velocity") for session in (lasting(60.0), more))
    assert "more than the minimal detectable change" in _change(velocity, later, lasting(60.0), more, 3.0)
