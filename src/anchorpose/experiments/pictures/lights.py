"""One anchor's light on the mesh: distortion of distance as colour, bright and shadowed border as lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.experiments.pictures.canvas import BARE, VERMILLION, View, draw_mesh, frame_axes
from anchorpose.geodesics.occlusion import Light, Occlusion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_M: Final = 0.10  # distortion at which the colour scale ends
ANCHOR: Final = VERMILLION  # red in the paper
BRIGHT, SHADOWED, NEITHER = "#f0e442", "#000000", "#8c8c8c"  # yellow and black in the paper
LEAST_BLUE: Final = 0.25  # where the scale begins: what is distorted at all stands out from the bare mesh
CUT_OFF: Final = (0.80, 0.47, 0.65)


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
    draw_mesh(axes, view, occlusion.seen, colour_of(distortion_m, occlusion.tolerance_m)[occlusion.node])
    frame_axes(axes, view, [(occlusion.whole, 0.0)])


def colour_of(distortion_m: np.ndarray, tolerance_m: float) -> np.ndarray:
    """(n, 3) 0 to 1: the bare mesh up to the tolerance, then blues up to ``SHOWN_M``; another colour where cut off."""
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
    """The scale and the legend."""
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
    handles.append(Patch(color=to_hex(CUT_OFF), label="no way left"))
    handles.append(Line2D([], [], color=ANCHOR, marker="*", linestyle="", markersize=11, label="anchor"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles) if len(axes) > 1 else 3)
