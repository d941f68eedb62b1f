"""The pages on faults and quality name tests that exist: a renamed test would leave a claim that nothing supports."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMED = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")


def named_tests(page: str) -> list[tuple[str, str]]:
    """(file, function) of each test that a page of the docs names; the function is empty where the whole file is."""
    return NAMED.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", ["faults.md"])
def test_every_test_that_a_page_names_exists(page: str) -> None:
    missing = [
        f"{file}::{function}"
        for file, function in named_tests(page)
        if not (ROOT / file).is_file() or f"def {function}" not in (ROOT / file).read_text(encoding="utf-8")
    ]
    assert missing == []


def test_every_fault_has_its_test() -> None:
    rows = [line for line in (ROOT / "docs/faults.md").read_text(encoding="utf-8").splitlines() if line[:2] == "| "]
    assert [row for row in rows if not NAMED.search(row) and "fault | what" not in row] == []
    assert len(rows) >= 20
