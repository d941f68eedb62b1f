"""Events at the command line: those of a recording, those given to track, and those given to measure afterwards."""

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import stand_in_pipeline
from recording_builder import HEIGHT, PERIOD_S, WIDTH, edit_json, write_picture, write_recording, write_timestamps
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.events import RecordedSpan, span_of
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.tables import read_joints
from anchorpose.results.trial_table import read_trial_table
from anchorpose.results.verify import Fits, read_log, verify
from anchorpose.sync.recorded_pulses import first_frame_s
from anchorpose.track_inputs import UserInputs, read_inputs
from anchorpose.tracker.config import TrackConfig
from anchorpose.writing import _recorded

HEAD = "onset\tduration\ttrial_type\tamplitude\n"


def write_events(path: Path, condition: str = "on", onset_s: float = 0.0) -> Path:
    path.write_text(f"{HEAD}{onset_s}\t{PERIOD_S}\t{condition}\t40\n")
    path.with_suffix(".json").write_text(json.dumps({"amplitude": {"Units": "mA"}}))
    return path


@pytest.fixture
def recording(tmp_path) -> Path:
    return write_recording(tmp_path / "recording", frames=6)


def read(recording: Path, events: Path | None = None):
    return read_inputs(recording, TrackConfig(motions=None), UserInputs(events=events))


def test_events_belong_to_the_run_and_another_trial_makes_another_run(recording, tmp_path):
    without = read(recording)
    assert without.trials is None
    write_events(recording / "events.tsv")
    own = read(recording)
    assert own.trials.conditions == ("on",)
    assert {"events.tsv", "events.json"} <= set(dict(own.sha256))
    write_events(recording / "events.tsv", "off")
    other = read(recording)
    edit_json(recording / "events.json", lambda units: units.update(amplitude={"Units": "V"}))
    assert len({each.identity for each in (without, own, other, read(recording))}) == 4
    given = read(recording, write_events(tmp_path / "mine.tsv", "given"))
    assert given.trials.conditions == ("given",)
    assert {"--events mine.tsv", "--events mine.json"} <= set(dict(given.sha256))


def two_cameras(folder: Path, starts_s: float) -> Path:
    """A recording whose first camera measured nothing; the second camera starts ``starts_s`` after the first."""
    recording = write_recording(folder, frames=6, cameras=("front", "left"))
    for frame in range(6):
        nothing = np.zeros((HEIGHT, WIDTH), np.uint16)
        write_picture(recording / "front" / "depth" / f"{frame:06d}.png", nothing)
    write_timestamps(recording / "left", [(frame, starts_s + frame * PERIOD_S) for frame in range(6)])
    write_events(recording / "events.tsv", onset_s=0.4)
    return recording


def test_onsets_count_from_the_first_camera_even_if_it_measured_nothing(tmp_path):
    inputs = read(two_cameras(tmp_path / "recording", starts_s=0.3))
    assert [camera.name for camera in inputs.recording.cameras] == ["left"]
    assert inputs.trials.rows[0].start_s == pytest.approx(0.4)
    assert any("onsets of trials count from the first frame of camera front" in note for note in inputs.recording.notes)
    assert span_of(inputs.recording) == RecordedSpan(0.0, pytest.approx(0.9))


def test_onsets_are_refused_if_the_first_camera_measured_nothing_and_has_other_times(tmp_path):
    recording = two_cameras(tmp_path / "recording", starts_s=500.0)
    with pytest.raises(InputError, match=r"events\.tsv: .*never overlap with the frames.*list a camera that measured"):
        read(recording)
    (recording / "events.tsv").unlink()
    assert span_of(read(recording).recording).first_s is None


def test_run_json_keeps_the_start_of_a_first_camera_that_measured_nothing(tmp_path):
    recording = read(two_cameras(tmp_path / "recording", starts_s=0.3)).recording
    assert _recorded(recording, TrackConfig()) == span_of(recording)
    assert _recorded(replace(recording, left_out_s=None), TrackConfig()) is None


