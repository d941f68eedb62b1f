"""Draw the paper's figures "appearance" and "mesh": one per cent of each method's matches, both right and wrong."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from anchorpose.research.experiment.matching import Matches, match_window
from anchorpose.research.experiment.method import Family, Method
from anchorpose.research.experiment.pictures.canvas import (
    BLUE,
    VERMILLION,
    Moment,
    Picture,
    View,
    apart_m,
    blank_figure,
    draw_mesh,
    frame_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SECTION: Final = "matches"
ALONE = "match"  # section of the pictures of single methods; the page shows only the picture of all methods
DRAWN_SHARE: Final = 0.01  # share of the matches that are drawn, as in the paper; more lines would hide each other
RIGHT_M: Final = 0.05  # m, maximum error of a right match: the paper's bound on the error of an anchor
DRAW_SEED: Final = 17
PAPER_ORDER: Final = ("fpfh", "rops", "shot", "shape-context", "hks", "si-hks", "wks", "anchors")
COLUMNS: Final = 4
TITLE_LETTERS: Final = 36  # maximum number of letters of a method's title in the picture of all methods
BY_TREE: Final = (
    " A method with several hypotheses per node is shown with the one that its track tree chooses, which uses the"
    " predicted movement; all others with the nearest descriptor."
)


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """A method's matches between two surfaces."""

    key: str
    title: str
    match: np.ndarray  # (n,), for each node of the first surface, its match among the nodes of the second, -1 = none
    error_m: np.ndarray  # (n,), distance of the match from the true place, seen or hidden; NaN without a match or truth
    by_tree: bool = False  # whether the track tree chose the matches from several hypotheses

    @property
    def right(self) -> np.ndarray:
        """Return (n,) bool: nodes whose match is less than ``RIGHT_M`` from the true place."""
        return self.error_m < RIGHT_M


def pairs_of(method: Method, setting: object, moment: Moment) -> Pairs | None:
    """Return a method's matches; None for a complete tracker, and for a method without matches, such as "no
    association".
    """
    if method.associate is None:
        return None
    found = match_window(method, setting, moment.window)
    match, by_tree = chosen_match(found)
    if method.family is Family.NONE and not (match >= 0).any():
        return None
    error = np.full(len(match), np.nan)
    known = (match >= 0) & on_patient(moment)
    places = moment.surfaces[1].points_m[match[known]]
    error[known] = np.linalg.norm(places - moment.truth.place_m[known], axis=1)
    return Pairs(method.key, method.title, match, error, by_tree)


def chosen_match(found: Matches) -> tuple[np.ndarray, bool]:
    """Return (n,) one match per node (-1 = none), and whether the track tree chose it from several hypotheses."""
    if len(found.links[0].subsets) <= 1:
        return found.direct, False
    match = np.full(len(found.direct), -1, np.int32)
    match[found.tree.node] = found.tree.tree.match
    return match, True


def on_patient(moment: Moment) -> np.ndarray:
    """Return (n,) bool: nodes of the first frame that have a true place in the second, seen or hidden."""
    return np.asarray(np.isfinite(moment.truth.place_m).all(axis=1))


def draw_nodes(known: np.ndarray) -> np.ndarray:
    """Return one per cent of the known nodes, (k,), drawn at random. known: (n,) bool.

    The drawn nodes are the same for all methods.
    """
    count = min(int(np.ceil(DRAWN_SHARE * len(known))), int(known.sum()))
    rng = np.random.default_rng(DRAW_SEED)
    return np.sort(rng.choice(np.flatnonzero(known), size=count, replace=False))


def in_paper_order(pairs: Sequence[Pairs]) -> list[Pairs]:
    """Sort methods' matches in the order in which the paper's two figures show the methods; other methods come last."""
    rank = {key: number for number, key in enumerate(PAPER_ORDER)}
    return sorted(pairs, key=lambda each: rank.get(each.key, len(rank)))


