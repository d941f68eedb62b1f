"""Which frame tracking begins in: the first that a body explains, and not the neighbour of a bad one."""

from __future__ import annotations

import numpy as np
import pytest

from anchorpose.isolation.people import PatientChoice
from anchorpose.tracker.initial_frame import TRIES, WELL, best_of
from anchorpose.tracker.room import InitialFrame


def candidate(frame: int, score: float = 1.0, whole: float = 1.0) -> InitialFrame:
    return InitialFrame(frame, PatientChoice(np.zeros(2), "is seen", True), score, whole, 2)


class Fits:
    """What a body would explain of each frame; keeps which were asked for."""

    def __init__(self, share: dict[int, float]) -> None:
        self.share, self.asked = share, list[int]()

    def __call__(self, one: InitialFrame) -> float:
        self.asked.append(one.frame)
        return self.share[one.frame]


def test_the_best_by_score_is_taken_without_looking_further_where_a_body_explains_it() -> None:
    fits = Fits({0: 1.0, 10: WELL, 20: 1.0})
    assert best_of([candidate(0, 0.5), candidate(10, 0.9), candidate(20, 0.8)], fits).frame == 10
    assert fits.asked == [10]


def test_after_a_bad_frame_its_neighbours_come_last() -> None:
    frames = range(0, 80, 5)
    fits = Fits({frame: 0.7 if frame > 40 else 0.99 for frame in frames})
    found = best_of([candidate(65), *(candidate(frame) for frame in frames if frame != 65)], fits)
    assert fits.asked[0] == 65
    assert found.frame <= 40
    assert len(fits.asked) == 2


def test_where_none_is_explained_well_the_best_of_some_is_taken() -> None:
    share = {frame: 0.5 + 0.01 * (frame % 7) for frame in range(20)}
    fits = Fits(share)
    found = best_of([candidate(frame) for frame in share], fits)
    assert len(set(fits.asked)) == len(fits.asked) == TRIES
    assert share[found.frame] == max(share[frame] for frame in fits.asked)


def test_of_bad_frames_one_that_shows_little_of_him_is_no_better_for_being_explained() -> None:
    fits = Fits({0: 0.85, 10: 0.80})
    assert best_of([candidate(0, 0.9, 0.4), candidate(10, 0.8, 0.9)], fits).frame == 10


def test_a_sliver_behind_somebody_is_not_an_initial_frame_however_well_it_is_explained() -> None:
    fits = Fits({0: 1.0, 50: 0.92})
    assert best_of([candidate(0, 0.6, 0.6), candidate(50, 0.5)], fits).frame == 50


@pytest.mark.parametrize("count", [1, 3])
def test_few_candidates_are_all_tried(count: int) -> None:
    fits = Fits(dict.fromkeys(range(count), 0.0))
    best_of([candidate(frame) for frame in range(count)], fits)
    assert sorted(fits.asked) == list(range(count))
