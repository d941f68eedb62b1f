"""``anchorpose batch``: what it writes, what it repeats, and how it ends."""

import csv
import json
import os
from pathlib import Path

import pytest
from recording_builder import edit_json, write_recording
from report_builder import squats, write_session

from anchorpose.batch.sessions import find_sessions
from anchorpose.batch.summary import MEASURES, OTHER_RUN, SESSIONS, SessionRow, identity_of, write_page
from anchorpose.batch.worker import Outcome
from anchorpose.cli import main
from anchorpose.cli.track_verbs import TrackOptions
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.results import run_record
from anchorpose.results.records import Measure
from anchorpose.results.run_record import hash_files


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def write_done(recording: Path, results: Path) -> None:
    """Write results that state the identity of the present recording with the default options."""
    (session,) = find_sessions([str(recording)], TrackOptions(smooth=False))
    hashes = dict(hash_files(input_files(open_recording(recording)), recording))
    write_session(results, squats(30), identity=identity_of(session, recording), inputs_sha256=hashes)


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """One session done, one that failed, one open."""
    for name in ("one", "two", "three"):
        write_recording(tmp_path / "in" / name, frames=2)
    write_done(tmp_path / "in" / "one", tmp_path / "out" / "sessions" / "one")
    (tmp_path / "out" / "batch.json").write_text('{"format": "anchorpose-batch"}')
    (tmp_path / "out" / "logs").mkdir()
    (tmp_path / "out" / "logs" / "two.json").write_text(json.dumps({"why": "two: is <broken>; mend it."}))
    return tmp_path


def test_a_summary_has_every_session_its_shares_and_its_measures(three: Path, capsys) -> None:
    assert main(["batch", str(three / "in"), "-o", str(three / "out"), "--summary"]) == 1
    printed = capsys.readouterr().out
    assert "two: is <broken>; mend it." in printed
    assert "1 done" in printed
    found = {row.session: row for row in SESSIONS.read(three / "out" / SESSIONS.file)}
    assert {name: row.state for name, row in found.items()} == {"one": "done", "two": "failed", "three": "open"}
    one = found["one"]
    assert (one.frames, one.length_s) == (30, pytest.approx(29 / 30))
    assert one.seen_share + one.inferred_share + one.lost_share == pytest.approx(1)
    assert one.lost_share == pytest.approx(3 / 30 / 21)  # the head, at the end
    assert found["three"].seen_share is None
    states = {row["session"]: row["state"] for row in rows(three / "out" / "sessions.csv")}
    assert states == {name: row.state for name, row in found.items()}
    measures = MEASURES.read(three / "out" / MEASURES.file)
    assert {row.session for row in measures} == {"one"}
    assert len(rows(three / "out" / "measures.csv")) == len(measures) == 11  # without the one of a single person


@pytest.mark.parametrize(("sigma", "written"), [(0.0, "12.0 s"), (0.5, "12.0 s ± 1.0 s"), (None, "12 s")])
def test_the_page_has_no_error_of_zero(tmp_path: Path, sigma, written) -> None:
    measure = Measure(measure="upright_time", value=12.0, unit="s", sigma=sigma, frames=30)
    row = SessionRow(session="one", recording="one", subject="", state="done")
    page = write_page(tmp_path, [row], {"one": (measure,)})
    assert f"<td>{written}</td>" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("changed", ["settings", "recording", "identity"])
def test_a_session_tracked_with_other_settings_or_inputs_is_open(three: Path, capsys, changed) -> None:
    command = ["batch", str(three / "in" / "one"), "-o", str(three / "out"), "--summary"]
    if changed == "settings":
        command.append("--smooth")
    elif changed == "recording":
        edit_json(three / "in" / "one" / "recording.json", lambda document: document.update(subject={"height_m": 1.8}))
    else:
        edit_json(three / "out" / "sessions" / "one" / "run.json", lambda run: run.update(identity="of other code"))
    assert main(command) == 0
    assert f"one: {OTHER_RUN}" in capsys.readouterr().out
    (row,) = SESSIONS.read(three / "out" / SESSIONS.file)
    assert (row.state, row.why, row.frames) == ("open", OTHER_RUN, None)
    assert not MEASURES.read(three / "out" / MEASURES.file)


