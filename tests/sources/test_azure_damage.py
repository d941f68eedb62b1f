"""Damaged recordings of Azure Kinect: the frames that can be read with a note, or one sentence."""

from pathlib import Path

import pytest
from azure_builder import calibration, cluster, images, mkv, recording, write

from anchorpose.errors import InputError
from anchorpose.sources.azure_kinect import AzureKinectFile, open_source


def opened(tmp_path: Path, content: bytes) -> AzureKinectFile:
    return open_source(write(tmp_path / "front.mkv", content))


def test_a_file_cut_short_gives_the_frames_before_the_cut_with_a_note(tmp_path: Path) -> None:
    content = recording(4)
    source = opened(tmp_path, content[: len(content) - images(1, "NFOV_2X2BINNED")[0].nbytes - 1000])
    assert len(list(source.frames())) == 3
    assert any("cut short" in note for note in source.notes)


def test_a_recorder_that_was_stopped_by_force_states_no_length(tmp_path: Path) -> None:
    content = recording(2)
    place = content.index(b"\x18\x53\x80\x67") + 4
    source = opened(tmp_path, content[:place] + b"\x01" + b"\xff" * 7 + content[place + 8 :])
    assert len(list(source.frames())) == 2
    assert any("did not close it" in note for note in source.notes)


@pytest.mark.parametrize("damaged_us", [900_000_000, 0, 33_345])
def test_one_damaged_time_costs_one_frame(tmp_path: Path, damaged_us: int) -> None:
    times = [100, 33_345, damaged_us, 100_012, 133_345]
    source = opened(tmp_path, mkv(images(5, "NFOV_2X2BINNED"), times, attached=calibration(), tags={}))
    assert [round(frame.time_s * 1e6) for frame in source.frames()] == [100, 33_345, 100_012, 133_345]
    assert source.notes[-1] == "depth images left out because their size or time is damaged: 1"
    list(source.frames())
    assert source.notes[-1].endswith(": 1")


def test_an_image_of_the_wrong_size_is_left_out(tmp_path: Path) -> None:
    content = recording(1)
    small = cluster(50_000, [(2, b"\0" * 100)])
    source = opened(tmp_path, content + small + cluster(90_000, [(2, b"\0" * (2 * 320 * 288))]))
    assert [round(frame.time_s * 1e6) for frame in source.frames()] == [336_289, 426_277]
    assert any(note.endswith("damaged: 1") for note in source.notes)


def test_a_recording_without_one_image_is_refused(tmp_path: Path) -> None:
    content = recording(1)
    empty = content[: content.index(b"\x1f\x43\xb6\x75")]
    with pytest.raises(InputError, match="as a Matroska file"):
        opened(tmp_path, empty)
    source = opened(tmp_path, empty + cluster(0, [(2, b"\0" * 100)]))
    with pytest.raises(InputError, match="no depth image"):
        list(source.frames())
