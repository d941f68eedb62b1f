"""Draw how a hole in a frame's mesh distorts geodesic distances from an anchor (paper, Definitions 4 and 5).

Colour shows the distortion: by how much a distance is longer with the hole. Lines along the hole's border show where
the anchor's distances to the border are undistorted (the bright region) and where they are distorted (the shadowed
boundary).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.research.experiment.pictures.canvas import BARE, VERMILLION, View, draw_mesh, frame_axes
from anchorpose.research.occlusion import Light, Occlusion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from dataclasses import dataclass

from anchorpose.geodesics.anchors import Anchors
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.research.experiment.config import PAPER_HOLES_M
from anchorpose.research.experiment.pictures.canvas import Picture, blank_figure
from anchorpose.research.geodesic_solvers import Solver
from anchorpose.research.occlusion import border_is_covered, light_from, occlude
from anchorpose.surface.surface import Surface

SHOWN_M: Final = 0.10  # m, distortion at the upper end of the colour scale
ANCHOR: Final = VERMILLION  # colour of the anchor, which is red in the paper
# colours of a hole's border: its bright part, where distances are undistorted, its shadowed part, where distances are
# distorted (both as in the paper), and the rest
BRIGHT, SHADOWED, NEITHER = "#f0e442", "#000000", "#8c8c8c"
LEAST_BLUE: Final = 0.25  # start of the scale in the colour map (0 to 1), so that small distortions are visible
CUT_OFF: Final = (0.80, 0.47, 0.65)  # colour of nodes that the hole disconnects from the anchor


def draw_light(axes: Axes, view: View, light: Light, node: int, title: str) -> None:
    """Draw distortion as colour, the hole's border with its bright parts (undistorted distances) and shadowed parts
    (distorted distances), and the anchor as a star.
    """
    occlusion = light.occlusion
    _draw_distortion(axes, view, occlusion, light.distortion_m)
    for edges, colour, width in (
        (occlusion.boundary.edges, NEITHER, 1.5),
        (light.shadowed_boundary.edges, SHADOWED, 2.6),
        (light.bright.edges, SHADOWED, 4.2),  # a dark rim, so that the yellow edges are visible on the grey mesh
        (light.bright.edges, BRIGHT, 2.6),
    ):
        _draw_edges(axes, view, occlusion, edges, colour, width)
    axes.plot(*view.flat_m(occlusion.whole.points_m[node]), "*", color=ANCHOR, markeredgecolor="black", markersize=13)
    axes.set_title(title)


def draw_together(axes: Axes, view: View, lights: Sequence[Light]) -> None:
    """Draw, for each node, the smallest distortion over all anchors, and the union of the anchors' bright regions (the
    parts of the hole's border with undistorted distances).
    """
    occlusion = lights[0].occlusion
    with np.errstate(invalid="ignore"):
        least = np.min([light.distortion_m for light in lights], axis=0)
    _draw_distortion(axes, view, occlusion, least)
    _draw_edges(axes, view, occlusion, occlusion.boundary.edges, SHADOWED, 4.2)
    for light in lights:
        _draw_edges(axes, view, occlusion, light.bright.edges, BRIGHT, 2.6)
    axes.set_title("all together: the least distortion")


def _draw_distortion(axes: Axes, view: View, occlusion: Occlusion, distortion_m: np.ndarray) -> None:
    draw_mesh(axes, view, occlusion.seen, colour_of(distortion_m, occlusion.tolerance_m)[occlusion.node])
    frame_axes(axes, view, [(occlusion.whole, 0.0)])


def colour_of(distortion_m: np.ndarray, tolerance_m: float) -> np.ndarray:
    """Return the colours (n, 3), 0 to 1, of nodes with these distortions.

    Nodes with a distortion of at most ``tolerance_m`` have the colour of the bare mesh. Nodes with a greater distortion
    are blue, darker for a greater distortion up to ``SHOWN_M``. Nodes that the hole disconnects from the anchor have
    the colour ``CUT_OFF``.
    """
    from matplotlib import colormaps

    level = np.clip(np.nan_to_num(distortion_m, nan=0.0, posinf=0.0) / SHOWN_M, 0.0, 1.0)
    colour = colormaps["Blues"](LEAST_BLUE + (1.0 - LEAST_BLUE) * level)[:, :3]
    with np.errstate(invalid="ignore"):
        colour[~(distortion_m > tolerance_m)] = BARE
    colour[np.isposinf(distortion_m)] = CUT_OFF
    return np.asarray(colour)


def _draw_edges(axes: Axes, view: View, occlusion: Occlusion, edges: np.ndarray, colour: str, width: float) -> None:
    from matplotlib.collections import LineCollection

    ends = view.flat_m(occlusion.whole.points_m)[edges]
    axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=width, capstyle="round"))


def explain(figure: Figure, *axes: Axes) -> None:
    """Draw the colour scale and the legend of a figure."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize, to_hex
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    blues = ListedColormap(colormaps["Blues"](np.linspace(LEAST_BLUE, 1.0, 256)))
    scale = ScalarMappable(Normalize(0.0, 100.0 * SHOWN_M), blues)
    figure.colorbar(scale, ax=list(axes), label="longer by (cm)", extend="max", shrink=0.6)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=3.0, label=label)
        for colour, label in ((BRIGHT, "bright border"), (SHADOWED, "shadowed border"), (NEITHER, "between"))
    ]
    handles.append(Patch(color=to_hex(CUT_OFF), label="no path left"))
    handles.append(Line2D([], [], color=ANCHOR, marker="*", linestyle="", markersize=11, label="anchor"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles) if len(axes) > 1 else 3)