def match_pictures(view: View, moment: Moment, pairs: Sequence[Pairs]) -> list[Picture]:
    """Return one picture per method, and one picture in which all methods are side by side."""
    about = (
        f"{moment.title}: the frame on the left, the next one on the right. Lines lead from one per cent of the frame's"
        " nodes, drawn at random, the same for all methods, to their matches: blue and solid within"
        f" {100 * RIGHT_M:.0f} cm of the true place, vermilion and dashed farther off; a ring is a node without"
        " a match. The shares are of all nodes whose true place the next frame shows."
    )
    pictures = []
    for each in pairs:
        figure = blank_figure(4.2, 3.9)
        draw_pairs(figure.add_subplot(), view, moment, each)
        caption = f"{each.title}. {about}{BY_TREE if each.by_tree else ''}"
        pictures.append(Picture(f"matches-{moment.name}-{each.key}.png", caption, ALONE, figure))
    rows = -(-len(pairs) // COLUMNS)
    sheet = blank_figure(3.1 * COLUMNS, 2.9 * rows)
    for number, each in enumerate(in_paper_order(pairs)):
        axes = sheet.add_subplot(rows, COLUMNS, number + 1)
        draw_pairs(axes, view, moment, each)
        axes.set_title(
            f"{textwrap.shorten(each.title, TITLE_LETTERS, placeholder=' ...')}\n{describe_pairs(each, moment)}"
        )
    pictures.append(
        Picture(
            f"matches-{moment.name}.png",
            f"All methods; larger ones are files. {about}{BY_TREE if any(each.by_tree for each in pairs) else ''}",
            SECTION,
            sheet,
        )
    )
    return pictures


def draw_pairs(axes: Axes, view: View, moment: Moment, pairs: Pairs) -> None:
    """Draw both surfaces side by side, with lines from nodes of the first to their matches in the second."""
    from matplotlib.collections import LineCollection

    before, after = moment.surfaces
    shift_m = apart_m(view, before, after)
    draw_mesh(axes, view, before)
    draw_mesh(axes, view, after, shift_m=shift_m)
    node = draw_nodes(on_patient(moment))
    start = view.flat_m(before.points_m)
    end = view.flat_m(after.points_m, shift_m)
    for right, colour, style in ((False, VERMILLION, (0, (4, 2))), (True, BLUE, "solid")):
        drawn = node[(pairs.match[node] >= 0) & (pairs.right[node] == right)]
        lines = np.stack([start[drawn], end[pairs.match[drawn]]], axis=1)
        axes.add_collection(LineCollection(list(lines), colors=colour, linestyles=style, linewidths=1.1))
        axes.plot(*lines.reshape(-1, 2).T, "o" if right else "s", color=colour, markersize=2.4)
    bare = node[pairs.match[node] < 0]
    axes.plot(*start[bare].T, "o", markerfacecolor="none", markeredgecolor="black", markersize=4)
    frame_axes(axes, view, [(before, 0.0), (after, shift_m)])
    axes.set_title(f"{pairs.title}\n{describe_pairs(pairs, moment)}")


def describe_pairs(pairs: Pairs, moment: Moment) -> str:
    """Return, of all nodes whose true place is seen, the shares with a right match, a wrong match and no match."""
    seen = moment.truth.seen
    if not seen.any():
        return "no true place is known"
    right, none = pairs.right[seen].mean(), (pairs.match[seen] < 0).mean()
    wrong = ((pairs.match[seen] >= 0) & ~pairs.right[seen]).mean()
    return f"{percent(right)} right, {percent(wrong)} wrong, {percent(none)} no match"


def percent(share: float) -> str:
    """Format a share as whole per cent. Only exact values give 0 or 100, so that a single wrong match is not hidden."""
    if 0.0 < share < 0.01:
        return "< 1 %"
    if 0.99 < share < 1.0:
        return "> 99 %"
    return f"{100 * share:.0f} %"
