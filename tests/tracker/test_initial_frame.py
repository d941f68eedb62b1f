"""In which frame tracking begins."""

import numpy as np
import pytest
from body_builder import FRONT, LEFT

from anchorpose.isolation.people import PatientChoice, Person
from anchorpose.tracker.initial_frame import TRIES, WELL, best_of, rank_initial_frames
from anchorpose.tracker.room import InitialFrame
from anchorpose.tracker.sighting import RoughBody, SeenPerson, Sighting


def patient(explained=1.0, area_m2=0.8, x=0.0) -> SeenPerson:
    place = np.array([x, 0.0])
    return SeenPerson(Person(place, 0.0, 1.7, area_m2), RoughBody(place, np.array([1.0, 0.0]), explained, 0.03))


def other(x: float) -> SeenPerson:
    place = np.array([x, 0.0])
    return SeenPerson(Person(place, 0.0, 1.7, 0.5), RoughBody(place, np.array([-1.0, 0.0]), 1.0, 0.03))


def best(*sightings: Sighting, place=None) -> int:
    return rank_initial_frames(range(len(sightings)), sightings, None, place, (FRONT, LEFT))[0].frame


NO_IMAGES = (None, None)
GOOD = Sighting(7, (patient(), other(1.5)), NO_IMAGES)


@pytest.mark.parametrize(
    "worse",
    [
        Sighting(7, (patient(explained=0.6), other(1.5)), NO_IMAGES),
        Sighting(7, (patient(area_m2=0.3), other(1.5)), NO_IMAGES),
        Sighting(7, (patient(), other(0.5)), NO_IMAGES),
        Sighting(7, (patient(area_m2=1.3),), NO_IMAGES),
    ],
    ids=["two in one body", "a sliver", "somebody near", "fewer people than usual"],
)
def test_a_better_frame_comes_first(worse):
    assert best(worse, GOOD, worse, GOOD) == 1


def test_of_equals_the_earlier_comes_first():
    assert best(GOOD, GOOD, GOOD) == 0


def test_more_surface_than_usual_is_not_better():
    assert best(GOOD, Sighting(7, (patient(area_m2=1.6), other(1.5)), NO_IMAGES), GOOD) == 0


def test_with_a_given_place_later_visits_of_the_place_do_not_count():
    """The patient is at the place in frames 1 and 2; in frame 4 another person may be, who is seen best."""
    poor = Sighting(7, (patient(explained=0.7), other(1.5)), NO_IMAGES)
    nobody = Sighting(7, (other(1.5),), NO_IMAGES)
    assert best(nobody, poor, poor, nobody, GOOD, place=(0.0, 0.0)) == 1
    ranked = rank_initial_frames(range(3), [nobody, poor, GOOD], None, (0.0, 0.0), (FRONT, LEFT))
    assert [initial.frame for initial in ranked] == [2, 1]


def candidate(frame: int, score: float = 1.0, whole: float = 1.0) -> InitialFrame:
    return InitialFrame(frame, PatientChoice(np.zeros(2), "is seen", True), score, whole, alone=False)


class Fits:
    """What a body would explain of each frame, and how probable its readings are; keeps which were asked for."""

    def __init__(self, share: dict[int, float], nats: dict[int, float] | None = None) -> None:
        self.share, self.nats, self.asked = share, share if nats is None else nats, list[int]()

    def __call__(self, one: InitialFrame) -> tuple[float, float]:
        self.asked.append(one.frame)
        return self.share[one.frame], self.nats[one.frame]


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


def test_of_bad_frames_the_one_that_makes_its_readings_most_probable_is_taken() -> None:
    """A body that is turned round covers as much as the right one in another frame."""
    fits = Fits({0: 0.85, 10: 0.55}, {0: 506.0, 10: 665.0})
    assert best_of([candidate(0, 0.9), candidate(10, 0.8)], fits).frame == 10


def test_a_sliver_behind_somebody_is_not_an_initial_frame_however_well_it_is_explained() -> None:
    fits = Fits({0: 1.0, 50: WELL})
    assert best_of([candidate(0, 0.6, 0.6), candidate(50, 0.5)], fits).frame == 50


@pytest.mark.parametrize("count", [1, 3])
def test_few_candidates_are_all_tried(count: int) -> None:
    fits = Fits(dict.fromkeys(range(count), 0.0))
    best_of([candidate(frame) for frame in range(count)], fits)
    assert sorted(fits.asked) == list(range(count))
