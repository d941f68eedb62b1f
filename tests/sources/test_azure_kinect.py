"""Azure Kinect's .mkv: every pixel and time stamp as recorded, and a sentence for what cannot be read."""

import struct
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from azure_builder import SIZES, TAGS, TIMES_US, calibration, elements, images, mkv, recording, write
from sources_builder import expected, peak_bytes

from anchorpose.camera import Camera
from anchorpose.errors import InputError, MissingPackage
from anchorpose.lens import Intrinsics
from anchorpose.sources.azure_kinect import MODES, AzureKinectFile, depth_mode, lens_of, open_source

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "recorder_files" / "azure_kinect_nfov.mkv"
needs_the_real_file = pytest.mark.skipif(not REAL.is_file(), reason="../shared/data/recorder_files is not there")


def opened(tmp_path: Path, content: bytes) -> AzureKinectFile:
    return open_source(write(tmp_path / "front.mkv", content))


def remux(path: Path, depth: list[np.ndarray], times_ms: list[int]) -> Path:
    """A recording that PyAV writes: another writer's layout of the same file, to whole milliseconds.

    It does not write the four letters of the recorder's format, so that they are put in afterwards.
    """
    height, width = depth[0].shape
    with av.open(str(path), "w", format="matroska", container_options={"allow_raw_vfw": "1"}) as container:
        container.metadata["K4A_DEVICE_SERIAL_NUMBER"] = "of PyAV"
        stream = container.add_stream("rawvideo", rate=30, width=width, height=height, pix_fmt="gray16be")
        stream.metadata["title"] = "DEPTH"
        container.add_attachment("calibration.json", "application/octet-stream", calibration())
        for image, time_ms in zip(depth, times_ms, strict=True):
            packet = av.Packet(image.astype(">u2").tobytes())
            packet.stream, packet.pts, packet.dts, packet.time_base = stream, time_ms, time_ms, Fraction(1, 1000)
            container.mux(packet)
    header = struct.pack("<IiiHH", 40, width, -height, 1, 16)  # it writes the rows from the top as minus
    written = path.read_bytes()
    assert written.count(header + bytes(4)) == 1
    return write(path, written.replace(header + bytes(4), header + b"b16g"))


@pytest.mark.parametrize("mode", SIZES)
def test_pixels_times_and_lens_of_each_mode_are_as_recorded(tmp_path: Path, mode: str) -> None:
    source = opened(tmp_path, recording(4, mode))
    (camera,) = source.cameras
    assert (camera.width, camera.height, camera.depth_scale) == (*SIZES[mode], 0.001)
    assert (camera.name, camera.model, camera.serial) == ("front", "Azure Kinect", "000123")
    assert camera.intrinsics == lens_of(calibration(), next(known for known in MODES if known.name == mode))
    frames = list(source.frames())
    assert [round(frame.time_s * 1e6) for frame in frames] == [336_277 + time for time in TIMES_US]
    for frame, image in zip(frames, images(4, mode), strict=True):
        assert frame.depth.dtype == np.dtype("=u2")
        np.testing.assert_array_equal(frame.depth, expected(image))
    assert source.notes == ()


def test_a_recording_that_pyav_wrote_is_read_alike(tmp_path: Path) -> None:
    depth = images(5, "NFOV_UNBINNED")
    source = open_source(remux(tmp_path / "side view.mkv", depth, [0, 33, 67, 100, 133]))
    assert (source.cameras[0].name, source.cameras[0].serial) == ("side-view", "of PyAV")
    frames = list(source.frames())
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 0.033, 0.067, 0.1, 0.133], abs=1e-9)
    for frame, image in zip(frames, depth, strict=True):
        np.testing.assert_array_equal(frame.depth, expected(image))


def test_times_of_a_device_set_to_the_hosts_clock_keep_their_microseconds(tmp_path: Path) -> None:
    tags = {**TAGS, "K4A_START_OFFSET_NS": str(1_790_000_000_123_457_000)}
    frames = opened(tmp_path, recording(2, tags=tags)).frames()
    assert [round(frame.time_s * 1e6) for frame in frames] == [1_790_000_000_123_457 + time for time in TIMES_US[:2]]


