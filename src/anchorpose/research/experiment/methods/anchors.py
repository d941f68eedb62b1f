"""The paper's proposed feature, geodesic distances to the anchors (Definition 3), and variants of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np

from anchorpose.geodesics.anchors import anchor_descriptor
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.research.experiment.framework import ANYWHERE_M, PAPER_GATE
from anchorpose.research.experiment.method import PROPOSED, Family, Method, cached, whole_content
from anchorpose.research.features.psi import match_by_psi, subsets_with_pieces
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.track_tree.hypotheses import GateConfig, HypothesisConfig, Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate

SOURCE: Final = "Li and Burdick, Definition 3 and Section IV"
PAPER_SUBSET: Final = 3  # N_S: "three anchor nodes suffice" (Section IV-D)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorSetting:
    """The gate, which the paper chose by hand; unclipped: see ``features.psi``."""

    gate: GateConfig = PAPER_GATE
    unclipped: bool = True


GATES: Final = tuple(
    GateConfig(anchor_bound_m=anchor, surface_bound_per_m=surface, search_radius_m=ANYWHERE_M)
    for anchor, surface in product((0.05, 0.03, 0.08, 0.02), (0.01, 0.005))
)


def _hypotheses(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(config, gate=setting.gate, hypotheses=HypothesisConfig(trusted_only=False))


def _next_frame_only(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(_hypotheses(config, setting), follow=replace(config.follow, look_ahead=1))


def _as_seen(seen: Observation) -> np.ndarray:
    return seen.descriptor


def _by_edges(seen: Observation) -> np.ndarray:
    """(n, 5) distances by Dijkstra's shortest paths along edges, as in the paper."""
    along_edges = partial(solve_distance, solver=Solver.DIJKSTRA)
    return anchor_descriptor(seen.whole, seen.anchors, along_edges)[: len(seen.surface)]


def _by_psi(describe: Callable[[Observation], np.ndarray], size: int, setting: AnchorSetting) -> Associate:
    """A hypothesis for every subset of ``size`` anchors, and for the anchors that are left behind a cut."""
    distances = cached(describe, whole_content)

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        source, target = distances(now), distances(following)
        subsets = subsets_with_pieces(source, target, now.anchors.found & following.anchors.found, size)

        def find(nodes: np.ndarray) -> np.ndarray:
            places_m = following.surface.points_m
            return match_by_psi(source[nodes], target, places_m, subsets, setting.gate, setting.unclipped)

        return Matcher(find, len(now.surface), subsets)

    return pair


def _method(
    key: str,
    title: str,
    describe: Callable[[Observation], np.ndarray] = _as_seen,
    size: int = PAPER_SUBSET,
    configure: Callable[[TrackConfig, AnchorSetting], TrackConfig] = _hypotheses,
) -> Method:
    return Method(
        key=key,
        title=title,
        family=Family.PROPOSED,
        source=SOURCE,
        settings=tuple(AnchorSetting(gate=gate) for gate in GATES),
        associate=partial(_by_psi, describe, size),
        configure=configure,
        several=True,
        frame_ms=90.0,
    )


_PROPOSED = _method(PROPOSED, "anchor geodesics as proposed")

METHODS = (
    replace(_PROPOSED, settings=(*_PROPOSED.settings, *(replace(one, unclipped=False) for one in _PROPOSED.settings))),
    _method("anchors-dijkstra", "the same, distances by Dijkstra", describe=_by_edges),
    _method("anchors-no-tree", "the same without the tree", size=len(ANCHOR_NAMES), configure=_next_frame_only),
    replace(
        _method("anchors-filter", "the same with a Kalman filter, not the tree", configure=_next_frame_only),
        filtered=True,
    ),
)
