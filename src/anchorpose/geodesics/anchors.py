"""Anchors: geodesic extrema of the surface (paper, Definition 2 and the equation after it).

The anchor descriptor f (paper, Definition 3): every node's geodesic distance to every anchor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import Cap, find_caps, geodesic_extrema, seen_mean, surface_center
from anchorpose.settings import Positive, settings
from anchorpose.surface.surface import Surface

ANCHOR_NAMES: Final = ("Head", "HandLeft", "HandRight", "FootLeft", "FootRight")
"""The identified anchors, in this order everywhere; left is the patient's left."""


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """The five identified anchors of a surface; a missed one is marked as missed, never guessed.

    node (5,) int32: index into the surface, -1 where missed. position_m (5, 3) float64 world: centre of the extremal
    cap, NaN where missed; sigma_m (5,) float64: one standard deviation of it on an axis, NaN where missed. The node is
    the cap's nearest to that centre: from frame to frame it moves half as much as the extremum itself, and so do the
    distances measured from it.
    """

    node: np.ndarray
    position_m: np.ndarray
    sigma_m: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(5,) bool."""
        return self.node >= 0


@settings
class AnchorConfig:
    """Lengths are fractions of the subject's height, so that they adapt to it (paper, Section V)."""

    radius: Positive = 0.5 / 1.75  # r: 0.5 m on a person of 1.75 m
    cap: Positive = 0.06 / 1.75  # how far below its tip the extremal cap reaches: 6 cm, about a fist
    gate: Positive = 0.25 / 1.75  # how far from its prediction an anchor may be: half a forearm


HEAD_GATE: Final = 0.18 / 1.75  # of the height; a head moves less, and a neck without its head is 20 cm away
END_GATE: Final = 0.09 / 1.75  # an end so near its prediction is one, even if hidden skin seems to continue
FIRST_GATE: Final = 2.1  # without prediction, in tolerances of the body's proportions; a foot is 2.15 from a hand

PROPORTIONS: Final = np.array(
    # geodesic distance from the centre, height above it, distance to the left of it; over the body height
    [[0.42, 0.42, 0.0], [0.52, 0.08, 0.20], [0.52, 0.08, -0.20], [0.56, -0.50, 0.07], [0.56, -0.50, -0.07]]
)
"""Where the anchors of a standing person are, seen from the centre of the front (order of ``ANCHOR_NAMES``)."""

TOLERANCES: Final = np.array(
    [[0.10, 0.10, 0.12], [0.12, 0.27, 0.20], [0.12, 0.27, 0.20], [0.10, 0.12, 0.12], [0.10, 0.12, 0.12]]
)
"""By how much those vary: arms move a lot, head and feet hardly."""

HEAD: Final = 0  # its far side is hidden from most cameras, so that hidden skin always continues there


def find_anchors(
    surface: Surface,
    up: np.ndarray,
    facing: np.ndarray,
    height_m: float = 1.75,
    cut: np.ndarray | None = None,
    predicted_m: np.ndarray | None = None,
    config: AnchorConfig | None = None,
) -> Anchors:
    """The identified anchors: which extremum is the head, which the hands and feet, and which is none of them.

    up, facing (3,) unit, world: against gravity, and the way the patient faces; height_m: the subject's. cut (n,) bool:
    nodes at an edge that something else cut (``surface.border``); an extremum there is a stump, not an anchor, unless
    another camera sees its end. predicted_m (5, 3) world: where each anchor is expected; for one without (NaN, or None
    for all) the proportions of a standing body decide. The names are the assignment of least total cost; an anchor
    without an extremum within its gate is missed, and so are all anchors of a surface without seen nodes.
    """
    config = config or AnchorConfig()
    if surface.seen_count == 0:
        return no_anchors()
    field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
    extrema = geodesic_extrema(surface, field, config.radius * height_m)
    caps = find_caps(surface, field, extrema, config.cap * height_m, cut)
    if not caps:
        return no_anchors()
    centers = np.array([cap.center_m for cap in caps])
    cost = _proportion_cost(surface, np.array([cap.reach_m for cap in caps]), centers, up, facing, height_m)
    cost /= FIRST_GATE
    excluded = _no_end_of_a_limb(caps, surface.seen_count < len(surface))
    if predicted_m is not None:
        gates = np.full(len(ANCHOR_NAMES), config.gate)
        gates[HEAD] = HEAD_GATE
        away = np.linalg.norm(centers[:, None] - predicted_m[None], axis=2) / height_m
        cost = np.where(np.isfinite(predicted_m).all(axis=1), away / gates, cost)
        excluded &= ~(away < END_GATE)  # a hand on a rail ends at a cut, just where its end is expected
    cost[excluded] = np.inf
    return _named(surface, caps, _assign(cost))


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


def _named(surface: Surface, caps: Sequence[Cap], chosen: np.ndarray) -> Anchors:
    """The anchors at the chosen caps: chosen (5,) int, -1 = missed."""
    anchors = no_anchors()
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


def _no_end_of_a_limb(caps: Sequence[Cap], closed: bool) -> np.ndarray:
    """(k, 5) bool: caps that cannot be that anchor.

    closed: hidden skin is part of the surface. For hands and feet it shows whether the limb continues, better than an
    edge in the depth frame does; the head is judged by its place.
    """
    wrong = np.array([cap.continues if closed else cap.stump for cap in caps])
    excluded = np.repeat(wrong[:, None], len(ANCHOR_NAMES), axis=1)
    excluded[:, HEAD] &= not closed
    return excluded


def _nearest(surface: Surface, nodes: np.ndarray, point_m: np.ndarray) -> int:
    return int(nodes[np.argmin(((surface.points_m[nodes] - point_m) ** 2).sum(axis=1))])


def _proportion_cost(
    surface: Surface, reach_m: np.ndarray, tips_m: np.ndarray, up: np.ndarray, facing: np.ndarray, height_m: float
) -> np.ndarray:
    """(k, 5): how many tolerances each extremum is away from each anchor's usual place."""
    left = np.cross(up, facing)
    offset = tips_m - seen_mean(surface)
    seen = np.stack([reach_m, offset @ up, offset @ left], axis=1) / height_m
    return np.linalg.norm((seen[:, None] - PROPORTIONS) / TOLERANCES, axis=2)


def _assign(cost: np.ndarray) -> np.ndarray:
    """(5,) int: row of ``cost`` (k, 5) each anchor takes, -1 = none; as many as possible, then the least total.

    A cost of 1 is the gate; beyond it, or NaN, is no match.
    """
    allowed = cost <= 1.0
    chosen = np.full(cost.shape[1], -1)
    for row, column in zip(*linear_sum_assignment(np.where(allowed, cost, 1e3)), strict=True):
        if allowed[row, column]:
            chosen[column] = row
    return chosen
