"""Simulated recordings on disk: complete, repeatable, readable, refused where they cannot be."""

import dataclasses
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from anchorpose.calibration.first_frames import noise_per_m
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.lens import LensModel
from anchorpose.recording.reader import open_recording
from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT
from anchorpose.simulate.shoot import set_up
from anchorpose.simulate.touches import touches
from anchorpose.simulate.write import simulate_recording

SHORT = SimulationConfig(seed=31, seconds=1.0, fps=3.0, cameras=2, therapists=2)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def clinic(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("simulated") / "clinic"
    simulate_recording(out, SHORT)
    return out


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not(clinic, tmp_path):
    simulate_recording(tmp_path / "again", SHORT)
    assert contents(tmp_path / "again") == contents(clinic)
    simulate_recording(tmp_path / "other", dataclasses.replace(SHORT, seed=32))
    other = contents(tmp_path / "other")
    assert other["recording/front/depth/000000.png"] != contents(clinic)["recording/front/depth/000000.png"]


def test_the_recording_reads_as_any_other(clinic):
    recording = open_recording(clinic / "recording")
    assert [camera.name for camera in recording.cameras] == ["front", "left"]
    assert [len(stream.files) for stream in recording.streams] == [3, 3]
    assert recording.streams[1].time_s == pytest.approx([0, 1 / 3, 2 / 3], abs=1e-6)
    assert {"knee-bar", "cross-bar", "rail-left", "post-right"} <= {part.name for part in recording.equipment.parts}
    assert all((background > 0).mean() > 0.5 for background in recording.backgrounds_m)


def test_the_truth_is_beside_the_recording_and_complete(clinic):
    assert sorted(p.name for p in clinic.iterdir()) == ["recording", "truth"]
    with np.load(clinic / "truth/truth.npz") as truth:
        assert truth["joints"].shape == (3, 21, 3)
        assert (tuple(truth["names"]), truth["time"]) == (JOINT_NAMES, pytest.approx(np.arange(3) / 3))
        assert truth["occluded"].dtype == bool
        assert truth["touched"].shape == (3, 31)
        assert truth["touched_joints"].shape == (3, 2, 21)
        assert truth["held_joints"].shape == (3, 2, 2)
        assert truth["part_names"].shape == (31,)
        images = [clinic / f"truth/labels/{name}/000001.png" for name in ("front", "left")]
        seen = sum(int((cv2.imread(str(image), cv2.IMREAD_UNCHANGED) == 2).sum()) for image in images)
        assert truth["patient_pixels"][1] == seen > 5000


def test_labels_and_parts_fit_the_depth(clinic):
    depth = cv2.imread(str(clinic / "recording/front/depth/000002.png"), cv2.IMREAD_UNCHANGED)
    background = cv2.imread(str(clinic / "recording/front/background.png"), cv2.IMREAD_UNCHANGED)
    label = cv2.imread(str(clinic / "truth/labels/front/000002.png"), cv2.IMREAD_UNCHANGED)
    part = cv2.imread(str(clinic / "truth/parts/front/000002.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == background.dtype == np.uint16
    assert np.array_equal(part > 0, label >= 2)
    assert part.max() <= 31
    both = (depth > 0) & (background > 0)
    away = np.abs(depth.astype(int) - background)
    assert np.median(away[both & (label <= 1)]) < 12
    assert np.median(away[both & (label == 2)]) > 300


@pytest.mark.thorough
def test_a_rough_recorder_writes_what_its_truth_says(tmp_path):
    clocks = {"clock_late_s": (0.0, 0.3), "clock_epoch_s": (0.0, 1.7e9), "stamp_jitter_s": 0.004}
    gaps = {"doubled_share": 0.2, "starts_late_s": (0.0, 0.4), "ends_early_s": (0.0, 0.5)}
    config = SimulationConfig(seed=3, seconds=2, fps=10, cameras=2, therapists=0, **clocks, **gaps)
    simulate_recording(tmp_path / "out", config)
    front, left = open_recording(tmp_path / "out/recording").streams
    with np.load(tmp_path / "out/truth/truth.npz") as truth:
        taken_s, doubled = truth["taken_s"], truth["doubled"]
    assert (list(front.frame), list(left.frame)) == (list(range(20)), list(range(4, 15)))
    assert np.flatnonzero(np.isfinite(taken_s[1])).tolist() == list(left.frame)
    assert 0 < left.duplicate.sum() < 8
    assert (left.duplicate == doubled[1, left.frame]).all()
    assert (front.duplicate == doubled[0]).all()
    sound = ~left.duplicate
    late = taken_s[1, left.frame] - (left.time_s - 1.7e9)
    assert late[sound] == pytest.approx(0.3, abs=0.009)
    assert (late[~sound] < 0.25).all()
    assert 0 < np.abs(front.time_s - front.frame / 10).max() <= 0.008 + 1e-6


def test_a_folder_that_is_not_empty_is_refused_and_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        simulate_recording(tmp_path / "out", SHORT)
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    with pytest.raises(InputError, match="is a link"):
        simulate_recording(tmp_path / "link", SHORT)
    assert contents(tmp_path) == {"out/notes.txt": b"mine"}


def test_an_interrupted_run_leaves_nothing_behind(tmp_path):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_recording(tmp_path / "out", SHORT, interrupt)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"seconds": 0.0},
        *({"seconds": value} for value in (-1.0, 1e9, 1e300, float("inf"), float("nan"))),
        *({"fps": value} for value in (0.0, 1e300, float("inf"), float("nan"))),
        {"fps": -1.0},
        {"cameras": 5},
        {"therapists": 4},
        {"sensor": "polaroid"},
        {"speed": "brisk"},
        {"motions": ("dance",)},
        {"motions": ()},
        {"motions": ("sit-to-stand",), "equipment": "standing-frame"},
        {"clothing_m": 0.05},
        {"hole_radius_m": 0.5},
        {"hole_share": 1.5},
        {"dropped_share": 1.0},
        {"doubled_share": -0.1},
        {"stamp_jitter_s": -0.001},
        {"starts_late_s": (1.0, 0.0), "cameras": 2},
        {"ends_early_s": (0.0, 99.0), "cameras": 2},
        {"clock_epoch_s": (0.0,), "cameras": 2},
        {"height_m": 0.9},
        {"clock_late_s": (0.1,), "cameras": 3},
    ],
)
def test_what_cannot_be_simulated_is_refused(wrong):
    with pytest.raises(ValueError, match=r"must|needs|fit|should"):
        SimulationConfig(**{"seed": 1, **wrong})


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"away_s": ((3.0, 1.0),), "equipment": "none"}, "away"),
        ({"away_s": ((1.0, 2.0),), "equipment": "standing-frame"}, "walk out"),
        ({"curtain_s": (2.0, 2.0)}, "curtain"),
        ({"cameras": 2, "sensors": ("d435",)}, "one value per camera"),
        ({"cameras": 2, "every": (2, 1)}, "every must be 1"),  # the first camera has all frames
    ],
)
def test_a_scene_or_cameras_that_cannot_be_are_refused(wrong, problem):
    with pytest.raises(ValueError, match=problem):
        SimulationConfig(seed=1, **wrong)


