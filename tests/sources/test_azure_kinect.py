"""Azure Kinect's .mkv: every pixel and time stamp as recorded, and a sentence for what cannot be read."""

from __future__ import annotations

import struct
import sys
import tracemalloc
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from azure_builder import SIZES, TAGS, calibration, cluster, elements, images, mkv, write

from anchorpose.camera import Camera
from anchorpose.errors import InputError, MissingPackage
from anchorpose.lens import Intrinsics
from anchorpose.sources.azure_calibration import MODES, depth_mode, lens_of
from anchorpose.sources.azure_kinect import AzureKinectFile, matches, open_source

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "recorder_files" / "azure_kinect_nfov.mkv"
needs_the_real_file = pytest.mark.skipif(not REAL.is_file(), reason="../shared/data/recorder_files is not there")
TIMES_US = [12, 33_345, 66_679, 7_200_000_001]
"""Not whole milliseconds, and two hours later, so that a rounded time stamp shows."""


def expected(image: np.ndarray) -> np.ndarray:
    return np.where(image == 65535, 0, image)


def opened(tmp_path: Path, content: bytes) -> AzureKinectFile:
    return open_source(write(tmp_path / "front.mkv", content))


def recording(count: int = 3, mode: str = "NFOV_2X2BINNED", **changed: object) -> bytes:
    return mkv(images(count, mode), TIMES_US[:count], mode, attached=calibration(), **changed)


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
    frames = list(source.frames([0]))
    assert [round(frame.time_s * 1e6) for frame in frames] == [336_277 + time for time in TIMES_US]
    for frame, image in zip(frames, images(4, mode), strict=True):
        assert frame.depth.dtype == np.dtype("=u2")
        np.testing.assert_array_equal(frame.depth, expected(image))
    assert source.notes == (f"depth mode {mode}, in millimetres",)


def test_a_recording_that_pyav_wrote_is_read_alike(tmp_path: Path) -> None:
    depth = images(5, "NFOV_UNBINNED")
    source = open_source(remux(tmp_path / "side view.mkv", depth, [0, 33, 67, 100, 133]))
    assert (source.cameras[0].name, source.cameras[0].serial) == ("side-view", "of PyAV")
    frames = list(source.frames([0]))
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 0.033, 0.067, 0.1, 0.133], abs=1e-9)
    for frame, image in zip(frames, depth, strict=True):
        np.testing.assert_array_equal(frame.depth, expected(image))


def test_times_of_a_device_set_to_the_hosts_clock_keep_their_microseconds(tmp_path: Path) -> None:
    tags = {**TAGS, "K4A_START_OFFSET_NS": str(1_790_000_000_123_457_000)}
    frames = opened(tmp_path, recording(2, tags=tags)).frames([0])
    assert [round(frame.time_s * 1e6) for frame in frames] == [1_790_000_000_123_457 + time for time in TIMES_US[:2]]


def test_reading_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    source = opened(tmp_path, recording(4))
    whole, rest = list(source.frames([0])), list(source.frames([3]))
    assert [frame.time_s for frame in rest] == [whole[3].time_s]
    np.testing.assert_array_equal(rest[0].depth, whole[3].depth)
    assert list(source.frames([4])) == []


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    depth = images(1, "WFOV_2X2BINNED") * 40
    content = mkv(depth, [33_333 * i for i in range(40)], "WFOV_2X2BINNED", attached=calibration())
    frames = opened(tmp_path, content).frames([0])
    next(frames)
    tracemalloc.start()
    for _ in frames:
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6 * depth[0].nbytes


def test_only_matroska_matches() -> None:
    assert matches(Path("named.bag"), recording(1)[:4096])
    assert not matches(Path("named.mkv"), b"#ROSBAG V2.0\n")
    assert not matches(Path("folder.mkv"), b"")


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
    assert len(list(source.frames([0]))) == 2


def test_without_tags_the_size_states_the_mode_and_a_note_that_the_clock_is_not_known(tmp_path: Path) -> None:
    source = opened(tmp_path, mkv(images(1, "NFOV_UNBINNED"), [5], None, attached=calibration(), tags={}))
    assert source.cameras[0].serial == ""
    assert source.cameras[0].intrinsics == lens_of(calibration(), depth_mode(640, 576) or MODES[0])
    assert [frame.time_s for frame in source.frames([0])] == [5e-6]
    assert "its times begin with the recording" in source.notes[1]


def test_a_file_cut_short_gives_the_frames_before_the_cut_with_a_note(tmp_path: Path) -> None:
    content = recording(4)
    source = opened(tmp_path, content[: len(content) - images(1, "NFOV_2X2BINNED")[0].nbytes - 1000])
    assert len(list(source.frames([0]))) == 3
    assert any("cut short" in note for note in source.notes)


