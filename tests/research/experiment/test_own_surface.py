"""Nodes matched to the body's own surface by geodesic distances, without any prediction."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, points, seen_body, standing, turned_about_y

from anchorpose.body.constraints import anchor_points
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import anchor_descriptor, find_anchors, no_anchors
from anchorpose.research.experiment import own_surface as matching
from anchorpose.research.experiment.own_surface import (
    MIRRORED,
    PAIRS,
    SeenGeodesics,
    match_skin,
    own_surface,
    skin_distance,
    turns,
)

BODY = adult_body()
HEIGHT_M = float(np.ptp(BODY.mesh.vertices[:, 1]))
REACHING = standing(LeftArm=(30.0, 0.0, 0.0), RightArm=(-15.0, 0.0, 25.0), RightForeArm=(0.0, -30.0, 20.0))
STEPPING = standing(
    LeftArm=(-25.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0), LeftUpLeg=(0.0, 0.0, 55.0), LeftLeg=(0.0, 0.0, -60.0)
)
STOOPING = standing(
    LowerBack=(0.0, 0.0, -25.0), Spine=(0.0, 0.0, -20.0), LeftArm=(-5.0, 0.0, 40.0), RightArm=(5.0, 0.0, 40.0)
)
POSTURES = {"reaching": REACHING, "stepping": STEPPING, "stooping": STOOPING}


def seen_of(pose: Pose, facing: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> SeenGeodesics:
    """What two cameras see of a pose; facing: which way the patient is thought to face."""
    surface = seen_body(pose, BODY, (FRONT, LEFT)).surface
    anchors = find_anchors(surface, np.array([0.0, 1.0, 0.0]), np.array(facing), HEIGHT_M)
    return SeenGeodesics(surface, anchors, anchor_descriptor(surface, anchors))


def close_share(seen: SeenGeodesics, truth: Pose) -> float:
    """The share of all tried nodes that are matched to skin within 8 cm of where they lie."""
    matches = match_skin(BODY, seen)
    off = pose_points(BODY, truth).points_m[matches.point] - seen.whole.points_m[matches.node]
    return float((np.linalg.norm(off, axis=1) < 0.08).sum() / matching.NODES)


def grid(count: int, step_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A flat square of triangles."""
    row, column = np.divmod(np.arange(count * count), count)
    corner = np.flatnonzero((row < count - 1) & (column < count - 1))
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count + 1], axis=1),
            np.stack([corner, corner + count + 1, corner + count], axis=1),
        ]
    )
    return np.stack([step_m * column, np.zeros(len(row)), step_m * row], axis=1), faces


def test_distances_on_a_plane_are_straight():
    vertices, faces = grid(41, 0.02)
    found = skin_distance(vertices, faces, np.array([0, 860]))
    true = np.linalg.norm(vertices - vertices[[0, 860]][:, None], axis=2)
    far = true > 0.1
    assert np.abs(found[far] / true[far] - 1.0).max() < 0.025  # 8 % along edges
    assert found[0, 0] == 0.0


def test_distances_on_a_sphere_are_those_of_great_circles():
    from scipy.spatial import ConvexHull

    golden = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(3000)
    height = np.linspace(1.0, -1.0, 3000)
    vertices = np.stack([np.cos(golden) * np.sqrt(1 - height**2), height, np.sin(golden) * np.sqrt(1 - height**2)], 1)
    found = skin_distance(vertices, ConvexHull(vertices).simplices, np.array([0]))[0]
    true = np.arccos(np.clip(vertices @ vertices[0], -1.0, 1.0))
    assert np.abs(found / np.maximum(true, 1e-9) - 1.0)[true > 0.3].max() < 0.03
    assert np.abs(found / np.maximum(true, 1e-9) - 1.0)[true > 0.3].mean() < 0.01


def test_what_nothing_leads_to_is_infinitely_far():
    vertices, faces = grid(3, 0.1)
    both = np.concatenate([faces, faces + len(vertices)])
    found = skin_distance(np.concatenate([vertices, vertices + 1.0]), both, np.array([0]))[0]
    assert np.isinf(found[9:]).all()
    assert np.isfinite(found[:9]).all()


