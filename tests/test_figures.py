"""No page of README and docs has a measured figure that no command produces: the rules of CONTRIBUTING, "Figures"."""

import inspect
import re
import sys
from pathlib import Path
from typing import Final

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import run
from blocks import BLOCK, NOT_YET, Block, Table, blocks_in, table_of
from documents import PAGES, wanted_by
from probing import PROBES
from remarks import REMARKS
from suites import cases_of

ROOT: Final = Path(__file__).parents[1]
TABLE: Final = re.compile(r"^\|[^\n]*\|\n\|[-:| ]+\|\n(?:\|[^\n]*\|\n)+", re.MULTILINE)
FIGURE: Final = re.compile(r"\| *\**[<±+−-]?\d[\d.,]*(?: to [\d.]+)? ?(?:mm|cm|degrees|°|ms|s|%|MB|GB)(?= *[|;,/])")
COMMIT: Final = re.compile(r"commits? `?[0-9a-f]{7,12}\b")
ORIGIN: Final = re.compile(r"^\*Commit [0-9a-f]{7,12}, \d{4}-\d\d-\d\d, [^\n]+:\* `python [^\n]+`$", re.MULTILINE)

NOT_MEASURED: Final = {
    ("docs/benchmark.md", "| part |"): "numbers of recordings",
    ("docs/calibration.md", "| tested |"): "limits of the program",
    ("docs/export.md", "| seed |"): "tests/exports/test_opensim.py checks these figures",
    ("docs/guide/cameras.md", "| camera, mode |"): "makers' specifications",
    ("docs/guide/record.md", "| question |"): "limits of the program",
    ("docs/measures.md", "| measure"): "definitions",
    ("docs/simulate.md", "| sensor | image |"): "what the simulator is set to",
    ("docs/sizing.md", "| three cameras |"): "extrapolated, as it says",
}
"""Tables with figures that are no measurements, by page and beginning, and what they are."""


def outside_of_blocks(page: str) -> str:
    """The text of a page without its measured blocks and its code."""
    text = BLOCK.sub("", (ROOT / page).read_text(encoding="utf-8"))
    return re.sub(r"^ *```.*?^ *```", "", text, flags=re.DOTALL | re.MULTILINE)


def tables_of_figures(text: str) -> list[str]:
    """The tables with a column of numbers, which is aligned to the right, or a cell that begins with a figure."""
    found = (match[0] for match in TABLE.finditer(text))
    return [table for table in found if "--:|" in table.splitlines()[1] or FIGURE.search(table)]


def test_what_counts_as_a_table_of_figures():
    for row in ("| a | 3.5 mm |", "| a | 12 to 14 %; 2 |", "| a | **0.4** |", "| a | ±2 degrees |"):
        aligned = "|---|--:|" if "mm" not in row else "|---|---|"
        assert tables_of_figures(f"| a | b |\n{aligned}\n{row}\n"), row
    for row in ("| a | within 5 mm |", "| a | `0.04` |", "| a | 3 sensors |"):
        assert not tables_of_figures(f"| a | b |\n|---|---|\n{row}\n"), row


@pytest.mark.parametrize("page", PAGES)
def test_every_table_of_figures_is_in_a_measured_block(page):
    exempt = tuple(beginning for of, beginning in NOT_MEASURED if of == page)
    loose = [table for table in tables_of_figures(outside_of_blocks(page)) if not table.startswith(exempt or "\0")]
    assert loose == []


def test_every_exemption_is_of_use():
    for page, beginning in NOT_MEASURED:
        assert any(table.startswith(beginning) for table in tables_of_figures(outside_of_blocks(page))), page


@pytest.mark.parametrize("page", PAGES)
def test_a_figure_of_a_commit_is_in_a_measured_block(page):
    assert COMMIT.findall(outside_of_blocks(page)) == []


def blocks() -> list[tuple[str, Block]]:
    found = ((page, (ROOT / page).read_text(encoding="utf-8")) for page in PAGES)
    return [(page, block) for page, text in found for block in blocks_in(text)]


