"""People who stay in place for a whole recording sway by millimetres; mannequins and furniture do not."""

from __future__ import annotations

import numpy as np
import pytest
from room_builder import FRONT, NOISE_PER_M, ROOM, body, in_front, picture

from anchorpose.isolation.background import foreground
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.still_people import swaying_people
from anchorpose.recording.equipment import Box

CUPBOARD = Box("cupboard", np.array([-1.0, 0.9, 1.0]), np.array([0.4, 1.8, 0.6]), np.eye(3))


def seen_over_time(sway_m: float, drift_m: float = 0.0) -> list[np.ndarray]:
    """Somebody who sways so far about one place beside a cupboard; drift_m: of all readings, in patches."""
    rng, frames = np.random.default_rng(3), []
    for k in range(16):
        depth = picture(FRONT, *ROOM, CUPBOARD, *body(sway_m * np.sin(1.3 * k), 0.0), seed=k)
        patches = np.kron(rng.normal(0.0, drift_m, (14, 16)), np.ones((16, 16)))[: depth.shape[0], : depth.shape[1]]
        frames.append((depth + patches * (depth > 0)).astype(np.float32))
    return frames


def found(frames) -> np.ndarray:
    """(height, width) bool: who stands out from the room that was learnt from the frames."""
    model = learn_background(None, frames, FRONT, 0.0, swaying=True)
    return foreground(picture(FRONT, *ROOM, CUPBOARD, *body(0.0, 0.0), seed=30), model)


def test_who_sways_by_millimetres_is_no_furniture():
    frames, expected = seen_over_time(0.005), in_front(FRONT, *body(0.0, 0.0))
    live = picture(FRONT, *ROOM, CUPBOARD, *body(0.0, 0.0), seed=30)
    without = foreground(live, learn_background(None, frames, FRONT, 0.0))
    assert without[expected].mean() < 0.05, "who moves by less than the noise is taken for the room at first"
    assert found(frames)[expected].mean() > 0.9
    assert found(frames)[~expected].mean() < 0.01


@pytest.mark.parametrize(("sway_m", "drift_m"), [(0.0, 0.0), (0.005, 0.01)], ids=["a mannequin", "readings that drift"])
def test_what_sways_no_more_than_the_furniture_stays_room(sway_m, drift_m):
    assert found(seen_over_time(sway_m, drift_m)).mean() < 0.01


def test_a_room_of_which_nothing_else_is_seen_shows_nobody():
    """Without furniture to compare with, swaying says nothing."""
    alone = [picture(FRONT, *body(0.005 * np.sin(1.3 * k), 0.0), seed=k) for k in range(16)]
    assert not swaying_people(alone[0], alone, FRONT, 0.0, NOISE_PER_M).any()
