"""Where people went between two frames: found from the pixels, and only where they did not stay."""

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, built_scene, picture

from anchorpose.isolation.scene import Pieces, find_pieces
from anchorpose.tracker.steps import GRID_M, REACH_M, find_steps, step_onto

SCENE = built_scene()
FIRST, SECOND = 1, 2


def pixels(*people, seed: int = 1) -> Pieces:
    parts = [part for person in people for part in person]
    return find_pieces(picture(FRONT, *ROOM, *parts, seed=seed), SCENE)


def skin(shown: Pieces, x: float, z: float) -> np.ndarray:
    """What is seen of the person who stands at a place."""
    return shown.points_m[np.hypot(shown.points_m[:, 0] - x, shown.points_m[:, 2] - z) < 0.25]


def steps(before: dict[int, tuple[float, float]], after: list[tuple[float, float]]) -> dict[int, np.ndarray]:
    shown = pixels(*(body(*place) for place in before.values()))
    known = {label: skin(shown, *place) for label, place in before.items()}
    return find_steps(known, [pixels(*(body(*place) for place in after), seed=2)], [FRONT])


def test_who_stays_takes_no_step():
    assert steps({FIRST: (0.0, 0.0), SECOND: (0.0, 0.8)}, [(0.02, 0.0), (0.0, 0.8)]) == {}


@pytest.mark.parametrize("to", [(0.0, 0.3), (0.0, -0.45), (-0.3, 0.0), (0.25, 0.25)])
def test_a_step_is_found_to_half_the_grid(to):
    found = steps({FIRST: (0.0, 0.0)}, [to])
    assert found[FIRST][[0, 2]] == pytest.approx(to, abs=GRID_M)
    assert found[FIRST][1] == 0.0


def test_two_who_walk_keep_apart():
    found = steps({FIRST: (0.0, 0.0), SECOND: (0.0, 0.6)}, [(0.0, 0.35), (0.0, 0.95)])
    assert found[FIRST][2] == pytest.approx(0.35, abs=GRID_M)
    assert found[SECOND][2] == pytest.approx(0.35, abs=GRID_M)


def test_who_stays_is_not_taken_for_the_one_who_left():
    assert FIRST not in steps({FIRST: (0.0, 0.0), SECOND: (0.0, 0.4)}, [(0.0, 0.4)])


def test_who_is_hidden_takes_no_step():
    hidden = steps({FIRST: (-0.8, 0.0)}, [(0.6, 0.0)])  # another person stands before the camera
    assert FIRST not in hidden


def test_nobody_walks_farther_than_the_reach():
    assert steps({FIRST: (0.0, 0.0)}, [(0.0, 2.0 * REACH_M)]) == {}


def test_expected_skin_is_moved_to_where_its_owner_is_seen():
    shown = pixels(body(0.0, 0.0))
    seen = skin(shown, 0.0, 0.0)
    off = np.array([0.0, 0.0, 0.3])
    assert step_onto(seen + off, seen, [shown], [FRONT]) == pytest.approx(-off, abs=GRID_M)
    assert not step_onto(seen, seen, [shown], [FRONT]).any()
