"""A results folder in the making: kept when its run is stopped, taken up again, and never made by two runs at once."""

import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from anchorpose.errors import InputError
from anchorpose.results.folder import RESULTS
from anchorpose.results.unfinished import (
    BEGUN_FILE,
    EARLIER,
    JOURNAL,
    MARK,
    MARK_FILE,
    begin_journal,
    begun_identity,
    end_journal,
    unfinished_results,
    wait_until_free,
)
from anchorpose.tracker.journal import Journal

INPUTS = {"recording.json": "0", "front/depth/000000.png": "1"}


@pytest.fixture
def recording(tmp_path) -> Path:
    (tmp_path / "recording").mkdir()
    return tmp_path / "recording"


class _Stopped(Exception):
    """Whatever ends a run."""


def _run(path: Path, recording: Path, stored: int, error: type[BaseException] | None = None, **options: Any) -> int:
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


def _unfinished(path: Path, recording: Path) -> Path:
    """The folder that a run leaves which was stopped while it wrote its tables."""
    with pytest.raises(_Stopped):
        _run(path, recording, 3, _Stopped)
    work = path.with_name(f".{path.name}.unfinished")
    (work / "joints.parquet").write_text("half")
    return work


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_stopped_run_goes_on_with_what_it_has_stored(tmp_path, recording, error):
    with pytest.raises(error) as stopped:
        _run(tmp_path / "out", recording, 3, error)
    assert "--resume" in stopped.value.__notes__[0]
    assert _names(tmp_path) == {"recording", ".out.unfinished"}
    assert _run(tmp_path / "out", recording, 2, resume=True) == 3
    assert ((tmp_path / "out" / "run.json").read_text(), _names(tmp_path)) == ("5", {"recording", "out"})
    assert _names(tmp_path / "out") == set(RESULTS.marks)


def test_a_run_that_stored_nothing_leaves_nothing(tmp_path, recording):
    with pytest.raises(_Stopped):
        _run(tmp_path / "out", recording, 0, _Stopped)
    assert _names(tmp_path) == {"recording"}


def test_what_a_run_left_that_was_killed_before_it_stored_anything_is_in_nobodys_way(tmp_path, recording):
    (tmp_path / ".out.unfinished" / JOURNAL).mkdir(parents=True)
    (tmp_path / ".out.unfinished" / MARK_FILE).write_text(MARK)
    (tmp_path / ".out.unfinished" / JOURNAL / "begun.json").write_text("half")
    (tmp_path / ".out.unfinished" / "joints.parquet").write_text("half")
    assert _run(tmp_path / "out", recording, 1) == 0


def test_an_unfinished_run_is_neither_continued_nor_deleted_unasked(tmp_path, recording):
    _unfinished(tmp_path / "out", recording)
    with pytest.raises(InputError, match="--resume"):
        _run(tmp_path / "out", recording, 1)
    assert len(list((tmp_path / ".out.unfinished").rglob("*.frames"))) == 3
    assert _run(tmp_path / "out", recording, 1, overwrite=True) == 0


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(
    "made", ["notes", "link to notes", "file", "dangling link", "journal of another", "edited mark"]
)
def test_what_was_not_made_by_this_program_is_not_touched(tmp_path, recording, made, resume):
    work, mine = tmp_path / ".out.unfinished", tmp_path / "mine"
    (mine / JOURNAL).mkdir(parents=True)
    for name in ("notes.txt", f"{JOURNAL}/{BEGUN_FILE}", f"{JOURNAL}/learnt"):
        (mine / name).write_text("years of work")
    if made == "edited mark":
        (mine / MARK_FILE).write_text(MARK + "mine")
    if made == "link to notes":
        (mine / MARK_FILE).write_text(MARK)
        work.symlink_to(mine)
    elif made == "dangling link":
        work.symlink_to(tmp_path / "nothing")
    elif made == "file":
        work.write_text("years of work")
    else:
        mine.rename(work)
    before = _content(tmp_path)
    with pytest.raises(InputError, match=r"\.out\.unfinished: is in the way, .*; rename it"):
        _run(tmp_path / "out", recording, 1, overwrite=not resume, resume=resume)
    wait_until_free(tmp_path / "out", 0.1)
    assert begun_identity(tmp_path / "out") is None
    assert _content(tmp_path) == before


def test_an_unfinished_run_with_a_link_in_it_is_not_touched(tmp_path, recording):
    _unfinished(tmp_path / "out", recording)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("years of work")
    (tmp_path / ".out.unfinished" / JOURNAL / "forward").symlink_to(tmp_path / "mine")
    before = _content(tmp_path)
    with pytest.raises(InputError, match="is in the way"):
        _run(tmp_path / "out", recording, 1, overwrite=True)
    assert _content(tmp_path) == before


def _content(folder: Path) -> dict[str, bytes | None]:
    """Of every file; None for a folder or a link."""
    found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*"))}
    return {
        name: path.read_bytes() if path.is_file() and not path.is_symlink() else None for name, path in found.items()
    }


def _refuse(path: Path, recording: Path, error: BaseException, begun: bool) -> None:
    """A run that is to overwrite another and ends before it stores anything."""
    with unfinished_results(path, recording, overwrite=True) as folder:
        if begun:
            begin_journal(folder, "another identity", INPUTS)
        raise error


