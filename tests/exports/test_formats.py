"""C3D, CSV and BIDS hold what the results hold, and say what is missing the way each format does."""

import csv
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from exports_builder import angle_names, angle_of, column, times, true_joints, write_all_poses, write_true_results
from scipy.spatial.transform import Rotation
from session_builder import contact

from anchorpose.errors import MissingPackage
from anchorpose.exports import c3d
from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.joints import JOINT_NAMES, STATE_NAMES
from anchorpose.options import ExportConfig
from anchorpose.results import frame_time
from anchorpose.results.records import CONTACTS_FILE, write_contacts
from anchorpose.results.tables import BodyPose, read_joints

START_S = 100.0
LOST = {5: ("KneeLeft",), 6: JOINT_NAMES}


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    """A squat in which a knee is lost in a frame, everything in the next, and two frames were dropped."""
    kept = np.delete(np.arange(75), [20, 21])
    folder = tmp_path_factory.mktemp("formats") / "Jane Doe"
    write_true_results(folder, true_joints()[kept], times(75)[kept] + START_S, LOST)
    with write_contacts(folder / CONTACTS_FILE) as contacts:
        held = replace(contact("knee_left", "person 1", 3, 9, 0.8), gap_mm=2.5)
        contacts.append(replace(held, start_s=START_S + 0.2, end_s=START_S + 0.6))
    return folder


def export(results: Path, out: Path, kind: Format, config: ExportConfig | None = None) -> Path:
    ((folder, _),) = export_results(results, [kind], config or ExportConfig(), out)
    return folder


def rows_of(path: Path, delimiter: str = ",") -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream, delimiter=delimiter))


