"""``anchorpose calibrate``, its file and ``track --calibration``: what is written, what is refused."""

import json

import cv2
import numpy as np
import pytest
from recording_builder import camera_entry, edit_json, write_recording

from anchorpose.calibration.calibration import (
    Calibration,
    PoseFigure,
    PoseRecord,
    PoseSource,
    calibration_rows,
    write_calibration,
)
from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import read_calibration, with_poses
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.write import simulate_recording


def calibration_of(recording, names=None) -> Calibration:
    cameras = tuple(camera for camera in recording.cameras if names is None or camera.name in names)
    figures = (PoseFigure("rms of the surface", 0.0012, "m"), PoseFigure("rms of the outline", 0.4, "px"))
    poses = tuple(PoseRecord(camera.name, PoseSource.EQUIPMENT, 0.002, 0.001, figures) for camera in cameras)
    return Calibration(cameras, 0.0, (), ("a note",), poses)


def test_a_calibration_file_is_read_as_it_was_written(tmp_path):
    recording = open_recording(write_recording(tmp_path / "r", cameras=("front", "left")))
    write_calibration(tmp_path, "r", calibration_of(recording))
    poses = read_calibration(tmp_path)  # its folder is enough
    assert list(poses) == ["front", "left"]
    np.testing.assert_array_equal(poses["left"], recording.cameras[1].T_world_camera)
    entry = json.loads((tmp_path / "calibration.json").read_text())["cameras"][0]
    assert entry["sigma_deg"] == pytest.approx(np.degrees(0.001))
    assert entry["method"] == "found from the equipment"
    row = calibration_rows(calibration_of(recording))[0]
    assert row == ("front", "found from the equipment", "2.0", "0.06", "1.2", "0.40")


def test_poses_of_a_file_replace_those_of_the_recording(tmp_path):
    recording = open_recording(write_recording(tmp_path / "r"))
    write_calibration(tmp_path, "r", calibration_of(recording))
    edit_json(tmp_path / "r" / "recording.json", lambda d: d["cameras"][0].update(camera_to_world=None))
    posed = with_poses(open_recording(tmp_path / "r"), tmp_path / "calibration.json")
    np.testing.assert_array_equal(posed.cameras[0].T_world_camera, camera_entry("front")["camera_to_world"])


def test_a_file_without_one_of_the_cameras_is_refused(tmp_path):
    recording = open_recording(write_recording(tmp_path / "r", cameras=("front", "left")))
    write_calibration(tmp_path, "r", calibration_of(recording, {"front"}))
    with pytest.raises(InputError, match="has no pose for camera left"):
        with_poses(recording, tmp_path / "calibration.json")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda d: d.update(format="rgbd-recording"), "format"),
        (lambda d: d["cameras"][0]["camera_to_world"][0].__setitem__(0, 3.0), "not a rigid motion"),
        (lambda d: d["cameras"].append(d["cameras"][0]), "twice"),
    ],
)
def test_a_damaged_calibration_file_is_refused(tmp_path, change, problem):
    recording = open_recording(write_recording(tmp_path / "r"))
    write_calibration(tmp_path, "r", calibration_of(recording))
    edit_json(tmp_path / "calibration.json", change)
    with pytest.raises(InputError, match=problem):
        read_calibration(tmp_path / "calibration.json")


def test_a_recording_without_its_equipment_is_refused_and_nothing_is_written(tmp_path, refusal):
    recording = write_recording(tmp_path / "r")
    edit_json(recording / "recording.json", lambda d: d["cameras"][0].update(camera_to_world=None))
    before = sorted(path.name for path in recording.rglob("*"))
    assert "camera_to_world is null for front" in refusal(["calibrate", str(recording)])
    assert {path.name for path in tmp_path.iterdir()} == {"r"}
    assert sorted(path.name for path in recording.rglob("*")) == before


@pytest.mark.slow
def test_a_clinic_is_calibrated_from_the_command_line(tmp_path, capsys):
    config = SimulationConfig(seed=33, seconds=1.0, fps=8.0, cameras=2, therapists=1, pose_known=False)
    simulate_recording(tmp_path / "s", config)
    assert main(["calibrate", str(tmp_path / "s/recording"), "-o", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"calibration.json", "front.png", "left.png"}
    picture = cv2.imread(str(tmp_path / "out/front.png"))
    coloured = (np.ptp(picture.astype(int), axis=2) > 90).sum()
    assert coloured > 2000  # the outline of each part of the equipment; the depth image is grey or dark blue
    with np.load(tmp_path / "s/truth/truth.npz") as truth:
        poses = read_calibration(tmp_path / "out")
        for name, true in zip(truth["camera_names"], truth["T_world_camera"], strict=True):
            assert np.abs(poses[str(name)] - true).max() < 0.01
    assert "look at its pictures" in capsys.readouterr().out
    assert main(["calibrate", str(tmp_path / "s/recording"), "-o", str(tmp_path / "out")]) == 2


@pytest.mark.slow
def test_a_given_pose_that_the_floor_contradicts_is_noted_or_refused_as_by_track(tmp_path, refusal):
    """A pose tilted by 25 degrees was written without a word."""
    simulate_recording(tmp_path / "s", SimulationConfig(seed=33, seconds=1.0, fps=8.0, equipment="none"))
    recording = tmp_path / "s/recording"
    true = np.array(json.loads((recording / "recording.json").read_text())["cameras"][0]["camera_to_world"])

    def tilted(degrees: float) -> None:
        T = true.copy()
        T[:3, :3] = cv2.Rodrigues(np.radians([0.0, 0.0, degrees]))[0] @ T[:3, :3]
        edit_json(recording / "recording.json", lambda d: d["cameras"][0].update(camera_to_world=T.tolist()))

    tilted(25.0)
    command = ["calibrate", str(recording), "-o", str(tmp_path / "out")]
    assert "the floor that camera front sees is tilted by 2" in refusal(command)
    assert not (tmp_path / "out").exists()
    tilted(3.0)
    assert main(command) == 0
    notes = json.loads((tmp_path / "out/calibration.json").read_text())["notes"]
    assert any("is tilted by 3" in note and "the given pose is used" in note for note in notes)
