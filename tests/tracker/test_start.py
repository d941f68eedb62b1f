"""What a first pose must be to be believed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult, adult_body, hide_bones, seen_body, standing
from scipy.spatial.transform import Rotation

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.pose import POSE_SIZE, Pose
from anchorpose.body.shape_prior import shape_of_height, standing_height
from anchorpose.body.skin_points import FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.isolation.people import PatientChoice
from anchorpose.tracker import start as start_module
from anchorpose.tracker.bystanders import RoughPerson
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.prior_shape import is_human
from anchorpose.tracker.start import NoStart, hangs

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


SEATED = {"LeftUpLeg": (0.0, 0.0, 85.0), "RightUpLeg": (0.0, 0.0, 85.0), "LeftLeg": (0.0, 0.0, -85.0)}
SEATED |= {"RightLeg": (0.0, 0.0, -85.0)}


@pytest.mark.parametrize(
    ("missing", "hidden", "why"),
    [
        ((), (), None),
        ((), ("LeftLeg", "LeftFoot", "LeftToeBase", "RightLeg", "RightFoot", "RightToeBase"), NoStart.HANGS),
        (("shank_left", "shank_right"), (), None),
    ],
    ids=["on a high couch", "only the upper half is seen", "both shanks missing"],
)
def test_who_sits_high_is_refused_only_if_the_legs_are_not_seen(missing, hidden, why):
    shape = replace(adult(), missing=missing)
    body, pose = build_body(body_points(), shape), standing(**SEATED)
    lowest_m = pose_points(body, pose).points_m[:, 1].min()
    seen = replace(seen_body(pose, body, (FRONT, LEFT), hide_bones(*hidden)), floor_m=lowest_m - 0.45)
    run = SimpleNamespace(room=SimpleNamespace(recording=SimpleNamespace(equipment="a couch")))
    start = Start(SimpleNamespace(evidence=seen), shape, vague_belief(pose), 1.0)
    assert start_module._why_not(start, run) is why


def test_missing_forearms_and_shanks_are_not_hidden_ones():
    shape = replace(adult(), missing=("shank_left", "shank_right"))
    body = build_body(body_points(), shape)
    start = Start(
        SimpleNamespace(evidence=seen_body(standing(), body, (FRONT, LEFT))), shape, vague_belief(standing()), 1.0
    )
    assert start_module.quality(start) > 0.9


def test_who_lies_on_a_bed_does_not_hang():
    on_the_back = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert not hangs(*raised(0.6, on_the_back), floor_m=0.0)


@pytest.mark.parametrize(
    ("hidden", "least", "most"), [((), 0.95, 1.0), (("LeftLeg", "LeftFoot", "LeftToeBase"), 0.7, 0.8)]
)
def test_a_frame_that_hides_a_shank_is_a_worse_one_to_begin_in(hidden, least, most):
    evidence = seen_body(standing(), adult_body(), (FRONT, LEFT), hide_bones(*hidden))
    start = Start(SimpleNamespace(evidence=evidence), adult(), vague_belief(standing()), 1.0)
    assert least <= start_module.quality(start) <= most


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
