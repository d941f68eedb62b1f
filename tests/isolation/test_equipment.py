"""The equipment in a picture: what is it, what it hides, and what merely leans on it."""

import numpy as np
from room_builder import FRONT, KNEE_BAR, ROOM, body, built_scene, in_front, picture
from scipy.ndimage import label as label_mask

from anchorpose.camera import transform_points
from anchorpose.isolation.background import equipment_depth, equipment_mask, foreground
from anchorpose.isolation.components import jump_limit, label_components, without_flying_pixels
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import find_pieces, set_scene
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.equipment import Box, EquipmentModel

FLAT_LIMIT = jump_limit(0.002, 180.0)


def nearer_than(parts, others) -> np.ndarray:
    """(height, width) bool: pixels that show ``parts`` and not what else stands there."""
    return picture(FRONT, *ROOM, *others, *parts) < picture(FRONT, *ROOM, *others) - 1e-3


def mask_of(depth, scene) -> np.ndarray:
    return equipment_mask(depth, foreground(depth, scene.background), scene.equipment)


def test_flying_pixels_are_left_out_and_surfaces_stay():
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] = 3.0
    depth[5, 9] = 2.5
    kept = without_flying_pixels(depth, depth > 0, FLAT_LIMIT)
    assert not kept[5, 9]
    assert kept.sum() == depth.size - 1


def test_pieces_are_those_of_scipy_where_nothing_jumps():
    mask = np.random.default_rng(1).random((60, 80)) < 0.45
    labels, count = label_components(np.full(mask.shape, 2.0, np.float32), mask, FLAT_LIMIT)
    expected, expected_count = label_mask(mask, np.ones((3, 3)))
    assert count == expected_count
    assert len({(a, b) for a, b in zip(labels[mask], expected[mask], strict=True)}) == count
    assert (labels[~mask] == 0).all()


def test_a_depth_jump_cuts_a_piece():
    depth = np.full((10, 10), 2.0, np.float32)
    depth[:, 5:] = 2.0 + 1.1 * FLAT_LIMIT.at(np.float32(2.2))
    assert label_components(depth, depth > 0, FLAT_LIMIT)[1] == 2
    depth[:, 5:] = 2.0 + 0.9 * FLAT_LIMIT.at(np.float32(2.0))
    assert label_components(depth, depth > 0, FLAT_LIMIT)[1] == 1


def test_the_expected_depth_of_equipment_lies_on_its_surface():
    bars = EquipmentModel((KNEE_BAR, *body(0.1, 0.5)))
    depth = equipment_depth(FRONT, bars)
    hit = depth > 0
    points = transform_points(FRONT.T_world_camera, FRONT.back_project(depth)[hit].astype(np.float64))
    assert hit.sum() > 500
    assert np.abs(bars.distance_m(points)).max() < 2e-3


def test_the_bar_is_equipment_and_the_hand_before_it_is_not():
    hand = Box("hand", np.array([0.36, 0.5, 0.1]), np.array([0.04, 0.2, 0.1]), np.eye(3))
    scene = built_scene(KNEE_BAR)
    mask = mask_of(picture(FRONT, *ROOM, KNEE_BAR, hand, seed=3), scene)
    on_hand = nearer_than((hand,), (KNEE_BAR,))
    assert mask[(scene.equipment.depth_m > 0) & ~on_hand].mean() > 0.98
    assert mask[on_hand].mean() < 0.1


def test_fingers_around_a_bar_are_seen_where_the_empty_bar_was_measured():
    """They stand out from it by less than the tolerance of a model that was measured by hand."""
    fingers = Box("fingers", np.array([0.338, 0.5, 0.0]), np.array([0.026, 0.2, 0.12]), np.eye(3))  # 26 mm before it
    depth = picture(FRONT, *ROOM, KNEE_BAR, fingers, seed=3)
    scene = built_scene(KNEE_BAR)
    on_fingers = nearer_than((fingers,), (KNEE_BAR,)) & scene.equipment.measured
    assert mask_of(depth, scene)[on_fingers].mean() < 0.1
    model = learn_background(picture(FRONT, *ROOM, seed=0), [picture(FRONT, *ROOM, seed=1)], FRONT, 0.0)
    drawn = set_scene(FRONT, model, EquipmentModel((KNEE_BAR,)))
    assert mask_of(depth, drawn)[on_fingers].mean() > 0.3


def test_a_bar_that_gives_no_reading_still_hides():
    scene = built_scene(KNEE_BAR)
    lost = picture(FRONT, *ROOM, KNEE_BAR, seed=3)
    lost[scene.equipment.depth_m > 0] = 0
    assert mask_of(lost, scene)[scene.equipment.depth_m > 0].all()


def test_a_bar_a_little_off_its_place_is_still_taken_away():
    """A pose found from depth is good to some millimetres."""
    moved = Box("knee-bar", KNEE_BAR.center_m + np.array([0.004, 0.003, 0.003]), KNEE_BAR.size_m, KNEE_BAR.rotation)
    model = learn_background(picture(FRONT, *ROOM, seed=0), [picture(FRONT, *ROOM, seed=1)], FRONT, 0.0)
    scene = set_scene(FRONT, model, EquipmentModel((moved,)))
    depth = picture(FRONT, *ROOM, KNEE_BAR, *body(0.0, 0.0), seed=3)
    labels = find_pieces(depth, scene).labels
    on_bar = nearer_than((KNEE_BAR,), body(0.0, 0.0))
    assert (labels[on_bar] == PixelLabel.EQUIPMENT).mean() > 0.97


def test_the_patient_behind_a_bar_loses_only_what_it_hides():
    scene = built_scene(KNEE_BAR)
    labels = find_pieces(picture(FRONT, *ROOM, KNEE_BAR, *body(0, 0), seed=3), scene).labels
    beside = in_front(FRONT, *body(0, 0)) & ~(scene.equipment.low_m < np.inf)
    assert (labels[beside] == PixelLabel.CLUTTER).mean() > 0.98
