"""Match nodes by distances to anchors together with the local descriptor SHOT, a combination that the paper leaves to
future work.

The two features complement each other. A local descriptor distinguishes a node from its neighbours but confuses distant
places. Distances to anchors distinguish distant places but confuse neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numba import njit

from anchorpose.joints import ANCHOR_NAMES
from anchorpose.research.experiment.config import Update
from anchorpose.research.experiment.framework import NEVER_M
from anchorpose.research.experiment.method import NEXT, Family, Method, cached, seen_content
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.track_tree.hypotheses import HypothesisConfig, Matcher, anchor_subsets
from anchorpose.track_tree.tree import TreeConfig
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate

SHOT: Final = ShotConfig(radius_m=0.20, z_by_normal=True)  # the settings that were chosen for the method SHOT
# Maximum squared deviation of a distance or place, in sigma^2. A greater squared deviation, which occlusions cause, is
# set to this maximum, and so is the squared deviation of an unknown distance.
MOST: Final = 9.0
# Maximum squared deviation of a signature, in sigma^2. A greater squared deviation is set to this maximum, since it
# does not rule out a match: a hole beside a node changes the node's signature.
MOST_SHOT: Final = 18.0
# Maximum distance in m of a match from the predicted place. A hand at 3 m/s moves 0.3 m in 0.1 s, and its descriptor
# still identifies the hand.
GIVEN_UP_M: Final = 0.30
# number of nodes matched at once, to save memory: 500 nodes with 2,000 possible matches each need 4 MB
ROWS: Final = 500
SUBSET: Final = 3  # number of anchors in a subset, N_S in the paper


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSetting:
    """The sigmas (standard deviations) in which deviations between two nodes are measured, and the cost of a match."""

    anchor_sigma_m: float = 0.04  # m, sigma of the change of a node's distance to an anchor between two frames
    shot_sigma: float = 0.15  # sigma of the distance between a node's signatures (of unit length) in two frames
    place_sigma_m: float = 0.03  # m, sigma of a node's movement between two frames; small, since most skin hardly moves
    cost_m: float = 0.01  # m, cost in the track tree of a match whose nodes deviate by one sigma


SETTINGS: Final = (
    NextSetting(),
    NextSetting(cost_m=0.02),
    NextSetting(anchor_sigma_m=0.03),
    NextSetting(shot_sigma=0.2),
    NextSetting(place_sigma_m=0.06),
    NextSetting(place_sigma_m=0.1),
)


def _configure(config: TrackConfig, setting: NextSetting) -> TrackConfig:
    """Return the configuration in which the body model in the expected pose closes holes in the mesh, as in this
    project's tracker.

    If bad matches are rejected, matches farther than ``GIVEN_UP_M`` from the predicted place count as bad.
    """
    tree = config.tree if config.tree.missed_cost_m == NEVER_M else TreeConfig(missed_cost_m=GIVEN_UP_M)
    hypotheses = HypothesisConfig(trusted_only=False)
    return replace(config, surface=SurfaceConfig(), hypotheses=hypotheses, tree=tree)


def _signatures(seen: Observation) -> np.ndarray:
    """Return SHOT's signatures (n, 352). An undefined signature is zero, which is far from every other signature."""
    return np.nan_to_num(shot(seen.surface.points_m, seen.surface.normals, SHOT))


def _associate(setting: NextSetting) -> Associate:
    signatures = cached(_signatures, seen_content)
    unlike = cached(
        lambda now, following: _unlike(signatures(now), signatures(following), setting.shot_sigma), seen_content
    )

    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        subsets = anchor_subsets(now.anchors.found & following.anchors.found, SUBSET)
        subsets = subsets if len(subsets) else np.empty((1, 0), np.int64)
        source = now.descriptor - jitter_m(now, following, unlike(now, following))

        def find(nodes: np.ndarray) -> np.ndarray:
            # the deviations of the signatures are taken from the cache on each call; if this function kept them
            # instead, they would need 16 MB for 2,000 nodes
            local = unlike(now, following)
            match = np.empty((len(nodes), len(subsets)), np.int32)
            per2 = (setting.anchor_sigma_m**-2, setting.place_sigma_m**-2)
            for first in range(0, len(nodes), ROWS):
                chosen = nodes[first : first + ROWS]
                seen = (source[chosen], now.surface.points_m[chosen])
                others = (following.descriptor, following.surface.points_m)
                match[first : first + ROWS], total = most_similar(local[chosen], seen, others, subsets, per2)
                matcher.cost_m[chosen] = setting.cost_m * np.sqrt(total)
            return match

        matcher = Matcher(find, len(now.surface), subsets)
        return matcher

    return pair


