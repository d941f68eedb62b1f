"""From a recording folder to a results folder, end to end."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from recording_builder import DATA

from anchorpose.body.config import LearningConfig
from anchorpose.body.kinematics import shape_body
from anchorpose.body.segments import load_body_asset
from anchorpose.body.shape_prior import adult_belief, standing_height
from anchorpose.body.skin_points import FittedShape, even_clothes
from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX, LIMBS, STATE_CODE, JointState
from anchorpose.pipeline import track_recording
from anchorpose.recording.recording import UNKNOWN
from anchorpose.results.explained import SEEN_PAST, UNCOVERED_CM2, read_explained
from anchorpose.results.records import decode_labels, read_people
from anchorpose.results.tables import JointTable, pose_of, read_anchors, read_joints, read_poses
from anchorpose.simulate.config import SimulationConfig, clinic, single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker import room as running
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.learning_pass import OtherFacing
from anchorpose.writing import _notes, _unknown_height

FRAMES, FPS, DAMAGED = 9, 8.0, 5
NAMES = "axes anchors angles contacts episodes explained joints measures people poses posture"
TABLES = [f"{name}.parquet" for name in NAMES.split()]
AGAIN = (
    "import sys; from pathlib import Path; from anchorpose.pipeline import TrackConfig, track_recording; "
    "track_recording(Path(sys.argv[1]), Path(sys.argv[2]), TrackConfig(), lambda done, total: None)"
)


def silent(done: int, total: int) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A tracked recording: its folders, run.json, joints, truth (t, 21, 3), and what progress was told."""

    results: Path
    document: dict
    joints: JointTable
    truth_m: np.ndarray
    told: list[tuple[int, int]]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    folder = tmp_path_factory.mktemp("pipeline")
    simulate_recording(folder / "out", single(5, seconds=FRAMES / FPS, fps=FPS))
    damaged = folder / f"out/recording/front/depth/{DAMAGED:06d}.png"
    damaged.write_bytes(damaged.read_bytes()[:2000])
    results, told = folder / "results", list[tuple[int, int]]()
    results.mkdir()
    track_recording(folder / "out/recording", results, TrackConfig(), lambda *progress: told.append(progress))
    with np.load(folder / "out/truth/truth.npz") as truth:
        truth_m = truth["joints"]
    document = json.loads((results / "run.json").read_text())
    return Run(results, document, read_joints(results / "joints.parquet"), truth_m, told)


