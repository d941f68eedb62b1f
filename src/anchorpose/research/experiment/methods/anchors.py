"""Define the paper's proposed feature, geodesic distances to the anchors (tips of head, hands and feet; Definition 3),
and variants of this feature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np

from anchorpose.geodesics.anchors import anchor_descriptor
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.research.experiment.config import Update
from anchorpose.research.experiment.framework import ANYWHERE_M, PAPER_GATE
from anchorpose.research.experiment.method import PROPOSED, Family, Method, cached, whole_content
from anchorpose.research.features.psi import match_by_psi, subsets_with_pieces
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.track_tree.hypotheses import GateConfig, HypothesisConfig, Matcher, anchor_subsets
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate

SOURCE: Final = "Li and Burdick, Definition 3 and Section IV"
PAPER_SUBSET: Final = 3  # number of anchors in a subset, N_S: "three anchor nodes suffice" (Section IV-D)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorSetting:
    """Settings of matching by psi, the set of nodes with similar distances to the anchors (see ``features.psi``)."""

    # Maximum difference between a node's distances to the anchors and the distances of a similar node of the other
    # frame; psi is the set of these similar nodes. The paper's authors chose this limit by hand.
    gate: GateConfig = PAPER_GATE
    unclipped: bool = True
    squared: bool = False
    # Whether a piece of surface is matched by an extra, smaller subset of anchors if a hole cuts the piece off from so
    # many anchors that too few for a subset remain. The extra subset consists of the anchors from which a path still
    # leads to this piece of surface.
    pieces: bool = True


GATES: Final = tuple(
    GateConfig(anchor_bound_m=anchor, surface_bound_per_m=surface, search_radius_m=ANYWHERE_M)
    for anchor, surface in product((0.05, 0.03, 0.08, 0.02), (0.01, 0.005))
)


def all_hypotheses(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(config, gate=setting.gate, hypotheses=HypothesisConfig(trusted_only=False))


def next_frame_only(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(all_hypotheses(config, setting), follow=replace(config.follow, look_ahead=1))


def _as_seen(seen: Observation) -> np.ndarray:
    return seen.descriptor


def _by_edges(seen: Observation) -> np.ndarray:
    """Return the distances (n, 5) to the anchors by Dijkstra's shortest paths along mesh edges, as in the paper."""
    along_edges = partial(solve_distance, solver=Solver.DIJKSTRA)
    return anchor_descriptor(seen.whole, seen.anchors, along_edges)[: len(seen.surface)]


def by_psi(describe: Callable[[Observation], np.ndarray], size: int, setting: AnchorSetting) -> Associate:
    """Return a function that matches two frames: each node gets one hypothesis (possible match) for each subset of
    ``size`` anchors.

    Subsets contain only anchors that both frames have. describe: function that returns the distances (n, 5) of a
    frame's seen nodes to the anchors; the column of a missed anchor is NaN.
    """
    distances = cached(describe, whole_content)

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        source, target = distances(now), distances(following)
        found = np.isfinite(source).any(axis=0) & np.isfinite(target).any(axis=0)
        subsets = subsets_with_pieces(source, target, found, size) if setting.pieces else anchor_subsets(found, size)

        def find(nodes: np.ndarray) -> np.ndarray:
            places_m, how = following.surface.points_m, (setting.gate, setting.unclipped, setting.squared)
            return match_by_psi(source[nodes], target, places_m, subsets, *how)

        return Matcher(find, len(now.surface), subsets)

    return pair


def _method(
    key: str,
    title: str,
    describe: Callable[[Observation], np.ndarray] = _as_seen,
    size: int = PAPER_SUBSET,
    configure: Callable[[TrackConfig, AnchorSetting], TrackConfig] = all_hypotheses,
) -> Method:
    return Method(
        key=key,
        title=title,
        family=Family.PROPOSED,
        source=SOURCE,
        settings=tuple(AnchorSetting(gate=gate) for gate in GATES),
        associate=partial(by_psi, describe, size),
        configure=configure,
        several=True,
        frame_ms=90.0,
    )


_PROPOSED = _method(PROPOSED, "anchor geodesics as proposed, repaired")

METHODS = (
    replace(_PROPOSED, settings=(*_PROPOSED.settings, *(replace(one, unclipped=False) for one in _PROPOSED.settings))),
    _method("anchors-dijkstra", "the same, distances by Dijkstra", describe=_by_edges),
    _method("anchors-no-tree", "the same without the tree", size=len(ANCHOR_NAMES), configure=next_frame_only),
    replace(
        _method("anchors-filter", "the same with a Kalman filter, not the tree", configure=next_frame_only),
        update=Update.KALMAN,
    ),
)
