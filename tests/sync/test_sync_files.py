"""XDF and EDF give the same signals as CSV, stamps of the Lab Streaming Layer give a clock, and damage is stated."""

import json
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, standing_joints, write_results
from sensor_builder import make_sensor
from xdf_builder import write_xdf

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.document import read_document
from anchorpose.recording.recording_file import RecordingDocument
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.sync.streams import distinct
from anchorpose.sync.synchronising import read_other

FIRST_S, COUNT = 100.0, 600


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    frames = [make_frame(k, FIRST_S + k / 10.0, standing_joints()) for k in range(COUNT)]
    return write_results(tmp_path_factory.mktemp("files") / "results", frames)


def emg(lsl_s: float):
    """A stream of two muscles for a minute, from ``lsl_s`` on."""
    time_s = lsl_s + np.arange(0.0, 60.0, 0.001)
    return time_s, ("rectus", "biceps"), np.column_stack([np.sin(time_s), np.cos(3.0 * time_s)]), 1000.0


def recording_of(folder, results, start: dict | None):
    """A folder with recording.json, and results that say that they are of it."""
    folder.mkdir()
    camera = {"name": "front", "width": 64, "height": 48, "depth_scale": 0.001}
    camera["intrinsics"] = {"fx": 60.0, "fy": 60.0, "cx": 32.0, "cy": 24.0}
    document = {
        "format": "rgbd-recording",
        "version": 1,
        "cameras": [camera],
        **({} if start is None else {"start": start}),
    }
    (folder / "recording.json").write_text(json.dumps(document))
    run = json.loads((results / RUN_FILE).read_text())
    run["inputs_sha256"] = dict(hash_files([folder / "recording.json"], folder))
    (results / RUN_FILE).write_text(json.dumps(run))
    return folder


def test_xdf_has_streams_markers_and_one_clock(tmp_path):
    pytest.importorskip("pyxdf")
    found = read_other(
        write_xdf(
            tmp_path / "a.xdf",
            {"EMG": emg(50.0), "IMU": (50.0 + np.arange(200) / 50.0, ("ax",), np.arange(200.0)[:, None], 50.0)},
            {"Task": [(51.0, "begin"), (55.5, "end")]},
            clock_offset_s=7.0,
        )
    )
    assert found.names == ("rectus", "biceps", "ax")
    time_s, values = found.take(("biceps",))
    assert time_s[0] == pytest.approx(57.0, abs=1e-4)
    np.testing.assert_allclose(values[:, 0], emg(50.0)[2][:, 1])
    np.testing.assert_allclose(found.markers[0].time_s, [58.0, 62.5], atol=1e-4)


@pytest.mark.parametrize("ending", ["xdf", "edf"])
def test_the_clock_from_movement_is_the_same_as_of_csv(ending, tmp_path):
    sensor = make_sensor(tmp_path / "sensor", seed=5, seconds=20.0)
    begin_s = 0.0 if ending == "edf" else float(sensor.clock_s[0])
    clock_s = begin_s + sensor.time_s
    names = ("ax", "ay", "az")
    if ending == "xdf":
        pytest.importorskip("pyxdf")
        path = write_xdf(tmp_path / "imu.xdf", {"IMU": (clock_s, names, sensor.acceleration, 100.0)}, {})
    else:
        path = write_edf(tmp_path / "imu.edf", names, sensor.acceleration, 100)
    rows = np.column_stack([clock_s, sensor.acceleration])
    np.savetxt(tmp_path / "imu.csv", rows, fmt="%.6f", delimiter=",", header="time_s,ax,ay,az", comments="")
    offsets = []
    for other in (path, tmp_path / "imu.csv"):
        out = tmp_path / f"out-{other.suffix[1:]}"
        options = ("--segment", "thigh_right", "--acceleration", "ax,ay,az")
        assert main(["sync", str(sensor.results), str(other), "-o", str(out), *options]) == 0
        offsets.append(json.loads((out / "clock.json").read_text())["offset_s"])
    assert offsets[0] == pytest.approx(offsets[1], abs=0.002)


