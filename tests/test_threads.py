"""Work shared among threads: the same bytes with one thread and with four."""

import time
from threading import Barrier, get_ident

import numpy as np
import pyarrow.parquet as pq
import pytest

from anchorpose.joints import JOINT_COUNT
from anchorpose.pipeline import track_recording
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import each, worker_threads
from anchorpose.tracker.config import FollowConfig, TrackConfig

FRAMES = 5


def test_results_come_in_the_order_of_the_arguments_and_a_call_within_a_call_does_not_wait_for_itself():
    def slower_first(k: int) -> int:
        time.sleep(0.02 * (4 - k))
        return k

    with worker_threads(4):
        assert each(slower_first, range(4)) == [0, 1, 2, 3]
    with worker_threads(2):
        assert each(lambda _: each(lambda k: k, range(3)), range(4)) == [[0, 1, 2]] * 4


def test_calls_run_at_the_same_time_and_only_where_threads_are_given():
    with worker_threads(3):
        together = Barrier(3)
        assert sorted(each(lambda _: together.wait(timeout=10.0), range(3))) == [0, 1, 2]
    assert each(lambda _: get_ident(), range(3)) == [get_ident()] * 3


def test_an_error_and_arguments_of_unequal_number_are_raised():
    with worker_threads(2):
        with pytest.raises(ZeroDivisionError):
            each(lambda k: 1 // k, [1, 0])
        with pytest.raises(ValueError, match="shorter"):
            each(lambda a, b: a + b, [1, 2], [3])


@pytest.mark.thorough
def test_three_cameras_and_two_therapists_give_the_same_bytes_with_one_thread_and_with_four(tmp_path):
    simulate_recording(tmp_path / "out", clinic(7, seconds=FRAMES / 15.0))
    few = TrackConfig(follow=FollowConfig(samples=2))  # looking around takes longer than all the rest

    def tables(threads: int) -> dict[str, bytes]:
        results = tmp_path / f"results-{threads}"
        results.mkdir()
        track_recording(tmp_path / "out/recording", results, few, lambda done, total: None, threads=threads)
        return {file.name: file.read_bytes() for file in sorted(results.glob("*.parquet"))}

    alone = tables(1)
    joints = pq.read_table(tmp_path / "results-1/joints.parquet")
    assert {"joints.parquet", "poses.parquet", "contacts.parquet", "explained.parquet"} <= set(alone)
    assert len(joints) == FRAMES * JOINT_COUNT
    assert np.isfinite(joints["x_m"].to_numpy()).mean() > 0.9
    assert tables(4) == alone
