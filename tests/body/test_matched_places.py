"""The pose from places on the skin: the true ones give it back, and gross errors do not matter."""

import numpy as np
import pytest
from body_builder import (
    FRONT,
    LEFT,
    adult_body,
    asset,
    before_wall,
    joint_errors_m,
    photograph,
    points,
    random_pose,
    skin_in,
    standing,
    stepped,
    turned_about_y,
)
from scipy.spatial import cKDTree

from anchorpose.body.matched_places import LEAST_MATCHES, Matches, fit_matches, matches_of
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.isolation.view import PixelLabel

BODY = adult_body()
THIGHS, SHANKS = (
    {f"{side}{bone}": (0.0, 0.0, turn) for side in ("Left", "Right")}
    for bone, turn in (("UpLeg", 90.0), ("Leg", -90.0))
)
POSES = {
    "standing": standing(),
    "turned round": standing(Hips=(0.0, 180.0, 0.0), LeftArm=(-30.0, 0.0, 20.0)),
    "seated": standing((0.3, 0.5, -0.2), **THIGHS, **SHANKS),
    "lying": standing((0.0, 0.2, 0.0), Hips=(0.0, 0.0, 90.0)),
    "any": random_pose(3, 0.6),
}


def true_matches(pose: Pose, count: int = 400, wrong: float = 0.0) -> Matches:
    """Places all over the skin where a body in a pose has them; wrong: share of them that lie anywhere near."""
    rng, skin = np.random.default_rng(8), asset().vertices
    chosen = rng.choice(len(points().vertex), count, replace=False)
    place = (skin[points().vertex[chosen]] - [0.0, skin[:, 1].min(), 0.0]) / np.ptp(skin[:, 1])
    target_m = pose_points(BODY, pose).points_m[chosen].astype(np.float64)
    target_m[: int(wrong * count)] += rng.uniform(-0.8, 0.8, (int(wrong * count), 3))
    return Matches(place, target_m, np.full(count, 0.02))


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES.keys())
def test_true_places_give_the_pose_back_and_a_fifth_of_gross_errors_does_not_matter(pose):
    assert joint_errors_m(BODY, fit_matches(BODY, true_matches(pose)), pose).mean() < 0.01
    assert joint_errors_m(BODY, fit_matches(BODY, true_matches(pose, wrong=0.2)), pose).mean() < 0.015


def test_who_is_elsewhere_has_the_same_pose_elsewhere():
    moved = turned_about_y(70.0, (1.0, 0.2, -2.0))
    here = true_matches(POSES["any"], wrong=0.1)
    there = Matches(here.place, here.target_m @ moved.T[:3, :3].T + moved.T[:3, 3], here.error)
    found, expected = fit_matches(BODY, there), moved.of_pose(fit_matches(BODY, here))
    assert joint_errors_m(BODY, found, expected).max() < 1e-3


def test_a_few_matches_are_no_pose():
    assert len(true_matches(standing(), LEAST_MATCHES)) == LEAST_MATCHES == 30
    with pytest.raises(ValueError, match="needs 30 matches, these are 29"):
        fit_matches(BODY, true_matches(standing(), LEAST_MATCHES - 1))


def test_the_pixels_of_a_label_are_matched_to_where_they_are_on_the_skin():
    """Of two people beside each other, seen by two cameras and not by a third."""
    views, cameras, skin = [None], [FRONT, FRONT, LEFT], skin_in(stepped(standing(), 0.0, 0.0, 0.5), BODY)
    for camera in cameras[1:]:
        view = before_wall(photograph(skin, camera), camera)
        views.append(view)
    found = matches_of(views, cameras, PixelLabel.PATIENT)
    pixels = sum(int(view.patient.sum()) for view in views if view is not None)
    assert len(found) > 0.9 * pixels * (200.0 / 365.0 / 2.0) ** 2  # rays are two hundredths apart
    assert np.quantile(cKDTree(skin).query(found.target_m)[0], 0.99) < 0.02
    rest = (asset().vertices - [0.0, asset().vertices[:, 1].min(), 0.0]) / np.ptp(asset().vertices[:, 1])
    true = rest[cKDTree(skin).query(found.target_m)[1]]
    assert np.median(np.linalg.norm(found.place - true, axis=1)) < 0.03
    assert len(matches_of(views, cameras, PixelLabel.OTHER_PERSON)) == len(matches_of([None], [FRONT], 4)) == 0
