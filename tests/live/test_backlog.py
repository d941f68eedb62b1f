"""What waits while the body is learnt is caught up with, however slow the machine is."""

import time

import numpy as np
import pytest

from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics
from anchorpose.live.feed import Feed, LiveImage, LiveSet
from anchorpose.live.first_seconds import STEP_S, Backlog, _pack

INTRINSICS = Intrinsics(fx=3.0, fy=3.0, cx=2.0, cy=1.5)
CAMERA = Camera(name="front", width=4, height=3, depth_scale=0.001, intrinsics=INTRINSICS)


def waiting(count: int) -> Backlog:
    """With so many sets, ``STEP_S`` apart; no more come."""
    feed = Feed(2)
    feed.use((1,))
    feed.close()
    backlog = Backlog(feed, [CAMERA])
    for number in range(count):
        image = LiveImage(1, number, STEP_S * number, STEP_S * number, np.full((3, 4), 7, np.uint16))
        backlog._packed.append(_pack(LiveSet((image,), 0, image.taken_s)))
    return backlog


@pytest.mark.parametrize(("follow_s", "taken"), [(0.0, list(range(10))), (0.25, [0, 3, 6, 9])])
def test_all_are_taken_in_order_but_where_following_is_slow_some_are_left_out_and_never_the_newest(follow_s, taken):
    """0.25 s is longer than the sets are apart: one by one, they would never end."""
    backlog, numbers = waiting(10), []
    while (found := backlog.take()) is not None:
        numbers.append(found.images[0].number)
        assert (found.images[0].grey == 7).all()
        time.sleep(follow_s)
    assert numbers == taken
