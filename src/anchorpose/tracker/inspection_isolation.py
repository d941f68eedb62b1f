"""Pictures of the stages that tell pixels apart: depth, room, equipment, people."""

from __future__ import annotations

import numpy as np

from anchorpose.isolation.background import foreground
from anchorpose.isolation.equipment import equipment_mask
from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.view import PixelLabel
from anchorpose.results.palette import BLUE, EQUIPMENT, GREY, SKY, WHITE, colour_of_person
from anchorpose.results.stage_pictures import Layer, draw_contour, draw_depth, draw_layers, name_masks
from anchorpose.tracker.inspection import InspectedCamera


def draw_reading(one: InspectedCamera) -> np.ndarray:
    """The depth as it was recorded."""
    return draw_depth(one.depth_m, one.camera)


def draw_background(one: InspectedCamera) -> np.ndarray:
    """The empty room as isolation knows it."""
    return draw_depth(one.scene.background.depth_m, one.camera)


def draw_foreground(one: InspectedCamera) -> np.ndarray:
    """What stands out of the room."""
    mask = foreground(one.depth_m, one.scene.background, one.config.isolation)
    return draw_layers(one.depth_m, one.camera, [Layer(mask, SKY)])


def draw_equipment(one: InspectedCamera) -> np.ndarray | None:
    """Where the equipment is expected, which pixels were removed, which are hidden by it; None without equipment."""
    expected = one.scene.equipment
    if expected is None:
        return None
    nearer = foreground(one.depth_m, one.scene.background, one.config.isolation)
    removed = equipment_mask(one.depth_m, nearer, expected)
    layers = [Layer(removed, EQUIPMENT), Layer(removed & (expected.depth_m > 0), BLUE, hatched=True)]
    picture = draw_layers(one.depth_m, one.camera, layers)
    draw_contour(picture, expected.depth_m > 0, one.camera, WHITE)
    return picture


def draw_people(one: InspectedCamera) -> np.ndarray:
    """Who owns which pixel; without anybody to look for, what would have been looked at."""
    labels = _labels(one)
    people = [int(label) for label in np.unique(labels) if label >= PixelLabel.PATIENT]
    masks = [labels == label for label in people]
    layers = [Layer(labels == PixelLabel.EQUIPMENT, EQUIPMENT), Layer(labels == PixelLabel.CLUTTER, GREY)]
    layers += [Layer(mask, colour_of_person(label)) for mask, label in zip(masks, people, strict=True)]
    picture = draw_layers(one.depth_m, one.camera, layers)
    name_masks(picture, one.camera, masks, [person_name(label) for label in people])
    return picture


def person_name(label: int) -> str:
    """What people call the one with this pixel label."""
    return "patient" if label == PixelLabel.PATIENT else f"person {label - PixelLabel.OTHER_PERSON + 2}"


def _labels(one: InspectedCamera) -> np.ndarray:
    observation = one.inspection.observation
    view = None if observation is None else observation.evidence.views[one.number]
    return find_pieces(one.depth_m, one.scene, one.config.isolation).labels if view is None else view.labels
