"""Bright and shadow regions of the hole (paper, Definitions 4 and 5) on the mesh of a real frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.experiments.pictures.canvas import BARE, VERMILLION, Picture, View, blank_figure, draw_mesh, frame_axes
from anchorpose.geodesics.anchors import ANCHOR_NAMES, Anchors
from anchorpose.geodesics.distance import Solver
from anchorpose.geodesics.occlusion import Light, Occlusion, border_is_covered, light_from, occlude
from anchorpose.surface.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SECTION: Final = "regions"
TOLERANCE_M: Final = 0.004  # fast marching's own error between two meshes
SHOWN_M: Final = 0.10  # distortion at which the colour scale ends
ANCHOR: Final = VERMILLION  # red in the paper
BRIGHT, SHADOWED, NEITHER = "#f0e442", "#000000", "#8c8c8c"
LEAST_BLUE: Final = 0.25  # where the scale begins: what is distorted at all stands out from the bare mesh
CUT_OFF: Final = np.array([0.80, 0.47, 0.65])
TITLES: Final = dict(zip(ANCHOR_NAMES, ("head", "left hand", "right hand", "left foot", "right foot"), strict=True))
WHAT: Final = (
    "what the hole does to geodesic distances from {}. The mesh of the whole frame, without the nodes that the hole"
    " takes; blue where the way is longer than without the hole, by more than 4 mm, purple where there is none left."
    " The hole's border is yellow where distances to it are undistorted (bright region, Definition 4), black where they"
    " are distorted (shadowed boundary, Definition 5), grey between one such node and one of the other kind."
)


def hole_in(whole: Surface, taken: np.ndarray) -> np.ndarray:
    """(n,) bool: nodes whose pixel of the first camera (height, width) was taken."""
    row, column = whole.pixel[whole.camera == 0].T
    hidden = np.zeros(len(whole), bool)
    hidden[whole.camera == 0] = taken[row, column]
    return hidden


def lights_of(whole: Surface, anchors: Anchors, hidden: np.ndarray) -> dict[str, Light]:
    """What the hole does to the distances from each anchor that was found and is not itself hidden."""
    occlusion = occlude(whole, hidden, Solver.FAST_MARCHING, TOLERANCE_M)
    return {
        name: light_from(occlusion, int(node))
        for name, node in zip(ANCHOR_NAMES, anchors.node, strict=True)
        if node >= 0 and not hidden[node]
    }


def region_pictures(view: View, whole: Surface, anchors: Anchors, taken: np.ndarray, title: str) -> list[Picture]:
    """The anchor whose distances the hole distorts most, and the sheet of all anchors; none where nothing is hidden."""
    hidden = hole_in(whole, taken)
    if not hidden.any() or hidden.all():
        return []
    lights = lights_of(whole, anchors, hidden)
    if not lights:
        return []
    name = max(lights, key=lambda each: len(lights[each].shadow.nodes))
    figure = blank_figure(4.6, 4.8)
    node = dict(zip(ANCHOR_NAMES, anchors.node.tolist(), strict=True))
    draw_light(figure.add_subplot(), view, lights[name], node[name], TITLES[name])
    _explain(figure, figure.axes[0])
    one = Picture(f"regions-{name.lower()}.png", f"{title}: {WHAT.format('the ' + TITLES[name])}", SECTION, figure)

    sheet = blank_figure(9.6, 8.6)
    for number, name in enumerate(ANCHOR_NAMES):
        axes = sheet.add_subplot(2, 3, number + 1)
        if name in lights:
            draw_light(axes, view, lights[name], node[name], TITLES[name])
        else:
            draw_mesh(axes, view, whole)
            frame_axes(axes, view, [(whole, 0.0)])
            axes.set_title(f"{TITLES[name]}: not found or hidden")
    draw_together(sheet.add_subplot(2, 3, 6), view, list(lights.values()))
    _explain(sheet, *sheet.axes)
    caption = (
        f"{title}: {WHAT.format('each anchor in turn')} Last: all anchors together, coloured by the least distortion;"
        f" the bright regions {'cover' if border_is_covered(list(lights.values())) else 'do not cover'} the hole's"
        " border (Proposition 2)."
    )
    return [one, Picture("regions.png", caption, SECTION, sheet)]


def draw_light(axes: Axes, view: View, light: Light, node: int, title: str) -> None:
    """Distortion as colour, the border by region, the anchor as a star."""
    occlusion = light.occlusion
    _draw_distortion(axes, view, occlusion, light.distortion_m)
    for edges, colour, width in (
        (occlusion.boundary.edges, NEITHER, 1.5),
        (light.shadowed_boundary.edges, SHADOWED, 2.6),
        (light.bright.edges, SHADOWED, 4.2),  # a rim, so that yellow is seen on grey
        (light.bright.edges, BRIGHT, 2.6),
    ):
        _draw_edges(axes, view, occlusion, edges, colour, width)
    axes.plot(*view.flat_m(occlusion.whole.points_m[node]), "*", color=ANCHOR, markeredgecolor="black", markersize=13)
    axes.set_title(title)


def draw_together(axes: Axes, view: View, lights: Sequence[Light]) -> None:
    """The least distortion over all anchors, and the union of the bright regions."""
    occlusion = lights[0].occlusion
    with np.errstate(invalid="ignore"):
        least = np.min([light.distortion_m for light in lights], axis=0)
    _draw_distortion(axes, view, occlusion, least)
    _draw_edges(axes, view, occlusion, occlusion.boundary.edges, SHADOWED, 4.2)
    for light in lights:
        _draw_edges(axes, view, occlusion, light.bright.edges, BRIGHT, 2.6)
    axes.set_title("all together: the least distortion")


def _draw_distortion(axes: Axes, view: View, occlusion: Occlusion, distortion_m: np.ndarray) -> None:
    draw_mesh(axes, view, occlusion.seen, colour_of(distortion_m)[occlusion.node])
    frame_axes(axes, view, [(occlusion.whole, 0.0)])


def colour_of(distortion_m: np.ndarray) -> np.ndarray:
    """(n, 3) 0 to 1: the bare mesh up to the tolerance, then blues up to ``SHOWN_M``; another colour where cut off."""
    from matplotlib import colormaps

    level = np.clip(np.nan_to_num(distortion_m, nan=0.0, posinf=0.0) / SHOWN_M, 0.0, 1.0)
    colour = colormaps["Blues"](LEAST_BLUE + (1.0 - LEAST_BLUE) * level)[:, :3]
    with np.errstate(invalid="ignore"):
        colour[~(distortion_m > TOLERANCE_M)] = BARE
    colour[np.isposinf(distortion_m)] = CUT_OFF
    return np.asarray(colour)


def _draw_edges(axes: Axes, view: View, occlusion: Occlusion, edges: np.ndarray, colour: str, width: float) -> None:
    from matplotlib.collections import LineCollection

    ends = view.flat_m(occlusion.whole.points_m)[edges]
    axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=width, capstyle="round"))


def _explain(figure: Figure, *axes: Axes) -> None:
    """The scale and the legend."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.lines import Line2D

    blues = ListedColormap(colormaps["Blues"](np.linspace(LEAST_BLUE, 1.0, 256)))
    scale = ScalarMappable(Normalize(0.0, 100.0 * SHOWN_M), blues)
    figure.colorbar(scale, ax=list(axes), label="longer by (cm)", extend="max", shrink=0.6)
    handles = [
        Line2D([], [], color=colour, linewidth=3.0, label=label)
        for colour, label in ((BRIGHT, "bright border"), (SHADOWED, "shadowed border"), (NEITHER, "between"))
    ]
    handles.append(Line2D([], [], color=ANCHOR, marker="*", linestyle="", markersize=11, label="anchor"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
