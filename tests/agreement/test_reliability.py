"""Intraclass correlations against Shrout and Fleiss 1979 to the printed digit; laws and refusals."""

import csv

import numpy as np
import pytest
from report_builder import squats, write_session

from anchorpose.agreement.reliability import (
    absolute_agreement,
    consistency,
    mean_squares,
    reliability_of,
    session_reliability,
)
from anchorpose.cli import main
from anchorpose.errors import InputError

RATINGS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
"""Four judges on six targets: Shrout and Fleiss 1979 (doi:10.1037/0033-2909.86.2.420), Table 2."""


def test_correlations_are_those_of_shrout_and_fleiss_to_the_printed_digit():
    ms = mean_squares(RATINGS)
    assert (f"{ms.subjects:.2f}", f"{ms.repeats:.2f}", f"{ms.rest:.2f}") == ("11.24", "32.49", "1.02")
    two, three = absolute_agreement(ms, 6, 4), consistency(ms, 6, 4)
    assert (f"{two.value:.2f}", f"{three.value:.2f}") == ("0.29", "0.71")
    # the intervals that R's psych and irr give for these data
    assert (f"{two.low:.3f}", f"{two.high:.3f}") == ("0.019", "0.761")
    assert (f"{three.low:.3f}", f"{three.high:.3f}") == ("0.342", "0.946")


def test_the_analysis_of_variance_is_that_of_statsmodels():
    """Least squares with an unknown for each subject and each repeat."""
    pandas, api = pytest.importorskip("pandas"), pytest.importorskip("statsmodels.formula.api")
    anova = pytest.importorskip("statsmodels.stats.anova")
    values = np.random.default_rng(3).normal(1e4, 3.0, (7, 4))
    subjects, repeats = np.indices(values.shape)
    columns = {"value": (values - 1e4).ravel(), "subject": subjects.ravel(), "repeated": repeats.ravel()}
    model = api.ols("value ~ C(subject) + C(repeated)", pandas.DataFrame(columns)).fit()
    known = anova.anova_lm(model)["mean_sq"]
    found = mean_squares(values)
    assert (found.subjects, found.repeats, found.rest) == pytest.approx(tuple(known.tolist()))


def test_many_subjects_cost_no_more_than_their_values():
    values = np.random.default_rng(4).normal(size=(200_000, 3))
    assert mean_squares(values).rest == pytest.approx(1.0, rel=0.02)


def test_intervals_hold_the_true_correlation_95_times_in_100():
    """Subjects spread by 2, sessions by 0.5, errors by 1: ICC(2,1) is 4 / 5.25, ICC(3,1) is 4 / 5."""
    rng, inside, repeats = np.random.default_rng(5), np.zeros(2), 400
    for _ in range(repeats):
        sessions = 0.5 * rng.normal(size=(1, 5))
        values = 2.0 * rng.normal(size=(20, 1)) + sessions + rng.normal(size=(20, 5))
        two, three = (each(mean_squares(values), 20, 5) for each in (absolute_agreement, consistency))
        inside += [two.low < 4.0 / 5.25 < two.high, three.low < 4.0 / 5.0 < three.high]
    assert (inside / repeats > 0.9).all(), inside / repeats


def test_the_minimal_detectable_change_is_exceeded_by_chance_5_times_in_100():
    rng = np.random.default_rng(8)
    found = reliability_of("a", None, "s", 10.0 * rng.normal(size=(300, 1)) + 3.0 * rng.normal(size=(300, 2)))
    assert found.sem == pytest.approx(3.0, rel=0.1)
    change = 3.0 * (rng.normal(size=20000) - rng.normal(size=20000))
    assert np.mean(np.abs(change) > found.mdc95) == pytest.approx(0.05, abs=0.03)


def test_a_constant_shift_between_sessions_lowers_agreement_and_not_consistency():
    shifted = RATINGS + np.array([0.0, 5.0, 0.0, 0.0])
    before, after = reliability_of("a", None, "1", RATINGS), reliability_of("a", None, "1", shifted)
    assert after.icc_3_1 == pytest.approx(before.icc_3_1)
    assert after.icc_2_1 != pytest.approx(before.icc_2_1, abs=0.01)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (RATINGS[:2], "2 subjects"),
        (RATINGS[:, :1], "only one session"),
        (np.ones((5, 2)), "never differs"),
        (np.arange(5.0)[:, None] + np.array([0.0, 1.0]), "equal but for a constant"),
    ],
)
def test_what_cannot_be_judged_has_a_reason_and_no_value(values, why):
    found = reliability_of("a", "left", "s", values)
    assert found.icc_2_1 is None
    assert why in found.why


