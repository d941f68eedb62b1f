"""Bright and shadow regions of the hole (paper, Definitions 4 and 5) on the mesh of a real frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.experiments.config import PAPER_HOLES_M
from anchorpose.experiments.pictures.canvas import Picture, View, blank_figure, draw_mesh, frame_axes
from anchorpose.experiments.pictures.lights import draw_light, draw_together, explain
from anchorpose.geodesics.anchors import ANCHOR_NAMES, Anchors
from anchorpose.geodesics.distance import Solver
from anchorpose.geodesics.occlusion import Light, border_is_covered, light_from, occlude
from anchorpose.surface.surface import Surface

SECTION: Final = "regions"
TOLERANCE_M: Final = 0.004  # fast marching's own error between two meshes
TITLES: Final = dict(zip(ANCHOR_NAMES, ("head", "left hand", "right hand", "left foot", "right foot"), strict=True))
COLUMNS: Final = 3
COLOURS: Final = (
    "The mesh of the whole frame, without the nodes that the hole takes; blue where the way is more than 4 mm longer"
    " than without the hole, purple where there is none left. The hole's border is yellow where distances to it are"
    " undistorted (bright region, Definition 4), black where they are distorted (shadowed boundary, Definition 5), grey"
    " between one such node and one of the other kind."
)


@dataclass(frozen=True, slots=True, eq=False)
class Holed:
    """A frame that shows the patient whole, and what the hole takes of it. taken (height, width) bool: pixels of the
    first camera; centre_m (3,): of the hole, world."""

    title: str
    surface: Surface
    anchors: Anchors
    taken: np.ndarray
    centre_m: np.ndarray

    @property
    def hidden(self) -> np.ndarray:
        """(n,) bool: nodes whose pixel was taken."""
        first = self.surface.camera == 0
        row, column = self.surface.pixel[first].T
        hidden = np.zeros(len(self.surface), bool)
        hidden[first] = self.taken[row, column]
        return hidden

    def within(self, radius_m: float) -> np.ndarray:
        """(n,) bool: nodes that a hole of another size would take."""
        return np.asarray(np.linalg.norm(self.surface.points_m - self.centre_m, axis=1) < radius_m)

    def node(self, anchor: str) -> int:
        """-1 where it was not found."""
        return int(self.anchors.node[ANCHOR_NAMES.index(anchor)])


def lights_of(holed: Holed, hidden: np.ndarray) -> dict[str, Light]:
    """What hiding nodes (n,) bool does to distances from each anchor that was found and is seen; none if it hides no
    node or all of them."""
    if not hidden.any() or hidden.all():
        return {}
    occlusion = occlude(holed.surface, hidden, Solver.FAST_MARCHING, TOLERANCE_M)
    nodes = {name: holed.node(name) for name in ANCHOR_NAMES}
    return {name: light_from(occlusion, node) for name, node in nodes.items() if node >= 0 and not hidden[node]}


def region_pictures(view: View, holed: Holed) -> list[Picture]:
    """The anchor whose distances the hole distorts most, all anchors, and the paper's sizes of hole."""
    lights = lights_of(holed, holed.hidden)
    if not lights:
        return []
    name = max(lights, key=lambda each: len(lights[each].shadow.nodes))
    return [_one(view, holed, name, lights[name]), _all(view, holed, lights), _sizes(view, holed, name)]


def _one(view: View, holed: Holed, name: str, light: Light) -> Picture:
    figure = blank_figure(4.6, 5.0)
    draw_light(figure.add_subplot(), view, light, holed.node(name), TITLES[name])
    explain(figure, *figure.axes)
    caption = f"{holed.title}: what the hole does to geodesic distances from the {TITLES[name]}. {COLOURS}"
    return Picture("regions-anchor.png", caption, SECTION, figure)


def _all(view: View, holed: Holed, lights: dict[str, Light]) -> Picture:
    figure = blank_figure(9.6, 8.6)
    for number, name in enumerate(ANCHOR_NAMES):
        axes = figure.add_subplot(2, COLUMNS, number + 1)
        if name in lights:
            draw_light(axes, view, lights[name], holed.node(name), TITLES[name])
        else:
            draw_mesh(axes, view, holed.surface)
            frame_axes(axes, view, [(holed.surface, 0.0)])
            axes.set_title(f"{TITLES[name]}: not found")
    everyone = list(lights.values())
    draw_together(figure.add_subplot(2, COLUMNS, len(ANCHOR_NAMES) + 1), view, everyone)
    explain(figure, *figure.axes)
    caption = (
        f"{holed.title}: what the hole does to geodesic distances from each anchor in turn. {COLOURS} Last: the least"
        f" distortion over all anchors; the bright regions {'cover' if border_is_covered(everyone) else 'do not cover'}"
        " the hole's border together (Proposition 2)."
    )
    return Picture("regions.png", caption, SECTION, figure)


def _sizes(view: View, holed: Holed, name: str) -> Picture:
    figure = blank_figure(9.6, 8.6)
    sizes = [radius_m for radius_m in PAPER_HOLES_M if radius_m > 0]
    for number, radius_m in enumerate(sizes):
        axes = figure.add_subplot(2, COLUMNS, number + 1)
        light = lights_of(holed, holed.within(radius_m)).get(name)
        if light is None:
            axes.set_axis_off()
            axes.set_title(f"{100 * radius_m:.0f} cm: hides no node, or the anchor")
            continue
        draw_light(axes, view, light, holed.node(name), told(light, radius_m))
    explain(figure, *figure.axes)
    caption = (
        f"{holed.title}: what holes of the paper's sizes at the body's centre do to geodesic distances from the"
        f" {TITLES[name]}. Titles: the hole's radius, and the shares of the seen nodes that are farther away with it"
        f" and that are cut off. {COLOURS}"
    )
    return Picture("regions-sizes.png", caption, SECTION, figure)


def told(light: Light, radius_m: float) -> str:
    """How much of what is seen the hole distorts, and how much it cuts off."""
    seen = light.distortion_m[~light.occlusion.hidden]
    cut = np.isposinf(seen).mean()
    longer = (seen > light.occlusion.tolerance_m).mean() - cut
    return f"{100 * radius_m:.0f} cm: {100 * longer:.0f} % longer, {100 * cut:.0f} % cut off"
