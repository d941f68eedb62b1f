"""Pictures of several cameras are paired by time, each used once."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_builder import write_recording, write_timestamps

from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.recording import (
    Clock,
    DepthStream,
    Recording,
    align_clocks,
    find_gaps,
    nearest_within,
    nominal_period_s,
    pair_frames,
)

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


def two_cameras(folder: Path, *left_s: float) -> Recording:
    """A recording of as many frames, ten a second; the times of the left camera are given."""
    write_recording(folder / "r", frames=len(left_s), cameras=("front", "left"))
    write_timestamps(folder / "r" / "left", list(enumerate(left_s)))
    return open_recording(folder / "r")


def test_a_slower_camera_is_missing_between_its_pictures_and_never_stale(tmp_path):
    recording = two_cameras(tmp_path, 0.03, 0.23, 0.43, 0.63)
    np.testing.assert_array_equal(pair_frames(recording)[:, 1], [0, -1, 1, -1])
    sets = list(read_frames(recording))
    assert [frame.depths_m[1] is None for frame in sets] == [False, True, False, True]
    assert all(frame.problems == () for frame in sets)


def test_cameras_are_paired_on_the_reference_clock(tmp_path):
    recording = align_clocks(two_cameras(tmp_path, 100.0, 100.1, 100.2), (Clock(), Clock(ahead_s=100.0)))
    np.testing.assert_array_equal(pair_frames(recording)[:, 1], [0, 1, 2])


def test_cameras_that_never_meet_are_refused_by_name(tmp_path):
    recording = two_cameras(tmp_path, 50.0, 50.1, 50.2)
    with pytest.raises(InputError, match=r"left.timestamps.csv: camera left never overlaps in time with camera front"):
        read_frames(recording)


def test_when_each_picture_was_taken_is_said_on_the_reference_clock(tmp_path):
    recording = align_clocks(two_cameras(tmp_path, 100.01, 100.11, 100.31), (Clock(), Clock(ahead_s=100.0)))
    sets = list(read_frames(recording))
    assert (sets[0].taken_s, sets[1].taken_s) == (pytest.approx((0.0, 0.01)), pytest.approx((0.1, 0.11)))
    assert sets[2].taken_s[1] is None


def test_a_doubled_picture_is_nobodys_pair(tmp_path):
    folder = write_recording(tmp_path / "r", frames=4, cameras=("front", "left"))
    shutil.copyfile(folder / "left/depth/000001.png", folder / "left/depth/000002.png")
    shutil.copyfile(folder / "front/depth/000002.png", folder / "front/depth/000003.png")
    recording = open_recording(folder)
    np.testing.assert_array_equal(pair_frames(recording), [[0, 0], [1, 1], [2, -1], [-1, 3]])
    front, left = find_gaps(recording)
    assert (front.duplicates, left.duplicates, left.usable) == (1, 1, 3)
    assert left.sentence == "camera left: 1 equal the previous depth image and were left out"


def test_pictures_without_noise_are_not_called_doubled(tmp_path):
    folder = write_recording(tmp_path / "r", frames=4)
    for frame in range(1, 4):
        shutil.copyfile(folder / "front/depth/000000.png", folder / f"front/depth/{frame:06d}.png")
    assert not open_recording(folder).streams[0].duplicate.any()


def test_a_stamp_given_twice_leaves_its_picture_out_and_a_clock_set_back_is_refused(tmp_path):
    folder = write_recording(tmp_path / "r", frames=12)
    write_timestamps(folder / "front", [(k, 0.1 * (k - (k == 5))) for k in range(12)])
    recording = open_recording(folder)
    assert recording.streams[0].frame.tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    assert find_gaps(recording)[0].repeated == 1
    folder = write_recording(tmp_path / "r", frames=3)
    write_timestamps(folder / "front", [(0, 0.0), (1, 0.1), (2, 0.05)])
    with pytest.raises(InputError, match=r"frame 2 is not later than 0.1 s; .*set back"):
        open_recording(folder)


def test_late_starts_early_ends_pauses_and_drops_are_said_once(tmp_path):
    folder = write_recording(tmp_path / "r", frames=60, cameras=("front", "left"))
    kept = [k for k in range(60) if 15 <= k <= 45 and k not in (20, 21) and not 28 <= k <= 40]
    for k in set(range(60)) - set(kept):
        (folder / f"left/depth/{k:06d}.png").unlink()
    write_timestamps(folder / "left", [(k, 0.1 * k) for k in kept])
    front, left = find_gaps(open_recording(folder))
    assert (front.sentence, left.late_s, left.early_s) == ("", pytest.approx(1.5), pytest.approx(1.4))
    assert left.dropped == 2
    assert left.pauses == (pytest.approx((2.7, 4.1)),)
    assert left.paired_share == pytest.approx(len(kept) / 60)
    assert "starts 1.5 s late; it ends 1.4 s early; it has no depth images from 2.7 to 4.1 s" in left.sentence


def stream(time_s: np.ndarray, fps: float | None = None) -> DepthStream:
    return DepthStream(files=(), time_s=time_s, frame=np.arange(len(time_s)), fps=fps)


ALL = np.arange(240) / 30.0
JITTER_S = np.random.default_rng(3).normal(0.0, 0.004, 240).clip(-0.008, 0.008)


@pytest.mark.parametrize(
    ("kept", "hz"),
    [
        pytest.param(np.arange(240) >= 0, 30.0, id="all"),
        pytest.param(np.arange(240) % 3 > 0, 30.0, id="every third lost"),
        pytest.param(np.arange(240) % 5 < 2, 30.0, id="three of five lost"),
        pytest.param(np.arange(240) % 2 == 0, 15.0, id="half of them, which is another rate"),
        pytest.param(np.arange(240) % 3 == 0, 10.0, id="a rate that no camera has"),
        pytest.param(np.random.default_rng(1).random(240) < 0.4, 30.0, id="most lost at random"),
    ],
)
@pytest.mark.parametrize("jitter_s", [0.0 * JITTER_S, JITTER_S], ids=["even", "jitter"])
def test_the_period_is_that_of_a_camera_that_lost_nothing(kept, hz, jitter_s):
    assert 1.0 / nominal_period_s(stream((ALL + jitter_s)[kept])) == pytest.approx(hz, rel=0.06)


def test_the_stated_rate_finds_that_every_second_frame_is_lost():
    assert nominal_period_s(stream(ALL[::2], fps=30.0)) == pytest.approx(1 / 30.0)
    assert nominal_period_s(stream(ALL[:1])) == 0.0


def test_a_regular_loss_is_counted(tmp_path):
    folder = write_recording(tmp_path / "r", frames=30)
    write_timestamps(folder / "front", [(k, k / 30.0) for k in range(30) if k % 3])
    for k in range(0, 30, 3):
        (folder / f"front/depth/{k:06d}.png").unlink()
    assert find_gaps(open_recording(folder))[0].dropped == 9  # the tenth was before the first frame that is there
