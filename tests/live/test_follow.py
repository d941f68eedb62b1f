"""Frames reach the tracker in the order of time, with increasing numbers, and without images that cannot be used."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from anchorpose.camera import Camera
from anchorpose.isolation.other_place import SENTENCE
from anchorpose.lens import Intrinsics
from anchorpose.live.feed import Feed, LiveImage
from anchorpose.live.follow import LatencyMeter, LiveFollower
from anchorpose.recording.recording import Clock, FrameSet

SHAPE = (48, 64)
WALL = np.full(SHAPE, 2000, np.uint16) + (np.arange(64) // 8).astype(np.uint16)
NEAR, EMPTY = WALL - 1700, np.zeros(SHAPE, np.uint16)
LENS = Intrinsics(fx=60.0, fy=60.0, cx=32.0, cy=24.0)
CAMERAS = [Camera(name=name, width=64, height=48, depth_scale=0.001, intrinsics=LENS) for name in ("left", "right")]
T0_S = time.monotonic()


class Collecting:
    """A follower that keeps the frame sets and estimates nothing."""

    def __init__(self):
        self.taken = []

    def step(self, frame_set):
        self.taken.append(frame_set)
        return iter(())


@pytest.fixture
def live():
    """A tracker of two cameras, the second of which has a clock that is half a second ahead."""
    wall_m = WALL.astype(np.float32) / 1000.0
    model = SimpleNamespace(depth_m=wall_m, sigma_m=np.full(SHAPE, 0.002, np.float32), usual_share=1.0)
    scenes = tuple(SimpleNamespace(camera=camera, background=model) for camera in CAMERAS)
    clocks = SimpleNamespace(clocks=(Clock(), Clock(ahead_s=0.5)))
    room = SimpleNamespace(recording=SimpleNamespace(cameras=CAMERAS), clocks=clocks, scenes=scenes)
    patient = SimpleNamespace(run=SimpleNamespace(room=room))
    return LiveFollower(patient, None, Collecting(), None, with_labels=False, latency=LatencyMeter())


def image(camera: int, number: int, after_s: float, grey: np.ndarray = WALL) -> LiveImage:
    return LiveImage(camera, number, 10.0 + after_s + 0.5 * camera, T0_S + after_s, grey)


def taken_from(*images: LiveImage):
    """The newest set of images, when no more come."""
    feed = Feed(2)
    for one in images:
        feed.put(one)
    feed.close()
    return feed._newest(max(one.taken_s for one in images) + 0.01)


def test_frames_go_on_with_increasing_numbers_while_the_first_camera_is_silent(live):
    live.take(taken_from(image(0, 700, 0.0), image(1, 40, 0.0)), live=True)
    live.take(taken_from(image(1, 71, 1.0)), live=True)
    live.take(taken_from(image(1, 75, 1.1)), live=True)
    live.take(taken_from(image(0, 736, 1.2), image(1, 78, 1.2)), live=True)
    live.take(taken_from(image(1, 79, 3.0)), live=True)
    assert [one.frame for one in live.follower.taken] == [700, 701, 702, 736, 737]
    assert [one.time_s for one in live.follower.taken] == pytest.approx([10.0, 11.0, 11.1, 11.2, 13.0])
    assert sorted(live._taken_s) == [700, 701, 702, 736, 737]


def test_a_frame_that_is_not_later_than_the_last_one_is_counted_as_dropped(live):
    live.take(taken_from(image(0, 1, 0.0), image(1, 1, 0.0)), live=True)
    live.take(taken_from(image(0, 1, 0.0), image(1, 1, 0.0)), live=False)  # the last of those that waited
    assert live.latency.dropped == 0
    live.take(taken_from(replace(image(0, 2, 0.1), time_s=9.0)), live=True)  # its clock was set back by a second
    assert (len(live.follower.taken), live.latency.dropped) == (1, 1)


def test_an_image_that_cannot_be_used_is_reported_with_its_camera(live):
    live.take(taken_from(image(0, 1, 0.0, EMPTY), image(1, 1, 0.0)), live=True)
    live.take(taken_from(image(0, 2, 0.1), image(1, 2, 0.1, NEAR)), live=True)
    first, second = live.follower.taken
    assert [depth is None for depth in first.depths_m] == [True, False]
    assert first.problems[0].startswith("camera left ")
    assert second.problems == (f"camera right {SENTENCE}",)


def test_recorded_first_seconds_are_tracked_without_images_of_another_place(live):
    depths_m = tuple(grey.astype(np.float32) / 1000.0 for grey in (NEAR, WALL))
    live.take_recorded(FrameSet(frame=5, time_s=10.0, depths_m=depths_m, taken_s=(10.0, 10.0)))
    (found,) = live.follower.taken
    assert [depth is None for depth in found.depths_m] == [True, False]
    assert found.problems == (f"camera left {SENTENCE}",)