@pytest.mark.parametrize("kept", ["no image is read", "the recording was moved away"])
def test_a_summary_reads_no_image_for_its_hash_and_needs_no_recording(three: Path, monkeypatch, kept) -> None:
    (three / "in" / "t.csv").write_text("recording,session\none,one\n")
    read = list[str]()
    if kept == "no image is read":
        monkeypatch.setattr(run_record, "require_regular", lambda file, most: read.append(file.suffix))
    else:
        (three / "in" / "one").rename(three / "elsewhere")
    assert main(["batch", str(three / "in" / "t.csv"), "-o", str(three / "out"), "--summary"]) == 0
    assert [row.state for row in SESSIONS.read(three / "out" / SESSIONS.file)] == ["done"]
    assert ".png" not in read


def test_the_page_shows_sessions_failures_and_measures_and_escapes_what_it_is_given(three: Path) -> None:
    main(["batch", str(three / "in"), "-o", str(three / "out"), "--summary"])
    page = (three / "out" / "index.html").read_text(encoding="utf-8")
    assert "not a medical device" in page
    assert "two: is &lt;broken&gt;; mend it." in page
    assert 'href="sessions/one/report.html"' in page
    assert "1 done, 1 failed, 1 open" in page
    assert "3.25" in page or "3.2" in page  # upright_time
    assert "the right knee is lost &lt;always&gt;" in page


@pytest.mark.thorough
def test_what_cannot_be_tracked_is_a_row_with_its_sentence_and_exit_code_1(tmp_path: Path, capsys) -> None:
    write_recording(tmp_path / "in" / "a", frames=2)
    (tmp_path / "in" / "a" / "recording.json").write_text("{")
    command = ["batch", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--workers", "1"]
    assert main(command) == 1
    assert "a: " in capsys.readouterr().out
    (row,) = SESSIONS.read(tmp_path / "out" / SESSIONS.file)
    assert row.state == "failed"
    assert "recording.json" in str(row.why)
    assert main([*command, "--index", "0"]) == 1
    assert "is not JSON" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "sentence"), [(["--index", "7"], "--index is 7"), (["--scheduler", "fast"], "--scheduler is 'fast'")]
)
def test_what_makes_no_sense_is_refused_before_anything_is_written(tmp_path: Path, refusal, more, sentence) -> None:
    write_recording(tmp_path / "a", frames=2)
    assert sentence in refusal(["batch", str(tmp_path / "a"), "-o", str(tmp_path / "out"), *more])
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_one_inside_a_recording_and_a_table_without_a_session_are_refused(
    tmp_path: Path, refusal
) -> None:
    write_recording(tmp_path / "a", frames=2)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("1")
    assert "not the folder of a batch" in refusal(["batch", str(tmp_path / "a"), "-o", str(tmp_path / "mine")])
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
    assert "lies inside the recording" in refusal(["batch", str(tmp_path / "a"), "-o", str(tmp_path / "a" / "out")])
    (tmp_path / "t.csv").write_text("recording,subject\n")
    assert "names no recording" in refusal(["batch", str(tmp_path / "t.csv"), "-o", str(tmp_path / "b")])
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize("name", ["sessions", "logs", "logs/one.log", "logs/two.json", "sessions.csv", "index.html"])
@pytest.mark.parametrize("kind", ["a link", "of another kind"])
def test_a_batch_writes_through_no_link_and_over_nothing_of_another_kind(three: Path, refusal, name, kind) -> None:
    out, mine = three / "out", three / "mine"
    place = out / name
    if place.exists():
        place.rename(mine)
    else:
        mine.write_text("years of work")
    if kind == "a link":
        place.symlink_to(mine)
    elif "." in name:
        place.mkdir()
    else:
        place.write_text("years of work")
    before = sorted(path for path in three.rglob("*") if path.name != ".batch.lock")
    assert "move it away" in refusal(["batch", str(three / "in"), "-o", str(out), "--summary"])
    assert sorted(path for path in three.rglob("*") if path.name != ".batch.lock") == before


