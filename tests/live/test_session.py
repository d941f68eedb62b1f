"""From a source that runs to joints at once and a finished results folder."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from live_builder import Again

from anchorpose.errors import AnchorposeError
from anchorpose.live.first_seconds import LiveOptions, User
from anchorpose.live.session import track_live
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.unfinished import unfinished_results
from anchorpose.simulate.config import clinic, single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig

FPS, SECONDS = 10.0, 4.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    simulate_recording(folder / "out", single(6, seconds=SECONDS, fps=FPS))
    return folder / "out/recording"


class Collecting:
    name = "collecting"

    def __init__(self, enough: int, stop: Event) -> None:
        self.frames, self._enough, self._stop = [], enough, stop

    def send(self, frame):
        self.frames.append(frame)
        if len(self.frames) == self._enough:
            self._stop.set()

    def close(self):
        pass


def run(source, results: Path, stop: Event, output: Collecting, options: LiveOptions | None = None, asked=lambda: None):
    options = options or LiveOptions(config=TrackConfig())
    said = []
    with unfinished_results(results, results.parent / "nothing") as folder:
        summary = track_live([source], folder, options, [output], User(said.append, stop, asked))
    return summary, said


@pytest.mark.slow
def test_frames_are_sent_while_they_happen_and_a_whole_results_folder_is_left(recording, tmp_path):
    stop = Event()
    output = Collecting(30, stop)
    options = LiveOptions(config=TrackConfig(), start_s=4.0, record=tmp_path / "kept")
    summary, said = run(Again(open_recording(recording), FPS), tmp_path / "out", stop, output, options)
    assert summary.count >= 30
    numbers = [frame.frame for frame in output.frames]
    assert numbers == sorted(set(numbers))
    assert np.mean([np.isfinite(frame.joints_m).all() for frame in output.frames]) > 0.9
    joints = read_joints(tmp_path / "out" / JOINTS_FILE)
    assert set(numbers) <= set(joints.frame.tolist())
    for frame in output.frames:
        row = int(np.flatnonzero(joints.frame == frame.frame)[0])
        np.testing.assert_allclose(joints.position_m[row], frame.joints_m, atol=2e-6)
    assert (tmp_path / "out" / "report.html").is_file()
    assert any("Tracking live" in sentence for sentence in said)
    kept = open_recording(tmp_path / "kept")
    assert set(joints.frame.tolist()) <= set(kept.streams[0].frame.tolist())


class Covered(Again):
    """Plays a camera beside another one, named before it, that is covered until ``uncovered`` is set."""

    def __init__(self, recording: Recording, fps: float) -> None:
        super().__init__(recording, fps)
        (front,) = self.cameras
        self.cameras = (replace(front, camera=replace(front.camera, name="covered")), front)
        self.uncovered = Event()

    def images(self, stop):
        for image in super().images(stop):
            grey = image.grey if self.uncovered.is_set() else np.zeros_like(image.grey)
            yield replace(image, number=image.number + 5000, grey=grey)
            yield replace(image, camera=1)


@pytest.mark.slow
def test_a_camera_that_is_covered_in_the_first_seconds_is_left_out_of_the_session(recording, tmp_path, monkeypatch):
    monkeypatch.setattr("anchorpose.live.first_seconds.STEP_S", 0.5)  # a busy machine must catch up, too
    stop = Event()
    output, options = Collecting(5, stop), LiveOptions(config=TrackConfig(), start_s=3.0, record=tmp_path / "kept")
    source = Covered(open_recording(recording), FPS)
    threading.Timer(8.0, source.uncovered.set).start()
    summary, _ = run(source, tmp_path / "out", stop, output, options)
    assert summary.count >= 5
    joints = read_joints(tmp_path / "out" / JOINTS_FILE)
    assert joints.frame.max() < 5000
    notes = json.loads((tmp_path / "out" / "run.json").read_text())["notes"]
    assert any(note.startswith("camera covered was left out: it measured nothing") for note in notes)
    assert [camera.name for camera in open_recording(tmp_path / "kept").cameras] == ["covered", "front"]


class Choosing(Collecting):
    """Asks for nobody known, then for a person in view; stops after some frames of the second patient."""

    def __init__(self, stop: Event) -> None:
        super().__init__(-1, stop)
        self.wishes, self.next = [99], 8

    def send(self, frame):
        super().send(frame)
        of_patient = [one for one in self.frames if one.patient == frame.patient]
        if frame.patient == 2 and len(of_patient) == 8:
            self._stop.set()
        if frame.patient == 1 and len(of_patient) >= self.next and frame.people:
            self.next = len(of_patient) + 40  # asks again where that person could not be told apart
            self.wishes.append(frame.people[0].number)

    def asked(self):
        return self.wishes.pop(0) if self.wishes else None


@pytest.mark.slow
def test_a_therapist_is_made_the_patient_and_the_results_of_both_are_apart(tmp_path, monkeypatch):
    monkeypatch.setattr("anchorpose.live.first_seconds.STEP_S", 0.5)  # a busy machine must catch up, too
    simulate_recording(tmp_path / "out", replace(clinic(61020, SECONDS, FPS), cameras=1, therapists=1))
    stop = Event()
    output, options = Choosing(stop), LiveOptions(config=TrackConfig(), start_s=4.0)
    threading.Timer(400.0, stop.set).start()
    source = Again(open_recording(tmp_path / "out/recording"), FPS)
    _, said = run(source, tmp_path / "results", stop, output, options, output.asked)
    assert "The new patient could not be looked at; the patient is as before." in said  # nobody has number 99
    assert "Looking at the new patient for 4 s." in said
    last, earlier = (read_joints(tmp_path / "results" / name / JOINTS_FILE) for name in ("", "earlier-patient-1"))
    assert earlier.frame.max() < last.frame.min()
    sent = {patient: {one.frame for one in output.frames if one.patient == patient} for patient in (1, 2)}
    assert sent[1] <= set(earlier.frame.tolist())
    assert sent[2] <= set(last.frame.tolist())
    apart_m = np.linalg.norm(np.nanmedian(earlier.position_m[:, 0], 0) - np.nanmedian(last.position_m[:, 0], 0))
    assert apart_m > 0.3  # another person's pelvis
    frame = f"frame {last.frame.min()}"
    for name, sentence in (("", f"until {frame}, another"), ("earlier-patient-1", f"from {frame} on, another")):
        assert sentence in (tmp_path / "results" / name / "run.json").read_text()
        assert (tmp_path / "results" / name / "report.html").is_file()


@pytest.mark.slow
def test_a_camera_that_is_lost_ends_the_run_in_order(recording, tmp_path):
    source = Again(open_recording(recording), FPS)
    source.lose_after = 400
    stop, options = Event(), LiveOptions(config=TrackConfig(), start_s=4.0)
    summary, _ = run(source, tmp_path / "out", stop, Collecting(9999, stop), options)
    assert summary.count > 0
    assert "check its cable" in (tmp_path / "out" / "run.json").read_text()


@pytest.mark.parametrize(("images", "told"), [(0, "check its cable"), (None, "Stopped before")])
def test_without_images_or_before_anybody_is_found_nothing_is_written(tmp_path, recording, images, told):
    source, stop = Again(open_recording(recording), FPS), Event()
    if images is None:
        threading.Timer(0.5, stop.set).start()
    else:
        source.lose_after = images
    with pytest.raises(AnchorposeError, match=told):
        run(source, tmp_path / "out", stop, Collecting(1, stop))
    assert list(tmp_path.iterdir()) == []
