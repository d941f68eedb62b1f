"""The trend over the dates of sessions: a known line, its band, what is refused, how often chance is called a trend."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from page_reader import PageReader
from report_builder import MEASURES, squats, write_session
from scipy import stats

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.report.comparison import write_comparison
from anchorpose.report.trend import dates_in, fit_line, parse_dates

DAYS = ("2025-03-03", "2025-03-10", "2025-03-17", "2025-03-31")

ANSCOMBE_X = np.array([10, 8, 13, 9, 11, 14, 6, 4, 12, 7, 5], dtype=float)
ANSCOMBE_Y = np.array([8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68])
"""Anscombe 1973 (doi:10.1080/00031305.1973.10478966), first set: y = 3.00 + 0.500 x, standard error of the slope 0.118,
residual standard error 1.24 with 9 degrees of freedom."""


def test_anscombe_s_first_line():
    fit = fit_line(ANSCOMBE_X, ANSCOMBE_Y, np.full(11, np.nan))
    assert fit.slope == pytest.approx(0.5001, abs=1e-4)
    assert fit.intercept == pytest.approx(3.0001, abs=1e-4)
    assert fit.scatter == pytest.approx(1.2366, abs=1e-4)
    assert fit.half / stats.t.ppf(0.975, 9) == pytest.approx(0.1179, abs=1e-4)
    at, half = fit.band(np.array([9.0, 14.0]))
    assert at == pytest.approx([7.5009, 10.0014], abs=1e-3)
    assert half[0] == pytest.approx(2.262157 * 1.2366 / math.sqrt(11), abs=1e-3)  # narrowest at the mean of x
    assert half[1] == pytest.approx(2.262157 * 1.2366 * math.sqrt(1 / 11 + 25 / 110), abs=1e-3)


def test_sessions_on_a_line_have_no_band_narrower_than_their_errors():
    x, sigma = np.array([0.0, 1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.0, 1.0])
    fit = fit_line(x, 3.0 - 2.0 * x, sigma)
    assert fit.slope == pytest.approx(-2.0)
    assert fit.scatter == pytest.approx(math.sqrt(2.5))
    assert fit_line(x, 3.0 - 2.0 * x, np.full(4, np.nan)).half == pytest.approx(0.0, abs=1e-9)


def test_of_patients_who_do_not_change_about_five_in_a_hundred_have_a_trend():
    random, x = np.random.default_rng(5), np.array([0.0, 1.0, 2.0, 4.0, 5.0])
    sigma = np.full(5, 0.5)
    fits = [fit_line(x, 10.0 + random.normal(scale=1.5, size=5), sigma) for _ in range(2000)]
    assert np.mean([abs(fit.slope) > fit.half for fit in fits]) <= 0.05 + 2 * math.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        (["2025-03-03"], "1 dates are given for 3 sessions"),
        (["2025-03-03", "soon", "2025-03-17"], "'soon' is not a date"),
        (["2025-03-03", "2025-02-30", "2025-03-17"], "'2025-02-30' is not a date"),
        (["2025-03-10", "2025-03-03", "2025-03-17"], "go back in time"),
    ],
)
def test_dates_that_cannot_be_are_refused(texts, problem):
    with pytest.raises(InputError) as refused:
        parse_dates(texts, 3, Path("c.html"))
    assert problem in str(refused.value)


def test_labels_are_dates_where_all_of_them_are():
    assert dates_in(["2025-03-03", "2025-03-10"]) == ["2025-03-03", "2025-03-10"]
    assert dates_in(["2025-03-03", "after"]) == []
    assert dates_in(["2025-03-10", "2025-03-03"]) == []
    assert parse_dates([], 2, Path("c.html")) is None


def sessions(folder: Path, knees: list[float | None]) -> list[Path]:
    """A session for each mean flexion of the left knee; all else stays as it is."""
    made = []
    for number, degrees in enumerate(knees, 1):
        why = "lost" if degrees is None else None
        measures = tuple(
            replace(row, value=degrees, why=why, sigma=None if degrees is None else 1.0)
            if row.measure == "knee_flexion_upright_mean" and row.side == "left"
            else row
            for row in MEASURES
        )
        run = {"recording": f"week {number}", "inputs_sha256": {"recording.json": f"{number}" * 64}}
        made.append(write_session(folder / f"r{number}", squats(30, seed=number), measures, **run))
    return made


def trends_of(page: PageReader) -> dict[str, list[str]]:
    table = next(t for t in page.find("table") if t.children[0].text == "Trends")
    rows = [row for row in page.find("tr") if table in row.ancestors][1:]
    return {row.children[0].text: [cell.text for cell in row.children[1:]] for row in rows}


LEFT = "knee flexion while upright, mean, left"


def test_a_knee_that_straightens_over_weeks_falls(tmp_path, capsys):
    folders = sessions(tmp_path, [20.0, 16.1, 12.0, 4.1])
    page_file = tmp_path / "c.html"
    dates = [text for day in DAYS for text in ("--date", day)]
    assert main(["report", *map(str, folders), "-o", str(page_file), *dates]) == 0
    page = PageReader(page_file)
    slope, change, verdict = trends_of(page)[LEFT]
    assert slope.startswith("\u22124.0°")
    assert change.startswith(("\u221216°", "\u221215.9°"))
    assert verdict == "▼ falling"
    assert trends_of(page)["share of known time upright"][2] == "not tested: it has the same value in all sessions"
    (chart,) = page.find("figure", id="trend-knee_flexion_upright_mean")
    dots = [
        p.attributes["d"] for p in page.find("path") if p.attributes["class"] == "dot left" and chart in p.ancestors
    ]
    assert dots[0].count("M") == 4
    bands = [
        p.attributes["d"] for p in page.find("path") if p.attributes["class"] == "band left" and chart in p.ancestors
    ]
    assert bands[0].endswith("z")
    assert [row.text.split("\u2003")[0][:10] for row in page.find("tr") if chart in row.ancestors][1:] == list(DAYS)


def test_a_change_below_the_minimal_detectable_change_is_no_trend(tmp_path):
    folders = sessions(tmp_path, [20.0, 16.1, 12.0, 4.1])
    table = tmp_path / "reliability.csv"
    table.write_text("measure,side,unit,mdc95\nknee_flexion_upright_mean,left,deg,18\n")
    page = PageReader(write_comparison(folders, tmp_path / "c.html", DAYS, table))  # labels that are dates
    assert trends_of(page)[LEFT][2] == "not shown: below the minimal detectable change (± 18.0°)"


def test_scatter_is_no_trend_and_missing_values_leave_too_few_days(tmp_path):
    page = PageReader(write_comparison(sessions(tmp_path / "a", [12.0, 15.0, 11.0, 14.0]), tmp_path / "a.html", DAYS))
    assert trends_of(page)[LEFT][2] == "not shown: the interval holds 0"
    page = PageReader(write_comparison(sessions(tmp_path / "b", [12.0, None, 11.0, None]), tmp_path / "b.html", DAYS))
    assert trends_of(page)[LEFT][2] == "not tested: only 2 days have a value, 3 are needed"
    assert page.find("figure", id="trend-knee_flexion_upright_mean") == []


@pytest.mark.parametrize(
    ("count", "labels", "words"),
    [
        (3, (), "the dates of the sessions are not known. Give --date once for each session"),
        (2, DAYS[:2], "it needs 3 sessions of different days at least, and these are 2"),
        (3, (DAYS[0], DAYS[0], DAYS[1]), "it needs 3 sessions of different days at least, and these are 2"),
    ],
)
def test_without_dates_or_with_too_few_there_is_a_sentence_and_no_trend(tmp_path, count, labels, words):
    folders = sessions(tmp_path, [12.0, 15.0, 11.0][:count])
    page = PageReader(write_comparison(folders, tmp_path / "c.html", (), None, labels))
    (section,) = page.find("section", id="trend")
    assert words in section.text
    assert not [t for t in page.find("table") if t.children[0].text == "Trends"]


def test_times_of_sessions_that_last_differently_have_no_trend(tmp_path):
    folders = sessions(tmp_path, [12.0, 15.0, 11.0])
    longer = tuple(replace(row, value=8.0) if row.measure == "recorded_time" else row for row in MEASURES)
    run = {"recording": "week 4", "inputs_sha256": {"recording.json": "4" * 64}}
    folders.append(write_session(tmp_path / "r4", squats(30, seed=4), longer, **run))
    page = PageReader(write_comparison(folders, tmp_path / "c.html", DAYS))
    assert "it grows with time" in trends_of(page)["time upright"][2]


def test_dates_belong_to_several_sessions(tmp_path, refusal):
    (one,) = sessions(tmp_path, [12.0])
    assert "is the only session" in refusal(["report", str(one), "--date", "2025-03-03"])
