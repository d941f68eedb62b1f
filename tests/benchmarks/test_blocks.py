"""Figures in pages: blocks are found, measured once per commit, and written with their origin."""

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import documents
import versions
from blocks import HEADLINES, Wanted, blocks_in, table_of, with_contents
from headlines import EASY, HARD, REAL, headline_table
from headlines import HEADLINES as ROWS
from measurements import Measurement, Origin, keep, kept_of
from suites import cases_of
from table import table

PAGE = """Before.

<!-- measured: easy --use held-out --columns mean_mm lost --rows "one camera" -->

old

<!-- end -->

<!-- measured once: anchorpose experiment OUT -->
| a |
|--:|
<!-- end -->

After.
"""
ROWS_MEASURED = {
    "one camera, nobody else": [{"mean_mm": 6.0, "lost": 0.01}, {"mean_mm": 8.0, "lost": 0.0}],
    "the same clinic": [{"mean_mm": 20.0}],
}
ORIGIN = Origin("0123456789", "2026-01-02", "a machine, 2 cores")


@pytest.fixture
def pages(tmp_path, monkeypatch) -> Path:
    """A repository with one page, at a commit whose name nothing else has."""
    (tmp_path / "README.md").write_text(PAGE)
    monkeypatch.setattr(documents, "REPOSITORY", tmp_path)
    monkeypatch.setattr(documents, "commit_of_code", lambda: ORIGIN.commit)
    monkeypatch.setattr(documents, "origin_of_now", lambda commit: ORIGIN)
    return tmp_path


def test_only_blocks_change_and_those_written_by_hand_do_not():
    assert with_contents(PAGE, lambda block: None) == PAGE
    changed = with_contents(PAGE, lambda block: "new")
    assert changed == PAGE.replace("\nold\n", "\nnew\n")
    assert with_contents(changed, lambda block: "new") == changed


def test_a_block_says_what_it_needs():
    first, second = blocks_in(PAGE)
    assert (first.once, second.once) == (False, True)
    asked = table_of(first)
    assert (asked.wanted, asked.columns, asked.rows) == (EASY, ("mean_mm", "lost"), ("one camera",))
    assert asked.wanted.command == "python benchmarks/run.py easy --use held-out"
    assert Wanted("benchmarks/limits.py", options=("one", "clinic")).command == "python benchmarks/limits.py one clinic"


@pytest.mark.parametrize("words", ["nowhere", "easy --columns", "easy --use both", "easy more", f"{HEADLINES} --quick"])
def test_words_without_a_meaning_are_refused(words):
    (block,) = blocks_in(f"<!-- measured: {words} -->\n<!-- end -->")
    with pytest.raises(ValueError, match=r"."):
        table_of(block)


def test_a_page_is_filled_and_nothing_is_measured_twice_with_one_commit(pages, tmp_path):
    asked = []

    def measure(wanted: Wanted) -> dict[str, list[dict[str, float]]]:
        asked.append(wanted)
        return ROWS_MEASURED

    for _ in range(2):
        documents.fill(["README.md"], tmp_path / "cache", measure)
    assert asked == [EASY]
    text = (pages / "README.md").read_text()
    assert "| one camera, nobody else | 2 | 7.0 (8.0) | 0.5 |" in text
    assert "the same clinic" not in text
    assert "*Commit 0123456789, 2026-01-02, a machine, 2 cores:* `python benchmarks/run.py easy --use held-out`" in text
    assert text.startswith("Before.")
    assert text.endswith("After.\n")


def test_a_suite_that_fails_keeps_none_of_the_others_from_being_written(pages, tmp_path):
    page = pages / "README.md"
    page.write_text("<!-- measured: hard --columns mean_mm -->\n<!-- end -->\n" + PAGE)

    def measure(wanted: Wanted) -> dict[str, list[dict[str, float]]]:
        if wanted.name == "hard":
            raise RuntimeError("a recording that is broken")
        return ROWS_MEASURED

    with pytest.raises(SystemExit, match="a recording that is broken"):
        documents.fill(["README.md"], tmp_path / "cache", measure)
    assert "7.0 (8.0)" in page.read_text()


def test_what_a_script_prints_is_the_content(pages, tmp_path):
    (pages / "benchmarks").mkdir()
    (pages / "benchmarks/hello.py").write_text("import sys; print('| ' + sys.argv[1] + ' |')")
    (pages / "README.md").write_text("<!-- measured: benchmarks/hello.py world -->\n<!-- end -->\n")
    documents.fill(["README.md"], tmp_path / "cache", lambda wanted: {})
    content = "| world |\n\n*Commit 0123456789, 2026-01-02, a machine, 2 cores:* `python benchmarks/hello.py world`"
    assert (pages / "README.md").read_text() == (
        f"<!-- measured: benchmarks/hello.py world -->\n\n{content}\n\n<!-- end -->\n"
    )


