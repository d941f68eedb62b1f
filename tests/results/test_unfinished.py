"""A results folder in the making: kept when its run is stopped, taken up again, and never made by two runs at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.results.folder import RESULTS
from anchorpose.results.unfinished import JOURNAL, begin_journal, end_journal, unfinished_results

INPUTS = {"recording.json": "0", "front/depth/000000.png": "1"}


@pytest.fixture
def recording(tmp_path) -> Path:
    (tmp_path / "recording").mkdir()
    return tmp_path / "recording"


class _Stopped(Exception):
    """Whatever ends a run."""


def _run(path: Path, recording: Path, stored: int, error: type[BaseException] | None = None, **options: bool) -> int:
    """A run that stores as many values, and then fails or ends; returns how many it found."""
    with unfinished_results(path, recording, **options) as folder:
        journal = begin_journal(folder, "identity", INPUTS)
        found = len(list(journal.glob("*.frames")))
        for number in range(found, found + stored):
            (journal / f"{number}.frames").write_text("frames")
        if error is not None:
            raise error
        for name in RESULTS.marks:
            (folder / name).write_text(str(found + stored))
        end_journal(folder)
    return found


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_stopped_run_goes_on_with_what_it_has_stored(tmp_path, recording, error):
    with pytest.raises(error) as stopped:
        _run(tmp_path / "out", recording, 3, error)
    assert "--resume" in stopped.value.__notes__[0]
    assert _names(tmp_path) == {"recording", ".out.unfinished"}
    assert _run(tmp_path / "out", recording, 2, resume=True) == 3
    assert (tmp_path / "out" / "run.json").read_text() == "5"
    assert _names(tmp_path) == {"recording", "out"}
    assert _names(tmp_path / "out") == set(RESULTS.marks)


def test_a_run_that_stored_nothing_leaves_nothing(tmp_path, recording):
    with pytest.raises(_Stopped):
        _run(tmp_path / "out", recording, 0, _Stopped)
    assert _names(tmp_path) == {"recording"}


def test_what_a_run_left_that_was_killed_before_it_stored_anything_is_in_nobodys_way(tmp_path, recording):
    (tmp_path / ".out.unfinished" / JOURNAL).mkdir(parents=True)
    (tmp_path / ".out.unfinished" / JOURNAL / "begun.json").write_text("half")
    (tmp_path / ".out.unfinished" / "joints.parquet").write_text("half")
    assert _run(tmp_path / "out", recording, 1) == 0


def test_an_unfinished_run_is_neither_continued_nor_deleted_unasked(tmp_path, recording):
    with pytest.raises(_Stopped):
        _run(tmp_path / "out", recording, 3, _Stopped)
    with pytest.raises(InputError, match="--resume"):
        _run(tmp_path / "out", recording, 1)
    assert len(list((tmp_path / ".out.unfinished").rglob("*.frames"))) == 3
    assert _run(tmp_path / "out", recording, 1, overwrite=True) == 0


def test_two_runs_into_one_folder_are_refused(tmp_path, recording):
    with (
        unfinished_results(tmp_path / "out", recording),
        pytest.raises(InputError, match="another run"),
        unfinished_results(tmp_path / "out", recording, resume=True),
    ):
        pass


def _begin(folder: Path, identity: str, inputs: dict[str, str]) -> None:
    folder.mkdir(exist_ok=True)
    begin_journal(folder, identity, inputs)


def test_a_run_goes_on_only_with_the_same_inputs_and_settings(tmp_path):
    _begin(tmp_path / "out", "one", INPUTS)
    _begin(tmp_path / "out", "one", INPUTS)
    with pytest.raises(InputError, match="other settings"):
        _begin(tmp_path / "out", "two", INPUTS)
    with pytest.raises(InputError, match=r"before front/depth/000000\.png changed"):
        _begin(tmp_path / "out", "two", INPUTS | {"front/depth/000000.png": "2"})
