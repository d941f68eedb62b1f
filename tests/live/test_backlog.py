"""What waits while the body is learnt is caught up with, however slow the machine is."""

import time

import numpy as np

from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics
from anchorpose.live.feed import Feed, LiveImage, LiveSet
from anchorpose.live.first_seconds import STEP_S, Backlog, _pack

INTRINSICS = Intrinsics(fx=3.0, fy=3.0, cx=2.0, cy=1.5)
CAMERA = Camera(name="front", width=4, height=3, depth_scale=0.001, intrinsics=INTRINSICS)


def waiting(count: int) -> Backlog:
    """With so many sets, ``STEP_S`` apart; no more come."""
    feed = Feed(1)
    feed.close()
    backlog = Backlog(feed, [CAMERA])
    for number in range(count):
        image = LiveImage(0, number, STEP_S * number, STEP_S * number, np.full((3, 4), 7, np.uint16))
        backlog._packed.append(_pack(LiveSet((image,), 0, image.taken_s)))
    return backlog


def test_all_are_taken_in_order_where_following_is_fast():
    backlog = waiting(10)
    numbers = []
    while (found := backlog.take()) is not None:
        numbers.append(found.images[0].number)
        assert (found.images[0].grey == 7).all()
    assert numbers == list(range(10))


def test_some_are_left_out_where_following_is_slow_and_the_newest_is_kept():
    backlog = waiting(10)
    numbers = []
    while (found := backlog.take()) is not None:
        numbers.append(found.images[0].number)
        time.sleep(0.25)  # longer than the sets are apart: one by one, they would never end
    assert numbers == [0, 3, 6, 9]
