"""Match nodes of the patient's surface with nodes of the next frame, by the best branches of a track tree. The tree
holds the possible matches of each node over two to four frames. The best matches become constraints on the body's pose
(paper, Section V).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anchorpose.body.constraints import Constraints, anchor_constraints, join, place_constraints
from anchorpose.body.nearest_skin import Oriented
from anchorpose.body.pose import Pose
from anchorpose.body.registration import node_parts
from anchorpose.body.skin_points import Body, PosedPoints, pose_points
from anchorpose.geodesics.anchors import Anchors
from anchorpose.surface.surface import Surface
from anchorpose.track_tree.hypotheses import (
    Feature,
    GateConfig,
    HypothesisConfig,
    Matcher,
    anchor_subsets,
    match_hypotheses,
    nearest_hypotheses,
)
from anchorpose.track_tree.parts import ITERATIONS, joints_of_parts, register_parts
from anchorpose.track_tree.tree import Support, TrackResult, TreeConfig, best_branches

PART_REACH_M = 0.08  # m; a node farther than this from the body's skin belongs to no part
# m, assumed sigma of a match's place; for matches by geodesic distances to the best anchors, sigma is 17 to 40 mm
PAIR_SIGMA_M = 0.04
ANCHOR_SIGMA_M = 0.05  # m, the paper's bound on the localisation error of anchors


@dataclass(frozen=True, slots=True, eq=False)
class GlobalHypothesis:
    """The pairs of nodes on the best branches: nodes of frame t and their matches in frame t + 1."""

    node: np.ndarray  # (m,) numbers of the nodes in frame t
    part: np.ndarray  # (m,) number of the bone that moves the node
    point: np.ndarray  # (m,) number of the skin point that is nearest to the node
    matched_m: np.ndarray  # (m, 3) place of the node's match in frame t + 1; NaN if missed
    tree: TrackResult  # result of the tree search; ``support`` states which matches are missed, and why

    @property
    def matched_share(self) -> float:
        """Return the share of the nodes that have a match in the next frame; 0 without nodes."""
        return float((self.tree.support == Support.MATCHED).mean()) if len(self.node) else 0.0


class SeenFrame(Protocol):
    """A frame with the data that the track tree needs. descriptor (n, 5): the geodesic distances from each node of the
    surface to the five anchors (head, hands and feet), as in ``anchor_descriptor``.
    """

    @property
    def surface(self) -> Surface: ...
    @property
    def anchors(self) -> Anchors: ...
    @property
    def descriptor(self) -> np.ndarray: ...


def link(now: SeenFrame, following: SeenFrame, config: HypothesisConfig, gate: GateConfig) -> Matcher:
    """Return the matcher that finds, for each node of a frame, its possible matches in the next frame: one column per
    subset of the anchors (head, hands and feet) that were found in both frames.

    Five anchors in subsets of three give ten columns. If fewer anchors were found than a subset needs, the only subset
    has all found anchors; without anchors, the matcher has no columns. With ``Feature.POSITION``, the only column has
    the node of the next frame that is nearest in space, if it is within the search radius.
    """
    if config.feature is Feature.POSITION:
        nearest = nearest_hypotheses(now.surface, following.surface, gate)
        return Matcher(nearest.match.__getitem__, len(now.surface), nearest.subsets)
    subsets = anchor_subsets(now.anchors.found & following.anchors.found, config.subset_size)

    def find(nodes: np.ndarray) -> np.ndarray:
        source, places = now.descriptor[nodes], now.surface.points_m[nodes]
        return match_hypotheses(source, following.surface, following.descriptor, subsets, places, gate).match

    return Matcher(find, len(now.surface), subsets)


def global_hypothesis(
    body: Body,
    pose: Pose,
    predicted: Sequence[Pose],
    window: Sequence[SeenFrame],
    links: Sequence[Matcher],
    node_count: int,
    config: TreeConfig,
) -> GlobalHypothesis:
    """Build, score and search the track tree from the first frame of the window over the later frames.

    predicted: one pose per frame after the first; links: one matcher per pair of successive frames; node_count: maximum
    number of nodes of the first frame with which the tree begins. A node is predicted to move with the body part on
    which it lies.
    """
    source = window[0].surface
    chosen = np.unique(np.linspace(0, len(source) - 1, min(len(source), node_count)).astype(np.int64))
    nodes = source.points_m[chosen].astype(np.float64)
    point, part = node_parts(body, pose, nodes, PART_REACH_M)
    on_body = part >= 0
    chosen, nodes, point, part = chosen[on_body], nodes[on_body], point[on_body], part[on_body]
    places = carried(body, pose, predicted, nodes, part)
    matches, costs = _reached(chosen, links)
    tree = best_branches(matches, [seen.surface.points_m for seen in window[1:]], places, config, costs)
    matched = np.full((len(chosen), 3), np.nan)
    found = tree.match >= 0
    matched[found] = window[1].surface.points_m[tree.match[found]]
    return GlobalHypothesis(chosen, part, point, matched, tree)


def _reached(chosen: np.ndarray, links: Sequence[Matcher]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return matches and costs, one array per level (step from a frame to the next). In the first level, each chosen
    node has a row. In later levels, each node of the frame has a row, which is filled if the level before reaches this
    node.
    """
    matches = [links[0].ask(chosen)]
    for link_ in links[1:]:
        before = matches[-1]
        link_.ask(before[before >= 0])
        matches.append(link_.match)
    return matches, [links[0].cost_m[chosen], *(link_.cost_m for link_ in links[1:])]


