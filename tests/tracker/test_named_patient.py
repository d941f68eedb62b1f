"""A patient who was named in the viewer is tracked, in the world of the results that were looked at."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from viewer_builder import write_small_recording, write_small_results

from anchorpose.calibration.calibration import PoseSource
from anchorpose.calibration.clocks import ClockConfig, clock_notes, clocks_of_results
from anchorpose.errors import InputError
from anchorpose.isolation.people import Person
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.pipeline import track_recording
from anchorpose.recording.recording import Clock
from anchorpose.results.corrections import (
    Corrections,
    NamedPatient,
    UnusableInterval,
    read_corrections,
    write_corrections,
)
from anchorpose.results.reviewed_recording import recording_of_run
from anchorpose.results.run_record import read_run
from anchorpose.results.tables import read_joints
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.write import simulate_recording
from anchorpose.track_inputs import TrackInputs, UserInputs, read_inputs
from anchorpose.tracker import preparation
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import settle
from anchorpose.tracker.room import NO_REVIEW
from anchorpose.tracker.sighting import SeenPerson, Sighting
from anchorpose.viewer.depth_frames import open_depth_frames

SIGNED = {"reason": "the therapist", "who": "AB", "when": "2026-03-01T09:30:00Z"}
PELVIS = JOINT_INDEX["SpineBase"]
FRAME = 6
NEAR_M = 0.3  # over the ground, from the mean of the seen surface to the pelvis of a person who walks
PASSED = SimulationConfig(seed=12, seconds=2.0, fps=5.0, cameras=1, therapists=0, passers_by=1, equipment="none")
PASSED = replace(PASSED, motions=("standing",), stool=False, pose_known=False)


def named(frame: int, place_m: np.ndarray, fps: float = 15.0) -> NamedPatient:
    return NamedPatient(frame=frame, time_s=frame / fps, position_m=tuple(map(float, place_m)), **SIGNED)


@dataclass(frozen=True, slots=True)
class Reviewed:
    """A small recording, and a file of corrections that names a patient in it."""

    recording: Path
    file: Path

    def read(self, config: TrackConfig | None = None) -> TrackInputs:
        return read_inputs(self.recording, config or TrackConfig(), UserInputs(corrections=self.file))


@pytest.fixture
def reviewed(tmp_path: Path) -> Reviewed:
    recording = write_small_recording(tmp_path / "recording")
    run = read_run(write_small_results(tmp_path / "results", recording) / "run.json")
    file = tmp_path / "c.json"
    write_corrections(file, Corrections(recording_of_run(run)).added(named(7, np.array([0.12, 1.0, -0.31]))))
    return Reviewed(recording, file)


def without_poses(recording: Path) -> None:
    document = json.loads((recording / "recording.json").read_text())
    for camera in document["cameras"]:
        camera["camera_to_world"] = None
    (recording / "recording.json").write_text(json.dumps(document))


def test_the_named_patient_is_as_one_of_the_command_line(reviewed: Reviewed) -> None:
    found = reviewed.read()
    assert (found.config.patient_xz_m, found.config.patient_frame) == ((0.12, -0.31), 7)
    assert found.pose_source is None
    same = replace(TrackConfig(), patient_xz_m=(0.12, -0.31), patient_frame=7)
    assert reviewed.read(same).config == found.config


@pytest.mark.parametrize(("place", "frame"), [((0.5, -0.31), 7), ((0.12, -0.31), 8), ((0.12, -0.31), None)])
def test_another_patient_on_the_command_line_is_refused(
    reviewed: Reviewed, place: tuple[float, float], frame: int | None
) -> None:
    config = replace(TrackConfig(), patient_xz_m=place, patient_frame=frame)
    with pytest.raises(InputError, match=r"c\.json: names the patient at 0\.12,-0\.31@7, and --patient names"):
        reviewed.read(config)


def test_a_frame_that_there_is_not_or_that_is_unusable_is_refused(reviewed: Reviewed) -> None:
    held = read_corrections(reviewed.file)
    write_corrections(reviewed.file, held.added(named(99, np.zeros(3))))
    with pytest.raises(InputError, match="names the patient in frame 99, which the recording does not have"):
        reviewed.read()
    gap = UnusableInterval(first_frame=5, last_frame=7, start_s=5 / 15, end_s=7 / 15, **SIGNED)
    write_corrections(reviewed.file, held.added(gap))
    with pytest.raises(InputError, match="in frame 7, which it marks as unusable; name the patient in another"):
        reviewed.read()


def test_a_time_that_is_not_of_its_frame_is_refused(reviewed: Reviewed) -> None:
    held = read_corrections(reviewed.file)
    write_corrections(reviewed.file, held.added(replace(named(7, np.zeros(3)), time_s=1.4)))
    with pytest.raises(
        InputError, match=r"the patient in frame 7 at 1\.4 s, but the recording has that frame at 0\.46"
    ):
        reviewed.read()
    gap = UnusableInterval(first_frame=5, last_frame=6, start_s=5 / 15, end_s=99.0, **SIGNED)
    write_corrections(reviewed.file, held.added(gap))
    with pytest.raises(InputError, match=r"frame 6 at 99 s"):
        reviewed.read()


def test_poses_that_the_recording_lacks_are_those_of_the_corrected_results(reviewed: Reviewed) -> None:
    given = reviewed.read().recording.cameras
    without_poses(reviewed.recording)
    found = reviewed.read()
    assert found.pose_source is PoseSource.RESULTS
    for camera, before in zip(found.recording.cameras, given, strict=True):
        np.testing.assert_array_equal(camera.require_pose(), before.require_pose())


def test_clocks_and_floor_are_those_of_the_corrected_results(reviewed: Reviewed) -> None:
    held = read_corrections(reviewed.file)
    known = {"front": Clock(), "right": Clock(ahead_s=0.02, at_s=1.0)}
    cameras = tuple(replace(camera, clock=known[camera.name]) for camera in held.recording.cameras)
    recording = replace(held.recording, cameras=cameras, floor_height_m=0.03)
    write_corrections(reviewed.file, replace(held, recording=recording))
    found = reviewed.read()
    settled = settle(found.recording, found.config, found.review)
    assert settled.clocks.clocks == tuple(known.values())
    assert settled.calibration.floor_height_m == 0.03
    assert clock_notes(settled.clocks) == ("the clock of camera right was corrected as in the corrected results",)
    kept = clock_notes(clocks_of_results(found.recording.cameras, {"right": Clock()}))
    assert kept == ("the clock of camera right was used as it is, as in the corrected results",)
    front, right = (stream.time_s for stream in settled.recording.streams)
    np.testing.assert_allclose(right, front - 0.02, atol=1e-9)
    as_stamped = replace(found.config, clocks=ClockConfig(estimate=False))
    front, right = (stream.time_s for stream in settle(found.recording, as_stamped, found.review).recording.streams)
    np.testing.assert_array_equal(right, front)


def test_poses_that_the_recording_has_must_be_the_same(reviewed: Reviewed) -> None:
    held = read_corrections(reviewed.file)
    cameras = tuple(
        replace(camera, camera_to_world=camera.camera_to_world + np.eye(4, k=3) * 0.01)
        for camera in held.recording.cameras
        if camera.camera_to_world is not None
    )
    write_corrections(reviewed.file, replace(held, recording=replace(held.recording, cameras=cameras)))
    with pytest.raises(InputError, match="another world"):
        reviewed.read()


def test_who_is_named_plays_no_part_in_finding_the_world(reviewed: Reviewed, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[TrackConfig]()
    monkeypatch.setattr(preparation, "furnish_room", lambda settled, config, review: asked.append(config))
    monkeypatch.setattr(preparation, "heading_of_patient", lambda *_: None)
    monkeypatch.setattr(preparation, "find_world", lambda *given: given[4](given[0].cameras, 0.0, ()))
    found = reviewed.read()
    assert found.config.patient_frame == 7
    preparation.calibrate(found.recording, (), found.config)
    assert [(config.patient_xz_m, config.patient_frame) for config in asked] == [(None, None)]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A recording of 40 frames, numbered from 100, in which the same person stands at one place."""

    def seen(position: int, scenes: tuple) -> Sighting:
        return Sighting(100 + position, (SeenPerson(Person(np.zeros(2), 0.0, 1.7, 0.6), None),), (None,))

    monkeypatch.setattr(preparation, "read_frame", lambda _, position: position)
    monkeypatch.setattr(preparation, "without_other_places", lambda position, _: position)
    monkeypatch.setattr(preparation, "sight_people", seen)
    stream = SimpleNamespace(files=range(40), frame=np.arange(100, 140))
    return SimpleNamespace(folder=Path("monday"), streams=(stream,))


