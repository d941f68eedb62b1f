"""Markers become trials in the form of BIDS, on the recording's clock, also after a power cut."""

import json
import time
from threading import Event, Thread

import numpy as np
import pytest

from anchorpose.cli import main
from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.live.cameras import Playback
from anchorpose.live.feed import LiveImage
from anchorpose.live.markers import MarkerInlet, Trial, plain_text, trials_of
from anchorpose.live.record import record_live
from anchorpose.live.recorder import Recorder, finish_recording
from anchorpose.recording.document import read_document
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import RecordingDocument
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.sources.plan import CameraPlan


@pytest.mark.parametrize(
    ("markers", "trials"),
    [
        ([(1.0, "begin stim 40 Hz"), (3.0, "end")], [Trial("stim 40 Hz", 1.0, 2.0)]),
        ([(1.0, "begin a"), (3.0, "begin b")], [Trial("a", 1.0, 2.0), Trial("b", 3.0, 7.0)]),
        ([(1.0, "begin a"), (3.0, "rating 4"), (4.0, "end a"), (5.0, "rating 6.5")], [Trial("a", 1.0, 3.0, 6.5)]),
        ([(3.0, "end"), (1.0, "begin a")], [Trial("a", 1.0, 2.0)]),
        ([(-2.0, "begin a"), (1.0, "end")], [Trial("a", 0.0, 1.0)]),
        ([(1.0, "begin a"), (1.0, "begin b"), (2.0, "end")], [Trial("b", 1.0, 1.0)]),
        ([(1.0, "begin"), (2.0, "pulse"), (3.0, "end"), (4.0, "rating 3"), (11.0, "begin late")], []),
        ([(1.0, "begin a"), (2.0, "rating soon")], [Trial("a", 1.0, 9.0)]),
    ],
)
def test_trials_of_markers(markers, trials):
    assert trials_of(markers, 10.0) == trials


def test_trials_never_overlap():
    rng = np.random.default_rng(3)
    for _ in range(200):
        words = rng.choice(["begin a", "begin b", "end", "rating 3", "pulse"], size=12)
        found = trials_of(list(zip(rng.uniform(-1.0, 12.0, 12).tolist(), words.tolist(), strict=True)), 10.0)
        ends = [0.0, *(trial.onset_s + trial.duration_s for trial in found), 10.0]
        assert all(trial.onset_s >= end - 1e-9 for trial, end in zip(found, ends, strict=False))
        assert all(trial.duration_s > 0.0 and end <= 10.0 + 1e-9 for trial, end in zip(found, ends[1:], strict=False))


def test_a_marker_is_one_cell():
    assert plain_text("a\tb\r\n c\x1b[31m") == "a b c [31m"
    assert len(plain_text("x" * 500)) == 200


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("markers")
    simulate_recording(folder / "out", single(6, seconds=2.5, fps=10.0))
    return open_recording(folder / "out/recording")


def test_markers_are_on_disk_at_once_and_count_from_the_first_image(recording, tmp_path):
    recorder = Recorder(tmp_path / "cut", [CameraPlan(camera=recording.cameras[0])])
    now_s = time.monotonic()
    recorder.mark("begin stand", now_s - 1.0)
    grey = np.full((recording.cameras[0].height, recording.cameras[0].width), 900, np.uint16)
    for k in range(4):
        recorder.put(LiveImage(0, k, 50.0 + k, now_s + k, grey + np.uint16(k)))
    recorder.mark("rating 3", now_s + 1.5)
    recorder.mark("end", now_s + 2.25)
    rows = (tmp_path / "cut/markers.tsv").read_text().splitlines()
    assert rows == [
        "onset\tduration\ttrial_type", "-1.0000\tn/a\tbegin stand", "1.5000\tn/a\trating 3", "2.2500\tn/a\tend",
    ]  # fmt: skip
    recorder.abandon()
    finish_recording(tmp_path / "cut")
    assert (tmp_path / "cut/events.tsv").read_text().splitlines() == [
        "onset\tduration\ttrial_type\trating",
        "0.0000\t2.2500\tstand\t3",
    ]
    assert json.loads((tmp_path / "cut/events.json").read_text()) == {"rating": {"Units": "score"}}


def test_the_recording_states_its_start(recording, tmp_path):
    pylsl = pytest.importorskip("pylsl")
    before_s = pylsl.local_clock()
    record_live([Playback(recording)], tmp_path / "again", None, 0.0, print, Event())
    start = read_document(tmp_path / "again/recording.json", RecordingDocument).start
    assert before_s - 0.1 <= start.lsl_s <= pylsl.local_clock()
    assert start.utc.endswith("Z")
    assert not (tmp_path / "again/markers.tsv").exists()


def test_markers_of_a_stream_are_kept_with_the_recording(recording, tmp_path):
    pylsl = pytest.importorskip("pylsl")
    info = pylsl.StreamInfo("Task-h5", "Markers", 1, pylsl.IRREGULAR_RATE, "string", "task-of-the-test")
    outlet, stop = pylsl.StreamOutlet(info), Event()
    sent: list[float] = []

    def send() -> None:
        outlet.wait_for_consumers(10.0)
        for text in ("begin sit", "end"):
            time.sleep(0.3)
            sent.append(time.monotonic())
            outlet.push_sample([text])

    sender = Thread(target=send)
    sender.start()
    record_live([Playback(recording)], tmp_path / "again", None, 0.0, print, stop, "Task-h5")
    sender.join()
    rows = [line.split("\t") for line in (tmp_path / "again/events.tsv").read_text().splitlines()]
    assert rows[1][2] == "sit"
    assert float(rows[1][1]) == pytest.approx(sent[1] - sent[0], abs=0.02)
    assert 0.0 < float(rows[1][0]) < 1.0


def test_a_stream_that_is_not_there_is_named(recording, tmp_path, monkeypatch, capsys):
    pytest.importorskip("pylsl")
    monkeypatch.setattr("anchorpose.live.markers.FIND_S", 0.2)
    assert main(["record", str(recording.folder), "-o", str(tmp_path / "again"), "--markers", "Nobody-h5"]) == 2
    assert "No stream of markers is named 'Nobody-h5'" in capsys.readouterr().err
    assert not (tmp_path / "again").exists()
    with pytest.raises(AnchorposeError, match="without quotes"):
        MarkerInlet("it's")


def test_live_keeps_markers_with_a_recording_only(recording, tmp_path, capsys):
    assert main(["live", str(recording.folder), "-o", str(tmp_path / "out"), "--markers", "Task"]) == 2
    assert "add --record FOLDER" in capsys.readouterr().err


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pylsl", None)
    with pytest.raises(MissingPackage, match="pylsl"):
        MarkerInlet("Task")