def test_a_patient_who_is_away_is_in_no_picture_and_has_no_joints(tmp_path):
    config = presets.scene(presets.single(7, seconds=8.0, fps=1.0), "enters-late")
    simulate_recording(tmp_path / "late", config)
    with np.load(tmp_path / "late/truth/truth.npz") as truth:
        away = truth["time"] < config.away_s[0][1]
        assert away.any()
        assert not away.all()
        np.testing.assert_array_equal(np.isnan(truth["joints"]).all(axis=(1, 2)), away)
        assert (truth["patient_pixels"][away] == 0).all()
        middle_m = np.linalg.norm(truth["joints"][:, 0, [0, 2]], axis=1)[~away]
    assert middle_m[0] > 1.0  # the patient walks in from the side
    assert (np.diff(middle_m) < 0.05).all()


@pytest.mark.parametrize("scene", ["enters-late", "leaves"])
def test_a_patient_walks_out_of_the_view_of_all_cameras_and_is_touched_and_held_only_at_the_place_of_training(scene):
    config = presets.scene(dataclasses.replace(presets.clinic(3, seconds=12.0, fps=10.0), therapists_stay=True), scene)
    clinic = draw_clinic(config)
    studio = set_up(clinic)
    performance = studio.performances[0]
    edges = np.flatnonzero(np.diff(performance.away))
    assert len(edges) == (2 if scene == "leaves" else 1)
    for frame in [f for edge in edges.tolist() for f in (edge, edge + 1)]:
        assert not any((image.label == PATIENT).any() for image in studio.shoot(frame).images), "nobody appears in view"
    for frame in np.flatnonzero(performance.away)[::8].tolist():
        touch = touches(clinic, performance, performance.figures(frame), frame)
        assert not any(part.any() for part in (touch.bones, touch.joints, touch.regions, touch.on_equipment))
    held = (performance.held_joints() >= 0).any(axis=(1, 2))
    assert held.any()
    assert np.linalg.norm(performance.joints_m()[held, JOINT_NAMES.index("SpineBase")][:, [0, 2]], axis=1).max() < 0.5
    places_m = np.concatenate([therapist.hold.places_m for therapist in clinic.therapists])
    assert np.linalg.norm(places_m[:, [0, 2]], axis=1).max() < 0.5


