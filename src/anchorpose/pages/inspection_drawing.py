"""Draw one camera's picture of every stage of an inspected frame, in the order of the stages."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Final

import numpy as np

from anchorpose.body.skin_points import body_points
from anchorpose.geodesics.center import center_field
from anchorpose.geodesics.extrema import geodesic_extrema
from anchorpose.isolation.background import equipment_mask, foreground
from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.pages.canvas import (
    Ink,
    colour_of_person,
    draw_contour,
    draw_dots,
    draw_lines,
    enlarge,
    projector,
    scale_of,
    shade,
    write,
)
from anchorpose.pages.overlay import OverlayScene, draw_scene
from anchorpose.pages.stage_drawing import (
    Layer,
    draw_arrows,
    draw_bar,
    draw_crosses,
    draw_layers,
    draw_values,
    fill_blocks,
    name_masks,
)
from anchorpose.surface.border import Border
from anchorpose.surface.links import links
from anchorpose.tracker.inspection import InspectedCamera
from anchorpose.tracker.observation import Observation

ISO_M: Final = 0.1  # m, spacing of the contour lines of distance along the skin
# Factor by which arrows are longer than the movement that they show: a hand moves nine pixels in a frame, too few to
# see as an arrow
MAGNIFIED: Final = 3.0
LIGHT: Final = np.array([-0.4, -0.5, -0.77])  # direction towards the light, camera frame; light comes from above left
SEEN_ONCE: Final = (235.0, 235.0, 235.0)  # colour of surface that is not linked with another camera's surface
SEEN_TWICE: Final = (255.0, 200.0, 130.0)  # colour of surface that is linked with another camera's surface

Projection = Callable[[np.ndarray], np.ndarray]
SurfaceDrawing = Callable[[InspectedCamera, Observation, np.ndarray], np.ndarray | None]


def draw_foreground(one: InspectedCamera) -> np.ndarray:
    """Draw the foreground: pixels in front of the empty room."""
    mask = foreground(one.depth_m, one.scene.background, one.time_s)
    return draw_layers(one.depth_m, one.camera, [Layer(mask, Ink.SKY)])


def draw_equipment(one: InspectedCamera) -> np.ndarray | None:
    """Draw where the equipment is expected, which pixels were removed as equipment, and where equipment hides surfaces
    behind it; None without equipment.
    """
    expected = one.scene.equipment
    if expected is None:
        return None
    nearer = foreground(one.depth_m, one.scene.background, one.time_s)
    removed = equipment_mask(one.depth_m, nearer, expected)
    layers = [Layer(removed, Ink.EQUIPMENT), Layer(removed & (expected.depth_m > 0), Ink.BLUE, hatched=True)]
    picture = draw_layers(one.depth_m, one.camera, layers)
    draw_contour(picture, expected.depth_m > 0, one.camera, Ink.WHITE)
    return picture


def draw_people(one: InspectedCamera) -> np.ndarray:
    """Draw the person label of each pixel or, if the patient was not found, the separate pieces of the foreground."""
    labels = _labels(one)
    people = [int(label) for label in np.unique(labels) if label >= PixelLabel.PATIENT]
    masks = [labels == label for label in people]
    layers = [Layer(labels == PixelLabel.EQUIPMENT, Ink.EQUIPMENT), Layer(labels == PixelLabel.CLUTTER, Ink.GREY)]
    layers += [Layer(mask, colour_of_person(label)) for mask, label in zip(masks, people, strict=True)]
    picture = draw_layers(one.depth_m, one.camera, layers)
    name_masks(picture, one.camera, masks, [person_name(label) for label in people])
    return picture


def _of_surface(draw: SurfaceDrawing) -> Callable[[InspectedCamera], np.ndarray | None]:
    """Turn ``draw``, which draws the nodes of the patient's surface that ``own`` selects, into a function that draws
    one camera's picture: ``own`` is then the mask of the nodes that this camera saw. The picture is None if the camera
    saw no node.
    """

    @wraps(draw)
    def drawn(one: InspectedCamera) -> np.ndarray | None:
        seen = one.inspection.observation
        if seen is None:
            return None
        own = seen.surface.camera == one.number
        return draw(one, seen, own) if own.any() else None

    return drawn


@_of_surface
def draw_mesh(one: InspectedCamera, seen: Observation, own: np.ndarray) -> np.ndarray:
    """Draw the patient's surface, shaded, in another colour where it is linked with another camera's surface; its links
    across gaps; inferred hidden skin; and its rim where the patient's own body, an object or the image's edge cuts it
    off.
    """
    picture, to_pixel = _canvas(one)
    surface, pairs = seen.surface, links(seen.surface)[0]
    draw_dots(picture, to_pixel(seen.whole.points_m[len(surface) :]), Ink.GREEN, 1, rim=False)
    same = surface.camera[pairs[:, 0]] == surface.camera[pairs[:, 1]]
    twice = np.zeros(len(surface), dtype=bool)
    twice[pairs[~same].ravel()] = True
    normals = surface.normals[own] @ one.camera.require_pose()[:3, :3]
    light = 0.2 + 0.8 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    colour = light[:, None] * np.where(twice[own, None], SEEN_TWICE, SEEN_ONCE)
    fill_blocks(picture, one.camera, surface.pixel[own], colour.astype(np.uint8))
    for kind, colour in ((Border.SELF, Ink.PURPLE), (Border.CUT, Ink.VERMILLION)):
        draw_dots(picture, to_pixel(surface.points_m[own & (seen.border == kind)]), colour, 1, rim=False)
    bridges = pairs[same & own[pairs[:, 0]]]
    draw_lines(
        picture, to_pixel(surface.points_m[bridges[:, 0]]), to_pixel(surface.points_m[bridges[:, 1]]), Ink.YELLOW
    )
    return picture


@_of_surface
def draw_geodesics(one: InspectedCamera, seen: Observation, own: np.ndarray) -> np.ndarray:
    """Draw the distance along the skin from the body's centre, with a contour line every ``ISO_M``."""
    picture, to_pixel = _canvas(one)
    whole = center_field(seen.whole)
    field, centre = whole.distance_m[: len(seen.surface)], whole.center
    reached = field[np.isfinite(field)]
    highest = float(reached.max()) if len(reached) else 1.0
    draw_values(picture, one.camera, seen.surface.pixel[own], field[own], highest, ISO_M)
    if own[centre]:
        draw_dots(picture, to_pixel(seen.surface.points_m[[centre]]), Ink.VERMILLION, 7, ["centre"])
    return draw_bar(picture, "0 m", f"{highest:.2f} m")


