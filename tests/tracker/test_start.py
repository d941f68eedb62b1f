"""What a first pose must be to be believed."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult, adult_body, hide_bones, seen_body, standing
from scipy.spatial.transform import Rotation

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.shape_prior import shape_of_height, standing_height
from anchorpose.body.skin_points import FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.isolation.people import PatientChoice, Person
from anchorpose.tracker import start as start_module
from anchorpose.tracker.bystanders import RoughPerson
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.room import InitialFrame
from anchorpose.tracker.sighting import RoughBody, SeenPerson, Sighting
from anchorpose.tracker.start import TRIES, WELL, best_of, hangs, rank_initial_frames

ASSET = body_points().asset


@pytest.mark.parametrize("height_m", [1.45, 1.7, 2.0])
def test_adults_are_human(height_m):
    assert is_human(shape_of_height(ASSET, height_m))


def test_half_a_person_is_not():
    """The upper half of one who sits, taken for the whole of a small person."""
    small = shape_of_height(ASSET, 1.45)
    while standing_height(ASSET, small)[0] > 0.85:
        small = FittedShape(small.coefficients * 1.1, small.offset_m)
    assert not is_human(small)
    assert np.isfinite(small.coefficients).all()


def raised(by_m: float, turn: np.ndarray) -> tuple[PosedPoints, np.ndarray]:
    """An adult at rest, turned about the pelvis, whose lowest point is so far above a floor at height 0."""
    body = build_body(body_points(), shape_of_height(ASSET, 1.7))
    rotations = np.tile(np.eye(3), (len(ASSET.bone_names), 1, 1))
    rotations[ASSET.bone("Hips")] = turn
    pose = Pose(rotations, np.zeros(3))
    lowest_m = pose_points(body, pose).points_m[:, 1].min()
    pose = Pose(rotations, np.array([0.0, by_m - lowest_m, 0.0]))
    return pose_points(body, pose), body.joints(pose)


@pytest.mark.parametrize(("by_m", "expected"), [(0.0, False), (0.25, False), (0.5, True)])
def test_nobody_hangs_above_the_floor(by_m, expected):
    assert hangs(*raised(by_m, np.eye(3)), floor_m=0.0) is expected


def test_who_lies_on_a_bed_does_not_hang():
    on_the_back = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert not hangs(*raised(0.6, on_the_back), floor_m=0.0)


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


@pytest.mark.parametrize(
    ("hidden", "least", "most"), [((), 0.95, 1.0), (("LeftLeg", "LeftFoot", "LeftToeBase"), 0.7, 0.8)]
)
def test_a_frame_that_hides_a_shank_is_a_worse_one_to_begin_in(hidden, least, most):
    evidence = seen_body(standing(), adult_body(), (FRONT, LEFT), hide_bones(*hidden))
    start = Start(SimpleNamespace(evidence=evidence), adult(), vague_belief(standing()), 1.0)
    assert least <= start_module.quality(start) <= most


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


@pytest.mark.parametrize(
    ("turned_deg", "hidden_s", "another"), [(180.0, 0.6, True), (40.0, 0.6, False), (180.0, 20.0, False)]
)
def test_who_shows_a_back_where_a_front_was_hidden_is_another_person(turned_deg, hidden_s, another):
    """In half a second nobody turns round behind a therapist; in twenty seconds anybody may."""
    before = PoseBelief(standing(), 1e-4 * np.eye(POSE_SIZE), 1e4 * np.eye(POSE_SIZE))
    expected = before.later(before.pose, hidden_s)
    assert start_module._turned_round(expected, standing(Hips=(0.0, turned_deg, 0.0))) == another


@pytest.mark.parametrize(("heading_deg", "tried"), [(0.0, 1), (180.0, 0)])
def test_the_rough_body_mends_a_limb_that_the_first_pose_misplaces(heading_deg, tried):
    """Only a rough body with the same facing does: with the opposite facing, its left arm is the right arm."""
    body, truth = adult_body(), standing(LeftForeArm=(-60, 0, 0))
    misplaced = standing(LeftArm=(0, 0, 120), LeftForeArm=(-60, 0, 0))
    seen = SimpleNamespace(evidence=seen_body(truth, body, (FRONT, LEFT)))
    belief = vague_belief(standing(Hips=(0, heading_deg, 0), LeftForeArm=(-60, 0, 0)))
    rough = RoughPerson(body, SimpleNamespace(belief=belief, found=True))
    crowd = SimpleNamespace(body_at=lambda place_xz_m: rough)
    choice, config = PatientChoice(np.zeros(2), "is seen", True), TrackConfig()
    poses = start_module._as_rough(body, crowd, choice, seen, misplaced, config)
    assert len(poses) == tried
    found = start_module._likeliest(body, [misplaced, *poses], seen, config)
    off_m = np.linalg.norm(body.joints(found.belief.pose) - body.joints(truth), axis=1).max()
    assert (off_m < 0.03) == bool(tried)
