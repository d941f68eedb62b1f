"""Nodes matched to the body's own surface, and the poses that follow from it, without any prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, joint_errors_m, points, seen_body, standing, turned_about_y

from anchorpose.body import own_surface as matching
from anchorpose.body.constraints import anchor_points
from anchorpose.body.limb_proposals import CHAINS, CONTRADICTED_M, anchor_paths, anchor_poses
from anchorpose.body.own_surface import (
    MIRRORED,
    PAIRS,
    match_skin,
    neutral,
    own_surface,
    poses_of_own_surface,
    settle_on,
    skin_distance,
    turns,
)
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import Anchors, SeenGeodesics, anchor_descriptor, find_anchors, no_anchors
from anchorpose.geodesics.extrema import Cap
from anchorpose.joints import JOINT_INDEX

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
    assert list(poses_of_own_surface(BODY, two)) == []
    blank = replace(seen, anchors=no_anchors(), descriptor=np.full_like(few, np.nan))
    assert len(match_skin(BODY, blank).node) == 0


def test_anchors_exchanged_are_matched_as_if_mirrored():
    seen = seen_of(REACHING)
    other = replace(seen, descriptor=seen.descriptor[:, MIRRORED])
    one, mirrored = match_skin(BODY, seen), match_skin(BODY, other, mirrored=True)
    np.testing.assert_array_equal(one.point, mirrored.point)
    np.testing.assert_array_equal(one.node, mirrored.node)


def test_a_rigidly_moved_body_is_laid_on_itself():
    moved = turned_about_y(130.0, (0.4, 0.1, -0.7)).of_pose(standing())
    some = np.arange(0, 2400, 50)
    places = pose_points(BODY, moved).points_m[some]
    assert joint_errors_m(BODY, neutral(BODY, some, places), moved).max() < 1e-6


@pytest.mark.parametrize("truth", POSTURES.values(), ids=POSTURES.keys())
def test_true_places_of_the_skin_give_the_pose(truth):
    some = np.arange(0, 2400, 6)
    places = pose_points(BODY, truth).points_m[some]
    assert joint_errors_m(BODY, settle_on(BODY, standing(), some, places), truth).max() < 0.05


@pytest.mark.parametrize("truth", POSTURES.values(), ids=POSTURES.keys())
def test_the_pose_is_proposed_whatever_was_believed(truth):
    errors = [joint_errors_m(BODY, pose, truth) for pose in poses_of_own_surface(BODY, seen_of(truth))]
    assert min(error.mean() for error in errors) < 0.06
    assert min(error.max() for error in errors) < 0.15


def test_a_patient_thought_to_face_the_other_way_is_found_with_the_names_exchanged():
    seen = seen_of(STEPPING, facing=(-1.0, 0.0, 0.0))
    assert seen.anchors.found.sum() >= 3
    errors = [joint_errors_m(BODY, pose, STEPPING).mean() for pose in poses_of_own_surface(BODY, seen)]
    assert min(errors) < 0.08
    assert errors[0] > 0.2


def test_the_proposal_moves_with_the_patient():
    seen, moved = seen_of(REACHING), turned_about_y(90.0, (1.0, 0.0, 2.0))
    surface = seen.whole
    T = moved.T.astype(np.float32)
    turned = replace(surface, points_m=surface.points_m @ T[:3, :3].T + T[:3, 3], normals=surface.normals @ T[:3, :3].T)
    here = next(iter(poses_of_own_surface(BODY, seen)))
    there = next(iter(poses_of_own_surface(BODY, replace(seen, whole=turned))))
    assert joint_errors_m(BODY, there, moved.of_pose(here)).max() < 0.01


def test_anchors_where_the_pose_has_its_tips_give_no_path():
    seen = seen_of(REACHING)
    assert seen.anchors.found.sum() >= 4
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=replace(seen.anchors, free=())))) == []


def test_a_hand_elsewhere_gives_the_path_of_an_arm():
    seen = seen_of(REACHING)
    wrong = standing(
        LeftArm=(-70.0, 0.0, 0.0),
        LeftForeArm=(0.0, -60.0, 0.0),
        RightArm=(-15.0, 0.0, 25.0),
        RightForeArm=(0.0, -30.0, 20.0),
    )
    anchors = replace(seen.anchors, free=())
    ((path, chains),) = anchor_paths(BODY, wrong, replace(seen, anchors=anchors))
    assert [chain.root for chain in chains] == ["ShoulderLeft", "ShoulderRight"]
    node = seen.anchors.node[1]
    np.testing.assert_array_equal(path.places_m[0], seen.whole.points_m[node].astype(np.float64))
    assert (np.diff(path.along_m) > 0.0).all()
    assert 0.0 < path.along_m[0] < CONTRADICTED_M
    errors = [
        joint_errors_m(BODY, pose, REACHING) for pose in anchor_poses(BODY, wrong, replace(seen, anchors=anchors))
    ]
    arm = [JOINT_INDEX[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")]
    assert min(error[arm].max() for error in errors) < 0.10


def test_a_free_end_may_be_that_of_any_limb_and_a_head_is_that_of_none():
    seen = seen_of(REACHING)
    tip = int(seen.anchors.node[1])
    cap = Cap(tip, np.array([tip]), seen.whole.points_m[tip].astype(np.float64), 0.8, 0.01, False, False)
    ((_, chains),) = anchor_paths(BODY, REACHING, replace(seen, anchors=replace(no_anchors(), free=(cap,))))
    assert chains == CHAINS
    head = no_anchors()
    head.node[0], head.position_m[0] = tip, seen.whole.points_m[tip]
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=head))) == []


def test_missed_anchors_give_no_path():
    seen = seen_of(REACHING)
    none: Anchors = no_anchors()
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=none))) == []