def test_the_bodys_own_distances_are_the_same_left_and_right_and_its_turns_opposite():
    from scipy.spatial import cKDTree

    own = own_surface(BODY)
    away, other = cKDTree(BODY.rest_m).query(BODY.rest_m * [1.0, 1.0, -1.0])
    close = away < 0.01
    assert close.mean() > 0.3
    off_m = np.abs(own.distance_m[close] - own.distance_m[other[close]][:, MIRRORED])
    assert off_m.mean() < 0.01
    assert off_m.max() < 0.08  # the mesh of the hands is not quite the same
    pair = {both: number for number, both in enumerate(PAIRS)}
    swapped = [tuple(MIRRORED[list(both)]) for both in PAIRS]
    column = [pair.get(both, pair.get(both[::-1])) for both in swapped]
    sign = np.array([1.0 if both in pair else -1.0 for both in swapped])
    off = own.turns[close] + sign * own.turns[other[close]][:, column]
    assert np.nanmedian(np.abs(off)) < 0.1
    assert np.nanmedian(np.abs(own.turns)) > 0.3


def test_the_tips_are_at_distance_zero_of_themselves():
    own = own_surface(BODY)
    np.testing.assert_array_equal(own.distance_m[anchor_points(points())].diagonal(), 0.0)
    assert own_surface(BODY) is own


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["seen from above", "seen from below"])
def test_turns_are_sines_of_the_angles_between_directions(side):
    vertices, _ = grid(9, 0.02)
    at = np.array([40])
    around = np.array([[39, 41, 31, 49, 30, 32, 48, -1]])
    angles = np.array([0.0, 0.5, 1.6, 3.0, 4.0])
    tips = vertices[at] + np.stack([np.cos(angles), np.zeros(5), -np.sin(angles)], axis=1) * 50.0
    distance = np.linalg.norm(vertices[:, None] - tips, axis=2)
    found = turns(vertices, np.array([[0.0, side, 0.0]]), at, around, distance)[0]
    expected = [side * np.sin(angles[b] - angles[a]) for a, b in PAIRS]
    np.testing.assert_allclose(found, expected, atol=0.02)
    moved = turned_about_y(40.0, (0.3, 0.0, 0.1))
    turned = vertices @ moved.T[:3, :3].T + moved.T[:3, 3]
    np.testing.assert_allclose(turns(turned, np.array([[0.0, side, 0.0]]), at, around, distance)[0], found, atol=1e-9)
    distance[:, 2] = np.nan
    unknown = np.isnan(turns(vertices, np.array([[0.0, side, 0.0]]), at, around, distance)[0])
    assert unknown.tolist() == [2 in both for both in PAIRS]


def test_squared_deviations_are_those_of_a_plain_sum():
    rng = np.random.default_rng(5)
    seen, sigma, own = rng.normal(size=(7, 4)), rng.uniform(0.5, 2.0, (7, 4)), rng.normal(size=(9, 4))
    seen[2, 1] = seen[5, 3] = np.nan
    found = matching._off2(seen, sigma, matching._table(own))
    plain = np.nansum(((seen[:, None] - own) / sigma[:, None]) ** 2, axis=2)
    np.testing.assert_allclose(found - found[:, :1], plain - plain[:, :1], atol=1e-4)


@pytest.mark.parametrize("truth", POSTURES.values(), ids=POSTURES.keys())
def test_most_nodes_are_matched_to_the_skin_that_they_show_and_turns_help(truth, monkeypatch):
    seen = seen_of(truth)
    share = close_share(seen, truth)
    assert share > 0.6
    monkeypatch.setattr(matching, "TURN_SIGMA", 1e6)
    assert share > close_share(seen, truth) + 0.05


def test_a_node_with_two_distances_has_no_match():
    seen = seen_of(REACHING)
    few = seen.descriptor.copy()
    few[:, 2:] = np.nan
    two = replace(seen, descriptor=few)
    assert len(match_skin(BODY, two).node) == 0
    blank = replace(seen, anchors=no_anchors(), descriptor=np.full_like(few, np.nan))
    assert len(match_skin(BODY, blank).node) == 0


def test_anchors_exchanged_are_matched_as_if_mirrored():
    seen = seen_of(REACHING)
    other = replace(seen, descriptor=seen.descriptor[:, MIRRORED])
    one, mirrored = match_skin(BODY, seen), match_skin(BODY, other, mirrored=True)
    np.testing.assert_array_equal(one.point, mirrored.point)
    np.testing.assert_array_equal(one.node, mirrored.node)
