"""What was done with results is in their log, and edits of the log or of what it names are found."""

import json
from pathlib import Path

import pytest
from recording_builder import edit_json, write_recording
from report_builder import squats, write_session

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.verify import LOCK_FILE, LOG_FILE, Fits, add_event, read_log, verify

SIGNED = {"reason": "a curtain", "who": "AB", "when": "2026-03-01T09:30:00Z"}
UNUSABLE = {"first_frame": 2, "last_frame": 4, "start_s": 0.1, "end_s": 0.2, **SIGNED}
CORRECTED = {"file": "c.json", "sha256": "a" * 64, "unusable": [UNUSABLE], "joints": [], "patient": None}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "recording", frames=3)


@pytest.fixture
def results(tmp_path: Path, recording: Path) -> Path:
    """As 'track' leaves them."""
    opened = open_recording(recording)
    inputs = dict(hash_files(input_files(opened), opened.folder)) | {"motions.npz": "b" * 64}
    folder = write_session(tmp_path / "r", squats(20), inputs_sha256=inputs, corrections=CORRECTED)
    tables = dict(hash_files(sorted(folder.glob("*.parquet")), folder))
    edit_json(folder / RUN_FILE, lambda run: run.update(outputs_sha256=tables))
    add_event(folder, "track", (RUN_FILE,))
    return folder


def test_untouched_results_fit_and_their_history_is_told(results, recording, capsys):
    assert main(["measure", str(results), "--by", "CD", "--smooth", "butterworth"]) == 0
    assert main(["report", str(results), "--by", "CD"]) == 0
    assert main(["export", str(results), "--to", "csv,trc", "--by", "EF"]) == 0
    capsys.readouterr()
    assert main(["verify", str(results), str(recording)]) == 0
    told = capsys.readouterr().out
    assert "AB marked frames 2 to 4 as unusable on 2026-03-01" in told
    assert "measure by CD" in told
    assert "export by EF" in told
    assert "Every file is as it was." in told
    assert main(["measure", str(results)]) == 0  # removes the processed angles
    assert verify(results, None).is_right


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("joints.parquet", "joints.parquet: changed"),
        ("measures.parquet", "measures.parquet: changed"),  # and not by 'anchorpose measure', or the log had it
        ("run.json", "run.json: changed"),
        ("new.parquet", "new.parquet: added"),
        ("pictures/a.png", "pictures/a.png: added"),
    ],
)
def test_what_was_changed_is_named(results, capsys, file, sentence):
    path = results / file
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((path.read_bytes() if path.exists() else b"") + b"\n")
    assert main(["verify", str(results)]) == 1
    assert sentence in capsys.readouterr().out


def edited(lines: list[str]) -> list[str]:
    return [lines[0].replace("track", "trick"), *lines[1:]]


@pytest.mark.parametrize("edit", [edited, lambda lines: lines[1:], lambda lines: [lines[0], lines[2], lines[1]]])
def test_a_log_that_was_edited_does_not_fit(results, edit):
    for who in ("AB", "CD"):
        add_event(results, "report", by=who)
    lines = (results / LOG_FILE).read_text().splitlines()
    assert verify(results, None).is_right
    (results / LOG_FILE).write_text("\n".join(edit(lines)) + "\n")
    found = verify(results, None)
    assert not found.is_right
    assert "log.jsonl: line" in found.broken[0]


@pytest.mark.parametrize("line", ["{", "[]", '{"at": "now"}', '{"a":' * 1000, "\0"])
def test_a_log_that_is_none_is_refused(results, refusal, line):
    with (results / LOG_FILE).open("a") as file:
        file.write(line + "\n")
    assert "log.jsonl: line 2 is not an entry of a log" in refusal(["verify", str(results)])
    add_event(results, "report")  # goes on behind it
    with pytest.raises(InputError):
        read_log(results)


def test_a_log_names_no_file_outside_of_the_results(results, tmp_path):
    (tmp_path / "secret").write_text("x")
    line = json.loads((results / LOG_FILE).read_text())
    line["files"]["../secret"] = dict(hash_files([tmp_path / "secret"], tmp_path))["secret"]
    (results / LOG_FILE).write_text(json.dumps(line) + "\n")
    assert verify(results, None).results["../secret"] is Fits.MISSING


def test_an_export_may_be_moved_and_one_that_was_changed_is_named(results):
    assert main(["export", str(results), "--to", "csv,trc"]) == 0
    (results / "exports/csv").rename(results.parent / "mine")
    assert verify(results, None).is_right
    (results / "exports/trc/export.json").write_text("{}")
    assert verify(results, None).results["exports/trc/export.json"] is Fits.CHANGED


@pytest.mark.parametrize("emptied", [True, False])
def test_a_log_that_is_emptied_or_removed_is_noticed(results, capsys, emptied):
    if emptied:
        (results / LOG_FILE).write_bytes(b"")
    else:
        (results / LOG_FILE).unlink()
    assert main(["verify", str(results)]) == 1
    assert "log.jsonl: is missing or empty" in capsys.readouterr().out


def test_a_log_that_cannot_be_written_costs_nothing(results, capsys):
    (results / LOCK_FILE).unlink()
    (results / LOCK_FILE).mkdir()
    assert main(["report", str(results)]) == 0
    assert "this is not logged" in capsys.readouterr().err
    assert (results / "report.html").is_file()
