"""What verify says of results and recordings that were changed."""

import json
from pathlib import Path

import pytest
from recording_builder import edit_json, write_recording
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.verify import Fits, add_event, verify


@pytest.fixture
def made(tmp_path) -> tuple[Path, Path]:
    """A results folder and its recording."""
    recording = write_recording(tmp_path / "recording")
    results = write_results(tmp_path / "results", [make_frame(k, k / 15.0, standing_joints()) for k in range(30)])
    inputs = dict(hash_files(input_files(open_recording(recording)), recording))
    edit_json(results / RUN_FILE, lambda run: run.update(inputs_sha256=inputs))
    add_event(results, "track", (RUN_FILE,))
    return results, recording


def test_one_byte_of_a_table_or_of_a_depth_image_is_noticed(made, capsys):
    results, recording = made
    image = sorted((recording / "front" / "depth").iterdir())[1]
    write_recording(recording.parent / "other", frames=5)
    other = sorted((recording.parent / "other" / "front" / "depth").iterdir())[4]
    image.write_bytes(other.read_bytes())
    table = results / "joints.parquet"
    table.write_bytes(table.read_bytes()[:-1] + b"?")
    found = verify(results, recording)
    assert found.results["joints.parquet"] is Fits.CHANGED
    assert [name for name, fits in found.recording.items() if not fits.is_right] == ["front/depth/000001.png"]
    assert main(["verify", str(results), str(recording)]) == 1
    assert "front/depth/000001.png: changed" in capsys.readouterr().out


def test_missing_and_added_files_are_named(made):
    results, recording = made
    (results / "joints.parquet").rename(results / "mine.parquet")
    images = sorted((recording / "front" / "depth").iterdir())
    images[-1].rename(images[-1].with_name("000099.png"))
    stamps = recording / "front" / "timestamps.csv"
    stamps.write_text(stamps.read_text().replace(f"\n{int(images[-1].stem)},", "\n99,"))
    found = verify(results, recording)
    assert found.results["joints.parquet"] is Fits.MISSING
    assert found.results["mine.parquet"] is Fits.ADDED
    assert found.recording["front/depth/000003.png"] is Fits.MISSING
    assert found.recording["front/depth/000099.png"] is Fits.ADDED


def test_who_corrected_what_and_what_no_longer_fits_is_said(made):
    results, _ = made
    joint = {"joint": "KneeLeft", "time_s": 0.1, "position_m": [0.0, 0.5, 0.0], "sigma_m": 0.02, "reason": "seen"}
    joint |= {"who": "AB", "when": "2026-03-04T10:00:00+00:00"}
    given = {"file": "c.json", "sha256": "0" * 64, "patient": None, "unusable": []}
    given["joints"] = [joint | {"frame": frame} for frame in (2, 3)]

    def change(run):
        run["corrections"] = given
        run["versions"] = dict(run["versions"], numpy="0.1")
        run["code"] = "f" * 64

    edit_json(results / RUN_FILE, change)
    found = verify(results, None)
    assert found.corrected == ("AB corrected 2 joints on 2026-03-04",)
    assert found.program[0].startswith("the program's code is not")
    assert any(sentence.startswith("numpy was 0.1") for sentence in found.program)


def test_results_without_hashes_are_refused(made):
    results, _ = made
    edit_json(results / RUN_FILE, lambda run: run.pop("outputs_sha256"))
    with pytest.raises(InputError, match="older version"):
        verify(results, None)
    assert json.loads((results / RUN_FILE).read_text())["format"] == "anchorpose-run"
