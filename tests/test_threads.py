"""Work per camera in threads: the same results in the same order, whatever their number."""

from __future__ import annotations

import threading
import time

import pytest

from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import camera_threads, for_each_camera


def test_results_come_in_the_order_of_the_cameras_whichever_is_done_first():
    def late(camera: int) -> int:
        time.sleep(0.02 * (3 - camera))
        return camera

    with camera_threads(4):
        assert for_each_camera(late, [0, 1, 2]) == [0, 1, 2]


@pytest.mark.parametrize(("count", "together"), [(1, False), (2, True)])
def test_cameras_are_worked_on_at_the_same_time_where_threads_are_allowed(count, together):
    both = threading.Barrier(2)

    def meet(_: int) -> bool:
        try:
            both.wait(0.5)
        except threading.BrokenBarrierError:
            return False
        return True

    with camera_threads(count):
        assert for_each_camera(meet, [0, 1]) == [together, together]


def test_an_error_in_a_thread_is_raised():
    def fail(camera: int) -> None:
        raise ValueError(f"camera {camera}")

    with camera_threads(2), pytest.raises(ValueError, match="camera 0"):
        for_each_camera(fail, [0, 1])


def test_work_inside_the_work_of_a_camera_does_not_wait_for_itself():
    with camera_threads(2):
        assert for_each_camera(lambda _: for_each_camera(abs, [-1, -2]), range(4)) == [[1, 2]] * 4


@pytest.mark.slow
def test_a_clinic_is_tracked_to_the_same_bytes_by_one_thread_and_by_four(tmp_path):
    simulate_recording(tmp_path / "clinic", clinic(21, seconds=1.5, fps=8.0))
    tables = []
    for count in (1, 4):
        results = tmp_path / str(count)
        results.mkdir()
        with camera_threads(count):
            track_recording(tmp_path / "clinic/recording", results, TrackConfig(), lambda done, total: None)
        tables.append({path.name: path.read_bytes() for path in sorted(results.glob("*.parquet"))})
    assert "joints.parquet" in tables[0]
    assert tables[0] == tables[1]
