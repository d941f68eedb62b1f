"""A good recording is green; each fault makes its own check yellow or red."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from recording_builder import edit_json, write_picture, write_recording

from anchorpose.camera import Camera
from anchorpose.check import material
from anchorpose.check.material import Finding, Level, OfCamera, SeenPatient, level_of, of_cameras
from anchorpose.check.recording_check import _borders, _noted, check_recording
from anchorpose.cli import main
from anchorpose.isolation.people import Person
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.lens import Intrinsics
from anchorpose.recording.recording import DepthStream
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording

Findings = dict[str, Finding]


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    simulate_recording(folder / "s", single(5, seconds=0.6, fps=15.0))
    return folder / "s" / "recording"


@pytest.fixture(autouse=True)
def _fewer_bodies(monkeypatch):
    monkeypatch.setattr(material, "LOOKS", 2)


def checked(recording: Path) -> Findings:
    return {finding.check: finding for finding in check_recording(recording)}


def with_fault(good: Path, folder: Path, change: Callable[[Path], None]) -> Findings:
    recording = folder / "recording"
    shutil.copytree(good, recording)
    change(recording)
    return checked(recording)


def change_camera(**values) -> Callable[[Path], None]:
    return lambda recording: edit_json(recording / "recording.json", lambda d: d["cameras"][0].update(values))


def change_images(change: Callable[[int, np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Every depth image, and that of the empty room, by ``change`` of its number and its grey values."""

    def change_all(recording: Path) -> None:
        images = sorted((recording / "front" / "depth").glob("*.png"))
        for number, path in enumerate([*images, recording / "front" / "background.png"]):
            write_picture(path, change(number, cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))

    return change_all


def after_the_picture(recording: Path) -> None:
    """The camera stood 2 % farther away when it recorded the empty room."""
    path = recording / "front" / "background.png"
    write_picture(path, np.round(1.02 * cv2.imread(str(path), cv2.IMREAD_UNCHANGED)).astype(np.uint16))


def longer_focal_length(recording: Path) -> None:
    def lengthen(document) -> None:
        lens = document["cameras"][0]["intrinsics"]
        lens.update(fx=1.5 * lens["fx"], fy=1.5 * lens["fy"])

    edit_json(recording / "recording.json", lengthen)


def drop_a_third(recording: Path) -> None:
    stamps = recording / "front" / "timestamps.csv"
    head, *rows = stamps.read_text().splitlines()
    gone = [row for number, row in enumerate(rows) if number in (2, 3, 6)]
    stamps.write_text("\n".join([head, *(row for row in rows if row not in gone)]) + "\n")
    for row in gone:
        (recording / "front" / "depth" / f"{int(row.split(',')[0]):06d}.png").unlink()


def drop_every_third(recording: Path) -> None:
    stamps = recording / "front" / "timestamps.csv"
    head, *rows = stamps.read_text().splitlines()
    for row in rows[1::3]:
        (recording / "front" / "depth" / f"{int(row.split(',')[0]):06d}.png").unlink()
    stamps.write_text("\n".join([head, *(row for number, row in enumerate(rows) if number % 3 != 1)]) + "\n")


def crop_below_the_knees(recording: Path) -> None:
    height = 270
    for path in [*(recording / "front" / "depth").glob("*.png"), recording / "front" / "background.png"]:
        write_picture(path, cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:height])
    change_camera(height=height)(recording)


def nobody(recording: Path) -> None:
    empty = cv2.imread(str(recording / "front" / "background.png"), cv2.IMREAD_UNCHANGED)

    def noisy(number: int, grey: np.ndarray) -> np.ndarray:
        noise = np.random.default_rng(number).integers(-1, 2, empty.shape)
        return np.where(empty > 0, empty + noise, 0).astype(np.uint16)

    change_images(noisy)(recording)


def without_background(recording: Path) -> None:
    (recording / "front" / "background.png").unlink()


