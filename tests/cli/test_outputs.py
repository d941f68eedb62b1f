"""What verbs write goes neither into a recording nor over what another program wrote; no verb makes a folder of an
address."""

import os
from pathlib import Path
from typing import Any

import pytest
from places_builder import make_places

from anchorpose.cli import main

FOLDERS = {
    "simulate": ["simulate", "{x}"],
    "demo": ["demo", "{x}", "--quick"],
    "convert": ["convert", "{recording}/front", "{x}"],
    "calibrate": ["calibrate", "{recording}", "-o", "{x}"],
    "track": ["track", "{recording}", "-o", "{x}"],
    "evaluate": ["evaluate", "{results}", "--reference", "{reference}", "-o", "{x}"],
    "export": ["export", "{results}", "--to", "csv", "-o", "{x}"],
    "inspect": ["inspect", "{recording}", "--frame", "0", "-o", "{x}"],
    "record": ["record", "{recording}", "-o", "{x}"],
    "live": ["live", "{recording}", "-o", "{x}"],
    "live --record": ["live", "{recording}", "-o", "{out}", "--record", "{x}"],
    "batch": ["batch", "{recording}", "-o", "{x}"],
    "experiment": ["experiment", "{x}", "--quick"],
    "benchmark make": ["benchmark", "make", "{x}"],
}
FILES = {
    "evaluate --json": ["evaluate", "{results}", "--truth", "{truth}", "--json", "{x}"],
    "reliability": ["reliability", "{sessions}", "-o", "{x}"],
    "report": ["report", "{results}", "{later}", "-o", "{x}"],
    "equipment fit": ["equipment", "fit", "{recording}", "-o", "{x}", "--overwrite"],
    "motions build": ["motions", "build", "{x}", "{results}", "--overwrite"],
    "benchmark score": ["benchmark", "score", "{later}", "{results}", "--json", "{x}"],
}
IN_A_RECORDING = "{recording}/front/new", "{recording}/new/deep"


@pytest.fixture
def places(tmp_path, monkeypatch) -> dict[str, Path]:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reference.trc").write_text("never read")
    rows = [f"s{k % 3},{k // 3},knee,{k}.5" for k in range(9)]
    (tmp_path / "sessions.csv").write_text("\n".join(["subject,session,measure,value", *rows]) + "\n")
    more = {"reference": tmp_path / "reference.trc", "sessions": tmp_path / "sessions.csv"}
    return make_places(tmp_path) | more


def _content(folder: Path) -> dict[str, Any]:
    found = {path: path.lstat() for path in folder.rglob("*")}
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() and not path.is_symlink() else status.st_mode
        for path, status in found.items()
    }


def _refused(command: list[str], places: dict[str, Path], x: str, capsys: Any) -> str:
    """What is said by a verb that is refused and leaves everything as it was."""
    folder = places["recording"].parent
    before = _content(folder)
    capsys.readouterr()
    assert main([part.format(x=x.format(**places), **places) for part in command]) == 2
    assert _content(folder) == before
    return " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("x", IN_A_RECORDING)
@pytest.mark.parametrize("verb", [*FOLDERS, *(verb for verb in FILES if verb != "equipment fit")])
def test_nothing_is_written_into_a_recording(verb, x, places, capsys):
    ending = ".npz" if verb == "motions build" else ""
    said = _refused((FOLDERS | FILES)[verb], places, x + ending, capsys)
    assert "lies inside the recording" in said


@pytest.mark.parametrize("verb", [*FOLDERS, *FILES])
def test_an_address_makes_no_folder_and_shows_no_password(verb, places, capsys):
    ending = ".npz" if verb == "motions build" else ""
    if verb == "track":  # it can write to an address
        return
    said = _refused((FOLDERS | FILES)[verb], places, "sftp://user:secret@host/x" + ending, capsys)
    assert "is an address" in said
    assert "secret" not in said


@pytest.mark.parametrize("verb", [verb for verb in FOLDERS if verb != "export"])
def test_the_root_of_the_disk_is_refused(verb, places, capsys):
    more = ["--overwrite"] if verb in ("track", "calibrate", "inspect", "evaluate", "live") else []
    assert "is the root of the disk" in _refused([*FOLDERS[verb], *more], places, "/", capsys)


@pytest.mark.parametrize("kind", ["text", "table", "link", "folder", "pipe"])
@pytest.mark.parametrize("verb", FILES)
def test_no_file_of_another_kind_is_replaced(verb, kind, places, capsys):
    x = places["recording"].parent / "mine.npz"
    if kind == "link":
        x.symlink_to(places["reference"])
    elif kind == "folder":
        x.mkdir()
    elif kind == "pipe":
        os.mkfifo(x)
    else:
        x.write_bytes(b"years of work" if kind == "text" else (places["results"] / "joints.parquet").read_bytes())
    problem = "is a link" if kind == "link" else "exists already, with other content"
    assert problem in _refused(FILES[verb], places, str(x), capsys)


@pytest.mark.parametrize("leads_to", ["nowhere", "an empty folder"])
@pytest.mark.parametrize("verb", FOLDERS)
def test_nothing_is_written_through_a_link(verb, leads_to, places, tmp_path, capsys):
    target, link = tmp_path / "elsewhere", tmp_path / "link"
    if leads_to != "nowhere":
        target.mkdir()
    link.symlink_to(target)
    _refused(FOLDERS[verb], places, str(link), capsys)
    assert link.is_symlink()
    assert target.exists() == (leads_to != "nowhere")
    assert leads_to == "nowhere" or not list(target.iterdir())


@pytest.mark.parametrize(
    ("verb", "name"),
    [("evaluate --json", "results/run.json"), ("evaluate --json", "truth.npz"), ("reliability", "sessions.csv")],
)
def test_no_input_is_replaced(verb, name, places, capsys):
    said = "which is used" if name.startswith("results") else "is given twice"
    assert said in _refused(FILES[verb], places, str(places["recording"].parent / name), capsys)


@pytest.mark.parametrize("verb", ["evaluate --json", "reliability", "motions build"])
def test_what_the_verb_wrote_itself_and_an_empty_file_are_replaced(verb, places):
    x = places["recording"].parent / "mine.npz"
    command = [part.format(x=x, **places) for part in FILES[verb]]
    x.touch()
    assert main(command) == 0
    first = x.read_bytes()
    assert main(command) == 0
    assert x.read_bytes()[:200] == first[:200] != b""


@pytest.mark.parametrize(("results", "record"), [("x", "x"), ("x/y", "x"), ("x", "x/y")])
def test_results_and_recording_of_live_lie_apart_and_nothing_is_left(results, record, places, capsys):
    given = ["live", "{recording}", "-o", results, "--record", record]
    said = "is given twice" if results == record else "which is used"
    assert said in _refused(given, places, "", capsys)


LONGEST = 255  # bytes of a name; some verbs work in a folder with a longer one beside it


@pytest.mark.parametrize(
    ("verb", "length"),
    [
        *((verb, LONGEST - 4) for verb in ("track", "calibrate", "simulate", "live")),
        *((verb, LONGEST + 1) for verb in ("export", "record", "batch")),
    ],
)
def test_a_name_that_is_too_long_leaves_no_folder_above_it(verb, length, places, capsys):
    _refused(FOLDERS[verb], places, "a\nb/c\x1b[31m/" + length * "x", capsys)


def test_a_folder_of_no_recordings_leaves_no_experiment(places, capsys):
    (places["out"].parent / "empty").mkdir()
    command = ["experiment", "out", "--quick", "--real", "empty"]
    assert "contains no recording folder" in _refused(command, places, "", capsys)
