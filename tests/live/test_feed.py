"""The newest images of all cameras as one set: nothing queues, nobody waits for a camera that is silent."""

import threading
import time

import numpy as np
import pytest

from anchorpose.live.feed import Feed, LiveImage
from anchorpose.live.follow import LatencyMeter

GREY = np.zeros((2, 2), np.uint16)


def image(camera: int, number: int, taken_s: float) -> LiveImage:
    return LiveImage(camera, number, 100.0 + taken_s, taken_s, GREY)


def test_the_newest_complete_set_is_given_once_and_what_nobody_took_is_counted():
    feed, now_s = Feed(1), time.monotonic()
    for number in range(3):
        feed.put(image(0, number, now_s - 0.2 + 0.06 * number))
    assert feed.take(0.1).images[0].number == 2
    assert feed.take(0.05) is None
    feed.put(image(0, 7, now_s + 0.01))
    found = feed.take(0.2)
    assert (found.images[0].number, found.skipped) == (7, 4)


def test_a_set_waits_for_the_other_camera_but_no_longer_than_a_period():
    feed, now_s = Feed(2), time.monotonic()
    for number, taken_s in enumerate((now_s - 0.21, now_s - 0.01)):
        feed.put(image(0, number, taken_s))
    feed.put(image(1, 0, now_s - 0.20))
    began_s = time.monotonic()
    threading.Timer(0.05, feed.put, (image(1, 1, now_s + 0.02),)).start()
    found = feed.take(1.0)
    assert [one.number for one in found.images] == [1, 1]
    assert 0.03 < time.monotonic() - began_s < 0.19


def test_a_silent_camera_is_left_out_and_another_one_is_the_reference():
    feed, now_s = Feed(2), time.monotonic()
    feed.put(image(0, 0, now_s - 5.0))
    feed.put(image(1, 40, now_s - 0.05))
    found = feed.take(0.2)
    assert found.reference == 1
    assert found.images[0] is None
    assert feed.silent() == (0,)


def test_a_camera_that_is_not_used_is_neither_the_reference_nor_in_a_set_nor_waited_for():
    feed, now_s = Feed(3), time.monotonic()
    feed.use((2, 1))
    feed.put(image(0, 90, now_s - 0.01))
    feed.put(image(1, 40, now_s - 0.05))
    feed.put(image(2, 70, now_s - 0.05))
    found = feed.take(0.2)
    assert [one.number for one in found.images] == [70, 40]
    assert found.images[found.reference].camera == 2
    feed.close()
    assert feed.take(0.2) is None


def test_images_half_a_period_apart_do_not_belong_together():
    feed, now_s = Feed(2), time.monotonic()
    for number in range(3):
        feed.put(image(0, number, now_s - 0.25 + 0.1 * number))
    for taken_s in (now_s - 0.12, now_s + 0.03):
        feed.put(image(1, 0, taken_s))
    assert [one and one.number for one in feed.take(0.2).images] == [2, None]


def test_a_camera_that_is_always_late_does_not_keep_the_tracker_waiting():
    feed, now_s = Feed(2), time.monotonic()
    for number in range(4):
        feed.put(image(0, number, now_s - 0.37 + 0.1 * number))
    feed.put(image(1, 0, now_s - 0.16))
    assert [one.number for one in feed.take(0.02).images] == [2, 0]


def test_latencies_are_known_to_a_millisecond_in_constant_memory():
    meter, drawn = LatencyMeter(), np.random.default_rng(3).gamma(3.0, 0.02, 5000)
    for latency_s in drawn:
        meter.add(latency_s, dropped=1)
    for share in (0.5, 0.99):
        assert meter.quantile_s(share) == pytest.approx(np.quantile(drawn, share), abs=0.0015)
    assert (meter.count, meter.dropped) == (5000, 5000)
    assert "no frame" in LatencyMeter().sentence