def smoothed(number: int, grey: np.ndarray) -> np.ndarray:
    return cv2.blur(grey, (13, 13))


def in_the_sun(number: int, grey: np.ndarray) -> np.ndarray:
    """Half of the image is lost, in blocks: single pixels would be noise, which the reader refuses."""
    blocks = np.random.default_rng(number).random((-(-grey.shape[0] // 8), -(-grey.shape[1] // 8))) < 0.5
    lit = np.kron(blocks, np.ones((8, 8), dtype=bool))[: grey.shape[0], : grey.shape[1]]
    return np.where(lit, 0, grey).astype(np.uint16)


def with_another_cameras_light(number: int, grey: np.ndarray) -> np.ndarray:
    if number % 4 != 1:
        return grey
    noisy = grey + np.random.default_rng(number).normal(0.0, 30.0, grey.shape)
    return np.where(grey > 0, np.clip(noisy, 1, 65535), 0).astype(np.uint16)


def noisier(number: int, grey: np.ndarray) -> np.ndarray:
    noisy = grey + np.random.default_rng(number).normal(size=grey.shape) * 1e-5 * grey.astype(float) ** 2
    return np.where(grey > 0, np.clip(noisy, 1, 65535), 0).astype(np.uint16)


def test_a_good_recording_is_green_but_for_its_length(good):
    found = checked(good)
    unlike = {name: finding for name, finding in found.items() if finding.level > Level.GREEN}
    assert list(unlike) == ["frames"], unlike
    assert "4 s or more" in unlike["frames"].remedy
    assert len(found) > 15
    assert all(finding.measured for finding in found.values())


FAULTS = (
    pytest.param(change_camera(depth_scale=0.002), ("depth unit",), Level.RED, id="scale"),
    pytest.param(crop_below_the_knees, ("whole in view",), Level.RED, id="feet"),
    pytest.param(drop_a_third, ("frames",), Level.RED, id="dropped"),
    pytest.param(drop_every_third, ("frames",), Level.RED, id="every third dropped"),
    pytest.param(nobody, ("patient",), Level.RED, id="nobody"),
    pytest.param(longer_focal_length, ("floor", "room square", "depth unit"), Level.YELLOW, id="focal length"),
    *(
        pytest.param(*fault, id=name, marks=pytest.mark.slow)
        for name, *fault in (
            ("half the scale", change_camera(depth_scale=0.0005), ("depth unit",), Level.RED),
            ("filtered", change_images(smoothed), ("depth steps and edges",), Level.YELLOW),
            ("sun", change_images(in_the_sun), ("readings in the room",), Level.YELLOW),
            ("light", change_images(with_another_cameras_light), ("steady readings",), Level.YELLOW),
            ("noise", change_images(noisier), ("depth noise",), Level.RED),
            ("no picture", without_background, ("empty room",), Level.YELLOW),
            ("moved", after_the_picture, ("empty room",), Level.YELLOW),
        )
    ),
)


@pytest.mark.thorough
@pytest.mark.parametrize(("change", "checks", "least"), FAULTS)
def test_a_fault_shows_in_its_checks_with_a_remedy(good, tmp_path, change, checks, least):
    found = with_fault(good, tmp_path, change)
    for check in checks:
        assert found[check].level >= least, found[check]
        assert found[check].remedy


@pytest.mark.slow
def test_a_wrong_focal_length_shows_without_given_poses(good, tmp_path):
    def change(recording: Path) -> None:
        longer_focal_length(recording)
        change_camera(camera_to_world=None)(recording)

    found = with_fault(good, tmp_path, change)
    assert found["depth unit"].level >= Level.YELLOW
    assert found["room square"].level >= Level.YELLOW


def test_poses_that_cannot_be_found_are_red_and_the_rest_is_checked(tmp_path):
    recording = write_recording(tmp_path / "r", frames=6, cameras=("front", "left"))

    def unplace(document) -> None:
        document["equipment"] = None
        for camera in document["cameras"]:
            camera["camera_to_world"] = None

    edit_json(recording / "recording.json", unplace)
    found = checked(recording)
    assert found["camera poses"].level is Level.RED
    assert found["camera poses"].remedy
    assert found["patient"].measured.startswith("not looked for")
    assert "frames" in found


def test_exit_codes_tell_good_red_and_unusable_apart(good, tmp_path, capsys, refusal):
    assert main(["check", str(good)]) == 0
    assert "green" in capsys.readouterr().out
    recording = tmp_path / "recording"
    shutil.copytree(good, recording)
    nobody(recording)
    assert main(["check", str(recording)]) == 1
    assert "nobody was seen" in capsys.readouterr().out
    assert "there is no such folder" in refusal(["check", str(tmp_path / "none")])


@pytest.mark.parametrize(("distance_m", "below"), [(3.0, False), (1.0, True)])
def test_feet_are_out_of_view_where_the_floor_below_the_patient_is(distance_m, below):
    """A bar may hide the legs, so that no pixel of the patient is at the lower border."""
    pose = np.array([[0, 0, -1, distance_m], [0, -1, 0, 1.2], [-1, 0, 0, 0], [0, 0, 0, 1.0]])  # level, 1.2 m up
    lens = Intrinsics(fx=200.0, fy=200.0, cx=159.5, cy=119.5)
    camera = Camera(name="front", width=320, height=240, depth_scale=0.001, intrinsics=lens, T_world_camera=pose)
    labels = np.zeros((240, 320), np.uint8)
    labels[60:120, 140:180] = PixelLabel.PATIENT
    view = View(np.full((240, 320), distance_m, np.float32), labels)
    seen = SeenPatient(Person(np.zeros(2), 1.0, 1.7, 0.2), (view,), np.zeros(1))
    assert _borders(seen, 0, camera, floor_m=0.0) == (False, below, False, False)


def test_notes_are_reported_and_only_a_camera_that_was_left_out_is_red():
    left_out, other = "camera left was left out: it gave no depth image", "camera right restarted before image 7"
    found = {finding.check: finding for finding in _noted((other, left_out))}
    assert (found["cameras left out"].level, found["cameras left out"].measured) == (Level.RED, left_out)
    assert (found["notes"].level, found["notes"].measured) == (Level.YELLOW, other)
    assert _noted(()) == []


def test_levels_by_limits_and_what_is_not_known():
    assert [level_of(value, 1.0, 2.0) for value in (1.0, 1.5, 2.5, np.nan)] == [
        Level.GREEN,
        Level.YELLOW,
        Level.RED,
        Level.GREEN,
    ]


def test_the_worst_camera_decides_and_is_named():
    good, poor = OfCamera("front", Level.GREEN, "3 mm", "a"), OfCamera("left", Level.RED, "60 mm", "b")
    assert of_cameras("noise", [good, poor]) == Finding("noise", Level.RED, "left: 60 mm", "b")
    assert of_cameras("noise", [good]) == Finding("noise", Level.GREEN, "3 mm", "")


@pytest.mark.parametrize(("hz", "kept_hz"), [(30.0, 15.0), (60.0, 15.0), (29.97, 14.985), (15.0, 15.0), (25.0, 25.0)])
def test_clocks_and_poses_are_found_from_no_more_frames_than_they_need(hz, kept_hz):
    files = tuple(Path(f"{k:06d}.png") for k in range(120))
    duplicate = np.arange(120) % 7 == 0
    every = DepthStream(files=files, time_s=np.arange(120) / hz, frame=np.arange(120), duplicate=duplicate)
    thin = material._thinned_stream(every)
    assert 1.0 / np.diff(thin.time_s) == pytest.approx(np.full(len(thin.files) - 1, kept_hz))
    assert [int(file.stem) for file in thin.files] == thin.frame.tolist()
    np.testing.assert_array_equal(thin.duplicate, duplicate[thin.frame])