@pytest.mark.parametrize("kind", [InputError, KeyboardInterrupt])
@pytest.mark.parametrize("begun", [False, True])
def test_what_is_to_be_overwritten_stays_until_the_new_run_has_stored_something(tmp_path, recording, kind, begun):
    """A refusal of the inputs, before or after the new journal is begun, leaves every byte of the earlier run."""
    work = _unfinished(tmp_path / "out", recording)
    before, error = _content(tmp_path), kind("x", "is damaged", "mend it")
    with pytest.raises(kind):
        _refuse(tmp_path / "out", recording, error, begun)
    assert _content(tmp_path) == before
    notes = ["The unfinished run that was there is kept: the same command with --resume goes on."]
    assert getattr(error, "__notes__", []) == ([] if kind is InputError else notes)
    with pytest.raises(_Stopped):
        _run(tmp_path / "out", recording, 1, _Stopped, overwrite=True)
    assert len(list(work.rglob("*.frames"))) == 1


@pytest.mark.parametrize("stored", [0, 1])
def test_of_a_run_that_was_killed_while_it_overwrote_another_that_one_is_left_which_stored_something(
    tmp_path, recording, stored
):
    work = _unfinished(tmp_path / "out", recording)
    (work / JOURNAL).rename(work / EARLIER)
    journal = begin_journal(work, "another identity", INPUTS)
    for number in range(stored):
        (journal / f"{number}.frames").write_text("frames")
    assert begun_identity(tmp_path / "out") == ("another identity" if stored else "identity")
    with pytest.raises(InputError, match="has an unfinished run"):
        _run(tmp_path / "out", recording, 1)
    assert not (work / EARLIER).exists()
    assert len(list(work.rglob("*.frames"))) == (1 if stored else 3)


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
    with pytest.raises(InputError, match=r"other settings.*; to begin again, give --overwrite instead of --resume"):
        _begin(tmp_path / "out", "two", INPUTS)
    with pytest.raises(InputError, match=r"before front/depth/000000\.png changed"):
        _begin(tmp_path / "out", "two", INPUTS | {"front/depth/000000.png": "2"})


def test_each_refusal_has_one_remedy_which_works(tmp_path, recording):
    """A refusal says what to do, and no note behind it says something else; what was stored is still there."""
    with pytest.raises(_Stopped) as stopped:
        _run(tmp_path / "out", recording, 3, _Stopped)
    assert stopped.value.__notes__ == ["What was done is kept: the same command with --resume goes on."]
    begun = tmp_path / ".out.unfinished" / JOURNAL / BEGUN_FILE
    whole, remedy = begun.read_text(), "to begin again, give --overwrite instead of --resume"
    for text, problem in ((whole.replace("identity", "other"), "other settings"), (whole[:-9], "is damaged")):
        begun.write_text(text)
        with pytest.raises(InputError, match=f"{problem}.*; {remedy}") as no:
            _run(tmp_path / "out", recording, 1, resume=True)
        assert not hasattr(no.value, "__notes__")
        assert len(list(begun.parent.glob("*.frames"))) == 3
    assert _run(tmp_path / "out", recording, 1, overwrite=True) == 0


SPOILT = {
    "begun.json is gone": lambda journal: (journal / BEGUN_FILE).unlink(),
    "begun.json is a pipe": lambda journal: _as_pipe(journal / BEGUN_FILE),
    "begun.json is a folder": lambda journal: ((journal / BEGUN_FILE).unlink(), (journal / BEGUN_FILE).mkdir()),
    "the journal is a file": lambda journal: (shutil.rmtree(journal), journal.write_text("frames")),
    "the journal is a pipe": lambda journal: (shutil.rmtree(journal), os.mkfifo(journal)),
    "all that is stored are pipes": lambda journal: [_as_pipe(one) for one in journal.glob("*.frames")],
}


def _as_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("spoilt", SPOILT)
def test_a_run_whose_journal_cannot_be_read_is_kept_until_it_is_overwritten(tmp_path, recording, spoilt):
    work = _unfinished(tmp_path / "out", recording)
    SPOILT[spoilt](work / JOURNAL)
    before = _content(tmp_path)
    damaged = spoilt != "all that is stored are pipes"
    remedy = "it is damaged: to begin again, give --overwrite" if damaged else "--resume goes on"
    with pytest.raises(InputError, match=remedy):
        _run(tmp_path / "out", recording, 1)
    if damaged:
        with pytest.raises(InputError, match="is damaged or missing; to begin again, give --overwrite"):
            _run(tmp_path / "out", recording, 1, resume=True)
    assert _content(tmp_path) == before
    assert _run(tmp_path / "out", recording, 1, overwrite=True) == 0


def test_a_run_that_is_not_continued_keeps_the_tables_beside_its_journal(tmp_path, recording):
    work = _unfinished(tmp_path / "out", recording)
    with (
        pytest.raises(InputError, match="other settings"),
        unfinished_results(tmp_path / "out", recording, resume=True) as folder,
    ):
        begin_journal(folder, "another identity", INPUTS)
    assert (work / "joints.parquet").read_text() == "half"
    assert _run(tmp_path / "out", recording, 0, resume=True) == 3


def test_a_damaged_value_is_refused_with_a_remedy_that_works(tmp_path, recording):
    journal = _unfinished(tmp_path / "out", recording) / JOURNAL
    with pytest.raises(InputError, match=re.escape(f"is damaged; remove {journal} and give the same command again.")):
        Journal(journal).read("0.frames", int)
    shutil.rmtree(journal)
    assert _run(tmp_path / "out", recording, 2, resume=True) == 0
