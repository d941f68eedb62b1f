"""The paper's proposed feature: geodesic distances to the anchors (Definition 3), with and without the track tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

from anchorpose.association.feature import HypothesisConfig
from anchorpose.association.gate import GateConfig
from anchorpose.association.hypotheses import anchor_subsets, match_hypotheses
from anchorpose.association.matcher import Matcher
from anchorpose.experiments.framework import ANYWHERE_M, PAPER_GATE
from anchorpose.experiments.method import Family, Method
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.geodesics.descriptor import anchor_descriptor
from anchorpose.geodesics.distance import Solver
from anchorpose.tracker.association import Associate, link
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorSetting:
    """What the paper chose by hand: the gate; and how many anchors a hypothesis rests on."""

    gate: GateConfig = PAPER_GATE
    subset_size: int = 3


GATES = tuple(
    GateConfig(anchor_bound_m=anchor, surface_bound_per_m=surface, search_radius_m=ANYWHERE_M)
    for anchor, surface in product((0.02, 0.05), (0.01, 0.03))
)


def _hypotheses(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    hypotheses = HypothesisConfig(subset_size=setting.subset_size, trusted_only=False)
    return replace(config, gate=setting.gate, hypotheses=hypotheses)


def _next_frame_only(config: TrackConfig, setting: AnchorSetting) -> TrackConfig:
    return replace(_hypotheses(config, setting), follow=replace(config.follow, look_ahead=1))


def _by_edges(setting: AnchorSetting) -> Associate:
    """As ``link``, but distances are Dijkstra's shortest paths along edges, as the paper computes them."""
    described: list[tuple[Observation, object]] = []

    def distances(seen: Observation):  # type: ignore[no-untyped-def]
        for known, descriptor in described:
            if known is seen:
                return descriptor
        descriptor = anchor_descriptor(seen.whole, seen.anchors, Solver.DIJKSTRA)[: len(seen.surface)]
        described[:] = [*described[-7:], (seen, descriptor)]
        return descriptor

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        subsets = anchor_subsets(now.anchors.found & following.anchors.found, config.hypotheses.subset_size)
        source, target = distances(now), distances(following)

        def find(nodes):  # type: ignore[no-untyped-def]
            places = now.surface.points_m[nodes]
            return match_hypotheses(source[nodes], following.surface, target, subsets, places, config.gate).match

        return Matcher(find, len(now.surface), subsets)

    return pair


def _as_tracked(setting: AnchorSetting) -> Associate:
    return link


def _method(
    key: str, title: str, subset_sizes: tuple[int, ...], configure: Callable[[TrackConfig, AnchorSetting], TrackConfig],
    associate: Callable[[AnchorSetting], Associate] = _as_tracked, sampled: bool = True,
) -> Method:  # fmt: skip
    settings = tuple(AnchorSetting(gate=gate, subset_size=size) for size in subset_sizes for gate in GATES)
    source = "Li and Burdick, Definition 3 and Section IV"
    return Method(key=key, title=title, family=Family.PROPOSED, source=source, settings=settings, associate=associate,
                  configure=configure, sampled=sampled)  # fmt: skip


METHODS = (
    _method("anchors", "anchor geodesics with the tree", (2, 3, 4), _hypotheses, sampled=False),
    _method("anchors-dijkstra", "the same, distances by Dijkstra", (3,), _hypotheses, _by_edges),
    _method("anchors-no-tree", "anchor geodesics without the tree", (len(ANCHOR_NAMES),), _next_frame_only),
)
