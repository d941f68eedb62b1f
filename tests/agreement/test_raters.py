"""Agreement of raters: known answers, kappa as another way to the same number, and refusals."""

import csv

import numpy as np
import pytest
from ratings_builder import write_scores

from anchorpose.agreement.reliability import absolute_agreement, mean_squares, rater_agreement
from anchorpose.cli import main

JUDGES = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]])
"""Four judges on six targets: Shrout and Fleiss 1979 (doi:10.1037/0033-2909.86.2.420), Table 2."""


@pytest.fixture
def files(tmp_path):
    """Each judge saw the targets in an order of their own."""
    return [
        write_scores(tmp_path / f"{name}.tsv", name, column, seed=k)
        for k, (name, column) in enumerate(zip(["AA", "BB", "CC", "DD"], JUDGES.T.tolist(), strict=True))
    ]


def test_scores_are_joined_by_trial_whatever_order_a_rater_saw_them_in(files):
    found = rater_agreement(files)
    row = found.reliability
    assert (found.raters, found.left_out) == (("AA", "BB", "CC", "DD"), 0)
    assert (row.measure, row.unit, row.subjects, row.repeats) == ("blinded_rating", "score", 6, 4)
    assert (f"{row.icc_2_1:.2f}", f"{row.icc_3_1:.2f}") == ("0.29", "0.71")


def test_sessions_are_put_together_and_a_trial_that_a_rater_left_out_counts_for_nobody(files, tmp_path):
    more = [
        write_scores(tmp_path / f"{n}2.tsv", n, [k, None if n == "CC" else 3], "s2")
        for k, n in enumerate(("AA", "BB", "CC", "DD"))
    ]
    found = rater_agreement([*files, *more])
    assert (found.reliability.subjects, found.left_out) == (7, 1)


def weighted_kappa(a: np.ndarray, b: np.ndarray) -> float:
    """Cohen 1968 with quadratic weights."""
    apart = (a[:, None] - b[None]) ** 2
    return float(1 - np.mean((a - b) ** 2) / np.mean(apart))


def test_with_two_raters_it_is_quadratically_weighted_kappa_but_for_terms_of_one_over_n():
    rng = np.random.default_rng(8)
    for trials in (50, 200, 800):
        truth = rng.integers(0, 11, trials)
        scores = np.clip(np.stack([truth + rng.integers(-1, 3, trials), truth], axis=1), 0, 10).astype(float)
        icc = absolute_agreement(mean_squares(scores), trials, 2).value
        assert abs(icc - weighted_kappa(*scores.T)) < 1.0 / trials


def test_the_verb_prints_and_writes_what_report_reads(files, tmp_path, capsys):
    out = tmp_path / "raters.csv"
    assert main(["reliability", *map(str, files), "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "Raters: AA, BB, CC, DD." in printed
    assert "left out" not in printed
    with out.open(encoding="utf-8", newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert (row["measure"], row["unit"], f"{float(row['icc_2_1']):.2f}") == ("blinded_rating", "score", "0.29")


def test_raters_who_did_not_score_the_same_are_refused_in_one_sentence(files, tmp_path, refusal):
    first = files[0]
    shorter = write_scores(tmp_path / "short.tsv", "EE", [1, 2, 3])
    elsewhere = write_scores(tmp_path / "other.tsv", "EE", [1] * 6, "s2")
    again = write_scores(tmp_path / "again.tsv", "AA", [1] * 6)
    broken = tmp_path / "broken.tsv"
    broken.write_text(first.read_text(encoding="utf-8").replace("\t9\t", "\t12\t"), encoding="utf-8")
    for given, said in (
        ([first, shorter], "has other trials than"),
        ([first, elsewhere], "did not score"),
        ([first, files[1], again], "again"),
        ([first, again], "the only rater"),
        ([first, first], "given twice"),
        ([first, broken], "whole score of 0 to 10"),
        ([first, tmp_path / "none.tsv"], "no such file"),
        ([first], "two raters or more"),
    ):
        sentence = refusal(["reliability", *map(str, given)])
        assert said in " ".join(sentence.split())
        assert "Traceback" not in sentence