SECTION: Final = "regions"
TOLERANCE_M: Final = 0.004  # m, largest distortion that counts as none: fast marching's error between two meshes
TITLES: Final = dict(zip(ANCHOR_NAMES, ("head", "left hand", "right hand", "left foot", "right foot"), strict=True))
COLUMNS: Final = 3
COLOURS: Final = (
    "The mesh of the whole frame, without the nodes that the hole removes; blue where the path is more than 4 mm longer"
    " than without the hole, purple where there is no path left. The hole's border is yellow where distances to it are"
    " undistorted (bright region, Definition 4), black where they are distorted (shadowed boundary, Definition 5), grey"
    " between one such node and one of the other kind."
)


@dataclass(frozen=True, slots=True, eq=False)
class HoledFrame:
    """A frame without a hole, and the pixels that a hole removes from it."""

    title: str
    surface: Surface
    anchors: Anchors
    taken: np.ndarray  # (height, width) bool, pixels of the first camera that the hole removes
    centre_m: np.ndarray  # (3,), centre of the hole, world

    @property
    def hidden(self) -> np.ndarray:
        """Return (n,) bool: nodes whose pixels the hole removes."""
        first = self.surface.camera == 0
        row, column = self.surface.pixel[first].T
        hidden = np.zeros(len(self.surface), bool)
        hidden[first] = self.taken[row, column]
        return hidden

    def within(self, radius_m: float) -> np.ndarray:
        """Return (n,) bool: nodes that are nearer to the hole's centre than ``radius_m``."""
        return np.asarray(np.linalg.norm(self.surface.points_m - self.centre_m, axis=1) < radius_m)

    def node(self, anchor: str) -> int:
        """Return the anchor's node, -1 if it was not found."""
        return int(self.anchors.node[ANCHOR_NAMES.index(anchor)])


def lights_of(holed: HoledFrame, hidden: np.ndarray) -> dict[str, Light]:
    """Return, by anchor, how distances from this anchor change if the nodes ``hidden`` (n,) bool are removed.

    Anchors that were not found or are hidden are left out. The result is empty if no node or every node is hidden.
    """
    if not hidden.any() or hidden.all():
        return {}
    occlusion = occlude(holed.surface, hidden, Solver.FAST_MARCHING, TOLERANCE_M)
    nodes = {name: holed.node(name) for name in ANCHOR_NAMES}
    return {name: light_from(occlusion, node) for name, node in nodes.items() if node >= 0 and not hidden[node]}


def region_pictures(view: View, holed: HoledFrame) -> list[Picture]:
    """Return three pictures of distorted distances: from the anchor that the hole affects most, from all anchors
    together, and from the most affected anchor for each size of hole in the paper.

    The list is empty if the hole hides no node or every node, or if every anchor is missed or hidden.
    """
    lights = lights_of(holed, holed.hidden)
    if not lights:
        return []
    name = max(lights, key=lambda each: len(lights[each].shadow.nodes))
    return [_one(view, holed, name, lights[name]), _all(view, holed, lights), _sizes(view, holed, name)]


def _one(view: View, holed: HoledFrame, name: str, light: Light) -> Picture:
    figure = blank_figure(4.6, 5.0)
    draw_light(figure.add_subplot(), view, light, holed.node(name), TITLES[name])
    explain(figure, *figure.axes)
    caption = f"{holed.title}: effect of the hole on geodesic distances from the {TITLES[name]}. {COLOURS}"
    return Picture("regions-anchor.png", caption, SECTION, figure)


def _all(view: View, holed: HoledFrame, lights: dict[str, Light]) -> Picture:
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
        f"{holed.title}: effect of the hole on geodesic distances from each anchor in turn. {COLOURS} Last: the least"
        f" distortion over all anchors; the bright regions {'cover' if border_is_covered(everyone) else 'do not cover'}"
        " the hole's border together (Proposition 2)."
    )
    return Picture("regions.png", caption, SECTION, figure)


def _sizes(view: View, holed: HoledFrame, name: str) -> Picture:
    figure = blank_figure(9.6, 8.6)
    sizes = [radius_m for radius_m in PAPER_HOLES_M if radius_m > 0]
    for number, radius_m in enumerate(sizes):
        axes = figure.add_subplot(2, COLUMNS, number + 1)
        light = lights_of(holed, holed.within(radius_m)).get(name)
        if light is None:
            axes.set_axis_off()
            axes.set_title(f"{100 * radius_m:.0f} cm: hides no node, or the anchor")
            continue
        draw_light(axes, view, light, holed.node(name), describe_distortion(light, radius_m))
    explain(figure, *figure.axes)
    caption = (
        f"{holed.title}: effect of holes of the paper's sizes at the body's centre on geodesic distances from the"
        f" {TITLES[name]}. Titles: the hole's radius, and the shares of the seen nodes that are farther away with it"
        f" or disconnected. {COLOURS}"
    )
    return Picture("regions-sizes.png", caption, SECTION, figure)


def describe_distortion(light: Light, radius_m: float) -> str:
    """Format the hole's radius, and the shares of seen nodes with a longer path to the anchor, or without a path."""
    seen = light.distortion_m[~light.occlusion.hidden]
    cut = np.isposinf(seen).mean()
    longer = (seen > light.occlusion.tolerance_m).mean() - cut
    return f"{100 * radius_m:.0f} cm: {100 * longer:.0f} % longer, {100 * cut:.0f} % cut off"
