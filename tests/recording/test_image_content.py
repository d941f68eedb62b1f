"""An image that is not a measurement is recognised by its content, and every real one is let through."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from recording_builder import DATA, HEIGHT, WIDTH, depth_grey, edit_json, write_picture, write_recording

from anchorpose.recording.depth_image import RecordedFrames
from anchorpose.recording.image_content import FARTHEST_M, content_problem, measured_m
from anchorpose.recording.reader import open_recording, read_frames

ROWS, COLUMNS = 120, 160
RNG = np.random.default_rng(8)


def room(sigma_per_m: float = 0.002) -> np.ndarray:
    """A wall, a floor that slants towards the camera, and a box before them, in millimetres."""
    row = np.repeat(np.arange(ROWS)[:, None], COLUMNS, axis=1)
    depth_m = np.minimum(4.0, 60.0 / np.maximum(row - 40, 1))
    depth_m[30:90, 60:90] = 2.0
    return (1000 * (depth_m + RNG.normal(0.0, sigma_per_m * depth_m**2))).astype(np.uint16)


def problem(grey: np.ndarray) -> str:
    return content_problem(grey, measured_m(grey, 0.001))


def noise(low: int = 0, high: int = 65536) -> np.ndarray:
    return RNG.integers(low, high, (ROWS, COLUMNS)).astype(np.uint16)


def scattered(share: float) -> np.ndarray:
    return np.where(RNG.random((ROWS, COLUMNS)) < share, room(), 0).astype(np.uint16)


BAD = {
    "saturated": (np.full((ROWS, COLUMNS), 65535, np.uint16), "saturated"),
    "beyond every room": (np.full((ROWS, COLUMNS), 40_000, np.uint16), "saturated"),
    "empty": (np.zeros((ROWS, COLUMNS), np.uint16), "no readings"),
    "single readings": (scattered(0.02), "no readings"),
    "clipped": (np.minimum(room(), 500), "same value"),
    "noise over all values": (noise(), "noise"),
    "noise over a room": (noise(500, 8000), "noise"),
    "every second reading": (scattered(0.4), "noise"),
    "noise in half of the image": (np.where(np.arange(COLUMNS) < COLUMNS // 2, noise(500, 8000), room()), "noise"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_not_a_measurement_is_recognised(kind):
    grey, words = BAD[kind]
    assert words in problem(grey)


@pytest.mark.parametrize("sigma_per_m", [0.0, 0.002, 0.01])
def test_a_room_is_a_measurement_however_noisy_its_camera(sigma_per_m):
    assert problem(room(sigma_per_m)) == ""


def test_a_room_with_holes_and_light_from_outside_is_a_measurement():
    grey = room()
    grey[:60] = 0
    grey[60:90, :40] = 65535
    assert problem(grey) == ""


def test_a_person_alone_is_a_measurement():
    grey = np.zeros((240, 320), np.uint16)
    grey[60:160, 150:180] = 3000 + RNG.normal(0, 10, (100, 30))
    assert problem(grey) == ""


def test_mirrored_images_are_judged_alike():
    for grey, _ in BAD.values():
        assert problem(grey[:, ::-1]) == problem(grey)


def test_codes_and_what_no_camera_reaches_are_no_readings():
    grey = np.array([[0, 1, 19_999, 20_001, 65_535]], np.uint16)
    np.testing.assert_allclose(measured_m(grey, 0.001), [[0, 0.001, 19.999, 0, 0]])
    assert measured_m(grey, 0.0001)[0, 4] == 0.0  # a code also where it would be 6.6 m
    assert FARTHEST_M == 20.0


def large_recording(folder, cameras=("front", "left"), frames=6):
    write_recording(folder, frames=frames, cameras=cameras)
    edit_json(folder / "recording.json", lambda d: [c.update(width=COLUMNS, height=ROWS) for c in d["cameras"]])
    for name in cameras:
        write_picture(folder / name / "background.png", room())
        for frame in range(frames):
            write_picture(folder / name / "depth" / f"{frame:06d}.png", room())
    return folder


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("frame", [0, 3])
def test_a_bad_image_is_dropped_with_its_reason_and_the_other_camera_goes_on(tmp_path, kind, frame):
    folder = large_recording(tmp_path / "r")
    grey, words = BAD[kind]
    write_picture(folder / "left" / "depth" / f"{frame:06d}.png", grey)
    recording = open_recording(folder)
    sets = list(read_frames(recording))
    assert [one.depths_m[1] is None for one in sets] == [number == frame for number in range(6)]
    assert all(one.depths_m[0] is not None for one in sets)
    assert sets[frame].problems[0].startswith(f"left/depth/{frame:06d}.png ")
    assert words in sets[frame].problems[0]
    assert sets[frame].taken_s[1] is None
    assert RecordedFrames(recording, recording.cameras).read(1, frame) is None


def test_small_drawings_without_noise_are_read(tmp_path):
    grey = depth_grey(0)
    assert grey.shape == (HEIGHT, WIDTH)
    assert problem(grey) == ""


@pytest.mark.skipif(not DATA.exists(), reason="the shared development data is not here")
def test_every_shared_image_is_a_measurement():
    looked_at = 0
    for document in sorted(DATA.rglob("recording.json")):
        recording = open_recording(document.parent)
        for camera, stream in zip(recording.cameras, recording.streams, strict=True):
            for file in stream.files[:: max(1, len(stream.files) // 3)]:
                grey = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
                assert content_problem(grey, measured_m(grey, camera.depth_scale)) == "", file
                looked_at += 1
    assert looked_at > 300