def test_without_pyav_one_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "front.mkv", recording(1))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingPackage, match=r"pip install 'anchorpose\[azure\]'"):
        open_source(path)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (recording(1, name="IR"), "no track named DEPTH"),
        (recording(1, four_letters=b"MJPG"), "not uncompressed"),
        (recording(1, four_letters=b"Y1\0\x10"), "big-endian"),  # little-endian, which would be misread
        (recording(1, four_letters=b"????"), "not uncompressed"),
        (mkv([np.ones((100, 100), np.uint16)], [0], None), "100 x 100"),
        (mkv(images(1, "NFOV_2X2BINNED"), [0], "NFOV_UNBINNED"), "another mode"),
        (b"\x1a\x45\xdf\xa3", "as a Matroska file"),
    ],
)
def test_what_is_no_depth_recording_is_refused(tmp_path: Path, content: bytes, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        opened(tmp_path, content)


@pytest.mark.parametrize(
    ("attached", "problem"),
    [(None, "no attachment calibration.json"), (b"{", "is damaged"), (calibration(SensorWidth=1), "1024 x 1024")],
)
def test_without_a_usable_calibration_the_lens_is_unknown_and_a_note_says_why(
    tmp_path: Path, attached: bytes | None, problem: str
) -> None:
    source = opened(tmp_path, mkv(images(2, "NFOV_2X2BINNED"), [0, 1], attached=attached))
    assert source.cameras[0].intrinsics is None
    assert any(note.startswith("no lens") and problem in note for note in source.notes)
    assert len(list(source.frames())) == 2


def test_without_tags_the_size_states_the_mode_and_a_note_that_the_clock_is_not_known(tmp_path: Path) -> None:
    source = opened(tmp_path, mkv(images(1, "NFOV_UNBINNED"), [5], None, attached=calibration(), tags={}))
    assert source.cameras[0].serial == ""
    assert source.cameras[0].intrinsics == lens_of(calibration(), depth_mode(640, 576) or MODES[0])
    assert [frame.time_s for frame in source.frames()] == [5e-6]
    assert "its times begin with the recording" in source.notes[0]


@needs_the_real_file
def test_the_real_file_pixel_by_pixel_against_another_decoder_and_by_hand_and_a_flat_wall() -> None:
    source = open_source(REAL)
    (frame,) = source.frames()
    with av.open(str(REAL)) as container:
        stream = next(video for video in container.streams.video if video.metadata["title"] == "DEPTH")
        decoded = next(container.decode(stream)).reformat(format="gray16le").to_ndarray()
        tags = container.metadata
    np.testing.assert_array_equal(frame.depth, decoded)

    found = list(elements(REAL.read_bytes()))
    names = [content.decode() for name, content in found if name == "536e"]
    index = [content for name, content in found if name == "d7"][names.index("DEPTH")][0]
    cluster_us, block = _block(found, index)
    np.testing.assert_array_equal(frame.depth, np.frombuffer(block[4:], ">u2").reshape(576, 640))
    ticks = cluster_us + int.from_bytes(block[1:3], signed=True)
    assert round(frame.time_s * 1e9) == 1000 * ticks + int(tags["K4A_START_OFFSET_NS"])
    assert (source.cameras[0].serial, source.cameras[0].model) == (tags["K4A_DEVICE_SERIAL_NUMBER"], "Azure Kinect")
    assert source.notes == ()
    lens = source.cameras[0].intrinsics
    without = Intrinsics(fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, distortion=lens.distortion[:5])
    own, dropped = (_wall_residual_m(frame.depth, given) for given in (lens, without))
    assert own < 0.003
    assert dropped > 3 * own


def _block(found: list[tuple[str, bytes]], index: int) -> tuple[int, bytes]:
    """The time of the cluster of a track's first block, and the block."""
    cluster_us = 0
    for name, content in found:
        if name == "e7":
            cluster_us = int.from_bytes(content)
        if name in ("a1", "a3") and content[0] == 0x80 | index:
            return cluster_us, content
    raise AssertionError("the file has no block of this track")


def _wall_residual_m(depth: np.ndarray, lens: Intrinsics) -> float:
    """How far the left wall, tan 0.2 to 1.0 off the axis, is from the plane through it (root mean square)."""
    camera = Camera(name="real", width=640, height=576, depth_scale=0.001, intrinsics=lens)
    points = camera.back_project(depth * 0.001)[20:470, 10:235]
    row, column = np.mgrid[20:470, 10:235]
    points = points[np.isfinite(points[..., 2]) & ((row < 300) | (column < 110))].astype(np.float64)
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return float(np.sqrt(np.mean((centred @ normal) ** 2)))


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    depth = images(1, "WFOV_2X2BINNED") * 40
    content = mkv(depth, [33_333 * i for i in range(40)], "WFOV_2X2BINNED", attached=calibration())
    frames = opened(tmp_path, content).frames()
    next(frames)
    assert peak_bytes(lambda: sum(1 for _ in frames)) < 6 * depth[0].nbytes