def test_a_recorder_that_was_stopped_by_force_states_no_length(tmp_path: Path) -> None:
    content = recording(2)
    place = content.index(b"\x18\x53\x80\x67") + 4
    source = opened(tmp_path, content[:place] + b"\x01" + b"\xff" * 7 + content[place + 8 :])
    assert len(list(source.frames([0]))) == 2
    assert any("did not close it" in note for note in source.notes)


@pytest.mark.parametrize("damaged_us", [900_000_000, 0, 33_345])
def test_one_damaged_time_costs_one_frame(tmp_path: Path, damaged_us: int) -> None:
    times = [100, 33_345, damaged_us, 100_012, 133_345]
    source = opened(tmp_path, mkv(images(5, "NFOV_2X2BINNED"), times, attached=calibration(), tags={}))
    assert [round(frame.time_s * 1e6) for frame in source.frames([0])] == [100, 33_345, 100_012, 133_345]
    assert source.notes[-1] == "depth images left out because their size or time is damaged: 1"
    list(source.frames([0]))
    assert source.notes[-1].endswith(": 1")


def test_an_image_of_the_wrong_size_is_left_out(tmp_path: Path) -> None:
    content = recording(1)
    small = cluster(50_000, [(2, b"\0" * 100)])
    source = opened(tmp_path, content + small + cluster(90_000, [(2, b"\0" * (2 * 320 * 288))]))
    assert [round(frame.time_s * 1e6) for frame in source.frames([0])] == [336_289, 426_277]
    assert any(note.endswith("damaged: 1") for note in source.notes)


def test_a_recording_without_one_image_is_refused(tmp_path: Path) -> None:
    content = recording(1)
    empty = content[: content.index(b"\x1f\x43\xb6\x75")]
    with pytest.raises(InputError, match="as a Matroska file"):
        opened(tmp_path, empty)
    source = opened(tmp_path, empty + cluster(0, [(2, b"\0" * 100)]))
    with pytest.raises(InputError, match="no depth image"):
        list(source.frames([0]))


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed in the header, near it or anywhere, the file cut, or a piece taken out."""
    header = content.index(b"\x1f\x43\xb6\x75") + 40
    place = int(rng.integers(header if rng.random() < 0.8 else len(content)))
    match rng.integers(4):
        case 0:
            return content[:place]
        case 1:
            return content[:place] + content[place + int(rng.integers(1, 64)) :]
        case _:
            changed = bytearray(content)
            for spot in {place, *rng.integers(header, size=int(rng.integers(4))).tolist()}:
                changed[spot] = int(rng.integers(256))
            return bytes(changed)


def test_whatever_is_damaged_gives_frames_or_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    rng = np.random.default_rng(19)
    content = recording(3)
    read = refused = 0
    for _ in range(400):
        try:
            source = opened(tmp_path, damaged(content, rng))
            frames = list(source.frames([0]))
        except InputError:
            refused += 1
            continue
        read += 1
        times = [frame.time_s for frame in frames]
        assert times == sorted(set(times))
        assert all(frame.depth.shape == (288, 320) for frame in frames)
        assert all(note.count("\n") == 0 for note in source.notes)
    assert read > 100
    assert refused > 30
    assert capfd.readouterr() == ("", "")


@needs_the_real_file
def test_the_real_file_pixel_by_pixel_against_another_decoder_and_by_hand() -> None:
    source = open_source(REAL)
    (frame,) = source.frames([0])
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
    assert source.notes == ("depth mode NFOV_UNBINNED, in millimetres",)


def _block(found: list[tuple[str, bytes]], index: int) -> tuple[int, bytes]:
    """The time of the cluster of a track's first block, and the block."""
    cluster_us = 0
    for name, content in found:
        if name == "e7":
            cluster_us = int.from_bytes(content)
        if name in ("a1", "a3") and content[0] == 0x80 | index:
            return cluster_us, content
    raise AssertionError("the file has no block of this track")


@needs_the_real_file
def test_a_wall_of_the_real_file_is_flat_with_its_own_lens_only() -> None:
    source = open_source(REAL)
    (frame,) = source.frames([0])
    lens = source.cameras[0].intrinsics
    assert lens is not None
    without = Intrinsics(fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, distortion=lens.distortion[:5])
    own, dropped = (_wall_residual_m(frame.depth, given) for given in (lens, without))
    assert own < 0.003
    assert dropped > 3 * own


def _wall_residual_m(depth: np.ndarray, lens: Intrinsics) -> float:
    """How far the left wall, tan 0.2 to 1.0 off the axis, is from the plane through it (root mean square)."""
    camera = Camera(name="real", width=640, height=576, depth_scale=0.001, intrinsics=lens)
    points = camera.back_project(depth * 0.001)[20:470, 10:235]
    row, column = np.mgrid[20:470, 10:235]
    points = points[np.isfinite(points[..., 2]) & ((row < 300) | (column < 110))].astype(np.float64)
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return float(np.sqrt(np.mean((centred @ normal) ** 2)))
