"""Match two surfaces by generalised multi-dimensional scaling, GMDS (paper, Section IV-A).

Samples are nodes of the source surface that lie far apart; candidates are nodes of the target surface that lie far
apart. Samples are mapped so that the distances between them change as little as possible. First, branch and bound maps
the few farthest samples onto few candidates and keeps the best maps that differ from each other. Next, all samples are
mapped onto more candidates. Finally, in the best maps, each sample may move from its candidate to any node of the
target. All other nodes are mapped by their distances to the samples. Source: Bronstein, Bronstein and Kimmel 2006
(doi:10.1073/pnas.0508601103): as the authors do, this module minimises a sum of squares; the initial map is found by
branch and bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.research.features.map_search import best_places, branch_and_bound, settle, stress_m
from anchorpose.settings import Count, Positive, Share, settings
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import Surface

APART_M: Final = 1e3  # m, assumed distance between separate pieces of surface, far greater than distances on a body
# m, first limit of the root mean square change of distances, up to which ``_starts`` searches maps; the limit is
# doubled until enough maps are found
FIRST_LIMIT_M: Final = 0.02


def farthest_points(surface: Surface, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (k,) int32, each as far as possible from the nodes before it, and their distance fields.

    k is ``count`` unless there are fewer nodes. The fields (k, n) float32 are in metres; nodes on other pieces of
    surface get ``APART_M``, far greater than any distance on a body. The first node is the farthest from the middle of
    its piece; the middle is the node nearest to the mean position of all nodes. Nodes of a piece without a chosen node
    count as farther away than all nodes of pieces with a chosen node. Raises ValueError for nodes that are not finite.
    Source: Gonzalez 1985 (doi:10.1016/0304-3975(85)90224-5): the greatest distance of a node from its nearest chosen
    node is at most twice as large as with the best choice.
    """
    wanted = min(count, len(surface))
    nodes, fields = np.empty(wanted, np.int32), np.empty((wanted, len(surface)), np.float32)
    if wanted == 0:
        return nodes, fields
    away = surface.points_m - surface.points_m.mean(axis=0, dtype=np.float64)
    nearest = field_from(surface, int((away**2).sum(axis=1).argmin()))
    nodes[0] = np.where(nearest < APART_M, nearest, -1.0).argmax()
    nearest = fields[0] = field_from(surface, nodes[0])
    for row in range(1, wanted):
        nodes[row] = nearest.argmax()
        fields[row] = field_from(surface, nodes[row])
        nearest = np.minimum(nearest, fields[row])
        nearest[nodes[: row + 1]] = -1.0  # a node is chosen at most once, even if several nodes have the same position
    return nodes, fields


def field_from(surface: Surface, node: int) -> np.ndarray:
    """Return the geodesic distance (n,) float32, metres, from one node to all nodes, at most ``APART_M``."""
    field = geodesic_distance(surface, np.array([node]))[0]
    return np.minimum(field, np.float32(APART_M))


@settings
class GmdsConfig:
    """Settings of the search for the best map, which determine its resolution and its computing time."""

    # Number of samples, which are 7 cm apart on a body. With 50 samples, the mirror image would more often fit as well
    # as the truth.
    samples: Count = 100
    first_samples: Count = 6  # number of samples that are mapped first, usually head, hands, feet and one more sample
    first_candidates: Count = 60  # number of candidates for the first samples, 10 cm apart on a body
    candidates: Count = 200  # number of candidates for all samples, 5 cm apart on a body
    # number of maps of the first samples that are extended to all samples; many of these maps mirror the body or swap
    # limbs
    starts: Count = 24
    finalists: Count = 3  # number of best maps in which, in the last step, samples may move from candidates to any node
    # Maximum change of a distance in m; greater changes count as this value, since all distances to a hand change when
    # it touches the body.
    cap_m: Positive = 0.15
    sweeps: Count = 10  # maximum number of sweeps over all samples; the search usually converges in four sweeps
    # minimum share of all nodes that a piece needs to be matched (3 %: a forearm); smaller pieces have no recognisable
    # shape
    min_piece: Share = 0.03
    max_branches: Count = 300_000  # maximum number of branches visited, which takes a tenth of a second

    def __post_init__(self) -> None:
        if not 2 <= self.first_samples <= self.samples:
            raise ValueError(f"of {self.samples} samples {self.first_samples} cannot be the first to be mapped")
        if not self.candidates >= self.first_candidates:
            raise ValueError(f"{self.candidates} candidates cannot hold the first {self.first_candidates}")
        if self.max_branches < self.first_samples:
            raise ValueError(f"{self.max_branches} branches end before {self.first_samples} samples have a place")


@dataclass(frozen=True, slots=True, eq=False)
class GmdsMaps:
    """The best maps of the samples, best first. Maps after the first are alternatives, such as the mirror image."""

    samples: np.ndarray  # (k,) int32, nodes of the source
    places: np.ndarray  # (m, k) int32, nodes of the target, one row per map
    stress_m: np.ndarray  # (m,) float64, root mean square of the capped changes of distance
    proven: bool  # whether it is proven that no better map of the first samples onto the first candidates exists


def match_by_gmds(source: Surface, target: Surface, config: GmdsConfig | None = None) -> np.ndarray:
    """Return (n_source,) int32: the target's node for each node of the source, according to the best of ``gmds_maps``.

    -1 = undefined: the node is not finite, or on a piece with less than the share ``min_piece`` of the finite nodes. If
    either surface has only such nodes, all nodes are undefined. Distances are computed by fast marching, and paths may
    follow links (edges outside the pixel grid). Positions do not count, only distances, so a body may be matched with
    its mirror image. Several nodes may share a match.
    """
    match: np.ndarray = _solve(source, target, config or GmdsConfig())[1]
    return match


