"""Draw the paper's figure "hypothesis": the subset of anchors by which each node was matched with the next frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose.joints import ANCHOR_NAMES
from anchorpose.pages.canvas import Ink, as_hex
from anchorpose.research.experiment.matching import Matches, match_window
from anchorpose.research.experiment.method import Method
from anchorpose.research.experiment.pictures.canvas import Moment, Picture, View, apart_m, blank_figure, frame_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SECTION: Final = "hypotheses"
NODES: Final = 5  # number of nodes whose possible matches are all drawn
DRAW_SEED: Final = 23
MISSED: Final = "#b8b8b8"
COLOURS: Final = (
    *(
        as_hex(colour)
        for colour in (Ink.ORANGE, Ink.SKY, Ink.GREEN, Ink.YELLOW, Ink.BLUE, Ink.VERMILLION, Ink.PURPLE, Ink.BLACK)
    ),
    "#882255",
    "#999933",
    "#117733",
    "#aa4499",
)
"""Colours of subsets of anchors: ten for subsets of three anchors, two for smaller subsets (on surface that a hole cuts
off).

The first eight are Okabe and Ito's colours, the last four are of Paul Tol's muted colours.
"""
MARKERS: Final = "os^vD<>PX*ph"
SHORT: Final = dict(zip(ANCHOR_NAMES, ("head", "left hand", "right hand", "left foot", "right foot"), strict=True))


def name_subset(subset: np.ndarray) -> str:
    """Return the anchors of a subset (n_s,), in words."""
    return ", ".join(SHORT[ANCHOR_NAMES[anchor]] for anchor in subset if anchor >= 0)


def hypothesis_pictures(view: View, moment: Moment, method: Method, setting: object) -> list[Picture]:
    """Return two pictures: all nodes in the colour of the subset that the track tree chose, and a few nodes with all of
    their hypotheses (possible matches).
    """
    found = match_window(method, setting, moment.window)
    figure = blank_figure(8.4, 4.4)
    draw_chosen(figure.add_subplot(), view, moment, found)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center", markerscale=2.5)
    chosen = Picture(
        f"hypotheses-{moment.name}.png",
        f"{moment.title}: each node of the frame (left) in the colour of the subset of anchors whose match the track"
        " tree chose for it, and the match (right) in the same. Shares are of the nodes on the body; where several"
        " subsets lead to the same match, the first of the legend is shown. Grey: no subset's match is near enough to"
        " the node's predicted position, or none is within the gate; on the right, nodes that are not a match.",
        SECTION,
        figure,
    )
    figure = blank_figure(8.4, 4.4)
    draw_possible(figure.add_subplot(), view, moment, found)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center")
    possible = Picture(
        f"hypotheses-{moment.name}-possible.png",
        f"{moment.title}: every possible match of {NODES} nodes drawn at random, one line per subset of anchors, the"
        " tree's choice thick, and the true place as a cross.",
        SECTION,
        figure,
    )
    return [chosen, possible]


def draw_chosen(axes: Axes, view: View, moment: Moment, found: Matches) -> None:
    """Draw the nodes of both frames, each in the colour of the subset of anchors that the track tree chose for it."""
    before, after = moment.surfaces
    shift_m = apart_m(view, before, after)
    start, end = view.flat_m(before.points_m), view.flat_m(after.points_m, shift_m)
    tree, node = found.tree.tree, found.tree.node
    matched = tree.match[tree.match >= 0]
    unused = np.setdiff1d(np.arange(len(after)), matched)
    missed = node[tree.match < 0]
    grey = np.concatenate([start[missed], end[unused]])
    share = len(missed) / max(len(node), 1)
    axes.plot(*grey.T, ".", color=MISSED, markersize=2, label=f"no match ({100 * share:.0f} %)")
    for number, subset in enumerate(found.links[0].subsets):
        by = tree.subset == number
        places = np.concatenate([start[node[by]], end[tree.match[by]]])
        label = f"{name_subset(subset)} ({100 * by.sum() / max(len(node), 1):.0f} %)"
        axes.plot(
            *places.T,
            MARKERS[number % len(MARKERS)],
            color=COLOURS[number % len(COLOURS)],
            markersize=2.6,
            markeredgewidth=0,
            label=label,
        )
    frame_axes(axes, view, [(before, 0.0), (after, shift_m)])


def draw_possible(axes: Axes, view: View, moment: Moment, found: Matches) -> None:
    """Draw lines from a few nodes to all of their possible matches."""
    before, after = moment.surfaces
    shift_m = apart_m(view, before, after)
    start, end = view.flat_m(before.points_m), view.flat_m(after.points_m, shift_m)
    axes.plot(*np.concatenate([start, end]).T, ".", color=MISSED, markersize=1.5)
    rows = draw_rows(found, moment.truth.seen)
    for number, subset in enumerate(found.links[0].subsets):
        look: dict[str, Any] = {"marker": MARKERS[number % len(MARKERS)], "markersize": 4}
        look["color"] = COLOURS[number % len(COLOURS)]
        axes.plot([], [], "-", **look, label=name_subset(subset))
        for row in rows:
            node = found.tree.node[row]
            match = found.links[0].match[node, number]
            if match >= 0:
                width, above = (3.2, 2) if found.tree.tree.subset[row] == number else (1.0, 3)
                ends = np.stack([start[node], end[match]])
                axes.plot(*ends.T, "-", **look, linewidth=width, zorder=above, markevery=[1])
    node = found.tree.node[rows]
    true = view.flat_m(moment.truth.place_m[node], shift_m)
    axes.plot(*true.T, "x", color="black", markersize=8, markeredgewidth=1.6, label="true place", zorder=5)
    frame_axes(axes, view, [(before, 0.0), (after, shift_m)])


def draw_rows(found: Matches, seen: np.ndarray) -> np.ndarray:
    """Return the rows (k,) of ``found.tree`` of up to ``NODES`` random nodes with a hypothesis and a seen true place.

    seen (n,) bool: nodes of the first frame whose true place is seen in the second.
    """
    node = found.tree.node
    usable = np.flatnonzero((found.links[0].match[node] >= 0).any(axis=1) & seen[node])
    rng = np.random.default_rng(DRAW_SEED)
    return np.sort(rng.choice(usable, size=min(NODES, len(usable)), replace=False))
