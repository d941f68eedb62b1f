"""What the images contradict or do not show: an impossible height, and a camera that is blind for a while."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from recording_builder import edit_json

from anchorpose.pipeline import track_recording
from anchorpose.recording.recording import FrameSet
from anchorpose.results.run_record import read_run
from anchorpose.results.tables import JointTable, read_joints
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import displaced, nobody_found

BLIND = range(14, 22)


def tracked(folder: Path, recording: Path) -> tuple[JointTable, list[str]]:
    folder.mkdir()
    track_recording(recording, folder, TrackConfig(), lambda done, of: None)
    return read_joints(folder / "joints.parquet"), read_run(folder / "run.json")["notes"]


@pytest.fixture
def simulated(tmp_path) -> tuple[Path, np.ndarray]:
    """A recording of one camera and the true joints (t, 21, 3)."""
    simulate_recording(tmp_path / "s", single(905, seconds=2.0))
    with np.load(tmp_path / "s" / "truth" / "truth.npz") as truth:
        return tmp_path / "s" / "recording", truth["joints"]


@pytest.mark.slow
def test_joints_in_blind_frames_are_hidden_and_their_sigma_covers_the_error(simulated, tmp_path):
    recording, true_m = simulated
    for frame in BLIND:
        path = recording / "front" / "depth" / f"{frame:06d}.png"
        cv2.imwrite(str(path), np.zeros_like(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    joints, _ = tracked(tmp_path / "results", recording)
    rows = np.array(BLIND)
    assert not (joints.state_code[rows] == 0).any()  # none is called observed
    off_m = np.abs(joints.position_m[rows] - true_m[rows])
    known = np.isfinite(off_m)
    assert (off_m <= 1.96 * joints.sigma_m[rows][..., None])[known].mean() > 0.9
    assert joints.sigma_m[BLIND[-1]].mean() > 2.0 * joints.sigma_m[BLIND[0]].mean()
    seen_again = np.linalg.norm(joints.position_m[BLIND[-1] + 2 :] - true_m[BLIND[-1] + 2 :], axis=2)
    assert seen_again.mean() < 0.015


@pytest.mark.slow
def test_an_impossible_height_is_noted_and_not_used(simulated, tmp_path):
    recording, true_m = simulated
    edit_json(recording / "recording.json", lambda document: document.update(subject={"height_m": 0.5}))
    joints, notes = tracked(tmp_path / "results", recording)
    assert any("the stated height of the patient (0.50 m tall) contradicts the images" in note for note in notes)
    assert np.linalg.norm(joints.position_m - true_m, axis=2).mean() < 0.015


def test_a_known_displacement_is_part_of_every_sigma():
    found = replace(nobody_found(FrameSet(frame=0, time_s=0.0, depths_m=(None,)), ""), sigma_m=np.full(21, 0.008))
    assert displaced(found, 0.0) is found
    assert displaced(found, 0.03).sigma_m == pytest.approx(np.full(21, np.hypot(0.008, 0.03 / np.sqrt(3.0))))
