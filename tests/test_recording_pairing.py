"""Pictures of several cameras are paired by time, each used once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_builder import write_recording, write_timestamps

from anchorpose.errors import InputError
from anchorpose.recording.pairing import nearest_within, pair_frames
from anchorpose.recording.reader import open_recording, read_frames

times = st.lists(st.integers(0, 400), min_size=1, max_size=30, unique=True).map(lambda t: np.sort(t) / 100.0)


@given(time_s=times, other_s=times, within_s=st.sampled_from([0.005, 0.02, 0.1]))
def test_pairs_are_the_mutually_nearest_within_reach(time_s, other_s, within_s):
    match = nearest_within(time_s, other_s, within_s)
    gap = np.abs(time_s[:, None] - other_s)
    for row, column in enumerate(match):
        if column >= 0:
            assert gap[row, column] <= within_s + 1e-9
            assert gap[row, column] == gap[row].min() == gap[:, column].min()
        else:
            nearest = gap[row].argmin()
            taken_or_far = gap[row, nearest] > within_s or gap[:, nearest].min() <= gap[row, nearest]
            assert taken_or_far
    used = match[match >= 0]
    assert len(set(used.tolist())) == len(used)


@given(time_s=times)
def test_a_camera_is_paired_with_itself(time_s):
    np.testing.assert_array_equal(nearest_within(time_s, time_s, 0.001), np.arange(len(time_s)))


def test_a_slower_camera_is_missing_between_its_pictures_and_never_stale(tmp_path):
    folder = write_recording(tmp_path / "r", frames=4, cameras=("front", "left"))
    write_timestamps(folder / "left", [(0, 0.03), (1, 0.23), (2, 0.43), (3, 0.63)])
    recording = open_recording(folder)
    np.testing.assert_array_equal(pair_frames(recording)[:, 1], [0, -1, 1, -1])
    sets = list(read_frames(recording))
    assert [frame.depths_m[1] is None for frame in sets] == [False, True, False, True]
    assert all(frame.problems == () for frame in sets)


def test_clock_offsets_are_added_to_the_cameras_clock(tmp_path):
    folder = write_recording(tmp_path / "r", frames=3, cameras=("front", "left"))
    write_timestamps(folder / "left", [(0, 100.0), (1, 100.1), (2, 100.2)])
    recording = open_recording(folder)
    np.testing.assert_array_equal(pair_frames(recording, clock_offset_s=(0.0, -100.0))[:, 1], [0, 1, 2])


def test_another_reference_camera_gives_its_own_clock(tmp_path):
    folder = write_recording(tmp_path / "r", frames=3, cameras=("front", "left"))
    write_timestamps(folder / "left", [(0, 0.11), (1, 0.21), (2, 0.31)])
    first = next(iter(read_frames(open_recording(folder), reference=1)))
    assert first.time_s == pytest.approx(0.11)
    assert first.depths_m[0][5, 5] == pytest.approx(2.001)


def test_cameras_that_never_meet_are_refused_by_name(tmp_path):
    folder = write_recording(tmp_path / "r", frames=3, cameras=("front", "left"))
    write_timestamps(folder / "left", [(0, 50.0), (1, 50.1), (2, 50.2)])
    recording = open_recording(folder)
    with pytest.raises(InputError, match=r"left.timestamps.csv: camera left never overlaps in time with camera front"):
        read_frames(recording)


def test_single_pictures_pair_when_a_usual_camera_would_have_taken_them_together(tmp_path):
    folder = write_recording(tmp_path / "r", frames=1, cameras=("front", "left"))
    write_timestamps(folder / "left", [(0, 0.01)])
    np.testing.assert_array_equal(pair_frames(open_recording(folder)), [[0, 0]])