@pytest.mark.parametrize("page", PAGES)
def test_every_comment_belongs_to_a_block(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert text.count("<!-- measured") == text.count("<!-- end -->") == len(blocks_in(text))


@pytest.mark.parametrize(("page", "block"), [one for one in blocks() if not one[1].once])
def test_a_block_asks_for_what_its_suite_or_script_produces(page, block):
    asked = table_of(block)
    if asked is None:
        return
    if asked.wanted.is_script:
        assert (ROOT / asked.wanted.name).is_file()
        return
    cases = cases_of([asked.wanted.name], asked.wanted.use, asked.wanted.quick)[asked.wanted.name]
    if not cases:
        pytest.skip("its recordings are not here")
    for row in asked.rows:
        assert any(case.row.startswith(row) or row.startswith(case.row) for case in cases), row
    assert unknown_columns(asked) == set()


def unknown_columns(asked: Table) -> set[str]:
    """The columns that no probe and no score of the suite names."""
    cases = cases_of([asked.wanted.name], asked.wanted.use, asked.wanted.quick)[asked.wanted.name]
    probes = {case.probe.script for case in cases if case.probe is not None}
    modules = {inspect.getmodule(getattr(case.score, "func", case.score)) for case in cases if case.probe is None}
    sources = [(ROOT / PROBES / f"{name}.py").read_text(encoding="utf-8") for name in probes]
    sources += [inspect.getsource(module) for module in (*modules, run) if module is not None]
    known = {one.name for one in REMARKS} | set(re.findall(r'"([a-z][a-z_0-9]*)"', " ".join(sources)))
    return set(asked.columns) - known


def test_a_column_that_nothing_measures_is_refused():
    (block,) = blocks_in("<!-- measured: clocks --columns offset_ms mean_mm -->\n<!-- end -->")
    asked = table_of(block)
    assert asked is not None
    assert unknown_columns(asked) == {"mean_mm"}


@pytest.mark.parametrize(("page", "block"), blocks())
def test_a_block_ends_with_its_origin(page, block):
    content = block.content.strip()
    named = COMMIT.search(content.lower()) if block.once else ORIGIN.search(content) or content == NOT_YET
    assert named, f"{page}: {block.words}"


@pytest.mark.parametrize("page", PAGES)
def test_the_measured_blocks_of_a_page_are_of_one_commit(page):
    commits: dict[str, list[str]] = {}
    for block in blocks_in((ROOT / page).read_text(encoding="utf-8")):
        for commit in () if block.once else re.findall(r"^\*Commit ([0-9a-f]+),", block.content, re.MULTILINE):
            commits.setdefault(commit, []).append(block.words)
    assert len(commits) <= 1, commits


@pytest.mark.parametrize(("page", "block"), [one for one in blocks() if one[1].once])
def test_what_was_measured_by_hand_can_be_repeated(page, block):
    scripts = re.findall(r"\b(?:benchmarks|tools|tests|examples)/[\w/]+\.py", block.words)
    assert scripts or block.words.startswith("anchorpose ")
    assert [name for name in scripts if not (ROOT / name).is_file()] == []


def test_every_block_stands_in_the_list_of_claims():
    rows = [row for row in (ROOT / "docs/claims.md").read_text(encoding="utf-8").splitlines() if row.startswith("|")]
    for page, block in blocks():
        link = "| README, " if page == "README.md" else f"({page.removeprefix('docs/')}"
        needed = [block.words] if block.once else [wanted.command for wanted in wanted_by(table_of(block))]
        listed = any(link in row and all(f"`{command}`" in row for command in needed) for row in rows)
        assert listed, f"docs/claims.md has no row for {page}: {block.words}"


def test_every_command_of_the_list_of_claims_exists():
    text = (ROOT / "docs/claims.md").read_text(encoding="utf-8")
    named = set(re.findall(r"\b(?:benchmarks|tools|tests)/[\w/]+(?:\.py)?", text))
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
