"""Anchors: geodesic extrema of the surface (paper, Definition 2 and the equation after it).

The anchor descriptor f (paper, Definition 3): every node's geodesic distance to every anchor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.geodesics.center import CenterField, center_field
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import Cap, find_caps, geodesic_extrema
from anchorpose.geodesics.naming import HEAD, LIMBS, Frame, name_extrema, place_costs
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.settings import Positive, settings
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """The five identified anchors of a surface; a missed one is marked as missed, never guessed.

    node (5,) int32: index into the surface, -1 where missed. position_m (5, 3) float64 world: centre of the extremal
    cap, NaN where missed; sigma_m (5,) float64: one standard deviation of it on an axis, NaN where missed. The node is
    the cap's nearest to that centre: from frame to frame it moves half as much as the extremum itself, and so do the
    distances measured from it. free: ends of limbs (neither cut off nor continued by hidden skin) that got no name, the
    farthest from the centre first.
    """

    node: np.ndarray
    position_m: np.ndarray
    sigma_m: np.ndarray
    free: tuple[Cap, ...] = ()

    @property
    def found(self) -> np.ndarray:
        """(5,) bool."""
        return self.node >= 0


@settings
class AnchorConfig:
    """Lengths are fractions of the subject's height, so that they adapt to it (paper, Section V)."""

    radius: Positive = 0.5 / 1.75  # r: 0.5 m on a person of 1.75 m
    cap: Positive = 0.06 / 1.75  # how far below its tip the extremal cap reaches: 6 cm, about a fist
    gate: Positive = 0.25 / 1.75  # so near its prediction, an end is the anchor in any pose: half a forearm


HEAD_GATE: Final = 0.18 / 1.75  # of the height; a head moves less, and a neck without its head is 20 cm away
END_GATE: Final = 0.09 / 1.75  # an end so near its prediction is one, even if hidden skin seems to continue


def find_anchors(
    surface: Surface,
    up: np.ndarray,
    facing: np.ndarray,
    height_m: float = 1.75,
    cut: np.ndarray | None = None,
    predicted_m: np.ndarray | None = None,
    config: AnchorConfig | None = None,
    missing: np.ndarray | None = None,
) -> Anchors:
    """The identified anchors: which extremum is the head, which the hands and feet, and which is none of them.

    up, facing (3,) unit, world: against gravity, and the way the patient faces; height_m: the subject's. cut (n,) bool:
    nodes at an edge that something else cut (``surface.border``); an extremum there is a stump, not an anchor, unless
    another camera sees its end. predicted_m (5, 3) world: where each anchor is expected, NaN for one without
    expectation, None for none. missing (5,) bool: anchors of limbs that the patient lacks. The names are the assignment
    of least total cost, of which the prediction is a bounded part (``naming``); an anchor is missed where every
    extremum costs too much, and so are all anchors of a surface without seen nodes.

    Left and right are those of ``facing``, whatever the prediction says of single hands or feet. Where facing is wrong
    by half a turn, they are exchanged consistently, with nothing in the anchors to show it.
    """
    config = config or AnchorConfig()
    if surface.seen_count == 0:
        return no_anchors()
    center = center_field(surface)
    extrema = geodesic_extrema(surface, center.distance_m, config.radius * height_m)
    caps = find_caps(surface, center.distance_m, extrema, config.cap * height_m, cut)
    if not caps:
        return no_anchors()
    frame = Frame(up, np.cross(up, facing), height_m)
    no_end = _no_end_of_a_limb(surface, center, caps)
    away = _off_prediction(caps, predicted_m) / height_m
    excluded = no_end & ~(away < END_GATE)  # a hand on a rail ends at a cut, just where its end is expected
    excluded |= False if missing is None else missing
    away /= np.array([HEAD_GATE, *[config.gate] * LIMBS])
    chosen = name_extrema(*place_costs(surface, center, caps, frame), away, excluded)
    free = tuple(cap for number, cap in enumerate(caps) if number not in chosen and not no_end[number, -1])
    return _named(surface, caps, chosen, free)


def _off_prediction(caps: Sequence[Cap], predicted_m: np.ndarray | None) -> np.ndarray:
    """(k, 5) metres: how far each extremum is from where each anchor is predicted, NaN for one without prediction."""
    if predicted_m is None:
        return np.full((len(caps), len(ANCHOR_NAMES)), np.nan)
    centers = np.array([cap.center_m for cap in caps])
    away: np.ndarray = np.linalg.norm(centers[:, None] - predicted_m[None], axis=2)
    return away


def anchor_descriptor(
    surface: Surface,
    anchors: Anchors,
    distance: Callable[[Surface, np.ndarray], np.ndarray] = geodesic_distance,
) -> np.ndarray:
    """(n, 5) float32 metres, columns in the order of ``ANCHOR_NAMES``.

    NaN in the column of a missed anchor; inf where the node lies on a piece of surface the anchor does not reach.
    """
    descriptor = np.full((len(surface), len(anchors.node)), np.nan, np.float32)
    descriptor[:, anchors.found] = distance(surface, anchors.node[anchors.found]).T
    return descriptor


def _named(surface: Surface, caps: Sequence[Cap], chosen: np.ndarray, free: tuple[Cap, ...]) -> Anchors:
    """The anchors at the chosen caps: chosen (5,) int, -1 = missed."""
    anchors = replace(no_anchors(), free=free)
    for name, number in enumerate(chosen):
        if number >= 0:
            anchors.node[name] = _nearest(surface, caps[number].nodes, caps[number].center_m)
            anchors.position_m[name] = caps[number].center_m
            anchors.sigma_m[name] = caps[number].sigma_m
    return anchors


def no_anchors() -> Anchors:
    """All five missed."""
    count = len(ANCHOR_NAMES)
    return Anchors(np.full(count, -1, np.int32), np.full((count, 3), np.nan), np.full(count, np.nan))


def _no_end_of_a_limb(surface: Surface, field: CenterField, caps: Sequence[Cap]) -> np.ndarray:
    """(k, 5) bool: caps that cannot be that anchor.

    Where hidden skin is a part of their piece, it shows whether a hand or foot continues, better than an edge in the
    depth frame does; the head is then judged by its place.
    """
    hidden = np.unique(field.piece[surface.seen_count :])
    closed = np.isin(field.piece[[cap.tip for cap in caps]], hidden)
    wrong = np.where(closed, [cap.continues for cap in caps], [cap.stump for cap in caps])
    excluded = np.repeat(wrong[:, None], len(ANCHOR_NAMES), axis=1)
    excluded[closed, HEAD] = False
    return excluded


def _nearest(surface: Surface, nodes: np.ndarray, point_m: np.ndarray) -> int:
    return int(nodes[np.argmin(((surface.points_m[nodes] - point_m) ** 2).sum(axis=1))])
