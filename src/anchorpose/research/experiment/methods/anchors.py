"""The paper's proposed feature, geodesic distances to the anchors (Definition 3), and variants of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from anchorpose.association.hypotheses import GateConfig, HypothesisConfig, Matcher, anchor_subsets, match_hypotheses
from anchorpose.geodesics.anchors import ANCHOR_NAMES, anchor_descriptor
from anchorpose.research.experiment.framework import ANYWHERE_M, PAPER_GATE
from anchorpose.research.experiment.method import PROPOSED, Family, Method, cached_per_frame
from anchorpose.research.features.nearest import nearest_descriptor
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.association import Associate, link
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation

SOURCE: Final = "Li and Burdick, Definition 3 and Section IV"


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorSetting:
    """The gate, which the paper chose by hand, and the number of anchors of a hypothesis."""

    gate: GateConfig = PAPER_GATE
    subset_size: int = 3


GATES: Final = tuple(
    GateConfig(anchor_bound_m=anchor, surface_bound_per_m=surface, search_radius_m=ANYWHERE_M)
    for anchor, surface in product((0.05, 0.02), (0.01, 0.03))
)


def _hypotheses(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    hypotheses = HypothesisConfig(subset_size=setting.subset_size, trusted_only=False)
    return replace(config, gate=setting.gate, hypotheses=hypotheses)


def _next_frame_only(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(_hypotheses(config, setting), follow=replace(config.follow, look_ahead=1))


def _closed(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    """Holes in the mesh are closed with the expected body, as in this project's tracker."""
    return replace(_hypotheses(config, setting), surface=SurfaceConfig())


def _as_tracked(setting: AnchorSetting) -> Associate:
    return link


def _by_edges(setting: AnchorSetting) -> Associate:
    """As ``link``, with distances by Dijkstra's shortest paths along edges, as in the paper."""
    along_edges = partial(solve_distance, solver=Solver.DIJKSTRA)

    @cached_per_frame
    def distances(seen: Observation) -> np.ndarray:
        return anchor_descriptor(seen.whole, seen.anchors, along_edges)[: len(seen.surface)]

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        subsets = anchor_subsets(now.anchors.found & following.anchors.found, config.hypotheses.subset_size)
        source, target = distances(now), distances(following)

        def find(nodes: np.ndarray) -> np.ndarray:
            places = now.surface.points_m[nodes]
            return match_hypotheses(source[nodes], following.surface, target, subsets, places, config.gate).match

        return Matcher(find, len(now.surface), subsets)

    return pair


def _refined(setting: AnchorSetting) -> Associate:
    """Beyond the paper, on a mesh without holes: e_1 is estimated and subtracted, and the most similar node matches.

    The paper's match is the node in the middle of psi. The anchors' jitter adds the same to all nodes (the paper's
    e_1). Most nodes of a body hardly move between two frames, so it is the median difference from the nearest node.
    """

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        subsets = anchor_subsets(now.anchors.found & following.anchors.found, config.hypotheses.subset_size)
        source = now.descriptor - _jitter(now, following).astype(np.float32)

        def find(nodes: np.ndarray) -> np.ndarray:
            columns = [nearest_descriptor(source[np.ix_(nodes, one)], following.descriptor[:, one]) for one in subsets]
            return np.stack(columns, axis=1) if columns else np.empty((len(nodes), 0), np.int32)

        return Matcher(find, len(now.surface), subsets)

    return pair


def _jitter(now: Observation, following: Observation) -> np.ndarray:
    """(5,) metres: median change of the distances to each anchor; 0 for one not reached in both frames."""
    if len(now.surface) == 0 or len(following.surface) == 0:
        return np.zeros(len(ANCHOR_NAMES))
    nearest = KDTree(following.surface.points_m).query(now.surface.points_m)[1]
    before, after = now.descriptor, following.descriptor[nearest]
    known = np.isfinite(before) & np.isfinite(after)
    pairs = zip(before.T, after.T, known.T, strict=True)
    return np.array([np.median(b[k] - a[k]) if k.any() else 0.0 for b, a, k in pairs])


def _method(
    key: str,
    title: str,
    subset_sizes: tuple[int, ...],
    configure: Callable[[TrackConfig, AnchorSetting], TrackConfig],
    associate: Callable[[AnchorSetting], Associate],
) -> Method:
    return Method(
        key=key,
        title=title,
        family=Family.PROPOSED,
        source=SOURCE,
        settings=tuple(AnchorSetting(gate=gate, subset_size=size) for size in subset_sizes for gate in GATES),
        associate=associate,
        configure=configure,
        several=subset_sizes != (len(ANCHOR_NAMES),),
        frame_ms=25.0,
    )


_REFINED = _method("anchors-refined", "anchor geodesics as refined here", (3, 2), _closed, _refined)

METHODS = (
    replace(_method(PROPOSED, "anchor geodesics with the tree", (3, 2, 4), _hypotheses, _as_tracked), sampled=False),
    _method("anchors-dijkstra", "anchor geodesics by Dijkstra", (3, 2), _hypotheses, _by_edges),
    _method(
        "anchors-no-tree", "anchor geodesics without the tree", (len(ANCHOR_NAMES),), _next_frame_only, _as_tracked
    ),
    replace(_REFINED, settings=tuple(setting for setting in _REFINED.settings if setting.gate == GATES[0])),
)
