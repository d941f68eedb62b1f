"""Matching two surfaces by generalised multi-dimensional scaling (paper, Section III-A), for thousands of nodes.

Samples far apart are mapped so that distances among them change least, from coarse to fine: first the few farthest,
onto few candidates, by branch and bound, which keeps the best of all their maps that differ; then all samples onto more
candidates; then, for the best maps, onto every node. All other nodes follow from their distances to the samples.
Source: Bronstein, Bronstein and Kimmel 2006 (doi:10.1073/pnas.0508601103); the least squares there, with branch and
bound for the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.features.farthest_points import APART_M, farthest_points
from anchorpose.features.gmds_stress import best_places, branch_and_bound, settle, stress
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.mesh import keep_nodes, pieces
from anchorpose.surface.surface import Surface

FIRST_LIMIT_M = 0.02  # mean change of a distance with which branch and bound begins; doubled until it finds enough


@dataclass(frozen=True, slots=True, kw_only=True)
class GmdsConfig:
    """How finely to look, and for how long."""

    samples: int = 50  # a hand's breadth apart on a body; Bronstein et al. took 50 of whole bodies
    first_samples: int = 6  # more often than not head, hands, feet and one more
    first_candidates: int = 60  # 10 cm apart on a body
    candidates: int = 200  # 5 cm
    starts: int = 24  # maps of the first samples to go on with: symmetries of a body, and what coarseness confuses
    finalists: int = 3  # of them are refined to nodes
    cap_m: float = 0.15  # no change counts for more: where a hand touches or loses touch, every way changes
    sweeps: int = 10  # over all samples, at most; they come to rest after four or so
    min_piece: float = 0.03  # of the nodes: a forearm; smaller pieces have no shape that tells where they belong
    max_branches: int = 300_000  # a tenth of a second

    def __post_init__(self) -> None:
        for name in ("starts", "finalists", "sweeps", "max_branches", "first_candidates"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not 2 <= self.first_samples <= self.samples:
            raise ValueError(f"of {self.samples} samples {self.first_samples} cannot be the first to be mapped")
        if not self.candidates >= self.first_candidates:
            raise ValueError(f"{self.candidates} candidates cannot hold the first {self.first_candidates}")
        if not 0 < self.cap_m < np.inf:
            raise ValueError(f"cap_m must be positive and finite, got {self.cap_m}")
        if not 0 <= self.min_piece <= 1:
            raise ValueError(f"min_piece is a share of the nodes, got {self.min_piece}")


@dataclass(frozen=True, slots=True, eq=False)
class GmdsMaps:
    """The best maps of the samples, the best first; the others are its rivals, such as the mirror image.

    samples (k,) int32 nodes of the source, places (m, k) int32 nodes of the target; stress_m (m,) float64: root mean
    square of the capped changes of distance. proven: whether no map of the first samples onto the first candidates was
    overlooked.
    """

    samples: np.ndarray
    places: np.ndarray
    stress_m: np.ndarray
    proven: bool


def match_by_gmds(source: Surface, target: Surface, config: GmdsConfig | None = None) -> np.ndarray:
    """(n_source,) int32: the target's node for each of the source's, by the best map of ``gmds_maps``; -1 = undefined.

    Undefined are nodes that are not finite or on pieces smaller than ``min_piece`` of the finite nodes, and all if either
    surface has no other. Distances are by fast marching, links are paths; where nodes are does not count, so a body may
    be matched with its mirror image. Several nodes may share a match.
    """
    match: np.ndarray = _solve(source, target, config or GmdsConfig())[1]
    return match


def gmds_maps(source: Surface, target: Surface, config: GmdsConfig | None = None) -> GmdsMaps:
    """The maps of the samples that ``match_by_gmds`` chooses from: no map at all where everything is undefined."""
    return _solve(source, target, config or GmdsConfig())[0]


def _solve(source: Surface, target: Surface, config: GmdsConfig) -> tuple[GmdsMaps, np.ndarray]:
    (a, node_a, large_a), (b, node_b, large_b) = (_usable(surface, config.min_piece) for surface in (source, target))
    match = np.full(len(source), -1, np.int32)
    samples, fields_a = farthest_points(a, config.samples, large_a)
    candidates, fields_b = farthest_points(b, config.candidates, large_b)
    if len(samples) == 0 or len(candidates) == 0:
        return GmdsMaps(np.empty(0, np.int32), np.empty((0, 0), np.int32), np.empty(0), True), match
    among_a, among_b = fields_a[:, samples], fields_b[:, candidates]
    starts, proven = _starts(among_a, among_b, config)
    coarse = [_settled(among_a, among_b, start, config) for start in starts]
    finalists = _different(sorted(coarse, key=lambda found: found[1]), config.finalists)
    fine = [_refined(b, among_a, candidates[places], fields_b[places], large_b, config) for places, _ in finalists]
    fine.sort(key=lambda found: found[2])
    rows = np.ascontiguousarray(fields_a[:, large_a].T)
    where = np.flatnonzero(large_b)
    place, _ = best_places(rows, fine[0][1][:, where], config.cap_m, np.full(len(rows), -1))
    match[node_a[large_a]] = node_b[where[place]]
    pairs = max(len(samples) * (len(samples) - 1), 1)
    stress_m = np.sqrt(np.array([cost for _, _, cost in fine]) / pairs)
    return GmdsMaps(node_a[samples], node_b[np.array([places for places, _, _ in fine])], stress_m, proven), match


def _usable(surface: Surface, min_piece: float) -> tuple[Surface, np.ndarray, np.ndarray]:
    """The finite part of a surface, the nodes (k,) int32 it is made of, and which (k,) bool are on large pieces."""
    finite = np.isfinite(surface.points_m).all(axis=1)
    part = keep_nodes(surface, finite)
    piece = pieces(part)
    large = np.bincount(piece)[piece] >= max(min_piece * len(part), 1)
    return part, np.flatnonzero(finite).astype(np.int32), large


def _starts(among_a: np.ndarray, among_b: np.ndarray, config: GmdsConfig) -> tuple[np.ndarray, bool]:
    """(m, k) int32 maps of the first samples to candidates, and whether they are the best that there are."""
    few = min(config.first_samples, len(among_a))
    a = np.ascontiguousarray(among_a[:few, :few])
    b = np.ascontiguousarray(among_b[: config.first_candidates, : config.first_candidates])
    worst = few * (few - 1) / 2 * config.cap_m**2
    limit = few * (few - 1) / 2 * min(FIRST_LIMIT_M, config.cap_m) ** 2
    while True:
        maps, costs = np.full((config.starts, few), -1, np.int32), np.full(config.starts, np.inf)
        bound = np.inf if limit > worst else limit
        spacing = float(np.sort(b, axis=1)[:, : 2].max(initial=0.0)) if len(b) > 1 else 0.0
        branches = branch_and_bound(a, b, config.cap_m, bound, maps, costs, 2.0 * spacing, config.max_branches)
        if np.isfinite(costs[-1]) or bound == np.inf or branches == config.max_branches and np.isfinite(costs[0]):
            return maps[np.isfinite(costs)], branches < config.max_branches
        limit *= 4.0


def _settled(
    among_a: np.ndarray, among_b: np.ndarray, start: np.ndarray, config: GmdsConfig
) -> tuple[np.ndarray, float]:
    """All samples on candidates, from a map of the first of them; and the stress."""
    places = np.zeros(len(among_a), np.int32)
    places[: len(start)] = start
    cost = settle(among_a, among_b, places, len(start), config.cap_m, config.sweeps)
    return places, cost


def _different(found: list[tuple[np.ndarray, float]], count: int) -> list[tuple[np.ndarray, float]]:
    """The first ``count`` of a list of maps, without repetition."""
    kept: list[tuple[np.ndarray, float]] = []
    for places, cost in found:
        if len(kept) < count and not any(np.array_equal(places, other) for other, _ in kept):
            kept.append((places, cost))
    return kept


def _refined(
    target: Surface, among_a: np.ndarray, places: np.ndarray, fields: np.ndarray, large: np.ndarray, config: GmdsConfig
) -> tuple[np.ndarray, np.ndarray, float]:
    """Moves samples to the nodes of least stress, one after another, until none moves; places, their fields, stress."""
    places, fields = places.copy(), fields.copy()
    where, calm = np.flatnonzero(large), 0
    for step in range(config.sweeps * len(places)):
        at = step % len(places)
        place, _ = best_places(among_a[at : at + 1], fields, config.cap_m, np.array([at]))
        calm += 1
        if place[0] != places[at] and large[place[0]]:
            places[at], calm = place[0], 0
            fields[at] = np.minimum(geodesic_distance(target, places[at : at + 1])[0], np.float32(APART_M))
        if calm >= len(places):
            break
    return places, fields, stress(among_a, fields[:, places], config.cap_m)