def errors_m(joints: JointTable, truth_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(joints.position_m - truth_m, axis=2)


def test_joints_are_close_to_the_truth(run):
    sound = np.arange(FRAMES) != DAMAGED
    errors = errors_m(run.joints, run.truth_m)[sound]
    # a body learnt from 1 s of one camera through 9 mm of clothes: 7 to 8 mm over three seeds, twice that is a fault
    assert np.isfinite(errors).all()
    assert errors.mean() < 0.016
    assert np.percentile(errors, 95) < 0.035


def test_most_joints_lie_within_their_sigma(run):
    off = np.abs(run.joints.position_m - run.truth_m)
    assert np.mean(off <= 1.96 * run.joints.sigma_m[..., None]) > 0.85  # 0.95 is meant, over many bodies


def test_every_frame_is_in_the_tables(run):
    np.testing.assert_array_equal(run.joints.frame, np.arange(FRAMES))
    np.testing.assert_allclose(run.joints.time_s, np.arange(FRAMES) / FPS, atol=1e-6)
    files = {path.name for path in run.results.iterdir() if path.is_file()}
    assert files == {*TABLES, ".log.jsonl.lock", "log.jsonl", "report.html", "run.json"}


def test_a_damaged_picture_is_counted_and_the_rest_tracked(run):
    (dropped,) = run.document["dropped"]
    assert dropped["frame"] == DAMAGED
    assert f"front/depth/{DAMAGED:06d}.png" in dropped["why"]
    assert dropped["time_s"] == pytest.approx(DAMAGED / FPS)
    observed = (run.joints.state_code == STATE_CODE[JointState.OBSERVED]).sum(axis=1)
    assert observed[DAMAGED] == 0
    assert np.delete(observed, DAMAGED).min() > 14
    beside = run.joints.sigma_m[[DAMAGED - 1, DAMAGED + 1]].min(axis=0)
    assert (run.joints.sigma_m[DAMAGED] > 2.0 * beside).all()


def test_a_well_tracked_person_is_explained_in_every_frame_that_shows_one(run):
    table = read_explained(run.results / "explained.parquet")
    np.testing.assert_array_equal(table.frame, run.joints.frame)
    np.testing.assert_array_equal(np.isnan(table.uncovered_cm2), table.frame == DAMAGED)
    assert np.nanmax(table.uncovered_cm2) < UNCOVERED_CM2
    assert np.nanmax(table.seen_past) < SEEN_PAST
    summary = run.document["explained"]
    assert (summary["known_frames"], summary["uncovered_share"], summary["worst"]) == (FRAMES - 1, 0.0, [])


def test_bones_keep_their_length_over_the_whole_recording(run):
    start, end = np.array([pair for pair in LIMBS if min(pair) > JOINT_INDEX["Neck"]]).T
    length = np.linalg.norm(run.joints.position_m[:, start] - run.joints.position_m[:, end], axis=2)
    assert np.ptp(length, axis=0).max() < 1e-6
    assert length.min() > 0.02
    assert length.max() < 0.6


def test_angles_are_those_of_a_person(run):
    rows = pq.read_table(run.results / "angles.parquet").to_pylist()
    bends = [row for row in rows if row["angle"].startswith(("knee_flexion", "elbow_flexion"))]
    assert len(bends) == 4 * FRAMES
    assert all(-10.0 < row["degrees"] < 160.0 for row in bends)


def test_the_pose_of_every_frame_gives_its_joints(run):
    table, asset = read_poses(run.results / "poses.parquet"), load_body_asset()
    body = shape_body(asset, np.array(run.document["body"]["coefficients"]))
    np.testing.assert_array_equal(table.frame, run.joints.frame)
    for row, joints_m in enumerate(run.joints.position_m):
        pose = pose_of(asset, table.head_m[row], table.quaternion[row])
        np.testing.assert_allclose(body.joints(body.bone_transforms(pose.rotations, pose.root_m)), joints_m, atol=1e-5)
    assert (table.axial_sigma_rad > 0).all()


def test_anchors_and_labels_are_of_the_same_patient(run):
    anchors, people = read_anchors(run.results / "anchors.parquet"), read_people(run.results / "people.parquet")
    head = np.linalg.norm(anchors.position_m[:, 0] - run.joints.position_m[:, JOINT_INDEX["Head"]], axis=1)
    assert np.nanmax(head) < 0.3
    for frame in run.joints.frame.tolist():
        if frame == DAMAGED:
            assert (frame, "front") not in people
        else:
            assert (decode_labels(people[frame, "front"]) == PixelLabel.PATIENT).sum() > 5000


@pytest.mark.slow
def test_another_process_gives_the_same_bytes(run, tmp_path):
    command = [sys.executable, "-c", AGAIN, str(run.results.parent / "out/recording"), str(tmp_path)]
    environment = {**os.environ, "PYTHONHASHSEED": "7", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    subprocess.run(command, env=environment, check=True, timeout=300)
    for name in TABLES:
        assert (tmp_path / name).read_bytes() == (run.results / name).read_bytes(), name


def test_the_record_says_with_what_and_from_what(run):
    document = run.document
    assert document["frame_count"] == FRAMES
    (camera,) = document["cameras"]
    assert camera["name"] == "front"
    assert camera["source"] == "given"
    recorded = json.loads((run.results.parent / "out/recording/recording.json").read_text())
    np.testing.assert_allclose(camera["camera_to_world"], recorded["cameras"][0]["camera_to_world"])
    assert document["config"]["method"] == "articulated"
    stages = {"surface", "anchors", "tree", "registration", "learning", "follow"}
    assert stages <= document["config"].keys()
    assert {"recording.json", "front/background.png", "front/depth/000000.png"} <= document["inputs_sha256"].keys()
    stages = {timing["stage"]: timing["seconds"] for timing in document["timings"]}
    assert {"calibration and background", "isolation", "first pose", "body shape", "registration"} <= stages.keys()
    assert all(seconds >= 0.0 for seconds in stages.values())
    assert any("clothes" in note for note in document["notes"])


def test_run_json_has_the_body_and_its_bones_are_those_of_every_frame(run):
    body = run.document["body"]
    assert 1.4 < body["height_m"] < 2.1
    assert 0.0 < body["height_sigma_m"] < 0.05
    thigh = next(bone for bone in body["bones"] if bone["bone"] == "thigh_left")
    assert 0.0 < thigh["sigma_m"] < 0.03
    hip, knee = (run.joints.position_m[:, JOINT_INDEX[name]] for name in ("HipLeft", "KneeLeft"))
    np.testing.assert_allclose(np.linalg.norm(hip - knee, axis=1), thigh["length_m"], atol=1e-6)


@pytest.fixture(scope="module")
def empty_room(tmp_path_factory) -> Path:
    """A recording in which nobody is ever seen."""
    out = tmp_path_factory.mktemp("empty") / "out"
    simulate_recording(out, single(6, seconds=4 / FPS, fps=FPS))
    front = out / "recording/front"
    for picture in (front / "depth").iterdir():
        shutil.copy(front / "background.png", picture)
    return out / "recording"


def test_a_recording_without_anybody_is_lost_from_end_to_end_and_says_so(empty_room, tmp_path):
    track_recording(empty_room, tmp_path, TrackConfig(), silent)
    joints = read_joints(tmp_path / "joints.parquet")
    assert (joints.state_code == STATE_CODE[JointState.LOST]).all()
    assert np.isnan(joints.position_m).all()
    document = json.loads((tmp_path / "run.json").read_text())
    assert document["frame_count"] == 4
    assert document["explained"]["uncovered_share"] is None
    assert np.isnan(read_explained(tmp_path / "explained.parquet").seen_past).all()
    assert any("nobody was seen" in note for note in document["notes"])
    assert "camera front, empty room: the given picture of the empty room" in document["notes"]
    assert document["pictures"] == []


def test_a_part_of_a_recording_keeps_its_frame_numbers_and_one_without_frames_is_refused(empty_room, tmp_path):
    with pytest.raises(InputError, match="has no frames"):
        track_recording(empty_room, tmp_path, TrackConfig(start=99), silent)
    assert list(tmp_path.iterdir()) == []
    track_recording(empty_room, tmp_path, TrackConfig(start=1, stop=3), silent)
    joints = read_joints(tmp_path / "joints.parquet")
    np.testing.assert_array_equal(joints.frame, [1, 2])
    np.testing.assert_allclose(joints.time_s, [1 / FPS, 2 / FPS], atol=1e-6)


@pytest.mark.thorough
def test_smoothing_is_recorded_and_gives_every_frame_in_order(run, tmp_path):
    told = list[tuple[int, int]]()
    recording = run.results.parent / "out/recording"
    track_recording(recording, tmp_path, TrackConfig(smooth=True), lambda *progress: told.append(progress))
    joints = read_joints(tmp_path / "joints.parquet")
    np.testing.assert_array_equal(joints.frame, np.arange(FRAMES))
    assert told[-1][0] == told[-1][1] > run.told[-1][1]
    document = json.loads((tmp_path / "run.json").read_text())
    assert document["config"]["smooth"]
    assert not run.document["config"]["smooth"]
    assert document["pictures"]  # of which frames depends on where the smoothed joints are least certain
    explained, first = (read_explained(folder / "explained.parquet") for folder in (tmp_path, run.results))
    np.testing.assert_array_equal(np.isnan(explained.uncovered_cm2), np.isnan(first.uncovered_cm2))
    assert not np.array_equal(explained.seen_past, first.seen_past, equal_nan=True)  # another pose, another explanation
    assert np.nanmax(np.abs(explained.seen_past - first.seen_past)) < 0.1
    assert np.nanmean(errors_m(joints, run.truth_m)) < 1.1 * np.nanmean(errors_m(run.joints, run.truth_m))
    jitter, before = (np.diff(table.position_m, 2, axis=0) for table in (joints, run.joints))
    assert np.abs(jitter).mean() < np.abs(before).mean()


def tracked(folder: Path, config: SimulationConfig) -> tuple[JointTable, np.ndarray]:
    simulate_recording(folder / "out", config)
    (folder / "results").mkdir()
    track_recording(folder / "out/recording", folder / "results", TrackConfig(), silent)
    with np.load(folder / "out/truth/truth.npz") as truth:
        return read_joints(folder / "results/joints.parquet"), truth["joints"]


@pytest.mark.slow
def test_three_cameras_see_through_a_frame_and_therapists(tmp_path):
    joints, truth_m = tracked(tmp_path, clinic(21, seconds=3.0, fps=15.0))
    errors = errors_m(joints, truth_m)
    assert np.isnan(errors).mean() < 0.05
    assert np.nanmean(errors) < 0.05  # 11 to 34 mm on two seeds: an arm may be lost for some frames


@pytest.mark.slow
@pytest.mark.parametrize(("sample", "bound_m"), [("sample_holes", 0.03), ("sample_clinic", 0.04)])
def test_the_sample_recordings_are_tracked(sample, bound_m, tmp_path):
    folder = DATA / sample
    if not folder.exists():
        pytest.skip(f"{sample} is not beside the project")
    recording = folder / "recording" if (folder / "recording").is_dir() else folder
    track_recording(recording, tmp_path, TrackConfig(), silent)
    with np.load(folder / "truth/truth.npz") as truth:
        errors = errors_m(read_joints(tmp_path / "joints.parquet"), truth["joints"])
    assert np.isnan(errors).mean() < 0.02
    assert np.nanmean(errors) < bound_m


def room_of_patient(frame: int) -> SimpleNamespace:
    """A room of frames numbered from 1000, in which the patient was found at the position ``frame``."""
    choice = SimpleNamespace(ground_xz_m=np.array([0.0, 1.0]), reason="is alone", rival_xz_m=None)
    recording = SimpleNamespace(subject=UNKNOWN, streams=[SimpleNamespace(frame=np.arange(1000, 1010))])
    return SimpleNamespace(initial_frame=SimpleNamespace(choice=choice, frame=frame), recording=recording)


def test_the_note_on_the_patient_names_the_number_of_the_initial_frame():
    assert "z 1.00 m in frame 1003, who is alone" in _notes(room_of_patient(3), None)[0]


def test_an_undecided_facing_is_noted():
    room = room_of_patient(3)
    shape = FittedShape(np.zeros(load_body_asset().shape_count), even_clothes(0.006))
    learnt = SimpleNamespace(shape=shape, contradiction="", turned=None)
    decided = _notes(room, learnt)
    learnt.turned = OtherFacing(pose=None, shape=shape, behind=2.0)
    (more,) = set(_notes(room, learnt)) - set(decided)
    assert "which way the patient faces" in more


def test_a_height_that_the_images_do_not_show_is_noted():
    def run(**subject: float) -> running.Run:
        recording = SimpleNamespace(subject=replace(UNKNOWN, **subject))
        return running.Run(SimpleNamespace(recording=recording), TrackConfig())

    prior = adult_belief(load_body_asset())
    much = 1e6 * prior.prior
    known = prior.having_seen(prior.shape, much, much @ prior.mean)
    learnt = [SimpleNamespace(belief=belief, contradiction="") for belief in (known, prior)]
    assert [len(_unknown_height(run().with_learnt(one.belief), one)) for one in learnt] == [0, 1]
    (note,) = _unknown_height(run().with_learnt(prior), learnt[1])
    height_m, row = standing_height(load_body_asset(), prior.shape)
    assert f"({height_m:.2f} m, sigma {100 * np.sqrt(prior.variance(row[None])[0]):.0f} cm)" in note
    stated = run(height_m=1.7).with_learnt(prior)
    assert not _unknown_height(stated, learnt[1])
    assert _unknown_height(stated, SimpleNamespace(belief=prior, contradiction="the images show another height"))
    assert not _unknown_height(run(), learnt[1])
    assert not _unknown_height(run().with_learnt(prior), None)
    fixed = replace(run(), config=TrackConfig(learning=LearningConfig(own_shape=False)))
    assert fixed.with_learnt(prior).shape is None