@pytest.mark.parametrize(("start", "stop", "count"), [(0, None, 13), (20, None, 7), (0, 21, 7), (18, 23, 5)])
def test_tracking_of_a_part_begins_within_this_part(
    alone: SimpleNamespace, start: int, stop: int | None, count: int
) -> None:
    """Of the 13 frames around the named frame, some lie outside of the tracked range."""
    config = TrackConfig(start=start, stop=stop, patient_xz_m=(0.0, 0.0), patient_frame=120)
    found = preparation._frames_of_named(alone, (), config, 120, NO_REVIEW)
    assert len(found) == count
    assert {one.frame for one in found} <= set(range(40)[start:stop])


@pytest.mark.parametrize(("start", "stop"), [(21, None), (0, 20)])
def test_a_place_in_a_frame_that_is_not_tracked_is_refused(
    alone: SimpleNamespace, start: int, stop: int | None
) -> None:
    config = TrackConfig(start=start, stop=stop, patient_xz_m=(0.0, 0.0), patient_frame=120)
    first, last = 100 + start, 99 + (stop or 40)
    with pytest.raises(InputError, match=f"from frame {first} to {last}, but .* in frame 120; give a frame of this"):
        preparation._frames_of_named(alone, (), config, 120, NO_REVIEW)


@pytest.mark.slow
def test_who_is_named_is_tracked_and_the_world_stays(tmp_path: Path) -> None:
    simulate_recording(tmp_path / "out", PASSED)
    recording, first, second = tmp_path / "out/recording", tmp_path / "first", tmp_path / "second"
    for results in (first, second):
        results.mkdir()
    track_recording(recording, first, TrackConfig(), lambda *_: None)
    run, before = read_run(first / "run.json"), read_joints(first / "joints.parquet")
    frames = open_depth_frames(recording, first, run, before.frame)
    walker = frames.labels(FRAME, 0) == PixelLabel.OTHER_PERSON
    row, column = middle_of(walker)
    place_m, _ = frames.place_of_person(FRAME, "front", column, row)
    seen_m = np.mean([frames.place_of_person(FRAME, "front", k, r)[0] for r, k in np.argwhere(walker)[::100]], axis=0)
    assert ground_m(before.position_m[FRAME, PELVIS], seen_m) > NEAR_M
    file = tmp_path / "c.json"
    write_corrections(file, Corrections(recording_of_run(run)).added(named(FRAME, place_m, PASSED.fps)))

    track_recording(recording, second, TrackConfig(), lambda *_: None, corrections=file)
    again, after = read_run(second / "run.json"), read_joints(second / "joints.parquet")
    assert not after.lost[:, PELVIS].any()
    assert ground_m(after.position_m[FRAME, PELVIS], seen_m) < NEAR_M
    assert again["corrections"]["patient"]["who"] == "AB"
    assert "was at the given place in frame 6" in again["patient"]["reason"]
    assert ground_m(np.insert(again["patient"]["xz_m"], 1, 0.0), place_m) < 1.0  # of a frame nearby
    assert again["cameras"][0]["source"] == "those of the corrected results"
    assert again["floor_height_m"] == run["floor_height_m"]
    assert again["cameras"][0]["camera_to_world"] == run["cameras"][0]["camera_to_world"]


def middle_of(mask: np.ndarray) -> tuple[int, int]:
    """Row and column of the pixel in the middle of a mask, by rows and then by columns."""
    row = int(np.median(np.nonzero(mask.any(axis=1))[0]))
    columns = np.nonzero(mask[row])[0]
    return row, int(columns[len(columns) // 2])


def ground_m(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a[[0, 2]] - b[[0, 2]]))
