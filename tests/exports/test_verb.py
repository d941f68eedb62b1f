"""The verb: folders that appear whole, are replaced only when asked, and a record of what was done."""

import hashlib
import json
from pathlib import Path

import pytest
from exports_builder import true_joints, write_true_results

from anchorpose import __version__
from anchorpose.cli import main
from anchorpose.exports import exporting
from anchorpose.exports.formats import Format
from anchorpose.options import ExportConfig


@pytest.fixture
def results(tmp_path) -> Path:
    return write_true_results(tmp_path / "results", true_joints()[:20])


def record_of(folder: Path) -> dict:
    return json.loads((folder / "export.json").read_text(encoding="utf-8"))


def test_each_format_gets_a_folder_of_its_own_and_its_record_says_what_was_done_from_which_bytes(results, capsys):
    assert main(["export", str(results), "--to", "trc, MOT,csv,bvh,bids"]) == 0
    assert {path.name for path in (results / "exports").iterdir()} == {"trc", "mot", "csv", "bvh", "bids"}
    assert "ik_setup.xml" in capsys.readouterr().out
    assert main(["export", str(results), "--to", "trc", "-o", str(results.parent / "elsewhere")]) == 0
    assert (results.parent / "elsewhere" / "trc" / "joints.trc").is_file()
    record = record_of(results / "exports" / "trc")
    assert (record["to"], record["versions"]["anchorpose"]) == ("trc", __version__)
    assert record["counts"] == {"frames": 20, "rate_hz": 15.0, "recorded_frames": 20, "missing_markers": 0}
    for name, digest in record["sources_sha256"].items():
        assert hashlib.sha256((results / name).read_bytes()).hexdigest() == digest
    assert set(record["sources_sha256"]) == {"joints.parquet", "angles.parquet"}
    assert set(record["files"]) == {"joints.trc", "model.osim", "ik_setup.xml", "scale_setup.xml"}
    for key in ("axes", "units", "time", "missing", "notes"):
        assert record[key]


def test_an_export_is_replaced_only_when_asked_and_one_of_another_format_never(results, refusal):
    assert main(["export", str(results), "--to", "csv"]) == 0
    before = (results / "exports" / "csv" / "joints.csv").read_bytes()
    write_true_results(results, true_joints()[:10])
    assert "--overwrite" in refusal(["export", str(results), "--to", "trc,csv"])
    assert not (results / "exports" / "trc").exists()
    assert (results / "exports" / "csv" / "joints.csv").read_bytes() == before
    assert main(["export", str(results), "--to", "trc"]) == 0
    assert main(["export", str(results), "--to", "csv", "--overwrite"]) == 0
    assert (results / "exports" / "csv" / "joints.csv").read_bytes() != before
    assert (results / "exports" / "trc" / "joints.trc").is_file()


def test_a_record_that_was_spoiled_by_hand_is_refused_in_one_sentence(results, refusal):
    assert main(["export", str(results), "--to", "csv"]) == 0
    (results / "exports" / "csv" / "export.json").write_text('{"files": 3}')
    message = refusal(["export", str(results), "--to", "csv", "--overwrite"])
    assert "export.json" in message
    assert message.count("\n") == 1
    assert (results / "exports" / "csv" / "joints.csv").is_file()


def test_a_folder_that_is_not_ours_is_never_touched(results, tmp_path, capsys):
    (tmp_path / "mine" / "trc").mkdir(parents=True)
    (tmp_path / "mine" / "trc" / "thesis.txt").write_text("years of work")
    assert main(["export", str(results), "--to", "trc", "-o", str(tmp_path / "mine"), "--overwrite"]) == 2
    assert "is not an export" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "mine" / "trc").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_whatever_stops_the_work_leaves_nothing_behind(results, monkeypatch, error):
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setitem(exporting._WRITERS, Format.BVH, fail)
    before = sorted(path.name for path in results.iterdir())
    with pytest.raises(error):
        exporting.export_results(results, [Format.CSV, Format.BVH], ExportConfig())
    assert sorted(path.name for path in results.iterdir()) == before


def test_the_same_results_give_the_same_bytes(results, tmp_path):
    for name in ("a", "b"):
        assert main(["export", str(results), "--to", "trc,mot,csv,bvh,bids", "-o", str(tmp_path / name)]) == 0
    files = [path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()]
    assert len(files) > 15
    assert [f for f in files if (tmp_path / "a" / f).read_bytes() != (tmp_path / "b" / f).read_bytes()] == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--to", "fbx"], "choose from trc, mot, c3d, csv, bvh, bids"),
        (["--to", "bids", "--subject", "Jane Doe"], "letters and digits"),
        (["--to", "bids", "--session", "2026-01-02"], "letters and digits"),
        (["--to", "bids", "--task", ""], "letters and digits"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(results, refusal, options, said):
    message = refusal(["export", str(results), *options])
    assert said in message
    assert message.count("\n") == 1
    assert not (results / "exports").exists()


def test_a_folder_that_is_no_result_or_has_a_damaged_table_is_refused(tmp_path, refusal, results):
    assert "there is no such folder" in refusal(["export", str(tmp_path / "nothing"), "--to", "csv"])
    (tmp_path / "empty").mkdir()
    assert "joints.parquet" in refusal(["export", str(tmp_path / "empty"), "--to", "csv"])
    assert list((tmp_path / "empty").iterdir()) == []
    (results / "contacts.parquet").write_bytes(b"PAR1 broken")
    assert "contacts.parquet" in refusal(["export", str(results), "--to", "csv"])
    assert not (results / "exports").exists()


def test_one_frame_goes_to_csv_and_nowhere_else(tmp_path, refusal):
    results = write_true_results(tmp_path / "results", true_joints()[:1])
    assert main(["export", str(results), "--to", "csv"]) == 0
    for kind in ("trc", "mot", "bvh", "bids"):
        assert "csv" in refusal(["export", str(results), "--to", kind])