def test_a_session_whose_measures_are_a_pipe_is_not_done(three: Path, capsys) -> None:
    measures = three / "out" / "sessions" / "one" / "measures.parquet"
    measures.unlink()
    os.mkfifo(measures)
    assert main(["batch", str(three / "in" / "one"), "-o", str(three / "out"), "--summary"]) == 1
    assert "is a named pipe" in capsys.readouterr().out


def test_a_scheduler_that_is_asked_is_named_first(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("anchorpose.batch.cluster.CONNECT_S", 0.5)
    write_recording(tmp_path / "a", frames=2)
    assert main(["batch", str(tmp_path / "a"), "-o", str(tmp_path / "b"), "--scheduler", "tcp://127.0.0.1:1"]) == 2
    said = capsys.readouterr()
    assert "Asking the scheduler at tcp://127.0.0.1:1" in said.out
    assert "No scheduler answers" in said.err


@pytest.mark.parametrize(("spoilt", "why"), [("logs/two.json", "is damaged"), ("sessions/one/measures.parquet", "")])
def test_a_damaged_file_of_one_session_fails_that_session_only(three: Path, capsys, spoilt, why) -> None:
    (three / "out" / spoilt).write_bytes(b"")
    assert main(["batch", str(three / "in"), "-o", str(three / "out"), "--summary"]) == 1
    assert why in capsys.readouterr().out
    states = {row.session: row.state for row in SESSIONS.read(three / "out" / SESSIONS.file)}
    assert set(states) == {"one", "two", "three"}
    assert states[Path(spoilt).parts[1].removesuffix(".json")] == "failed"


def test_texts_of_users_are_no_formulas_in_csv_and_whole_in_parquet(three: Path) -> None:
    (three / "in" / "t.csv").write_text('recording,subject\none,"=HYPERLINK(""http://x"")"\ntwo,-5\nthree,@sum\n')
    main(["batch", str(three / "in" / "t.csv"), "-o", str(three / "out"), "--summary"])
    subjects = [row["subject"] for row in rows(three / "out" / "sessions.csv")]
    assert subjects == ['\'=HYPERLINK("http://x")', "-5", "'@sum"]
    assert next(row.subject for row in SESSIONS.read(three / "out" / SESSIONS.file)) == '=HYPERLINK("http://x")'
    assert {row["subject"][:2] for row in rows(three / "out" / "measures.csv")} == {"'="}


@pytest.mark.thorough
def test_a_password_in_an_address_is_nowhere_in_a_batch(tmp_path: Path, capsys) -> None:
    command = ["batch", "sftp://user:se%40cret@127.0.0.1:1/x", "-o", str(tmp_path / "out"), "--workers", "1"]
    assert main(command) == 1
    printed = "".join(capsys.readouterr())
    assert "sftp://user:***@127.0.0.1:1/x" in printed
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert {"sessions.csv", "batch.json", "x.log", "index.html"} <= {path.name for path in files}
    for text in (printed.encode(), *(path.read_bytes() for path in files)):
        assert b"cret" not in text


def test_an_outcome_that_cannot_be_noted_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(out: Path, outcome: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("anchorpose.batch.tracking.note_outcome", full)
    broken = [Outcome("a", "a is broken.")]
    monkeypatch.setattr("anchorpose.batch.tracking.run_jobs", lambda jobs, place: broken)
    write_recording(tmp_path / "a", frames=2)
    assert main(["batch", str(tmp_path / "a"), "-o", str(tmp_path / "out")]) == 1
    (row,) = SESSIONS.read(tmp_path / "out" / SESSIONS.file)
    assert (row.state, row.why) == ("failed", "a is broken.")
