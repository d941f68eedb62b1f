"""Anchors: geodesic extrema of the surface (paper, Definition 2 and the equation after it)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import Cap, find_caps, geodesic_extrema, seen_mean, surface_center
from anchorpose.surface.surface import Surface

ANCHOR_NAMES: Final = ("Head", "HandLeft", "HandRight", "FootLeft", "FootRight")
"""The identified anchors, in this order everywhere; left is the patient's left."""


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """The five identified anchors of a surface; a missing one is said to be missing, never guessed.

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


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorConfig:
    """Lengths are fractions of the subject's height, so that they adapt to it (paper, Section V)."""

    radius: float = 0.5 / 1.75  # r: 0.5 m on a person of 1.75 m
    cap: float = 0.06 / 1.75  # how far below its tip the extremal cap reaches: 6 cm, about a fist
    gate: float = 0.25 / 1.75  # how far from its prediction an anchor may be: half a forearm
    head_gate: float = 0.18 / 1.75  # a head moves less, and a neck without its head is 20 cm away
    end_gate: float = 0.09 / 1.75  # an end so near its prediction is one, though hidden skin seems to lead on
    first_gate: float = 2.1  # without prediction: tolerances of the body's proportions; a foot is 2.15 from a hand

    def __post_init__(self) -> None:
        for name in ("radius", "cap", "gate", "head_gate", "end_gate", "first_gate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


PROPORTIONS: Final = np.array(
    # geodesic distance from the centre, height above it, distance to the left of it; over the body height
    [[0.42, 0.42, 0.0], [0.52, 0.08, 0.20], [0.52, 0.08, -0.20], [0.56, -0.50, 0.07], [0.56, -0.50, -0.07]]
)
"""Where the anchors of a standing person are seen from the centre of the front (order of ``ANCHOR_NAMES``)."""

TOLERANCES: Final = np.array(
    [[0.10, 0.10, 0.12], [0.12, 0.27, 0.20], [0.12, 0.27, 0.20], [0.10, 0.12, 0.12], [0.10, 0.12, 0.12]]
)
"""By how much those vary: arms move through everything, head and feet hardly."""

HEAD: Final = 0  # the one limb whose far side is hidden from most cameras, so that hidden skin always goes on


def find_anchors(
    surface: Surface,
    up: np.ndarray,
    facing: np.ndarray,
    height_m: float = 1.75,
    cut: np.ndarray | None = None,
    predicted_m: np.ndarray | None = None,
    config: AnchorConfig | None = None,
) -> Anchors:
    """The identified anchors of one surface: centre, its field, the extrema and their names.

    Arguments as in ``identify_anchors``, height_m the subject's. A surface without seen nodes has no anchors.
    """
    config = config or AnchorConfig()
    if surface.seen_count == 0:
        return no_anchors()
    field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
    extrema = geodesic_extrema(surface, field, config.radius * height_m)
    return identify_anchors(surface, field, extrema, up, facing, height_m, cut, predicted_m, config)


def identify_anchors(
    surface: Surface,
    field: np.ndarray,
    extrema: np.ndarray,
    up: np.ndarray,
    facing: np.ndarray,
    height_m: float = 1.75,
    cut: np.ndarray | None = None,
    predicted_m: np.ndarray | None = None,
    config: AnchorConfig | None = None,
) -> Anchors:
    """Which extremum is the head, which the hands and feet, and which is none of them.

    field (n,) float32: geodesic distance from the centre; extrema (k,) int: nodes of ``geodesic_extrema``. up, facing
    (3,) unit, world: against gravity, and the way the patient faces. cut (n,) bool: nodes at an edge that something
    else cut (``surface.border``); an extremum there is a stump, not an anchor, unless another camera sees its end.
    predicted_m (5, 3) world: where each anchor is expected; for one without (NaN, or None for all) the proportions of a
    standing body decide.
    The names are the assignment of least total cost; whatever is out of the gate is missed.
    """
    config = config or AnchorConfig()
    caps = find_caps(surface, field, extrema, config.cap * height_m, cut)
    if not caps:
        return no_anchors()
    centers = np.array([cap.center_m for cap in caps])
    cost = _proportion_cost(surface, np.array([cap.reach_m for cap in caps]), centers, up, facing, height_m)
    cost /= config.first_gate
    untrue = _untrue(caps, surface.seen_count < len(surface))
    if predicted_m is not None:
        gates = np.full(len(ANCHOR_NAMES), config.gate)
        gates[HEAD] = config.head_gate
        away = np.linalg.norm(centers[:, None] - predicted_m[None], axis=2) / height_m
        cost = np.where(np.isfinite(predicted_m).all(axis=1), away / gates, cost)
        untrue &= ~(away < config.end_gate)  # a hand on a rail ends at a cut, just where its end is expected
    cost[untrue] = np.inf
    anchors = no_anchors()
    for name, number in enumerate(_assign(cost)):
        if number >= 0:
            anchors.node[name] = _nearest(surface, caps[number].nodes, caps[number].center_m)
            anchors.position_m[name] = caps[number].center_m
            anchors.sigma_m[name] = caps[number].sigma_m
    return anchors


def no_anchors() -> Anchors:
    """All five missed."""
    count = len(ANCHOR_NAMES)
    return Anchors(np.full(count, -1, np.int32), np.full((count, 3), np.nan), np.full(count, np.nan))


def _untrue(caps: Sequence[Cap], closed: bool) -> np.ndarray:
    """(k, 5) bool: caps that cannot be the end of a limb.

    closed: hidden skin is part of the surface. It then tells of hands and feet whether they go on, better than an edge
    in the picture does; of the head its place decides.
    """
    wrong = np.array([cap.goes_on if closed else cap.stump for cap in caps])
    untrue = np.repeat(wrong[:, None], len(ANCHOR_NAMES), axis=1)
    untrue[:, HEAD] &= not closed
    return untrue


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
