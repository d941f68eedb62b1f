"""A results folder appears whole or not at all, and nobody's files are lost."""

from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.results.folder import RESULTS, new_results_folder, whole_or_nothing, write_text_whole


@pytest.fixture
def recording(tmp_path) -> Path:
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "recording.json").write_text("{}")
    return tmp_path / "recording"


def _fill(folder: Path, text: str) -> None:
    folder.mkdir(exist_ok=True)
    for name in RESULTS.marks:
        (folder / name).write_text(text)


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_folder_appears_only_when_it_is_complete(tmp_path, recording):
    with new_results_folder(tmp_path / "out", recording) as folder:
        _fill(folder, "new")
        assert not (tmp_path / "out").exists()
    assert (_names(tmp_path / "out"), _names(tmp_path)) == (set(RESULTS.marks), {"recording", "out"})


def _fail_half_way(path: Path, recording: Path, error: type[BaseException], overwrite: bool = False) -> None:
    with new_results_folder(path, recording, overwrite) as folder:
        _fill(folder, "new")
        raise error


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_whatever_stops_the_work_leaves_nothing_behind(tmp_path, recording, error):
    with pytest.raises(error):
        _fail_half_way(tmp_path / "deep" / "er" / "out", recording, error)
    assert _names(tmp_path) == {"recording"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failed_replacement_leaves_the_old_result(tmp_path, recording, error):
    _fill(tmp_path / "out", "old")
    with pytest.raises(error):
        _fail_half_way(tmp_path / "out", recording, error, overwrite=True)
    assert ((tmp_path / "out" / "run.json").read_text(), _names(tmp_path)) == ("old", {"recording", "out"})


def test_a_result_is_replaced_only_when_asked(tmp_path, recording):
    _fill(tmp_path / "out", "old")
    with pytest.raises(InputError, match="--overwrite"), new_results_folder(tmp_path / "out", recording):
        pass
    with new_results_folder(tmp_path / "out", recording, overwrite=True) as folder:
        _fill(folder, "new")
    assert ((tmp_path / "out" / "run.json").read_text(), _names(tmp_path)) == ("new", {"recording", "out"})


def test_a_folder_that_is_no_result_is_never_touched(tmp_path, recording):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with (
        pytest.raises(InputError, match="not a results folder"),
        new_results_folder(tmp_path / "thesis", recording, overwrite=True),
    ):
        pass
    assert (tmp_path / "thesis" / "chapter.txt").read_text() == "years of work"


def test_results_may_not_go_into_the_recording_nor_replace_it(tmp_path, recording):
    for bad in (recording, recording / "out", recording / "a" / ".." / "out", tmp_path):
        with pytest.raises(InputError, match="recording"), new_results_folder(bad, recording, overwrite=True):
            pass
    assert _names(recording) == {"recording.json"}


def test_a_file_or_a_link_is_not_replaced(tmp_path, recording):
    (tmp_path / "file").write_text("x")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for name in ("file", "link"):
        with pytest.raises(InputError, match="another name"), new_results_folder(tmp_path / name, recording, True):
            pass


def test_a_text_file_is_replaced_whole_or_kept(tmp_path):
    path = tmp_path / "report.html"
    write_text_whole(path, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text_whole(path, "half \udc80")
    assert (path.read_text(), _names(tmp_path)) == ("old", {"report.html"})


def _replace(path: Path, recording: Path) -> None:
    with new_results_folder(path, recording, overwrite=True) as folder:
        _fill(folder, "new")


def test_files_of_the_user_survive_a_replacement(tmp_path, recording):
    (tmp_path / "out" / "exports").mkdir(parents=True)
    _fill(tmp_path / "out", "old")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    (tmp_path / "out" / "exports" / "a.trc").write_text("of the old results")
    _replace(tmp_path / "out", recording)
    assert _names(tmp_path / "out") == set(RESULTS.marks)
    assert (tmp_path / "out.kept" / "notes.txt").read_text() == "mine"
    assert _names(tmp_path / "out.kept") == {"notes.txt", "exports"}
    assert _names(tmp_path) == {"recording", "out", "out.kept"}


def test_a_folder_that_appears_meanwhile_is_not_touched_and_the_results_are_kept(tmp_path, recording):
    def make() -> None:
        with new_results_folder(tmp_path / "out", recording) as folder:
            _fill(folder, "new")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "thesis.txt").write_text("years of work")

    with pytest.raises(InputError, match=r"the results are in .*out-2"):
        make()
    assert (tmp_path / "out" / "thesis.txt").read_text() == "years of work"
    assert (tmp_path / "out-2" / "run.json").read_text() == "new"
    assert _names(tmp_path) == {"recording", "out", "out-2"}


def test_a_replacement_that_was_killed_half_way_is_undone(tmp_path, recording):
    _fill(tmp_path / ".out.replaced", "old")
    with pytest.raises(InputError, match="--overwrite"), new_results_folder(tmp_path / "out", recording):
        pass
    assert (tmp_path / "out" / "run.json").read_text() == "old"


def test_a_place_where_a_disk_is_mounted_is_refused_before_any_work(tmp_path, recording, monkeypatch):
    (tmp_path / "disk").mkdir()
    monkeypatch.setattr("os.path.ismount", lambda path: Path(path).name == "disk")
    with pytest.raises(InputError, match="choose a folder in it"), new_results_folder(tmp_path / "disk", recording):
        pass


def test_what_a_killed_run_left_behind_blocks_no_later_one(tmp_path, recording):
    (tmp_path / ".out.partial-2").mkdir()
    with new_results_folder(tmp_path / "out", recording) as folder:
        _fill(folder, "new")
    assert (tmp_path / "out" / "run.json").read_text() == "new"


@pytest.mark.parametrize("made", ["folder of the user", "link to results"])
def test_only_results_that_were_moved_away_are_moved_back(tmp_path, recording, made):
    replaced = tmp_path / ".out.replaced"
    if made == "link to results":
        _fill(tmp_path / "elsewhere", "of another run")
        replaced.symlink_to(tmp_path / "elsewhere")
    else:
        replaced.mkdir()
        (replaced / "notes.txt").write_text("mine")
    before = _names(tmp_path)
    with new_results_folder(tmp_path / "out", recording, overwrite=True) as folder:
        _fill(folder, "new")
    assert (_names(tmp_path), _names(tmp_path / "out")) == (before | {"out"}, set(RESULTS.marks))


def test_nothing_is_made_or_replaced_through_a_link(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.csv").write_text("mine")
    (tmp_path / "tables").symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="is a link"), whole_or_nothing(tmp_path / "tables", ("*.csv",)):
        pass
    assert ((tmp_path / "mine" / "a.csv").read_text(), _names(tmp_path)) == ("mine", {"mine", "tables"})
