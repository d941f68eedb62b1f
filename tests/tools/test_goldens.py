"""How goldens are compared: exactly on the machine that made them, within tolerances elsewhere."""

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

import goldens
from golden_digests import TOLERANCES, differences, digest_of_folder, digests_of
from goldens import Made, compare

HERE, ELSEWHERE = {"processor": "this", "numpy": "2"}, {"processor": "another", "numpy": "2"}
SUMMARY = {
    "joints_mm": {"Head": [0.0, 1600.0, 0.0], "Neck": None},
    "cameras_mm": {"front": [2500.0, 1200.0, 0.0]},
    "height_mm": {"patient": 1700.0},
    "states": {"observed": 0.9, "lost": 0.1},
    "shares": {"upright_share": 1.0},
}


@pytest.fixture
def results(tmp_path) -> Path:
    """Files of each kind that a results folder has."""
    folder = tmp_path / "results"
    for place in ("pictures", "exports/csv"):
        (folder / place).mkdir(parents=True)
    write_table(folder, x_m=[0.1, None])
    write_run(folder)
    for name in ("pictures/0.png", "exports/csv/joints.csv", "log.jsonl", "report.html"):
        (folder / name).write_text("as it was")
    (folder / "exports/csv/export.json").write_text(json.dumps({"files": ["joints.csv"], "sources_sha256": {"a": "0"}}))
    return folder


def write_table(folder: Path, **columns: list[float | None]) -> None:
    table = pa.table({"frame": [0, 1], "x_m": [0.1, None], "y_m": [1.0, 2.0], **columns})
    pq.write_table(table, folder / "joints.parquet")


def write_run(folder: Path, **changed: object) -> None:
    (folder / "run.json").write_text(json.dumps({"notes": [], "timings": 1.0, "code": "a", "identity": "b", **changed}))


def made(digests: dict | None = None, **summary: object) -> Made:
    return Made(digests or {"recording": {"all": "0"}, "joints.parquet": {"all": "1", "x_m": "2"}}, SUMMARY | summary)


def stored(of: Made) -> dict:
    return {"fingerprint": HERE, "recordings": {"clinic": asdict(of)}}


def test_a_change_of_one_bit_is_reported_by_file_and_column(results):
    before = digests_of(results)
    write_table(results, x_m=[0.1 + 2**-56, None])
    assert differences(before, digests_of(results)) == ["joints.parquet: x_m"]


def test_what_every_run_or_edit_changes_is_left_out(results):
    before = digests_of(results)
    write_run(results, timings=2.0, code="c", identity="d")
    (results / "log.jsonl").write_text("later")
    (results / "report.html").write_text("later")
    (results / "exports/csv/export.json").write_text(json.dumps({"files": ["joints.csv"], "sources_sha256": {}}))
    assert differences(before, digests_of(results)) == []


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("pictures/0.png", "pictures/0.png: differs"),
        ("exports/csv/joints.csv", "exports/csv/joints.csv: differs"),
        ("exports/csv/more.csv", "exports/csv/more.csv is new"),
    ],
)
def test_pictures_and_exports_are_compared(results, file, line):
    before = digests_of(results)
    (results / file).write_text("changed")
    assert differences(before, digests_of(results)) == [line]
    assert differences(digests_of(results), digests_of(results)) == []


def test_a_changed_note_and_a_missing_table_are_reported(results):
    before = digests_of(results)
    write_run(results, notes=["another"])
    (results / "joints.parquet").unlink()
    assert sorted(differences(before, digests_of(results))) == ["joints.parquet is missing", "run.json: notes"]


def test_a_changed_simulator_is_told_from_a_changed_tracker(tmp_path):
    (tmp_path / "depth.png").write_text("an image")
    before = {"recording": {"all": digest_of_folder(tmp_path)}}
    (tmp_path / "depth.png").rename(tmp_path / "other.png")
    (line,) = differences(before, {"recording": {"all": digest_of_folder(tmp_path)}})
    assert "the simulator changed" in line


def test_on_the_machine_of_the_goldens_every_byte_counts_on_another_values_within_the_tolerances_agree():
    now = made({"recording": {"all": "0"}, "joints.parquet": {"all": "3", "x_m": "4"}})
    assert compare("clinic", now, stored(made()), HERE) == ["clinic: joints.parquet: x_m"]
    assert compare("clinic", made(), stored(made()), HERE) == []
    now = made({"recording": {"all": "8"}}, joints_mm={"Head": [0.0, 1600.1, 0.0], "Neck": None})
    assert compare("clinic", now, stored(made()), ELSEWHERE) == []


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("joints_mm", {"Head": [0.0, 1600.0, TOLERANCES["joints_mm"] + 0.1], "Neck": None}),
        ("states", {"observed": 0.9 - TOLERANCES["states"] - 0.01, "lost": 0.1}),
        ("cameras_mm", {"front": [2500.0, 1200.0 + TOLERANCES["cameras_mm"] + 0.1, 0.0]}),
        ("cameras_mm", {"left": [2500.0, 1200.0, 0.0]}),
        ("height_mm", {"patient": 1700.0 + TOLERANCES["height_mm"] + 0.1}),
        ("height_mm", {"patient": None}),
        ("shares", {"upright_share": 0.0}),
    ],
)
def test_on_another_machine_values_beyond_the_tolerances_are_reported(kind, value):
    (line,) = compare("clinic", made(**{kind: value}), stored(made()), ELSEWHERE)
    assert line.startswith(f"clinic: {kind}: more than {TOLERANCES[kind]} from the stored values: ")


def test_the_fingerprint_is_the_same_before_and_after_tracking_loads_its_libraries():
    code = (
        "from golden_machine import fingerprint; first = fingerprint(); import anchorpose.pipeline; "
        "import anchorpose.simulate.write; import anchorpose.exports.exporting; assert fingerprint() == first"
    )
    subprocess.run([sys.executable, "-c", code], cwd=Path(goldens.__file__).parent, check=True)


def test_one_recording_of_another_machine_cannot_be_stored(monkeypatch, tmp_path):
    monkeypatch.setattr(goldens, "STORED", tmp_path / "goldens.json")
    (tmp_path / "goldens.json").write_text(json.dumps(stored(made())))
    before = (tmp_path / "goldens.json").read_bytes()
    with pytest.raises(SystemExit, match="of another machine"):
        goldens.update(["clinic"], tmp_path)
    assert (tmp_path / "goldens.json").read_bytes() == before


def test_every_recording_is_stored():
    recordings = goldens.read_stored()["recordings"]
    assert tuple(recordings) == goldens.NAMES