def test_a_recording_without_time_for_the_walks_is_refused():
    with pytest.raises(AnchorposeError, match=r"no time to walk .* takes 4 s each way; simulate a longer recording"):
        draw_clinic(presets.scene(presets.single(7, seconds=8.0), "leaves"))


def test_labels_and_parts_of_a_repeated_image_are_those_of_the_image_on_the_disk(tmp_path):
    config = dataclasses.replace(presets.single(6, seconds=1.0, fps=6.0), doubled_share=0.4, motions=("arm-raise",))
    simulate_recording(tmp_path / "out", config)
    with np.load(tmp_path / "out/truth/truth.npz") as truth:
        doubled = truth["doubled"][0]
    assert 0 < doubled.sum() < 5
    for folder in ("recording/front/depth", "truth/labels/front", "truth/parts/front"):
        files = [(tmp_path / f"out/{folder}/{frame:06d}.png").read_bytes() for frame in range(6)]
        assert [False, *(a == b for a, b in pairwise(files))] == doubled.tolist()


def test_a_curtain_hides_the_patient_for_two_seconds_and_no_longer(tmp_path):
    config = presets.scene(presets.single(7, seconds=6.0, fps=1.0), "hidden")
    simulate_recording(tmp_path / "hidden", config)
    with np.load(tmp_path / "hidden/truth/truth.npz") as truth:
        behind = (truth["time"] >= config.curtain_s[0]) & (truth["time"] < config.curtain_s[1])
        assert behind.sum() == 2
        np.testing.assert_array_equal(truth["patient_pixels"] == 0, behind)
        assert np.isfinite(truth["joints"]).all()


@pytest.mark.thorough
def test_cameras_of_different_models_have_their_own_images_lenses_rates_and_noise(tmp_path):
    config = SimulationConfig(seed=31, seconds=1.0, fps=4.0, cameras=2, therapists=0)
    config = dataclasses.replace(config, sensors=("femto-bolt", "d435"), every=(1, 2))
    simulate_recording(tmp_path / "mixed", config)
    front, left = (recording := open_recording(tmp_path / "mixed" / "recording")).cameras
    assert ((front.width, front.height), (left.width, left.height)) == ((640, 576), (848, 480))
    assert (front.intrinsics.model, left.intrinsics.model) == (LensModel.RATIONAL, LensModel.BROWN_CONRADY)
    assert recording.streams[1].time_s == pytest.approx([0.0, 0.5])
    noise = [noise_per_m([room]) for room in recording.backgrounds_m if room is not None]
    assert noise[1] > 2 * noise[0]
    one_model = [camera.T_world_camera for camera in draw_clinic(dataclasses.replace(config, sensors=())).cameras]
    np.testing.assert_array_equal([front.T_world_camera, left.T_world_camera], one_model)
