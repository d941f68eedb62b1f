"""Damaged bags: one sentence, or the images before the damage with a note; never another error, never other depth."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sources_builder import peak_bytes

pytest.importorskip("rosbags")

from bags_builder import FORMATS, SIZE, Sent, depth_bag, depth_values, expected, image_of, write_bag

from anchorpose.errors import InputError, MissingPackage
from anchorpose.sources.bag_file import files_of, open_bag
from anchorpose.sources.ros_bags import open_source

IMAGE = "sensor_msgs/msg/Image"


def read_all(path: Path) -> tuple[list[Any], tuple[str, ...]]:
    source = open_source(path)
    frames = list(source.frames())
    return frames, source.notes


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "db3-folder"])
def test_what_is_before_the_cut_is_read_bit_for_bit(tmp_path: Path, form: str) -> None:
    path = depth_bag(tmp_path, form)
    whole = path.read_bytes()
    for share in np.linspace(0.0, 0.98, 30):
        path.write_bytes(whole[: int(share * len(whole))])
        try:
            frames, notes = read_all(path)
        except InputError:
            continue
        for k, frame in enumerate(frames):
            assert np.array_equal(frame.depth, expected(depth_values(k)))
        assert len(frames) == 4 or notes


def test_a_recorder_of_ros_1_that_was_killed_leaves_what_it_wrote(tmp_path: Path) -> None:
    """Without the index, and with the last image cut in half."""
    path = depth_bag(tmp_path, "ros1", count=6)
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.rindex(depth_values(5).tobytes()) + 100])
    frames, notes = read_all(path)
    assert len(frames) == 5
    assert all(np.array_equal(frame.depth, expected(depth_values(k))) for k, frame in enumerate(frames))
    assert "no usable index" in notes[-2]


def test_an_mcap_file_without_its_end_is_refused_with_the_tool_that_repairs_it(tmp_path: Path) -> None:
    path = depth_bag(tmp_path, "mcap")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"recorded\.mcap: the bag is damaged: .*'mcap recover FILE -o NEW'"):
        read_all(path)


def test_a_broken_chunk_ends_the_reading_with_a_note(tmp_path: Path) -> None:
    """Images of a quarter of a megabyte, so that each megabyte chunk of rosbags' writer holds a few."""
    values = np.random.default_rng(1).integers(500, 5000, (360, 400)).astype(np.uint16)
    sent = [Sent("/depth/image", IMAGE, k, image_of(values + k, "16UC1", 5 + k)) for k in range(16)]
    path = write_bag(tmp_path, "ros1-bz2", sent)
    data = bytearray(path.read_bytes())
    place = [found.end() for found in re.finditer(b"compression=bz2", data)][3]
    data[place + 3000] ^= 255
    path.write_bytes(data)
    frames, notes = read_all(path)
    assert 4 <= len(frames) < 16
    assert all(np.array_equal(frame.depth, values + k) for k, frame in enumerate(frames))
    assert "what follows is missing: repair it with 'rosbag reindex" in notes[-1]


@pytest.mark.parametrize("form", ["ros1", "db3", "mcap"])
def test_an_image_that_changes_its_size_is_left_out(tmp_path: Path, form: str) -> None:
    topic = "/camera/depth/image"
    small = np.ones((SIZE[0] - 2, SIZE[1]), np.uint16)
    values = (depth_values(0), small, depth_values(2))
    sent = [Sent(topic, IMAGE, k, image_of(v, "16UC1", 5 + k)) for k, v in enumerate(values)]
    frames, notes = read_all(write_bag(tmp_path, form, sent))
    assert len(frames) == 2
    assert notes[1:] == ("1 depth images of camera are damaged: left out.",)


@pytest.mark.parametrize("encoding", ["32FC1", "bgr8", "16SC1"])
def test_an_image_that_changes_its_encoding_is_left_out(tmp_path: Path, encoding: str) -> None:
    """Its bytes are enough for the camera's size, so that they would pass for depth."""
    other = image_of(depth_values(1).astype(np.float32), encoding, 6)
    builds = (image_of(depth_values(0), "16UC1", 5), other, image_of(depth_values(2), "mono16", 7))
    sent = [Sent("/camera/depth/image", IMAGE, k, build) for k, build in enumerate(builds)]
    frames, notes = read_all(write_bag(tmp_path, "db3", sent))
    assert [round(frame.time_s * 1e9) for frame in frames] == [5, 7]
    assert notes[1:] == ("1 depth images of camera are damaged: left out.",)


@pytest.mark.parametrize(
    ("form", "module"),
    [("ros1", "rosbags.rosbag1"), ("mcap", "rosbags.rosbag2.storage_mcap"), ("db3-zstd", "backports.zstd")],
)
def test_a_missing_library_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str, module: str
) -> None:
    path = depth_bag(tmp_path, form)
    monkeypatch.setitem(sys.modules, module, None)
    parent, _, name = module.rpartition(".")
    monkeypatch.delattr(sys.modules[parent], name)
    with pytest.raises(MissingPackage, match=r"anchorpose\[ros\]"):
        read_all(path)


def test_the_files_of_a_folder_are_read_by_their_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for k in (2, 10, 9):
        (tmp_path / str(k)).mkdir()
        sent = [Sent("/depth/image", IMAGE, k, image_of(depth_values(k), "16UC1", 10**9 * k))]
        write_bag(tmp_path / str(k), "db3", sent).rename(folder / f"bag_{k}.db3")
    frames, _ = read_all(folder)
    assert [frame.time_s for frame in frames] == [2.0, 9.0, 10.0]


def test_names_that_begin_with_a_number_come_before_names_that_begin_with_letters(tmp_path: Path) -> None:
    names = ["2.mcap", "10_walk.db3", "bag_3.db3", "bag_20.mcap", "bag_x.db3"]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in files_of(tmp_path)] == names


@pytest.mark.parametrize("form", ["ros1", "db3", "mcap"])
def test_memory_does_not_grow_with_the_length(tmp_path: Path, form: str) -> None:
    peaks = []
    for count in (40, 160):
        (tmp_path / str(count)).mkdir()
        image = image_of(np.full((240, 320), 1500, np.uint16), "16UC1", 5)
        path = write_bag(tmp_path / str(count), form, (Sent("/depth/image", IMAGE, k, image) for k in range(count)))
        peaks.append(peak_bytes(lambda path=path: sum(1 for _ in open_source(path).frames())))
    assert peaks[1] < peaks[0] + 500_000  # of 18 MB of images that came in addition


def test_messages_of_other_topics_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a damaged file two topics may have one number, so that a reader gives both."""
    bag = open_bag(depth_bag(tmp_path, form="ros1"))
    asked = bag.channels[0].topic
    assert len({channel.topic for channel in bag.channels}) > 1
    (file,) = bag._files
    read = file._read
    monkeypatch.setattr(file, "_read", lambda numbers: read(list(file._connections)))
    found = list(bag.messages((asked,)))
    assert found
    assert {message.channel.topic for message in found} == {asked}