def test_a_mistake_in_the_events_is_found_before_anything_is_tracked(recording, tmp_path, refusal):
    events = write_events(tmp_path / "mine.tsv", onset_s=100.0)
    told = refusal(["track", str(recording), "-o", str(tmp_path / "out"), "--events", str(events)])
    assert "mine.tsv: line 2 is a trial from 100 to" in told.replace("\n", " ")
    assert not (tmp_path / "out").exists()
    (recording / "events.tsv").write_text("onset\n")
    told = refusal(["track", str(recording), "-o", str(tmp_path / "out")])
    assert "line 1 has no column duration, trial_type" in told.replace("\n", " ")


def test_track_takes_events_and_verify_accepts_them(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "anchorpose.pipeline", stand_in_pipeline)
    events = write_events(tmp_path / "mine.tsv")
    out = tmp_path / "out"
    assert main(["track", str(recording), "-o", str(out), "--events", str(events)]) == 0
    assert read_trial_table(out / "trials.parquet").conditions == ("on",)
    inputs = dict(hash_files(input_files(open_recording(recording)), recording))
    inputs["--events mine.tsv"] = "0" * 64
    edit_json(out / RUN_FILE, lambda run: run.update(inputs_sha256=inputs))
    assert all(fits is Fits.SAME for fits in verify(out, recording).recording.values())


@pytest.fixture
def results(tmp_path) -> Path:
    """Six seconds whose clock begins at 7 s."""
    frames = [make_frame(k, 7.0 + k / 10.0, standing_joints()) for k in range(60)]
    return write_results(tmp_path / "results", frames)


def test_measure_takes_events_for_results_that_are_there(results, tmp_path, capsys):
    events = tmp_path / "events.tsv"
    events.write_text("onset\tduration\ttrial_type\n0\t2\toff\n3\t3\ton\n")
    assert main(["measure", str(results), "--events", str(events)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "2 trials as well (conditions: off, on)" in told
    assert [trial.start_s for trial in read_trial_table(results / "trials.parquet").rows] == [7.0, 10.0]
    table = pq.read_table(results / "measures.parquet").to_pylist()
    frames = {row["trial"]: row["frames"] for row in table if row["measure"] == "recorded_time"}
    assert frames == {None: frames[None], 1: 20, 2: 30}
    log = read_log(results)
    assert "events.tsv" in log.events[-1].about
    assert {"trials.parquet", "trial_intervals.parquet"} <= set(log.events[-1].files)
    assert main(["measure", str(results)]) == 0  # they stay
    assert read_trial_table(results / "trials.parquet").conditions == ("off", "on")


def test_results_of_a_part_count_from_the_beginning_of_the_recording_or_are_refused(results, tmp_path, refusal, capsys):
    events = tmp_path / "events.tsv"
    events.write_text("onset\tduration\ttrial_type\n2\t2\toff\n")
    edit_json(results / RUN_FILE, lambda run: run.update(config={"start": 20, "stop": None}))
    assert "does not state when the recording began" in refusal(["measure", str(results), "--events", str(events)])
    edit_json(results / RUN_FILE, lambda run: run.update(recorded=asdict(RecordedSpan(None, 13.0))))
    assert "measured nothing" in refusal(["measure", str(results), "--events", str(events)])
    with pytest.raises(InputError, match="does not know when the recording began"):
        first_frame_s(results, read_joints(results / "joints.parquet"))
    edit_json(results / RUN_FILE, lambda run: run.update(recorded=asdict(RecordedSpan(5.0, 13.0))))
    assert main(["measure", str(results), "--events", str(events)]) == 0
    assert read_trial_table(results / "trials.parquet").rows[0].start_s == 7.0


def test_trials_that_were_changed_by_hand_are_not_measured(results, tmp_path, refusal, capsys):
    events = tmp_path / "events.tsv"
    events.write_text("onset\tduration\ttrial_type\n0\t2\toff\n")
    assert main(["measure", str(results), "--events", str(events)]) == 0
    path = results / "trials.parquet"
    pq.write_table(pq.read_table(path), path, compression="none")
    assert "trials.parquet" in refusal(["measure", str(results)])