def test_figures_are_of_the_last_commit_of_the_code_which_must_hold_every_change(tmp_path, monkeypatch):
    def git(*arguments: str) -> str:
        identity = ("-c", "user.name=nobody", "-c", "user.email=nobody")
        done = subprocess.run(["git", *identity, *arguments], cwd=tmp_path, check=True, capture_output=True, text=True)
        return done.stdout.strip()

    monkeypatch.setattr(versions, "REPOSITORY", tmp_path)
    git("init", "-q")
    (tmp_path / "src").mkdir()
    (tmp_path / "src/code.py").write_text("1")
    git("add", "-A")
    git("commit", "-qm", "code")
    code = git("rev-parse", "--short=10", "HEAD")
    (tmp_path / "README.md").write_text("a page")
    git("add", "-A")
    git("commit", "-qm", "a page")
    assert versions.commit_of_code() == code
    (tmp_path / "src/code.py").write_text("2")
    with pytest.raises(SystemExit, match=r"src/code\.py"):
        versions.commit_of_code()


def test_from_what_is_kept_a_block_that_was_never_measured_is_named_and_stays(pages, tmp_path):
    with pytest.raises(SystemExit, match=r"not measured yet: python benchmarks/run\.py easy --use held-out"):
        documents.fill(["README.md"], tmp_path / "cache", None)
    assert (pages / "README.md").read_text() == PAGE


def test_a_page_that_is_none_is_refused(tmp_path):
    with pytest.raises(SystemExit, match=r"no page docs/nothing\.md"):
        documents.fill(["docs/nothing.md"], tmp_path, None)


def test_a_measurement_is_read_as_it_was_kept(tmp_path):
    measurement = Measurement(ORIGIN, {"a": [{"mean_mm": float("nan")}]})
    keep(EASY, measurement, tmp_path)
    assert repr(kept_of(EASY, tmp_path)) == repr(measurement)  # a NaN equals nothing
    assert kept_of(HARD, tmp_path) is None


def test_a_column_that_no_recording_has_is_refused():
    assert "| 7.0 (8.0) |" in table(ROWS_MEASURED, ["mean_mm"])
    for name in ("mean", "thigh", "hidden_mm"):
        with pytest.raises(KeyError, match=f"no {name} was measured"):
            table(ROWS_MEASURED, [name])


def test_counts_have_no_decimals_and_percentages_one():
    rows = {"a": [{"images": 19.0, "found_percent": 97.36, "certainty": 0.5, "lag_ms": 1.25}]}
    text = table(rows, ["images", "found_percent", "certainty", "lag_ms"]).splitlines()
    assert text[0] == "| scene | recordings | images | found % | certainty | lag ms |"
    assert text[2] == "| a | 1 | 19 | 97.4 | 0.50 | 1.25 |"


def test_every_headline_has_its_row_in_its_suite():
    for one in ROWS:
        rows = {case.row for case in cases_of([one.wanted.name], one.wanted.use, False)[one.wanted.name]}
        assert one.wanted == REAL or any(row.startswith(one.rows) for row in rows), one.situation


def test_headlines_state_means_and_the_worst():
    joints = [{"mean_mm": 10.0, "confident": 0.002}, {"mean_mm": 30.0, "confident": 0.0}]
    real = {
        "MSR Action3D: labels": [
            {"labels": 10.0, "within_100": 1.0, "median_mm": 30.0},
            {"labels": 30.0, "within_100": 0.8, "median_mm": 40.0},
        ],
        "thigh sensor: squat": [{"tilt_deg": 2.0, "kinect_deg": 4.0}],
        "thigh sensor: walk": [{"tilt_deg": 6.0, "kinect_deg": 5.0}],
    }
    measured = {REAL: real, EASY: {}, HARD: {}} | {
        wanted: {one.rows: [*joints, {"refused": 1.0}] for one in ROWS if one.wanted == wanted}
        for wanted in (EASY, HARD)
    }
    text = headline_table(measured)
    assert "4.0 degrees in 2 recordings; the Kinect's own skeleton 4.5 |" in text
    assert "85 % of 40 joints within 100 mm, the median 35 mm |" in text
    assert "20.0 mm, the worst of 2 recordings 30.0; 0.10 % of the joints are over 100 mm and" in text
    assert "four sigma off; 1 more refused |" in text
    with pytest.raises(KeyError, match="one camera"):
        headline_table(measured | {EASY: {}})