def test_subjects_without_a_value_in_every_session_are_left_out():
    holes = np.vstack([RATINGS, [[1.0, np.nan, 2.0, 3.0]]])
    found = reliability_of("a", None, "1", holes)
    assert (found.subjects, found.icc_2_1) == (6, reliability_of("a", None, "1", RATINGS).icc_2_1)


def _sessions(path, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    return path


def test_the_verb_reads_numbers_and_writes_its_table(tmp_path, capsys):
    rows = [["subject", "rater", "measure", "value", "unit"]]
    rows += [[f"p{s}", r, "score", RATINGS[s, r], "1"] for s in range(6) for r in range(4)]
    path = _sessions(tmp_path / "sessions.csv", rows)
    assert main(["reliability", str(path), "-o", str(tmp_path / "reliability.csv")]) == 0
    assert "0.29" in capsys.readouterr().out
    table = list(csv.DictReader((tmp_path / "reliability.csv").open(encoding="utf-8")))
    assert f"{float(table[0]['icc_3_1']):.2f}" == "0.71"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda v: v * [1, 1, 1000, 1], "session 'c' has values 786 times those of the others"),
        (lambda v: v * [1, 0.001, 1, 1], "session 'b' has values 0.000429 times those of the others"),
        (lambda v: v * np.where(np.arange(24).reshape(6, 4) == 9, 1000, 1), "session 'b' of subject 'p2' has"),
        (lambda v: v * [1, 20, 1, 1], None),
    ],
)
def test_a_session_in_another_unit_is_stated_and_gives_no_value(tmp_path, change, why):
    values = change(RATINGS + 1.0)
    rows = [["subject", "session", "measure", "value"]]
    rows += [[f"p{s}", "abcd"[r], "score", values[s, r]] for s in range(6) for r in range(4)]
    (found,) = session_reliability(_sessions(tmp_path / "sessions.csv", rows))
    assert (found.why is None) == (why is None)
    if why is not None:
        assert found.why.startswith(why)
        assert found.icc_2_1 is None


def _of_folders(path, repeated, *folders):
    rows = [[f"p{n // 2}", n % 2, folder] for n, folder in enumerate(folders)]
    return session_reliability(_sessions(path / "sessions.csv", [["subject", repeated, "results"], *rows]))


def test_a_folder_or_recording_counts_once_unless_raters_or_devices_share_a_recording(tmp_path):
    for n, recording in enumerate("abcdeff"):
        hashes = {"recording.json": recording * 64, "events.tsv": f"{n}" * 64}
        write_session(tmp_path / f"r{n}", squats(4), inputs_sha256=hashes)
    assert _of_folders(tmp_path, "session", "r0", "r1", "r2", "r3", "r4", "r5")[0].subjects == 3
    for repeated in ("session", "rater", "device"):
        with pytest.raises(InputError, match="r0: is given twice"):
            _of_folders(tmp_path, repeated, "r0", "r1", "r2", "../" + tmp_path.name + "/r0")
    with pytest.raises(InputError, match=r"r6: was made from the same recording as .*r5;"):
        _of_folders(tmp_path, "session", "r5", "r6")
    for repeated in ("rater", "device"):
        assert _of_folders(tmp_path, repeated, "r5", "r6")[0].repeats == 2


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([["subject", "value"]], "columns"),
        ([["subject", "session", "measure", "value"]], "holds no sessions"),
        ([["subject", "session", "measure", "value"], ["a", "1", "m", "x"]], "not a number"),
        ([["subject", "session", "measure", "value"], ["a", "1", "m", "1_0"]], "'1_0', which is not a number"),
        ([["subject", "session", "measure", "value"], ["a", "1", "m", "\uff11\uff12"]], "not a number"),
        ([["subject", "session", "measure", "value"], ["a", "1", "m", "9" * 400]], "'9{40}', which is not a number"),
        ([["subject", "session", "measure", "value"], ["a", "1", "m", "1"], ["a", "1", "m", "2"]], "twice"),
        ([["subject", "session", "results"], ["a", "1", "nowhere"]], "no such file"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(tmp_path, rows, problem):
    with pytest.raises(InputError, match=problem):
        session_reliability(_sessions(tmp_path / "sessions.csv", rows))
