"""Five true anchors of five behind the standing frame's bars, and none on a stump."""

from functools import cache

import numpy as np
import pytest
from body_builder import FRONT, adult_body, asset, before_wall, photograph, points, shaken, skin_in, standing

from anchorpose.body.constraints import anchor_points
from anchorpose.body.skin_map import map_body
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import anchor_descriptor, find_anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import find_caps, geodesic_extrema, surface_center
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.surface.border import Border, border
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import ExpectedSkin

UP, AHEAD, HEIGHT_M = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), 1.72
POSES = {
    "standing": standing(),
    "arms out": standing(LeftArm=(45.0, 0.0, 0.0), RightArm=(-45.0, 0.0, 0.0)),
    "a step": standing(LeftUpLeg=(0.0, 0.0, 25.0), LeftLeg=(0.0, 0.0, -20.0)),
}
LIMB_ENDS = ("Head", "LeftHand", "RightHand", "LeftToeBase", "RightToeBase")


@cache
def body_map():
    return map_body(adult_body())


def expected_in(pose):
    posed = pose_points(adult_body(), pose)
    skin = ExpectedSkin(posed.points_m.astype(np.float32), posed.normals.astype(np.float32), body_map())
    return skin, posed.points_m[anchor_points(points())]


def seen_behind(pose, bars_m, noise_m=0.003):
    """The body before a wall, its readings noisy, with bars (height of the middle, width) in front of it."""
    view = before_wall(photograph(skin_in(pose, adult_body()), FRONT), FRONT)
    noise = np.random.default_rng(5).normal(0.0, noise_m, view.depth_m.shape)
    depth = np.where(view.depth_m > 0, view.depth_m + noise, 0.0).astype(np.float32)
    labels = view.labels.copy()
    away_m = 0.35  # in front of the body
    rays = np.concatenate([FRONT.pixel_rays(), np.ones((*depth.shape, 1))], axis=2) @ FRONT.require_pose()[:3, :3].T
    far_m = (away_m - FRONT.position_m[0]) / rays[..., 0]
    up = FRONT.position_m[1] + far_m * rays[..., 1]
    for middle_m, width_m in bars_m:
        bar = np.abs(up - middle_m) < width_m / 2
        depth[bar], labels[bar] = far_m[bar], PixelLabel.EQUIPMENT
    return View(depth, labels)


def part_at(pose, place_m):
    skin = skin_in(pose, adult_body())
    return asset().bone_names[asset().main_bone()[np.argmin(np.linalg.norm(skin - place_m, axis=1))]]


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("bars", [(0.05, 0.05), (0.09, 0.09), (0.07, 0.05)], ids=str)
@pytest.mark.parametrize("seed", [0, 1])
def test_five_true_anchors_of_five_behind_knee_bar_and_hip_bar(pose, bars, seed):
    true = POSES[pose]
    skin, places = expected_in(shaken(true, seed, turn_deg=3.0, shift_m=0.01))
    view = seen_behind(true, [(0.47, bars[0]), (0.98, bars[1])])
    surface = patient_surface([view], [FRONT], skin)
    anchors = find_anchors(surface, UP, AHEAD, HEIGHT_M, border(surface, [view]) == Border.CUT, places)
    assert anchors.found.all()
    for name, end in enumerate(LIMB_ENDS):
        found = part_at(true, anchors.position_m[name])
        assert found.startswith((end, end.replace("ToeBase", "Foot"), end.replace("Hand", "Finger"))), found
    assert np.isfinite(anchor_descriptor(surface, anchors)[: surface.seen_count]).all()


def test_a_bar_changes_the_ways_between_head_and_feet_by_a_centimetre_on_average():
    true = POSES["standing"]
    skin, places = expected_in(true)
    ways = []
    for bars in ([], [(0.47, 0.09), (0.98, 0.09)]):
        view = seen_behind(true, bars, noise_m=0.0)
        surface = patient_surface([view], [FRONT], skin)
        anchors = find_anchors(surface, UP, AHEAD, HEIGHT_M, border(surface, [view]) == Border.CUT, places)
        ends = anchors.node[[0, 3, 4]]  # the bar at the hip hides the hands in part, and so moves their caps
        ways.append(geodesic_distance(surface, ends)[:, ends])
    np.testing.assert_allclose(ways[1], ways[0], atol=0.025)
    apart = ~np.eye(3, dtype=bool)
    assert np.abs(ways[1] - ways[0])[apart].mean() < 0.012


@pytest.mark.parametrize("hide_below_m", [0.30, 0.45])
def test_a_shin_that_ends_at_something_is_no_foot(hide_below_m):
    true = POSES["standing"]
    skin, places = expected_in(true)
    view = seen_behind(true, [(hide_below_m / 2, hide_below_m)])
    surface = patient_surface([view], [FRONT], skin)
    cut = border(surface, [view]) == Border.CUT
    anchors = find_anchors(surface, UP, AHEAD, HEIGHT_M, cut, places)
    np.testing.assert_array_equal(anchors.found, [True, True, True, False, False])
    assert np.isnan(anchors.sigma_m[3:]).all()
    assert (anchors.sigma_m[:3] > 0).all()
    field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
    caps = find_caps(surface, field, geodesic_extrema(surface, field, 0.5), 0.06, cut)
    low = [cap for cap in caps if cap.center_m[1] < hide_below_m + 0.15]
    assert len(low) == 2
    assert all(cap.continues and cap.stump for cap in low)


def test_who_is_wholly_hidden_has_no_anchors():
    skin, places = expected_in(POSES["standing"])
    view = seen_behind(POSES["standing"], [(1.0, 3.0)])
    surface = patient_surface([view], [FRONT], skin)
    assert surface.seen_count == 0
    anchors = find_anchors(surface, UP, AHEAD, HEIGHT_M, border(surface, [view]) == Border.CUT, places)
    assert not anchors.found.any()
    assert len(anchors.node) == len(ANCHOR_NAMES)
