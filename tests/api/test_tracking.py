"""A recording tracked by one call, and frame by frame: the joints of the truth, and the same as by the command line."""

from dataclasses import replace

import numpy as np
import pytest

import anchorpose
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording

FRAMES = 24
NEAR_M = 0.03  # a body that is learnt from a second is so far off, at most


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("single")
    simulate_recording(folder / "out", single(7, seconds=FRAMES / 15.0))
    with np.load(folder / "out/truth/truth.npz") as truth:
        return open_recording(folder / "out/recording"), truth["joints"]


def images_of(recording, frame):
    return {"front": read_frame(recording, frame).depths_m[0]}


def test_every_public_name_can_be_imported_and_a_wrong_one_says_so():
    for name in anchorpose.__all__:
        assert getattr(anchorpose, name).__doc__ or name == "JOINT_NAMES"
    assert set(anchorpose.__all__) <= set(dir(anchorpose))
    with pytest.raises(AttributeError, match="no attribute 'nobody'"):
        _ = anchorpose.nobody


@pytest.mark.thorough
def test_frames_that_come_one_after_another_give_poses_once_the_first_seconds_are_over(simulated):
    recording, truth = simulated
    with anchorpose.Tracker(recording.folder, start_s=1.0) as tracker:
        poses = [tracker.step(images_of(recording, k), k / 15.0) for k in range(FRAMES)]
        assert [pose is None for pose in poses] == [k < 15 for k in range(FRAMES)]
        assert tracker.why == ""
        assert tracker.height_m == pytest.approx(np.ptp(truth[0, :, 1]) + 0.15, abs=0.15)
    with pytest.raises(anchorpose.AnchorposeError, match="closed; make a new Tracker"):
        tracker.step(images_of(recording, 0), FRAMES / 15.0)
    for pose in poses[15:]:
        away_m = np.linalg.norm(pose.joints_m - truth[pose.frame], axis=1)
        assert away_m.mean() < NEAR_M
        assert pose.sigma_m.shape == (21,)
    last = poses[-1]
    np.testing.assert_array_equal(last["Head"], last.joints_m[JOINT_INDEX["Head"]])
    thigh, shank = (last[f"{end}Left"] - last["KneeLeft"] for end in ("Hip", "Ankle"))
    bent_deg = 180.0 - np.degrees(np.arccos(thigh @ shank / np.linalg.norm(thigh) / np.linalg.norm(shank)))
    assert abs(last.angles_deg["knee_flexion_left"]) == pytest.approx(bent_deg, abs=1.0)
    assert last.angles_sigma_deg["knee_flexion_left"] > 0.0
    with pytest.raises(KeyError):
        last["Tail"]


@pytest.mark.thorough
def test_cameras_that_are_covered_or_absent_in_the_first_seconds_are_left_out(simulated):
    recording, truth = simulated
    (front,) = recording.cameras
    names = ("absent", "covered", "front")
    wall = np.full((front.height, front.width), 2.0)
    with anchorpose.Tracker([replace(front, name=name) for name in names], start_s=1.0) as tracker:
        for k in range(15):
            images = images_of(recording, k) | {"covered": np.zeros_like(wall)}
            assert tracker.step(images, k / 15.0) is None
        pose = tracker.step(images_of(recording, 15), 1.0)
        pose = tracker.step(images_of(recording, 16) | {"absent": wall, "covered": wall}, 16 / 15.0)
    assert np.linalg.norm(pose.joints_m - truth[16], axis=1).mean() < NEAR_M


@pytest.mark.thorough
def test_arrays_give_the_joints_of_the_recording_that_they_are(simulated, tmp_path):
    recording, truth = simulated
    frames = [read_frame(recording, k) for k in range(FRAMES)]
    arrays = anchorpose.DepthImages(
        cameras=recording.cameras,
        depth_m={"front": np.stack([frame.depths_m[0] for frame in frames])},
        time_s=recording.streams[0].time_s,
        subject=recording.subject,
        empty_room_m={"front": recording.backgrounds_m[0]},
    )
    found = anchorpose.track(arrays)
    kept = found.folder
    away_m = np.linalg.norm(found.joint_table.position_m - truth, axis=2)
    assert away_m.mean() < NEAR_M
    named = anchorpose.track(recording.folder, tmp_path / "results")
    np.testing.assert_array_equal(named.joint_table.position_m, found.joint_table.position_m)
    with pytest.raises(anchorpose.InputError, match="exists"):
        anchorpose.track(recording.folder, tmp_path / "results")
    del found
    assert not kept.exists()


def test_why_there_is_no_pose_yet(simulated):
    recording, _ = simulated
    with anchorpose.Tracker(recording.cameras, start_s=5.0) as tracker:
        assert tracker.why == "no image was given yet"
        assert tracker.step(images_of(recording, 0), 10.0) is None
        assert tracker.step(images_of(recording, 1), 11.5) is None
        assert tracker.why == "1.5 of the first 5 s were looked at"
        assert tracker.height_m is None


def test_a_frame_that_does_not_fit_is_refused_and_the_next_one_is_taken(simulated):
    recording, _ = simulated
    images = images_of(recording, 0)
    with anchorpose.Tracker(recording.cameras) as tracker:
        tracker.step(images, 1.0)
        for wrong, time_s, sentence in (
            (images, 1.0, "at 1 s is not later"),
            (images, float("nan"), "not later"),
            ({"back": images["front"]}, 2.0, "camera back is unknown; name one of front"),
            ({"front": images["front"][:10]}, 2.0, "has the shape"),
        ):
            with pytest.raises(anchorpose.AnchorposeError, match=sentence):
                tracker.step(wrong, time_s)
        assert tracker.step(images, 2.0) is None
        assert tracker.why == "1.0 of the first 6 s were looked at"


def test_an_empty_room_of_an_unknown_camera_is_refused_and_leaves_no_folder(simulated, tmp_path, monkeypatch):
    recording, _ = simulated
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(anchorpose.AnchorposeError, match="camera Front is unknown; name one of front"):
        anchorpose.Tracker(recording.cameras, empty_room_m={"Front": recording.backgrounds_m[0]})
    assert list(tmp_path.iterdir()) == []


def test_a_closed_tracker_accepts_no_frame(simulated):
    recording, _ = simulated
    with anchorpose.Tracker(recording.cameras) as tracker:
        tracker.step(images_of(recording, 0), 0.0)
    with pytest.raises(anchorpose.AnchorposeError, match="closed; make a new Tracker"):
        tracker.step(images_of(recording, 1), 0.1)


@pytest.mark.thorough
def test_seconds_without_anybody_are_looked_at_again(simulated):
    recording, _ = simulated
    wall = np.full((recording.cameras[0].height, recording.cameras[0].width), 3.0)
    wall += np.random.default_rng(0).normal(0.0, 0.003, wall.shape)
    with anchorpose.Tracker(recording.cameras, start_s=0.5) as tracker:
        for k in range(6):
            assert tracker.step({"front": wall}, 0.1 * k) is None
        assert "first" not in tracker.why
        assert tracker.step({"front": wall}, 0.6) is None
        assert tracker.why == "0.0 of the first 0.5 s were looked at"