def carried(body: Body, pose: Pose, predicted: Sequence[Pose], nodes_m: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return (m, depth, 3): places of nodes that move with their body parts from ``pose`` to each predicted pose."""
    T_world_rest = body.transforms(pose)
    places = np.empty((len(nodes_m), len(predicted), 3))
    for level, later in enumerate(predicted):
        T_next_now = part_motion(T_world_rest, body.transforms(later))
        places[:, level] = np.einsum("mij,mj->mi", T_next_now[part, :3, :3], nodes_m) + T_next_now[part, :3, 3]
    return places


def part_motion(T_world_rest_now: np.ndarray, T_world_rest_next: np.ndarray) -> np.ndarray:
    """Return the motion of every body part between two frames (tau^(t,t+1) in the paper): (b, 4, 4) T_next_now."""
    return T_world_rest_next @ np.linalg.inv(T_world_rest_now)


def held_by(
    body: Body, pose: Pose, predicted: Pose, hypothesis: GlobalHypothesis, window: Sequence[SeenFrame]
) -> Constraints:
    """Return constraints on the body in the window's second frame, from the pairs of nodes that the track tree matched,
    and from the anchors (head, hands and feet).
    """
    now = pose_points(body, pose)
    pairs = pairs_of(now, hypothesis, window, part_motion(now.transforms, body.transforms(predicted)))
    return join([pairs, anchor_constraints(body.points, window[1].anchors, ANCHOR_SIGMA_M)])


def pairs_of(
    now: PosedPoints, hypothesis: GlobalHypothesis, window: Sequence[SeenFrame], T_next_now: np.ndarray
) -> Constraints:
    """Return a constraint per pair (node and match). Each node lies near a skin point of the body, at a small offset.
    The constraint pulls this skin point to the place of the node's match plus this offset, which turns with the body
    part.
    """
    found = np.isfinite(hypothesis.matched_m).all(axis=1)
    point, part = hypothesis.point[found], hypothesis.part[found]
    nodes = window[0].surface.points_m[hypothesis.node[found]].astype(np.float64)
    beside = np.einsum("mij,mj->mi", T_next_now[part, :3, :3], now.points_m[point] - nodes)
    return place_constraints(point, hypothesis.matched_m[found] + beside, PAIR_SIGMA_M, 3.0 * PAIR_SIGMA_M)


def skin_places(
    now: PosedPoints, hypothesis: GlobalHypothesis, window: Sequence[SeenFrame], T_next_now: np.ndarray
) -> np.ndarray:
    """Return (m, 3) the target of the skin point beside each node: the place of the node's match, shifted along the
    skin by the offset from the node to the skin point. The target is NaN if the node's match is missed.

    Only the offset along the skin is kept, not the offset perpendicular to the skin, so a body that has drifted off the
    seen surface is pulled back to it.
    """
    skin, normals = now.points_m[hypothesis.point], now.normals[hypothesis.point]
    beside = skin - window[0].surface.points_m[hypothesis.node]
    along = beside - (beside * normals).sum(axis=1, keepdims=True) * normals
    return np.asarray(hypothesis.matched_m + np.einsum("mij,mj->mi", T_next_now[hypothesis.part, :3, :3], along))


def joints_by_parts(
    body: Body,
    pose: Pose,
    predicted: Pose,
    hypothesis: GlobalHypothesis,
    window: Sequence[SeenFrame],
    iterations: int = ITERATIONS,
    robust: bool = True,
) -> np.ndarray:
    """Register every body part separately, as in the paper, and return the joints (21, 3) in the second frame. A joint
    is the mean of its places on the parts that it joins (the paper's rule J, ``joints_of_parts``).

    The motion of each part is fitted to the ``skin_places`` of its skin points, and refined by ICP (iterative closest
    point) to the surface. Parts with too few matches and nodes keep their predicted motion.
    """
    now, point, part = pose_points(body, pose), hypothesis.point, hypothesis.part
    T_predicted = part_motion(now.transforms, body.transforms(predicted))
    matched = skin_places(now, hypothesis, window, T_predicted)
    skin = Oriented(now.points_m[point], now.normals[point])
    T_next_now = register_parts(skin, part, matched, window[1].surface, T_predicted, iterations, robust)
    return joints_of_parts(body.points.asset, body.mesh, T_next_now @ now.transforms)
