"""The paper's future work: anchors with a local descriptor, which say different things about where a node is.

A local descriptor tells neighbours apart and confuses places far from each other; distances to anchors do the opposite.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from anchorpose.association.hypotheses import HypothesisConfig, Matcher, anchor_subsets
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.research.experiment.framework import NEVER_M
from anchorpose.research.experiment.method import NEXT, Family, Method, cached_per_frame
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.association import Associate
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracking.tree import TreeConfig

SHOT: Final = ShotConfig(radius_m=0.20, z_by_normal=True)  # as chosen for SHOT alone
MOST: Final = 9.0  # squared deviations: a distance that an occlusion changed counts no more, nor does an unknown one
MOST_SHOT: Final = 18.0  # of a signature: a hole beside a node changes it
GIVEN_UP_M: Final = 0.30  # a hand at 3 m/s is so far off its prediction, and its descriptor shows it all the same
ROWS: Final = 500  # source nodes that are compared at once: 4 MB per anchor for 2,000 of the other frame
SUBSET: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSetting:
    """anchor_sigma_m: of a distance to an anchor; shot_sigma: of the distance of two signatures, which are of unit
    length; place_sigma_m: of where a node goes, since most of the skin hardly moves; cost_m: what a branch of the tree
    pays per deviation of its nodes' descriptors."""

    anchor_sigma_m: float = 0.04
    shot_sigma: float = 0.15
    place_sigma_m: float = 0.03
    cost_m: float = 0.01


SETTINGS: Final = (
    NextSetting(),
    NextSetting(cost_m=0.02),
    NextSetting(anchor_sigma_m=0.03),
    NextSetting(shot_sigma=0.2),
    NextSetting(place_sigma_m=0.06),
    NextSetting(place_sigma_m=0.1),
)


def _configure(config: TrackConfig, setting: NextSetting) -> TrackConfig:
    """Holes in the mesh are closed with the expected body, as in this project's tracker."""
    tree = config.tree if config.tree.missed_cost_m == NEVER_M else TreeConfig(missed_cost_m=GIVEN_UP_M)
    hypotheses = HypothesisConfig(trusted_only=False)
    return replace(config, surface=SurfaceConfig(), hypotheses=hypotheses, tree=tree)


def _signatures(seen: Observation) -> np.ndarray:
    """(n, 352), zero where undefined: then unlike everything."""
    return np.nan_to_num(shot(seen.surface.points_m, seen.surface.normals, SHOT))


def _associate(setting: NextSetting) -> Associate:
    signatures = cached_per_frame(_signatures)

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        subsets = anchor_subsets(now.anchors.found & following.anchors.found, SUBSET)
        subsets = subsets if len(subsets) else np.empty((1, 0), np.int64)
        local = partial(_local, signatures(now), signatures(following), setting.shot_sigma)
        source = now.descriptor - jitter_m(now, following, local)

        def find(nodes: np.ndarray) -> np.ndarray:
            match = np.empty((len(nodes), len(subsets)), np.int32)
            for first in range(0, len(nodes), ROWS):
                chosen = nodes[first : first + ROWS]
                off2 = _off2(source[chosen], following.descriptor, setting.anchor_sigma_m)
                base = local(chosen) + _moved2(now, following, chosen, setting.place_sigma_m)
                rows = np.arange(len(chosen))
                for number, subset in enumerate(subsets):
                    total = base + off2[subset].sum(axis=0)
                    best = total.argmin(axis=1)
                    match[first : first + ROWS, number] = best
                    matcher.cost_m[chosen, number] = setting.cost_m * np.sqrt(total[rows, best])
            return match

        matcher = Matcher(find, len(now.surface), subsets)
        return matcher

    return pair


def _local(source: np.ndarray, target: np.ndarray, sigma: float, nodes: np.ndarray) -> np.ndarray:
    """(k, n) float32: squared distances of signatures of unit length, in deviations, at most ``MOST_SHOT``."""
    apart2 = np.maximum(2.0 - 2.0 * source[nodes] @ target.T, 0.0)
    return np.asarray(np.minimum(apart2 / np.float32(sigma**2), np.float32(MOST_SHOT)))


def _moved2(now: Observation, following: Observation, nodes: np.ndarray, sigma_m: float) -> np.ndarray:
    """(k, n) float32: squared distances from each node to each of the other frame, in deviations, at most ``MOST``."""
    away = cdist(now.surface.points_m[nodes], following.surface.points_m, "sqeuclidean")
    return np.minimum(away / sigma_m**2, MOST).astype(np.float32)


def _off2(source: np.ndarray, target: np.ndarray, sigma_m: float) -> np.ndarray:
    """(5, k, n) float32: squared differences of the distances to each anchor, in deviations, at most ``MOST``."""
    off = (source.T[:, :, None] - target.T[:, None, :]) / np.float32(sigma_m)
    return np.nan_to_num(np.minimum(off * off, MOST), nan=MOST, posinf=MOST).astype(np.float32)


def jitter_m(now: Observation, following: Observation, local: partial[np.ndarray]) -> np.ndarray:
    """(5,) float32 metres, e_1: the anchors' own movement adds the same to the distance of every node.

    It is the median difference between nodes and their matches by the local descriptor alone; 0 for an anchor that is
    not reached in both frames.
    """
    jitter = np.zeros(len(ANCHOR_NAMES), np.float32)
    if len(now.surface) == 0 or len(following.surface) == 0:
        return jitter
    some = np.arange(0, len(now.surface), 1 + len(now.surface) // ROWS)
    with np.errstate(invalid="ignore"):
        off = now.descriptor[some] - following.descriptor[local(some).argmin(axis=1)]
    for anchor, column in enumerate(off.T):
        known = column[np.isfinite(column)]
        jitter[anchor] = np.median(known) if len(known) else 0.0
    return jitter


METHODS = (
    Method(
        key=NEXT,
        title="next generation: anchors with SHOT",
        family=Family.PROPOSED,
        source="Li and Burdick, Section VI (future work)",
        settings=SETTINGS,
        associate=_associate,
        configure=_configure,
        several=True,
        own_surface=True,
        frame_ms=350.0,
    ),
)
