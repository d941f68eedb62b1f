"""A sound recording is read as it stands; frames stream in order; damage to single pictures is reported."""

from pathlib import Path

import numpy as np
import pytest
from recording_builder import (
    DATA,
    HEIGHT,
    WIDTH,
    depth_grey,
    edit_json,
    write_picture,
    write_recording,
    write_timestamps,
)

from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording, read_frames


def test_a_recording_comes_back_as_it_was_written(tmp_path):
    recording = open_recording(write_recording(tmp_path / "r", frames=3, cameras=("front", "left")))
    camera = recording.cameras[1]
    assert (camera.name, camera.width, camera.height, camera.depth_scale) == ("left", WIDTH, HEIGHT, 0.001)
    assert camera.intrinsics.fy == 31.0
    np.testing.assert_array_equal(camera.T_world_camera[:3, 3], [2.5, 1.2, 0.1])
    assert recording.subject.height_m == 1.72
    assert [part.name for part in recording.equipment.parts] == ["bar", "post"]
    np.testing.assert_allclose(recording.streams[0].time_s, [0, 0.1, 0.2])
    assert recording.backgrounds_m[0].dtype == np.float32


def test_frames_are_metres_and_zero_where_there_is_no_reading(tmp_path):
    recording = open_recording(write_recording(tmp_path / "r", frames=3))
    frames = list(read_frames(recording))
    assert [frame.frame for frame in frames] == [0, 1, 2]
    for number, frame in enumerate(frames):
        np.testing.assert_allclose(frame.depths_m[0], depth_grey(number) * 0.001, atol=1e-6)
        assert frame.depths_m[0].dtype == np.float32


@pytest.mark.parametrize(("start", "stop"), [(4, None), (2, 2), (3, 1), (-1, 2)])
def test_an_empty_range_is_refused_before_the_first_frame_is_asked_for(tmp_path, start, stop):
    recording = open_recording(write_recording(tmp_path / "r", frames=4))
    with pytest.raises(InputError, match="choose a start"):
        read_frames(recording, start, stop)


@pytest.mark.parametrize("place", ["camera", "top"])
def test_a_frame_rate_stands_in_for_missing_timestamps_and_keeps_dropped_frames_apart(tmp_path, place):
    folder = write_recording(tmp_path / "r", frames=4)
    (folder / "front" / "timestamps.csv").unlink()
    (folder / "front" / "depth" / "000002.png").unlink()
    edit_json(folder / "recording.json", lambda d: (d["cameras"][0] if place == "camera" else d).update(fps=20))
    recording = open_recording(folder)
    np.testing.assert_allclose(recording.streams[0].time_s, [0.0, 0.05, 0.15])
    assert [frame.frame for frame in read_frames(recording)] == [0, 1, 3]
    assert [frame.position for frame in read_frames(recording)] == [0, 1, 2]


@pytest.mark.parametrize("absent", ["equipment", "subject", "camera_to_world"])
def test_what_may_be_unknown_may_be_null_or_absent(tmp_path, absent):
    folder = write_recording(tmp_path / "r")
    for change in (lambda d: d.update({absent: None}), lambda d: d.pop(absent)):
        edit_json(folder / "recording.json", lambda d, c=change: c(d if absent in d else d["cameras"][0]))
        recording = open_recording(folder)
        unknown = {"equipment": recording.equipment, "subject": recording.subject.height_m}
        assert unknown.get(absent, recording.cameras[0].T_world_camera) is None


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def _flip_a_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))


DAMAGE = {
    "truncated": _truncate,
    "checksum is wrong": _flip_a_byte,
    "not a PNG": lambda path: path.write_bytes(b"JFIF" * 30),
    "not 16-bit grey": lambda path: write_picture(path, np.zeros((HEIGHT, WIDTH), np.uint8)),
    "colour type 2": lambda path: write_picture(path, np.zeros((HEIGHT, WIDTH, 3), np.uint16)),
    "32 x 25": lambda path: write_picture(path, np.ones((HEIGHT + 1, WIDTH), np.uint16)),
}


@pytest.mark.parametrize("problem", DAMAGE)
@pytest.mark.parametrize("frame", [0, 2])
def test_one_damaged_picture_is_missing_and_named_and_the_rest_is_read(tmp_path, problem, frame):
    folder = write_recording(tmp_path / "r", frames=4, cameras=("front", "left"))
    DAMAGE[problem](folder / "left" / "depth" / f"{frame:06d}.png")
    sets = list(read_frames(open_recording(folder)))
    assert [depths.depths_m[1] is None for depths in sets] == [number == frame for number in range(4)]
    assert all(depths.depths_m[0] is not None for depths in sets)
    assert [len(depths.problems) for depths in sets] == [int(number == frame) for number in range(4)]
    assert f"left/depth/{frame:06d}.png" in sets[frame].problems[0]
    assert problem in sets[frame].problems[0]


@pytest.mark.parametrize("problem", DAMAGE)
def test_a_camera_without_a_single_sound_picture_is_refused(tmp_path, problem):
    folder = write_recording(tmp_path / "r", frames=3)
    for frame in range(3):
        DAMAGE[problem](folder / "front" / "depth" / f"{frame:06d}.png")
    with pytest.raises(InputError, match=f"000000.png.*{problem}"):
        open_recording(folder)


def test_every_file_that_is_read_is_an_input_and_those_of_a_file_browser_are_not(tmp_path):
    folder = write_recording(tmp_path / "r", frames=2)
    (folder / "notes.txt").write_text("the patient felt well")
    files = {path.relative_to(folder).as_posix() for path in input_files(open_recording(folder))}
    pictures = {"front/background.png", "front/depth/000000.png", "front/depth/000001.png"}
    assert files == {"recording.json", "equipment.json", "front/timestamps.csv", *pictures}
    (folder / "front" / "depth" / "._000000.png").write_bytes(b"x")
    (folder / "front" / "depth" / "Thumbs.db").write_bytes(b"x")
    assert len(open_recording(folder).streams[0].files) == 2


def test_timestamps_with_carriage_returns_and_a_byte_order_mark_are_read(tmp_path):
    folder = write_recording(tmp_path / "r", frames=2)
    (folder / "front" / "timestamps.csv").write_bytes(b"\xef\xbb\xbfframe,time_s\r\n0,1.5\r\n1,1.6\r\n\r\n")
    np.testing.assert_allclose(open_recording(folder).streams[0].time_s, [1.5, 1.6])


def test_frames_keep_the_numbers_of_their_files(tmp_path):
    folder = write_recording(tmp_path / "r", frames=4)
    (folder / "front" / "depth" / "000001.png").unlink()
    write_timestamps(folder / "front", [(0, 0.0), (2, 0.2), (3, 0.3)])
    assert [frame.frame for frame in read_frames(open_recording(folder))] == [0, 2, 3]


@pytest.mark.skipif(not DATA.exists(), reason="the shared development data is not here")
def test_every_shared_recording_opens_and_gives_a_frame():
    folders = [path.parent for path in sorted(DATA.rglob("recording.json"))]
    assert len(folders) > 90
    for folder in folders:
        frame = next(iter(read_frames(open_recording(folder))))
        assert frame.problems == ()
        assert all(depth is not None and depth.max() > 0.5 for depth in frame.depths_m)