def write_edf(path, names, values, hz, annotations=()):
    pyedflib = pytest.importorskip("pyedflib")
    with pyedflib.EdfWriter(str(path), len(names), file_type=pyedflib.FILETYPE_EDFPLUS) as file:
        for row, name in enumerate(names):
            most = float(np.ceil(np.abs(values[:, row]).max()))
            file.setSignalHeader(
                row,
                {
                    "label": name,
                    "dimension": "g",
                    "sample_frequency": hz,
                    "transducer": "",
                    "prefilter": "",
                    "physical_min": -most,
                    "physical_max": most,
                    "digital_min": -32768,
                    "digital_max": 32767,
                },
            )
        file.writeSamples([np.ascontiguousarray(column) for column in values.T])
        for onset_s, text in annotations:
            file.writeAnnotation(onset_s, -1, text)
    return path


def test_annotations_of_edf_are_markers(tmp_path):
    values = np.sin(np.arange(1000.0) / 10.0)[:, None]
    found = read_other(
        write_edf(tmp_path / "a.edf", ("emg",), values, 100, [(1.0, "beep"), (2.5, "beep"), (3.0, "stop")])
    )
    assert {each.name: each.time_s.tolist() for each in found.markers} == {"beep": [1.0, 2.5], "stop": [3.0]}
    assert found.take(("emg",))[1][:, 0] == pytest.approx(values[:, 0], abs=1e-3)


@pytest.mark.parametrize("of_numbers", [False, True])
def test_pulses_may_be_a_stream_of_markers_as_texts_or_numbers(results, of_numbers, tmp_path):
    pytest.importorskip("pyxdf")
    at_s = np.sort(np.random.default_rng(1).uniform(2.0, 55.0, 12))
    codes = (at_s + 5000.0, ("code",), np.random.default_rng(2).integers(1, 5, (12, 1)).astype(float), 0.0)
    markers = {} if of_numbers else {"Task": [(float(each) + 5000.0, "x") for each in at_s]}
    streams = {"EMG": emg(5000.0), **({"Task": codes} if of_numbers else {})}
    other = write_xdf(tmp_path / "a.xdf", streams, markers)
    events = [f"{each:.4f}\t0.1\tx" for each in at_s]
    (tmp_path / "events.tsv").write_text("\n".join(["onset\tduration\ttrial_type", *events]) + "\n")
    options = ("--pulses", "Task", "--pulse-times", str(tmp_path / "events.tsv"))
    assert main(["sync", str(results), str(other), "-o", str(tmp_path / "out"), *options]) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text())
    assert clock["offset_s"] == pytest.approx(5000.0 - FIRST_S, abs=0.005)
    signals = pq.read_table(tmp_path / "out/signals.parquet")
    assert signals.column_names[3:7] == ["rectus", "rectus_rms", "biceps", "biceps_rms"]
    assert signals.column_names[7:] == (["code"] if of_numbers else [])
    at_s = signals["other_time_s"].to_numpy()
    inside = (at_s > 5000.1) & (at_s < 5059.9)
    np.testing.assert_allclose(signals["rectus"].to_numpy()[inside], np.sin(at_s[inside]), atol=0.01)


@pytest.mark.filterwarnings("error")
def test_a_channel_without_values_stays_empty(results, tmp_path):
    time_s = np.arange(0.0, 50.0, 0.01)
    rows = [f"{each:.2f},{each % 7.0 < 0.1:d},1.0," for each in time_s]
    (tmp_path / "a.csv").write_text("\n".join(["time_s,p,q,none", *rows]) + "\n")
    events = [f"{each:.4f}\t0.1\tx" for each in np.arange(0.0, 50.0, 7.0)]
    (tmp_path / "events.tsv").write_text("\n".join(["onset\tduration\ttrial_type", *events]) + "\n")
    options = ("--pulses", "p", "--pulse-times", str(tmp_path / "events.tsv"), "--near", str(-FIRST_S))
    assert main(["sync", str(results), str(tmp_path / "a.csv"), "-o", str(tmp_path / "out"), *options]) == 0
    signals = pq.read_table(tmp_path / "out/signals.parquet")
    assert signals["none"].null_count == signals["none_rms"].null_count == len(signals)
    assert set(signals["q"].to_numpy()[10:400]) == {1.0}