@_of_surface
def draw_anchors(one: InspectedCamera, seen: Observation, own: np.ndarray) -> np.ndarray:
    """Draw all extrema of the surface: the points farther along the skin from the body's centre than all points around
    them. Extrema that were identified as anchors (head, hands, feet) get their names, and anchors that were missed are
    listed.
    """
    picture, to_pixel = _canvas(one)
    extrema = geodesic_extrema(
        seen.whole, center_field(seen.whole).distance_m, one.config.anchors.radius * one.inspection.height_m
    )
    draw_values(picture, one.camera, seen.surface.pixel[own], np.full(int(own.sum()), 0.35), 1.0, None)
    draw_dots(picture, to_pixel(seen.surface.points_m[extrema[own[extrema]]]), Ink.WHITE, 11, hollow=True)
    found = seen.anchors.found
    here = np.where(own[seen.anchors.node, None] & found[:, None], seen.anchors.position_m, np.nan)
    elsewhere = np.where(found[:, None] & ~own[seen.anchors.node, None], seen.anchors.position_m, np.nan)
    draw_dots(picture, to_pixel(elsewhere), Ink.SKY, 6, [f"{name} (seen by another camera)" for name in ANCHOR_NAMES])
    draw_dots(picture, to_pixel(here), Ink.VERMILLION, 8, ANCHOR_NAMES)
    missed = [name for name, known in zip(ANCHOR_NAMES, found, strict=True) if not known]
    write(picture, f"missed: {', '.join(missed) if missed else 'none'}", (0, 16))
    return picture


@_of_surface
def draw_hypotheses(one: InspectedCamera, seen: Observation, own: np.ndarray) -> np.ndarray | None:
    """Draw, for each node, how many of its hypotheses matched it with a node of the next frame's surface. A hypothesis
    is the match that is found with one subset of the anchors (head, hands, feet); a node has one hypothesis per subset.
    The result is None without a next frame.
    """
    if (following := one.inspection.next) is None:
        return None
    picture, _ = _canvas(one)
    matched = (following.links.match >= 0).sum(axis=1).astype(np.float64)
    subsets = following.links.match.shape[1]
    values = np.where(matched > 0, matched, np.nan)
    draw_values(picture, one.camera, seen.surface.pixel[own], values[own], float(subsets), None)
    return draw_bar(picture, "1", f"{subsets} hypotheses")


@_of_surface
def draw_tree(one: InspectedCamera, seen: Observation, own: np.ndarray) -> np.ndarray | None:
    """Draw, as arrows, how places on the skin move to the next frame according to the best branch of the track tree
    (the tree of possible matches of nodes over the next frames). Nodes without a match get a cross. The result is None
    without a next frame.
    """
    if (following := one.inspection.next) is None:
        return None
    picture, to_pixel = _canvas(one)
    chosen = own[following.hypothesis.node]
    nodes = seen.surface.points_m[following.hypothesis.node[chosen]].astype(np.float64)
    matched = following.hypothesis.matched_m[chosen]
    missed = ~np.isfinite(matched).all(axis=1)
    draw_crosses(picture, to_pixel(nodes[missed]), Ink.ORANGE)
    draw_arrows(picture, to_pixel(nodes), to_pixel(nodes + MAGNIFIED * (matched - nodes)), Ink.SKY)
    return picture


def draw_registration(one: InspectedCamera) -> np.ndarray | None:
    """Draw the posed body and the joints; None if the patient was not found."""
    estimate = one.inspection.estimate
    if estimate is None or estimate.belief is None or estimate.shape is None:
        return None
    asset = body_points().asset
    body = estimate.shape.mesh(asset)
    pose = estimate.belief.pose
    view = estimate.observation.evidence.views[one.number] if estimate.observation else None
    return draw_scene(
        OverlayScene(
            camera=one.camera,
            depth_m=one.depth_m,
            labels=None if view is None else view.labels,
            joints_m=estimate.joints_m,
            joint_states=estimate.states,
            sigma_m=estimate.sigma_m,
            body_m=body.skin(body.bone_transforms(pose.rotations, pose.root_m)),
        )
    )


def _canvas(one: InspectedCamera) -> tuple[np.ndarray, Projection]:
    """Return the dimmed depth image to draw on, and the projection of world points onto it."""
    picture = enlarge(shade(one.depth_m) // 2, scale_of(one.camera))
    return picture, projector(one.camera, scale_of(one.camera))


def person_name(label: int) -> str:
    """Return the name that pictures show for the person with this pixel label."""
    return "patient" if label == PixelLabel.PATIENT else f"person {label - PixelLabel.OTHER_PERSON + 2}"


def _labels(one: InspectedCamera) -> np.ndarray:
    observation = one.inspection.observation
    view = None if observation is None else observation.evidence.views[one.number]
    return find_pieces(one.depth_m, one.scene, one.time_s).labels if view is None else view.labels