def gmds_maps(source: Surface, target: Surface, config: GmdsConfig | None = None) -> GmdsMaps:
    """Return the maps of the samples from which ``match_by_gmds`` chooses; no map if all nodes are undefined."""
    return _solve(source, target, config or GmdsConfig())[0]


def _solve(source: Surface, target: Surface, config: GmdsConfig) -> tuple[GmdsMaps, np.ndarray]:
    (a, node_a), (b, node_b) = (_usable(surface, config.min_piece) for surface in (source, target))
    match = np.full(len(source), -1, np.int32)
    if len(a) == 0 or len(b) == 0:
        return GmdsMaps(np.empty(0, np.int32), np.empty((0, 0), np.int32), np.empty(0), True), match
    samples, fields_a = farthest_points(a, config.samples)
    candidates, fields_b = farthest_points(b, config.candidates)
    among_a, among_b = fields_a[:, samples], fields_b[:, candidates]
    starts, proven = _starts(among_a, among_b, config)
    coarse = [_settled(among_a, among_b, start, config) for start in starts]
    finalists = _alternatives(coarse, among_b, config.finalists)
    fine = [_refined(b, among_a, candidates[p], fields_b[p], config) for p in finalists]
    fine.sort(key=lambda found: found[2])
    rows = np.ascontiguousarray(fields_a.T)
    match[node_a] = node_b[best_places(rows, fine[0][1], config.cap_m, np.full(len(rows), -1))]
    places, stress_m = np.array([found[0] for found in fine]), np.array([found[2] for found in fine])
    return GmdsMaps(node_a[samples], node_b[places], stress_m, proven), match


def _usable(surface: Surface, min_piece: float) -> tuple[Surface, np.ndarray]:
    """Return the surface of the finite nodes on large pieces, and the numbers of these nodes on ``surface``.

    A piece is large if it has at least the share ``min_piece`` of all finite nodes.
    """
    node = np.flatnonzero(np.isfinite(surface.points_m).all(axis=1)).astype(np.int32)
    finite = keep_nodes(surface, np.isin(np.arange(len(surface)), node))
    piece = pieces(finite)
    large = np.bincount(piece)[piece] >= min_piece * len(finite)
    return keep_nodes(finite, large), node[large]


def _starts(among_a: np.ndarray, among_b: np.ndarray, config: GmdsConfig) -> tuple[np.ndarray, bool]:
    """Return (m, k) int32 maps of the first samples to candidates, best first, and whether it is proven that no map is
    better than the first.
    """
    few = min(config.first_samples, len(among_a))
    a = np.ascontiguousarray(among_a[:few, :few])
    b = np.ascontiguousarray(among_b[: config.first_candidates, : config.first_candidates])
    change_m = FIRST_LIMIT_M
    while True:
        limit = few * (few - 1) / 2 * change_m**2 if change_m < config.cap_m else np.inf
        apart_m = 2.0 * _spacing_m(b)
        maps, costs, steps = branch_and_bound(a, b, config.cap_m, limit, config.starts, apart_m, config.max_branches)
        gave_up = steps == config.max_branches
        if np.isfinite(costs[-1]) or limit == np.inf or (gave_up and np.isfinite(costs[0])):
            return maps[np.isfinite(costs)], not gave_up
        change_m *= 2.0


def _settled(
    among_a: np.ndarray, among_b: np.ndarray, start: np.ndarray, config: GmdsConfig
) -> tuple[np.ndarray, float]:
    """Map all samples to candidates, starting from a map of the first samples; return the candidate of each sample
    (k,), and the stress: the root mean square of the capped changes of distance.
    """
    places = np.zeros(len(among_a), np.int32)
    places[: len(start)] = start
    settle(among_a, among_b, places, len(start), config.cap_m, config.sweeps)
    return places, stress_m(among_a, among_b[np.ix_(places, places)], config.cap_m)


def _alternatives(found: list[tuple[np.ndarray, float]], among_b: np.ndarray, count: int) -> list[np.ndarray]:
    """Return up to ``count`` maps with the least stress (root mean square of the changes of distance), without maps
    that nearly equal a better map.
    """
    kept: list[np.ndarray] = []
    for places, _ in sorted(found, key=lambda one: one[1]):
        if len(kept) < count and all(among_b[places, other].mean() > _spacing_m(among_b) for other in kept):
            kept.append(places)
    return kept


def _spacing_m(distances: np.ndarray) -> float:
    """Return the median distance of a point to its nearest neighbour; 0 for a single point."""
    return float(np.median(np.sort(distances, axis=1)[:, min(1, len(distances) - 1)]))


def _refined(
    target: Surface, among_a: np.ndarray, places: np.ndarray, fields: np.ndarray, config: GmdsConfig
) -> tuple[np.ndarray, np.ndarray, float]:
    """Move each sample in turn to the node with the least stress (root mean square of the changes of distance), until
    no sample moves or all sweeps are done.

    Return the samples' places, the distance fields of these places, and the stress.
    """
    places, fields, unmoved = places.copy(), fields.copy(), 0
    for step in range(config.sweeps * len(places)):
        at = step % len(places)
        place = best_places(among_a[at : at + 1], fields, config.cap_m, np.array([at]))[0]
        unmoved += 1
        if place != places[at]:
            places[at], unmoved = place, 0
            fields[at] = field_from(target, place)
        if unmoved >= len(places):
            break
    return places, fields, stress_m(among_a, fields[:, places], config.cap_m)