def test_stamps_give_the_clock(results, tmp_path):
    pytest.importorskip("pyxdf")
    recording = recording_of(tmp_path / "recording", results, {"utc": "2026-03-28T09:15:02.125Z", "lsl_s": 5000.0})
    other = write_xdf(tmp_path / "a.xdf", {"EMG": emg(4990.0)}, {})
    options = ["sync", str(results), str(other), "-o", str(tmp_path / "out"), "--stamps"]
    assert main([*options, str(recording)]) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text())
    assert (clock["method"], clock["offset_s"]) == ("stamps", 4900.0)
    assert clock["common_s"] == pytest.approx([FIRST_S, FIRST_S + 50.0], abs=0.1)


@pytest.mark.parametrize(
    ("start", "lsl_s", "words"),
    [
        (None, 5000.0, "does not state its start by the clock"),
        ({"utc": "2026-03-28T09:15:02Z"}, 5000.0, "does not state its start by the clock"),
        ({"lsl_s": 5000.0}, 9000.0, "was recorded at another time"),
    ],
)
def test_stamps_that_give_no_clock_are_refused(results, start, lsl_s, words, tmp_path, capsys):
    pytest.importorskip("pyxdf")
    recording = recording_of(tmp_path / "recording", results, start)
    other = write_xdf(tmp_path / "a.xdf", {"EMG": emg(lsl_s)}, {})
    options = ["sync", str(results), str(other), "-o", str(tmp_path / "out"), "--stamps"]
    assert main([*options, str(recording)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_stamps_of_another_recording_are_refused(results, tmp_path, capsys):
    pytest.importorskip("pyxdf")
    first = recording_of(tmp_path / "first", results, {"lsl_s": 5000.0})
    recording_of(tmp_path / "second", results, {"lsl_s": 1.0})
    other = write_xdf(tmp_path / "a.xdf", {"EMG": emg(5000.0)}, {})
    assert main(["sync", str(results), str(other), "-o", str(tmp_path / "out"), "--stamps", str(first)]) == 2
    assert "is not of the recording" in capsys.readouterr().err


@pytest.mark.parametrize("utc", ["2026-03-28T09:15:02", "yesterday", "2026-03-28T09:15:02+01:00", "", 5])
def test_a_start_that_is_no_time_in_utc_is_refused(utc, results, tmp_path):
    folder = recording_of(tmp_path / "recording", results, {"utc": utc})
    with pytest.raises(InputError, match=r"recording\.json"):
        read_document(folder / "recording.json", RecordingDocument)


@pytest.mark.parametrize(("package", "name"), [("pyxdf", "a.xdf"), ("pyedflib", "a.edf")])
def test_a_missing_package_is_named(package, name, results, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"XDF:")
    options = ("--segment", "trunk", "--gyroscope", "x")
    assert main(["sync", str(results), str(tmp_path / name), "-o", str(tmp_path / "out"), *options]) == 2
    assert "pip install 'anchorpose[sync]'" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.xdf", "a.edf", "a.bdf"])
@pytest.mark.parametrize("content", [b"", b"XDF:", b"XDF:" + bytes(range(256)) * 9, b"0       " + b"x" * 3000])
def test_garbage_is_refused_in_one_sentence(name, content, results, tmp_path, capfd):
    pytest.importorskip("pyxdf")
    pytest.importorskip("pyedflib")
    (tmp_path / name).write_bytes(content)
    options = ("--segment", "trunk", "--gyroscope", "x")
    assert main(["sync", str(results), str(tmp_path / name), "-o", str(tmp_path / "out"), *options]) == 2
    said = capfd.readouterr()
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_cut_xdf_is_read_as_far_as_it_goes_with_a_note(results, tmp_path):
    pytest.importorskip("pyxdf")
    streams = {"EMG": emg(50.0), "IMU": (50.0 + np.arange(200) / 50.0, ("ax",), np.arange(200.0)[:, None], 50.0)}
    path = write_xdf(tmp_path / "a.xdf", streams, {})
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"<name>IMU") + 900])
    found = read_other(path)
    assert found.names == ("rectus", "biceps")


def test_names_are_told_apart():
    assert distinct(("emg", "emg", "emg 2", "emg")) == ("emg", "emg 2", "emg 2 2", "emg 3")
