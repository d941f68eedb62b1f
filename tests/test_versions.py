"""The digest of the code: the same for the same files, another for any other."""

import json
from pathlib import Path

import pytest

from anchorpose import versions
from anchorpose.results.run_record import RunRecord, write_run_record


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of three files."""
    for name in ("versions.py", "stage/a.py", "viewer/b.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(versions, "__file__", str(tmp_path / "versions.py"))
    return tmp_path


def digest(*leave_out: str) -> str:
    versions.code_digest.cache_clear()
    try:
        return versions.code_digest(leave_out)
    finally:
        versions.code_digest.cache_clear()


@pytest.mark.parametrize("change", ["stage/a.py", "stage/c.py", "stage/data.npz", "stage/data.weights"])
def test_a_changed_or_added_file_is_another_digest(package: Path, change: str) -> None:
    before = digest()
    (package / change).write_text("changed")
    assert digest() != before


def test_what_is_left_out_and_what_is_not_code_changes_nothing(package: Path) -> None:
    before = digest("viewer/")
    (package / "viewer/b.py").write_text("changed")
    (package / "stage/notes.txt").write_text("changed")
    assert digest("viewer/") == before


def test_a_run_states_version_and_code(tmp_path: Path) -> None:
    write_run_record(tmp_path / "run.json", RunRecord(recording="r", config=None, inputs_sha256={}, cameras=()))
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["code"] == versions.code_digest()
    assert run["versions"]["anchorpose"] == versions.versions()["anchorpose"]