def _unlike(source: np.ndarray, target: np.ndarray, sigma: float) -> np.ndarray:
    """Return (m, n) float32: squared distances between signatures, in units of sigma^2, each at most ``MOST_SHOT``.

    Since signatures have unit length, a squared distance is 2 minus twice their scalar product.
    """
    apart2 = 2.0 * source @ target.T
    # computed in place, since making new arrays of this size takes longer than the arithmetic
    np.subtract(2.0, apart2, out=apart2)
    np.maximum(apart2, 0.0, out=apart2)
    apart2 /= np.float32(sigma**2)
    return np.asarray(np.minimum(apart2, np.float32(MOST_SHOT), out=apart2))


Nodes = tuple[np.ndarray, np.ndarray]
"""The nodes of a frame: their distances to the anchors (n, 5) and their places (n, 3), metres."""


@njit(cache=True)
def most_similar(
    local: np.ndarray, seen: Nodes, others: Nodes, subsets: np.ndarray, per2: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (k, s) int32: for each node and subset of anchors, the most similar node of the other frame.

    Also return (k, s) float32: how much the two nodes deviate, the sum of the squared deviations of signature, place
    and distances to the subset's anchors. A squared deviation is in units of sigma^2. The squared deviation of a place
    or a distance is at most ``MOST``, the value that is also used for an unknown distance. local (k, n): squared
    deviations of the signatures. seen: the k nodes; others: the n nodes of the other frame. per2: 1 / sigma^2 of
    distances and of places, 1/m2. Of equally similar nodes, the node with the lower number is chosen.
    """
    match = np.zeros((len(local), len(subsets)), np.int32)
    total = np.full((len(local), len(subsets)), np.inf, np.float32)
    each, sums = np.empty(seen[0].shape[1], np.float32), np.empty(len(subsets), np.float32)
    for node in range(len(local) if local.shape[1] else 0):
        likely = local[node].argmin()
        _add_up(_base(local, seen, others, per2, node, likely), seen, others, subsets, per2, node, likely, each, sums)
        worst = sums.max()  # a node whose deviation in signature and place alone exceeds this is not the most similar
        for other in range(local.shape[1]):
            if local[node, other] > worst:
                continue
            base = _base(local, seen, others, per2, node, other)
            if base > worst:
                continue
            _add_up(base, seen, others, subsets, per2, node, other, each, sums)
            for s in range(len(subsets)):
                if sums[s] < total[node, s]:
                    total[node, s], match[node, s] = sums[s], other
            worst = min(worst, total[node].max())
    return match, total


@njit(cache=True)
def _base(
    local: np.ndarray, seen: Nodes, others: Nodes, per2: tuple[float, float], node: int, other: int
) -> np.float32:
    """Return the sum of the squared deviations, in signature and place, of a node from a node of the other frame."""
    base = np.float32(0.0)
    for axis in range(3):
        off = seen[1][node, axis] - others[1][other, axis]
        base += off * off
    return local[node, other] + min(base * np.float32(per2[1]), np.float32(MOST))


@njit(cache=True)
def _add_up(
    base: np.float32,
    seen: Nodes,
    others: Nodes,
    subsets: np.ndarray,
    per2: tuple[float, float],
    node: int,
    other: int,
    each: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Fill ``sums`` (s,), for each subset of anchors, with ``base`` (the result of ``_base``) plus the squared
    deviations of the distances to the subset's anchors.

    ``each`` (5,) is filled with the squared deviation of the distance to each anchor.
    """
    for anchor in range(len(each)):
        off = seen[0][node, anchor] - others[0][other, anchor]
        off2 = off * off * np.float32(per2[0])
        each[anchor] = off2 if off2 < MOST else np.float32(MOST)  # NaN is never less, so NaN becomes MOST
    for s in range(len(subsets)):
        sums[s] = base
        for anchor in subsets[s]:
            sums[s] += each[anchor]


def jitter_m(now: Observation, following: Observation, local: np.ndarray) -> np.ndarray:
    """Return e_1 (5,) float32, m: for each anchor, the amount by which its jitter changes all nodes' distances to it.

    e_1 is estimated as the median, over nodes, of the node's distance to the anchor minus the same distance of the
    node's match by the local descriptor alone. It is 0 for an anchor that no path reaches in one of the frames. local:
    squared deviations of the signatures, from each node to each node of the next frame.
    """
    jitter = np.zeros(len(ANCHOR_NAMES), np.float32)
    if len(now.surface) == 0 or len(following.surface) == 0:
        return jitter
    some = np.arange(0, len(now.surface), 1 + len(now.surface) // ROWS)
    with np.errstate(invalid="ignore"):
        off = now.descriptor[some] - following.descriptor[local[some].argmin(axis=1)]
    for anchor, column in enumerate(off.T):
        known = column[np.isfinite(column)]
        jitter[anchor] = np.median(known) if len(known) else 0.0
    return jitter


METHODS = (
    Method(
        key=NEXT,
        title="next generation: anchors with SHOT",
        family=Family.PROPOSED,
        source="Li and Burdick, Section VII (future work)",
        settings=SETTINGS,
        associate=_associate,
        configure=_configure,
        several=True,
        own_surface=True,
        update=Update.KALMAN,
        frame_ms=170.0,
    ),
)
