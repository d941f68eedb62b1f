"""A live session that ends early, on a full disk or killed, is finished from what is stored."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_builder import Again

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.live.feed import Intake
from anchorpose.live.first_seconds import LiveOptions
from anchorpose.live.session import _finish
from anchorpose.live.stored import SESSION_FILE, SessionStore, StoredPatient, read_session
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.unfinished import JOURNAL, unfinished_results
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.frame_record import TrackedFrame
from anchorpose.tracker.journal import Blocks, Journal

FPS, SECONDS = 10.0, 4.0
LIVE = ["--start-seconds", "3"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("finish")
    simulate_recording(folder / "out", single(6, seconds=SECONDS, fps=FPS))
    return folder / "out/recording"


@pytest.fixture
def played(recording, monkeypatch) -> str:
    """The name of a source that plays forward and backward without an end."""
    monkeypatch.setattr("anchorpose.live.cameras.Playback", lambda found: Again(found, FPS))
    return str(recording)


@pytest.mark.thorough
def test_a_full_disk_ends_the_session_and_what_is_stored_becomes_results(
    played, tmp_path, monkeypatch, capsys, refusal
):
    write = Blocks.write

    def full_after_the_first(blocks: Blocks, number: int, items: list) -> None:
        if number > 0:
            raise InputError(tmp_path, "cannot be written to (No space left on device)", "make room and resume")
        write(blocks, number, items)

    monkeypatch.setattr(Blocks, "write", full_after_the_first)
    monkeypatch.chdir(tmp_path)
    said = refusal(["live", played, "-o", "session", *LIVE])
    assert "No space left on device); make room and give the same command with --finish." in said
    assert "--resume" not in said
    assert main(["live", played, "-o", "session"]) == 2
    assert (
        "'anchorpose live --finish -o session' finishes it; to begin again, give --overwrite" in capsys.readouterr().err
    )
    assert "anchorpose live --finish" in refusal(["track", played, "-o", "session", "--resume"])

    assert main(["live", "--finish", "-o", "session"]) == 0
    assert os.listdir(tmp_path) == ["session"]
    assert len(read_joints(tmp_path / "session" / JOINTS_FILE).frame) >= 1  # the last of the first seconds
    (note,) = [one for one in json.loads(Path("session/run.json").read_text())["notes"] if "ended early" in one]
    assert "No space left on device" in note
    assert "has no live session that was cut off" in refusal(["live", "--finish", "-o", "session"])


@pytest.mark.slow
def test_a_killed_session_is_finished_with_all_that_was_stored(recording, tmp_path):
    program = (
        "import sys; from live_builder import Again; from anchorpose.cli import main;"
        f" from anchorpose.live import cameras; cameras.Playback = lambda one: Again(one, {FPS}); sys.exit(main())"
    )
    command = [sys.executable, "-c", program, "live", str(recording), "-o", str(tmp_path / "session"), *LIVE]
    paths = os.pathsep.join(sys.path)
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": paths}, stdout=subprocess.DEVNULL) as child:
        journal = tmp_path / ".session.unfinished" / JOURNAL
        until_s = time.monotonic() + 240.0
        while not (journal / "patient-1/000001.frames").is_file() and time.monotonic() < until_s:
            time.sleep(0.1)
        child.send_signal(signal.SIGKILL)
    stored = [one.record.joints for number in range(2) for one in _block(journal, number)]
    assert main(["live", "--finish", "-o", str(tmp_path / "session")]) == 0
    joints = read_joints(tmp_path / "session" / JOINTS_FILE)
    assert joints.frame.tolist()[: len(stored)] == [one.frame for one in stored]
    np.testing.assert_allclose(joints.position_m[0], stored[0].position_m, atol=1e-6)
    assert "the program was killed" in (tmp_path / "session/run.json").read_text()


def _block(journal: Path, number: int) -> list:
    from anchorpose.live.stored import _journal

    return _journal(journal / "patient-1").read(f"{number:06d}.frames", list[TrackedFrame])


def killed(results: Path, fill: Callable[[SessionStore], None]) -> None:
    """Leaves what a session leaves that is killed once ``fill`` has been called."""
    kept = results.parent / "kept"
    with suppress(KeyboardInterrupt), unfinished_results(results, None) as work:
        fill(SessionStore(work, LiveOptions(config=TrackConfig())))
        shutil.copytree(work, kept)
        raise KeyboardInterrupt
    shutil.rmtree(work, ignore_errors=True)
    kept.rename(work)


def test_a_session_that_was_killed_before_a_patient_was_found_blocks_no_later_one_and_another_form_is_refused(
    tmp_path, capsys, refusal
):
    killed(tmp_path / "session", lambda store: (store.first_seconds / "start-1.json").touch())
    assert main(["live", "--finish", "-o", str(tmp_path / "session")]) == 2
    assert "was cut off before a patient was found; begin again" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    killed(tmp_path / "session", lambda store: (store.first_seconds.parent / SESSION_FILE).write_text('{"options": 7}'))
    assert SESSION_FILE in refusal(["live", "--finish", "-o", str(tmp_path / "session")])


def _patient(store: SessionStore) -> None:
    journal = store.first_seconds.parent
    Journal(journal).inside("patient-1").write("000000.frames", [])
    write = StoredPatient(first_seconds="start-1", place_xz_m=None)
    store._write(replace(store._session, patients=(write,)))


SPOILT: dict[str, tuple[Callable[[Path], object], str]] = {
    "begun.json is gone": (lambda journal: (journal / "begun.json").unlink(), "start-1: there is no such folder"),
    "begun.json is damaged": (
        lambda journal: (journal / "begun.json").write_text("{"),
        "start-1: there is no such folder",
    ),
    "session.json is a pipe": (
        lambda journal: ((journal / SESSION_FILE).unlink(), os.mkfifo(journal / SESSION_FILE)),
        "session.json: is a named pipe",
    ),
    "session.json is gone": (
        lambda journal: (journal / SESSION_FILE).unlink(),
        "session.json: is missing, and the stored frames are useless without it",
    ),
    "frames are cut off": (lambda journal: (journal / "patient-1/000000.frames").write_text("x"), "frames: is damaged"),
    "a block is copied": (
        lambda journal: shutil.copy(journal / "patient-1/000000.frames", journal / "patient-1/000001.frames"),
        "000001.frames: is damaged",
    ),
    "a link": (lambda journal: (journal / "forward").symlink_to(journal), "is a link"),
}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_a_damaged_session_is_kept_and_the_remedy_works(spoilt, tmp_path, recording, refusal):
    killed(tmp_path / "session", _patient)
    spoil, problem = SPOILT[spoilt]
    spoil(tmp_path / ".session.unfinished" / JOURNAL)
    before = sorted(tmp_path.rglob("*"))
    said = " ".join(refusal(["live", "--finish", "-o", str(tmp_path / "session")]).split())
    assert problem in said
    assert ("put the target of the link there" if spoilt == "a link" else "'anchorpose live' and --overwrite") in said
    said = " ".join(refusal(["live", str(recording), "-o", str(tmp_path / "session")]).split())
    assert ("put the target" if spoilt == "a link" else "to begin again, give --overwrite") in said
    assert sorted(tmp_path.rglob("*")) == before


def test_a_body_that_is_gone_is_named(tmp_path, monkeypatch, capsys):
    killed(tmp_path / "session", _patient)
    monkeypatch.setattr("anchorpose.live.stored.open_recording", lambda folder: None)
    monkeypatch.setattr("anchorpose.live.stored.new_room", lambda recording, options: (SimpleNamespace(config=None), 0))
    monkeypatch.setattr("anchorpose.live.stored.Run", lambda room, config: None)
    monkeypatch.setattr(LiveOptions, "live", lambda options, config: None)
    assert main(["live", "--finish", "-o", str(tmp_path / "session")]) == 2
    assert "learnt: is missing; begin again with 'anchorpose live' and --overwrite" in capsys.readouterr().err


def test_results_below_the_current_folder_are_accepted(recording, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("anchorpose.live.cameras.Playback.images", lambda self, stop: iter(()))
    assert "Nothing can be tracked" in refusal(["live", str(recording), "-o", "session"])


@pytest.mark.parametrize(
    ("out", "given", "told"),
    [
        ("{recording}/session", [], "lies inside the recording"),
        ("{tmp}/session", ["--calibration", "{tmp}/none.json"], "none.json: there is no such file"),
    ],
)
def test_what_cannot_be_played_into_a_folder_is_refused_at_once(recording, tmp_path, refusal, out, given, told):
    arguments = ["live", "{recording}", "-o", out, *given]
    assert told in refusal([each.format(recording=recording, tmp=tmp_path) for each in arguments])
    assert list(tmp_path.iterdir()) == []


def test_a_stored_session_names_its_own_copy_of_the_calibration(recording, tmp_path):
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    given = tmp_path / "wednesday.json"
    cameras = [{"name": "front", "camera_to_world": pose.tolist()}]
    given.write_text(json.dumps({"format": "camera-calibration", "version": 1, "cameras": cameras}))
    (tmp_path / "results").mkdir()
    store = SessionStore(tmp_path / "results", LiveOptions(config=TrackConfig(height_m=1.7), calibration=given))
    store._write(store._session)
    found = read_session(tmp_path / "results")
    given.unlink()
    assert (store.first_seconds / found.options.calibration).is_file()
    assert found == store._session


class _Unfinished:
    finished = False

    def finish(self, notes=()):
        raise OSError(24, "Too many open files")


def test_a_recording_that_cannot_be_finished_costs_no_results():
    intake = Intake([])
    assert _finish(_Unfinished(), intake) is None
    assert "Too many open files" in intake.failed[0]
    assert "anchorpose record" in intake.failed[0]