def test_a_c3d_comes_back_with_points_rate_gaps_angles_sigma_and_states(results, tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d(str(export(results, tmp_path, Format.C3D) / "joints.c3d"))
    joints = read_joints(results / "joints.parquet")
    point = file["parameters"]["POINT"]
    assert point["LABELS"]["value"][:21] == list(JOINT_NAMES)
    assert (point["UNITS"]["value"], point["X_SCREEN"]["value"], point["Y_SCREEN"]["value"]) == (["mm"], ["+X"], ["+Y"])
    assert file["header"]["points"]["frame_rate"] == 15.0
    assert file["parameters"]["ANCHORPOSE"]["START_TIME"]["value"] == [START_S]
    assert file["data"]["points"].shape == (4, 21 + len(point["ANGLES"]["value"]), 75)
    recorded = np.delete(np.arange(75), [20, 21])
    places = file["data"]["points"][:3, :21].transpose(2, 1, 0)
    assert np.allclose(places[recorded], 1000.0 * joints.position_m, atol=1e-3, equal_nan=True)
    assert np.isnan(places[[20, 21]]).all()
    residual = file["data"]["meta_points"]["residuals"][0, :21].T
    assert np.array_equal(residual, np.where(np.isnan(places[..., 0]), -1.0, 0.0))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    assert file["parameters"]["POINT"]["ANGLES"]["value"] == angle_names(results)
    for name in angle_names(results):
        written = file["data"]["points"][0, labels.index(name)]
        assert np.allclose(written[recorded], angle_of(results, name), atol=1e-4, equal_nan=True)
    analog = dict(zip(file["parameters"]["ANALOG"]["LABELS"]["value"], file["data"]["analogs"][0], strict=True))
    number = column("KneeLeft")
    assert np.array_equal(analog["KneeLeft.state"][recorded], joints.state_code[:, number])
    sigma_mm = np.where(joints.lost[:, number], -1.0, 1000.0 * joints.sigma_m[:, number])
    assert np.allclose(analog["KneeLeft.sigma"][recorded], sigma_mm, atol=1e-5)
    assert analog["HandLeft.state"][0] == STATE_NAMES.index("hidden_by_person")
    assert analog["knee_flexion_left.state"][5] == STATE_NAMES.index("lost")
    assert file["parameters"]["ANCHORPOSE"]["STATES"]["value"] == list(STATE_NAMES)


def test_the_residuals_of_a_c3d_are_words_that_no_program_can_read_differently(results, tmp_path):
    pytest.importorskip("ezc3d")
    content = (export(results, tmp_path, Format.C3D) / "joints.c3d").read_bytes()
    points, channels = np.frombuffer(content, "<u2", 2, offset=2)
    data = 512 * (int(np.frombuffer(content, "<u2", 1, offset=16)[0]) - 1)
    rows = np.frombuffer(content, "<f4", 75 * (4 * int(points) + int(channels)), offset=data).reshape(75, -1)
    words = rows[:, 3 : 4 * points : 4]  # residual in the low byte, cameras in the high byte
    assert set(np.unique(words)) == {-1.0, 0.0}


def test_a_recording_too_long_for_one_c3d_goes_into_several(results, tmp_path, monkeypatch):
    ezc3d = pytest.importorskip("ezc3d")
    monkeypatch.setattr(c3d, "LARGEST_FRAMES", 30)
    folder = export(results, tmp_path, Format.C3D)
    files = [ezc3d.c3d(str(path)) for path in sorted(folder.glob("*.c3d"))]
    assert [file["data"]["points"].shape[2] for file in files] == [30, 30, 15]
    starts = [file["parameters"]["ANCHORPOSE"]["START_TIME"]["value"][0] for file in files]
    assert starts == pytest.approx([START_S, START_S + 2.0, START_S + 4.0], abs=1e-4)
    last = 1000.0 * read_joints(results / "joints.parquet").position_m[-1]
    assert np.allclose(files[2]["data"]["points"][:3, :21, -1].T, last, atol=1e-3)
    assert c3d.LARGEST_FRAMES <= 2**16 - 1


def test_without_ezc3d_there_is_one_sentence_and_nothing_written(results, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(MissingPackage, match=r"anchorpose\[c3d\]"):
        export_results(results, [Format.CSV, Format.C3D], ExportConfig(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_csv_holds_every_number_and_empty_cells_where_there_is_none(results, tmp_path):
    folder = export(results, tmp_path, Format.CSV)
    joints = read_joints(results / "joints.parquet")
    long = rows_of(folder / "joints.csv")
    assert len(long) == 73 * 21
    for row in long[:: 21 * 5]:
        place = joints.position_m[int(np.flatnonzero(joints.frame == int(row["frame"]))[0]), column(row["joint"])]
        assert [row[f"{axis}_m"] for axis in "xyz"] == (
            ["", "", ""] if np.isnan(place[0]) else [repr(x) for x in place.tolist()]
        )
    wide = rows_of(folder / "joints_wide.csv")
    assert [float(row["time_s"]) for row in wide] == joints.time_s.tolist()
    assert (wide[5]["KneeLeft_x_m"], wide[5]["KneeLeft_sigma_m"], wide[5]["KneeLeft_state"]) == ("", "", "lost")
    assert float(wide[5]["KneeRight_y_m"]) == joints.position_m[5, column("KneeRight"), 1]
    assert rows_of(folder / "contacts.csv")[0]["gap_mm"] == "2.5"
    written = [float(row["knee_flexion_right_deg"] or "nan") for row in rows_of(folder / "angles_wide.csv")]
    assert np.array_equal(written, angle_of(results, "knee_flexion_right"), equal_nan=True)
    assert "nan" not in "".join(path.read_text() for path in folder.glob("*wide.csv")).lower()


def test_the_data_dictionary_explains_every_column_of_every_table(results, tmp_path):
    folder = export(results, tmp_path, Format.CSV)
    explained = {(row["file"], row["column"]) for row in rows_of(folder / "data_dictionary.csv") if row["meaning"]}
    found = set()
    for path in folder.glob("*.csv"):
        if path.name != "data_dictionary.csv":
            header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
            found |= {(path.name, name) for name in header}
    assert found == explained
    assert ("joints_wide.csv", "AnkleLeft_sigma_m") in explained


def test_bids_writes_one_channel_a_column_and_na_where_nothing_was_found(results, tmp_path):
    config = ExportConfig(subject="P7", session="2", task="squat")
    folder = export(results, tmp_path, Format.BIDS, config)
    stem = folder / "sub-P7" / "ses-2" / "motion" / "sub-P7_ses-2_task-squat_tracksys-anchorpose"
    channels = rows_of(Path(f"{stem}_channels.tsv"), "\t")
    lines = [line.split("\t") for line in Path(f"{stem}_motion.tsv").read_text().splitlines()]
    joints = read_joints(results / "joints.parquet")
    assert ({len(line) for line in lines}, len(lines)) == ({len(channels)}, 73)
    index = {channel["name"]: number for number, channel in enumerate(channels)}
    knee = [line[index["KneeLeft_y"]] for line in lines]
    assert (knee[5], knee[6], lines[5][index["KneeLeft_sigma"]]) == ("n/a", "n/a", "n/a")
    assert float(knee[9]) == pytest.approx(joints.position_m[9, column("KneeLeft"), 1], abs=1e-6)
    assert [float(line[index["latency"]]) for line in lines] == pytest.approx(joints.time_s - START_S, abs=1e-9)
    sidecar = json.loads(Path(f"{stem}_motion.json").read_text())
    told = [sidecar[name] for name in ("TaskName", "SamplingFrequency", "RecordingType")]
    assert told == ["squat", 15.0, "discontinuous"]
    assert sidecar["SamplingFrequencyEffective"] == pytest.approx(72 / (joints.time_s[-1] - START_S), abs=1e-5)
    for kind in ("POS", "JNTANG", "LATENCY", "MISC"):
        assert sidecar[f"{kind}ChannelCount"] == sum(channel["type"] == kind for channel in channels)
    events = rows_of(folder / "sub-P7" / "ses-2" / "motion" / "sub-P7_ses-2_task-squat_events.tsv", "\t")
    assert [(row["onset"], row["duration"], row["trial_type"], row["part"]) for row in events] == [
        ("0.2", "0.4", "contact", "knee_left")
    ]


@pytest.mark.parametrize("config", [ExportConfig(), ExportConfig(subject="P7", session="2", task="squat")])
def test_the_bids_validator_accepts_the_dataset(results, tmp_path, config):
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    validator = shutil.which("bids-validator-deno", path=places)
    if validator is None:
        pytest.skip("the BIDS validator is not installed")
    folder = export(results, tmp_path, Format.BIDS, config)
    answer = subprocess.run([validator, str(folder), "--format", "json"], capture_output=True, text=True, timeout=60)
    issues = json.loads(answer.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    assert answer.returncode == 0
    subjects = json.loads(answer.stdout)["summary"]["subjectMetadata"]
    assert [subject["participantId"] for subject in subjects] == [config.subject]


@pytest.mark.parametrize("kind", Format)
def test_nothing_that_is_exported_names_the_patient_or_a_place_on_the_disk(results, tmp_path, kind):
    if kind is Format.C3D:
        pytest.importorskip("ezc3d")
    folder = export(results, tmp_path, kind)
    for path in folder.rglob("*"):
        assert "Jane" not in path.name
        content = path.read_bytes() if path.is_file() else b""
        assert b"Jane" not in content
        assert str(tmp_path).encode() not in content
        assert b"garden" not in content  # of the recording's name in run.json


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_a_number_in_a_csv_is_the_shortest_that_reads_back(results, tmp_path, kind):
    values = np.array([0.1, -3.0, 1e-7, np.nan, 1e300 if kind == "float64" else 1e30], dtype=kind)
    other = tmp_path / "other"
    shutil.copytree(results, other)
    pq.write_table(pa.table({"value": pa.array(values)}), other / "odd.parquet")
    written = [row["value"] for row in rows_of(export(other, tmp_path / "out", Format.CSV) / "odd.csv")]
    assert (written[0], written[3]) == ("0.1", "")
    known = [0, 1, 2, 4]
    assert np.array_equal(np.array([float(written[place]) for place in known], dtype=kind), values[known])


@pytest.mark.parametrize("kind", [Format.CSV, Format.BIDS])
def test_an_export_of_a_few_frames_at_a_time_has_the_same_bytes(tmp_path, monkeypatch, kind):
    rng, stamps = np.random.default_rng(4), times(75)
    write_true_results(tmp_path / "results", true_joints(), stamps, LOST)
    poses = [
        BodyPose(k, stamps[k], at, Rotation.random(len(at), rng).as_quat(scalar_first=True), np.full(len(at), 0.1))
        for k, at in enumerate(true_joints())
    ]
    write_all_poses(tmp_path / "results", poses)
    once = export(tmp_path / "results", tmp_path / "once", kind)
    monkeypatch.setattr(frame_time, "FRAMES_AT_ONCE", 7)
    pieces = export(tmp_path / "results", tmp_path / "pieces", kind)
    for folder, other in ((once, pieces), (pieces, once)):
        for path in (path for path in folder.rglob("*") if path.is_file()):
            assert path.read_bytes() == (other / path.relative_to(folder)).read_bytes()
