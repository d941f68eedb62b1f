"""Extrema become head, hands and feet, or are said to be none of them."""

from dataclasses import replace

import numpy as np
import pytest
from surface_builder import star

from anchorpose.geodesics.anchors import AnchorConfig, anchor_descriptor, find_anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.surface.mesh import keep_nodes

UP, FACING = np.array([0, 1.0, 0]), np.array([1.0, 0, 0])
ENDS = {
    "Head": (0.02, 0.72),
    "HandLeft": (0.75, 0.15),
    "HandRight": (-0.72, 0.2),
    "FootLeft": (0.14, -0.95),
    "FootRight": (-0.14, -0.97),
}
"""(left, up) of the ends of a paper figure 1.7 m tall."""


def figure(**changed):
    ends = {**ENDS, **changed}
    return star({name: end for name, end in ends.items() if end is not None}, width_m=0.06)


def places(**changed):
    """(5, 3) world position of the ends."""
    return np.array([[0.0, end[1], -end[0]] for end in {**ENDS, **changed}.values()])


def test_a_standing_figure_gives_all_five_at_their_places():
    anchors = find_anchors(figure(), UP, FACING, 1.7)
    assert anchors.found.all()
    assert np.linalg.norm(anchors.position_m - places(), axis=1).max() < 0.05
    near = np.linalg.norm(figure().points_m[anchors.node] - anchors.position_m, axis=1)
    assert near.max() < 0.02


@pytest.mark.parametrize(
    "pose",
    [
        {"HandLeft": (0.35, 0.75), "HandRight": (-0.35, 0.8)},  # both arms up, higher than the head
        {"HandLeft": (0.5, -0.4), "HandRight": (-0.5, -0.4)},  # hanging
        {"FootLeft": (0.5, -0.8)},  # a step aside
    ],
)
def test_arms_and_legs_keep_their_names_when_they_move(pose):
    anchors = find_anchors(figure(**pose), UP, FACING, 1.7)
    assert anchors.found.all()
    assert np.linalg.norm(anchors.position_m - places(**pose), axis=1).max() < 0.06


def test_a_mirrored_figure_swaps_left_and_right_and_turning_the_world_turns_the_answer_with_it():
    surface = figure()
    mirrored = replace(surface, points_m=surface.points_m * np.array([1, 1, -1], np.float32))
    one, other = (find_anchors(s, UP, FACING, 1.7) for s in (surface, mirrored))
    np.testing.assert_array_equal(other.node, one.node[[0, 2, 1, 4, 3]])
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    turned = replace(surface, points_m=(surface.points_m @ turn.T).astype(np.float32))
    np.testing.assert_array_equal(
        find_anchors(turned, UP, turn @ FACING, 1.7).node, find_anchors(surface, UP, FACING, 1.7).node
    )


@pytest.mark.parametrize("name", ANCHOR_NAMES)
def test_a_limb_that_is_not_there_is_missed_and_the_others_keep_their_names(name):
    anchors = find_anchors(figure(**{name: None}), UP, FACING, 1.7)
    missed = ANCHOR_NAMES.index(name)
    assert not anchors.found[missed]
    assert np.isnan(anchors.position_m[missed]).all()
    others = np.delete(np.arange(5), missed)
    assert np.linalg.norm((anchors.position_m - places())[others], axis=1).max() < 0.05


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4], [0, 2, 1, 4, 3]])
def test_the_prediction_names_what_nothing_else_can(order):
    sideways = np.array([0.0, 0.0, 1.0])  # seen from the side, left and right are alike
    predicted = places()[order]
    anchors = find_anchors(figure(), UP, sideways, 1.7, predicted_m=predicted)
    assert np.linalg.norm(anchors.position_m - predicted, axis=1).max() < 0.05


@pytest.mark.parametrize("name", [1, 2, 3, 4])
def test_a_wrong_prediction_does_not_hide_an_end(name):
    right = find_anchors(figure(), UP, FACING, 1.7, predicted_m=places())
    predicted = places()
    predicted[name] += [0.4, 0.0, 0.0]
    anchors = find_anchors(figure(), UP, FACING, 1.7, predicted_m=predicted)
    np.testing.assert_array_equal(anchors.node, right.node)


def test_a_prediction_that_is_far_off_or_exchanges_the_hands_changes_no_name():
    without = find_anchors(figure(), UP, FACING, 1.7)
    anchors = find_anchors(figure(), UP, FACING, 1.7, predicted_m=places() + 5.0 * UP)
    np.testing.assert_array_equal(anchors.node, without.node)
    exchanged = places()[[0, 2, 1, 3, 4]]
    anchors = find_anchors(figure(), UP, FACING, 1.7, predicted_m=exchanged)
    assert np.linalg.norm(anchors.position_m - places(), axis=1).max() < 0.05


