"""Depth images: chunks that are not needed change no pixel, and what is not a measurement is recognised."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from bad_images import BAD, RNG, large_recording, room
from recording_builder import DATA, write_picture

from anchorpose.recording.depth_image import FARTHEST_M, RecordedFrames, content_problem, decode_grey_png, measured_m
from anchorpose.recording.reader import open_recording, read_frames

GREY = np.random.default_rng(5).integers(0, 65536, (48, 64)).astype(np.uint16)
PNG = cv2.imencode(".png", GREY)[1].tobytes()
HEADER = 33


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def animated() -> bytes:
    """Its first frame covers a corner of the image, as a valid animation may."""
    control = struct.pack(">IIIIIHHBB", 0, 16, 12, 0, 0, 1, 10, 0, 0)
    return PNG[:HEADER] + chunk(b"acTL", struct.pack(">II", 1, 0)) + chunk(b"fcTL", control) + PNG[HEADER:]


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(animated(), id="an animation"),
        pytest.param(PNG[:HEADER] + chunk(b"tEXt", b"Comment\0front") + PNG[HEADER:], id="a note"),
        pytest.param(PNG[:HEADER] + chunk(b"tRNS", b"\x07\xd0") + PNG[HEADER:], id="a transparent value"),
        pytest.param(PNG[:HEADER] + chunk(b"gAMA", struct.pack(">I", 45455)) + PNG[HEADER:], id="a gamma"),
        pytest.param(PNG[:HEADER] + chunk(b"zTXt", b"x\0\0" + zlib.compress(bytes(1 << 24))) + PNG[HEADER:], id="bomb"),
        pytest.param(PNG + b"what follows the image", id="bytes behind it"),
    ],
)
def test_what_is_beside_the_image_changes_no_pixel(data):
    grey, problem = decode_grey_png(data, 64, 48)
    assert problem == ""
    np.testing.assert_array_equal(grey, GREY)


def test_a_chunk_that_is_needed_and_unknown_is_a_problem_and_a_bomb_fills_no_more_than_the_image():
    data = PNG[:HEADER] + chunk(b"NEED", b"1") + PNG[HEADER:]
    assert decode_grey_png(data, 64, 48)[0] is None
    assert "needs a chunk 'NEED'" in decode_grey_png(data, 64, 48)[1]
    header = struct.pack(">IIBBBBB", 64, 48, 16, 0, 0, 0, 0)
    content = zlib.compress(bytes(1 << 26), 9)
    data = PNG[:8] + chunk(b"IHDR", header) + chunk(b"IDAT", content) + chunk(b"IEND", b"")
    grey, problem = decode_grey_png(data, 64, 48)
    assert (grey is None and problem) or grey.shape == (48, 64)


def problem(grey: np.ndarray) -> str:
    return content_problem(grey, measured_m(grey, 0.001))


@pytest.mark.parametrize("kind", BAD)
def test_what_is_not_a_measurement_is_recognised(kind):
    grey, words = BAD[kind]
    assert words in problem(grey)


@pytest.mark.parametrize("sigma_per_m", [0.0, 0.002, 0.01])
def test_a_room_is_a_measurement_however_noisy_its_camera(sigma_per_m):
    assert problem(room(sigma_per_m)) == ""


def test_a_room_with_holes_and_light_from_outside_and_a_person_alone_are_measurements():
    grey = room()
    grey[:60] = 0
    grey[60:90, :40] = 65535
    assert problem(grey) == ""
    grey = np.zeros((240, 320), np.uint16)
    grey[60:160, 150:180] = 3000 + RNG.normal(0, 10, (100, 30))
    assert problem(grey) == ""


def test_codes_and_what_no_camera_reaches_are_no_readings():
    grey = np.array([[0, 1, 19_999, 20_001, 65_535]], np.uint16)
    np.testing.assert_allclose(measured_m(grey, 0.001), [[0, 0.001, 19.999, 0, 0]])
    assert measured_m(grey, 0.0001)[0, 4] == 0.0  # a code also where it would be 6.6 m
    assert FARTHEST_M == 20.0


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
