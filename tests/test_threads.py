"""Work shared among threads: the same bytes with one thread and with four."""

import time
from threading import Barrier, get_ident

import numpy as np
import pytest
from body_builder import true_shape

from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import each, worker_threads
from anchorpose.tracker.config import FollowConfig, TrackConfig
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run

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
    room = prepare_room(open_recording(tmp_path / "out/recording"), few)
    frames = [read_frame(room.recording, k) for k in range(FRAMES)]
    with np.load(tmp_path / "out/truth/truth.npz") as truth:
        shape = true_shape(truth["shape_coefficients"], 0.007)

    def joints(threads: int) -> list[bytes]:
        with worker_threads(threads):
            followed = follow_openly(Run(room, TrackConfig()), frames, room.initial_frames[0].choice, shape)
            return [np.concatenate([one.joints_m, one.sigma_m[:, None]], axis=1).tobytes() for one, _ in followed]

    alone, shared = joints(1), joints(4)
    assert len(alone) == FRAMES
    assert np.isfinite(np.frombuffer(alone[-1])).mean() > 0.9
    assert shared == alone