def test_an_elbow_in_place_of_a_hand_that_is_not_seen_is_no_hand():
    shortened = {"HandLeft": (0.36, 0.27)}
    anchors = find_anchors(figure(**shortened), UP, FACING, 1.7, predicted_m=places(HandLeft=(0.2, -0.3)))
    np.testing.assert_array_equal(anchors.found, [True, False, True, True, True])
    (end,) = anchors.free
    assert np.linalg.norm(end.center_m - [0.0, 0.27, -0.36]) < 0.06


def test_a_sixth_end_is_free_and_a_stump_is_not():
    surface = star({**ENDS, "tail": (-0.5, -0.45)}, width_m=0.06)
    anchors = find_anchors(surface, UP, FACING, 1.7, predicted_m=places())
    assert np.linalg.norm(anchors.position_m - places(), axis=1).max() < 0.05
    (tail,) = anchors.free
    assert np.linalg.norm(surface.points_m[tail.tip] - [0.0, -0.45, 0.5]) < 0.06
    cut = np.linalg.norm(surface.points_m - tail.center_m, axis=1) < 0.1
    assert find_anchors(surface, UP, FACING, 1.7, cut=cut, predicted_m=places()).free == ()


@pytest.mark.parametrize("name", [1, 2])
def test_a_hand_beyond_a_gap_is_found(name):
    surface = figure()
    middle = 0.5 * places()[name]
    surface = keep_nodes(surface, np.linalg.norm(surface.points_m - middle, axis=1) > 0.06)
    anchors = find_anchors(surface, UP, FACING, 1.7)
    assert anchors.found.all()
    assert np.linalg.norm(anchors.position_m - places(), axis=1).max() < 0.05


def test_a_stump_at_a_cut_edge_is_no_foot():
    surface = figure()
    surface = keep_nodes(surface, surface.points_m[:, 1] > -0.8)
    whole = find_anchors(surface, UP, FACING, 1.7)
    assert whole.found.all()
    cut = surface.points_m[:, 1] < -0.75
    found = find_anchors(surface, UP, FACING, 1.7, cut=cut).found
    np.testing.assert_array_equal(found, [True, True, True, False, False])


def test_a_foot_that_one_of_two_cameras_sees_whole_is_a_foot():
    surface = figure()
    second = np.random.default_rng(0).random(len(surface)) < 0.5
    surface = replace(surface, camera=second.astype(np.uint8))
    low = surface.points_m[:, 1] < -0.85
    assert not find_anchors(surface, UP, FACING, 1.7, cut=low).found[3:].any()
    assert find_anchors(surface, UP, FACING, 1.7, cut=low & second).found.all()


def test_a_cap_s_centre_is_steadier_than_its_tip():
    surface, rng = figure(), np.random.default_rng(5)
    nodes, centres = [], []
    for _ in range(12):
        noise = rng.normal(0, 0.004, (len(surface), 3)).astype(np.float32)
        anchors = find_anchors(replace(surface, points_m=surface.points_m + noise), UP, FACING, 1.7)
        nodes.append(surface.points_m[anchors.node])
        centres.append(anchors.position_m)
    assert np.std(centres, axis=0).max() <= np.std(nodes, axis=0).max()
    assert np.std(centres, axis=0).max() < 0.01


def test_nobody_has_no_anchors():
    surface = figure()
    anchors = find_anchors(keep_nodes(surface, np.zeros(len(surface), bool)), UP, FACING)
    assert not anchors.found.any()
    assert np.isnan(anchors.position_m).all()


def test_the_descriptor_holds_the_distances_nan_where_missed_inf_where_cut_off():
    surface = figure(HandRight=None)
    keep = np.linalg.norm(surface.points_m[:, 1:] - [0.1, -0.5], axis=1) > 0.06  # cuts the left arm
    surface = keep_nodes(surface, keep)
    anchors = find_anchors(surface, UP, FACING, 1.7)
    descriptor = anchor_descriptor(surface, anchors)
    assert descriptor.shape == (len(surface), 5)
    assert np.isnan(descriptor[:, ~anchors.found]).all()
    np.testing.assert_array_equal(descriptor[:, 0], geodesic_distance(surface, anchors.node[:1])[0])
    assert np.isinf(descriptor[surface.points_m[:, 2] < -0.58, 0]).all()


@pytest.mark.parametrize("name", ["radius", "cap", "gate"])
def test_lengths_that_are_not_positive_are_refused(name):
    with pytest.raises(ValueError, match=name):
        AnchorConfig(**{name: 0.0})


def test_an_anchor_without_prediction_is_found_again():
    predicted = places()
    predicted[2] = np.nan
    anchors = find_anchors(figure(), UP, FACING, 1.7, predicted_m=predicted)
    assert anchors.found.all()
    assert np.linalg.norm(anchors.position_m[2] - places()[2]) < 0.05
