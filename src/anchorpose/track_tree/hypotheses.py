"""Make hypotheses on where each node is in the next frame, one hypothesis per subset of the anchors (paper, Track Tree
Construction).

The gate is the largest accepted difference between the descriptors of one skin point in two frames (paper, Error
Analysis). The descriptor of a node is the list of its geodesic distances to the anchors (head, hands and feet).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree

from anchorpose.body.nearest_skin import sort_into_voxels
from anchorpose.settings import Count, NotNegative, Positive, settings
from anchorpose.surface.surface import Surface
from anchorpose.track_tree.matching import Target, hold_subset, match_all, sort_balls


class Feature(StrEnum):
    """The evidence that two nodes show the same place on the skin."""

    GEODESIC = "geodesic"  # geodesic distances to the anchors (paper, Definition 3)
    # nearness to the node's place in the frame before, without a descriptor; for comparisons with ``GEODESIC``
    POSITION = "position"


@settings
class HypothesisConfig:
    """Settings for making hypotheses."""

    feature: Feature = Feature.GEODESIC
    # N_S, number of anchors per hypothesis; three are enough (paper, Section IV-D); 5 = all anchors in a single
    # hypothesis
    subset_size: Count = 3
    # whether matches of nodes between frames constrain the registration of the whole body in every frame; False = they
    # are not used for it. The paper's method (``Method.PARTS``) uses the matches whether ``always`` is set or not
    always: bool = False
    # whether a node's distances to anchors are left out if a hole in the surface lengthens them; False = they are kept,
    # as in the paper, where the track tree has to choose subsets of anchors with correct distances
    trusted_only: bool = True


@settings
class GateConfig:
    """Settings of the gate e_max = e_1 + e_2: the largest change of a descriptor between two frames that anchor jitter
    (e_1) and surface noise (e_2) can cause.
    """

    # e_1, m, for anchor jitter. The gate e_1 + e_2 (largest accepted change of a descriptor) is 3 cm at 1 m from an
    # anchor; the paper's 5 cm made the matches worse by a quarter
    anchor_bound_m: NotNegative = 0.020
    # e_2, m per m of path to the anchor, for the noise of geodesic distances that remains after smoothing
    surface_bound_per_m: NotNegative = 0.010
    # m, radius around the predicted place in which matches are searched; a hand at 3.6 m/s moves this far in 33 ms
    search_radius_m: Positive = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """For each node of a frame, one possible match in the next frame per subset of the anchors. A node without a match
    has the value -1, which is not an error.
    """

    match: np.ndarray  # (m, s) int32, node of the next surface, -1 = no node within the gate
    subsets: np.ndarray  # (s, n_s) int, indices of the anchors in each subset


def anchor_subsets(found: np.ndarray, size: int = 3) -> np.ndarray:
    """Return all subsets of ``size`` found anchors (S_A,m in the paper), as rows of anchor indices in ascending order.

    found (5,) bool: whether each anchor (head, hands and feet) was found in both frames. Return an int64 array (C(N_A,
    size), size). If fewer anchors than ``size`` were found, the only subset has all found anchors; without anchors, the
    result is a (0, size) array.
    """
    if size < 1:
        raise ValueError(f"size must be at least 1, got {size}")
    anchors = np.flatnonzero(found)
    if len(anchors) == 0:
        return np.empty((0, size), np.int64)
    return np.array(list(combinations(anchors, min(size, len(anchors)))), np.int64)


def error_bound(descriptor: np.ndarray, subsets: np.ndarray, config: GateConfig) -> np.ndarray:
    """Return the gate e_max (m, s) float32 in metres for every node and subset of anchors (paper, Error Analysis).

    descriptor (m, 5): distances to the anchors in metres; subsets (s, n_s): anchor indices of each subset. The bound is
    linear in the mean distance to a subset's anchors. The bound is NaN if a distance is missing, and inf if no path on
    the surface leads to an anchor; the node then has no match under this subset.
    """
    distance = np.asarray(descriptor, dtype=np.float32)[:, subsets].mean(axis=2)
    return config.anchor_bound_m + config.surface_bound_per_m * distance


def match_hypotheses(
    source_descriptor: np.ndarray,
    target_surface: Surface,
    target_descriptor: np.ndarray,
    subsets: np.ndarray,
    predicted_m: np.ndarray | None = None,
    config: GateConfig | None = None,
) -> Hypotheses:
    """Match every source node with a node of the target frame, separately for every subset of the anchors.

    For a source node v, psi(v) is the set of target nodes with a similar descriptor: the Euclidean distance between
    both descriptors, over the anchors of the subset, is below ``error_bound``. The match is the node of psi closest to
    the average position of all nodes in psi. source_descriptor (m, 5), target_descriptor (n, 5) float32 metres; NaN
    (missed anchor) and inf (unreachable) are never within the gate. subsets (s, n_s): from ``anchor_subsets``.
    predicted_m (m, 3) world: the expected place of each source node in the target frame; psi is then searched within
    ``search_radius_m`` of it, and a node whose prediction is NaN has no match. Without predictions psi is searched on
    the whole surface, as in the paper, which is about four times slower. Source: the paper, Error Analysis and Track
    Tree Construction.
    """
    config = config or GateConfig()
    _refuse_mismatch(source_descriptor, target_surface, target_descriptor, subsets, predicted_m)
    count = len(source_descriptor)
    if len(target_surface) == 0 or len(subsets) == 0:
        return Hypotheses(match=np.full((count, len(subsets)), -1, np.int32), subsets=subsets)
    centres = np.zeros((count, 3), np.float32) if predicted_m is None else predicted_m.astype(np.float32)
    radius = np.inf if predicted_m is None else config.search_radius_m
    voxels = sort_into_voxels(target_surface.points_m, radius)
    distances = np.ascontiguousarray(target_descriptor[voxels.order], dtype=np.float32)
    target = Target(np.ascontiguousarray(target_surface.points_m[voxels.order]), distances)
    source = np.ascontiguousarray(source_descriptor, dtype=np.float32)
    limit2 = np.ascontiguousarray(error_bound(source, subsets, config) ** 2)
    numbers = np.ascontiguousarray(subsets, dtype=np.int64)
    enough = hold_subset(numbers, source.shape[1])
    match = match_all(source, limit2, sort_balls(centres, radius, voxels), target, voxels, numbers, enough)
    return Hypotheses(match=match, subsets=subsets)


def nearest_hypotheses(source: Surface, target: Surface, config: GateConfig) -> Hypotheses:
    """Match each source node with the nearest target node within ``search_radius_m``; without such a node, the match is
    missed.

    Anchors are not used, so the result has a single column, for an empty subset of anchors.
    """
    match = np.full((len(source), 1), -1, np.int32)
    if len(source) and len(target):
        nearest = KDTree(target.points_m).query(source.points_m, distance_upper_bound=config.search_radius_m)[1]
        match[:, 0] = np.where(nearest < len(target), nearest, -1)
    return Hypotheses(match, np.empty((1, 0), np.int64))


class Matcher:
    """The matches of one frame's nodes in the next frame. Each match is computed on first use, since the track tree
    does not reach all nodes (with several cameras, only half of them).
    """

    def __init__(self, find: Callable[[np.ndarray], np.ndarray], node_count: int, subsets: np.ndarray) -> None:
        """Make a matcher. find: function that returns the matches (k, s) of nodes (k,) under each of s subsets; the
        match of a node must not depend on the other nodes.
        """
        self.subsets = subsets
        # (node_count, s), match of each node under each subset of the anchors: a node of the next frame; -1 = no match,
        # or not computed yet
        self.match = np.full((node_count, len(subsets)), -1, np.int32)
        # m, cost that the track tree adds to the distance between each match and the node's predicted place
        self.cost_m = np.zeros((node_count, len(subsets)), np.float32)
        self._asked = np.zeros(node_count, dtype=bool)
        self._find = find

    def ask(self, nodes: np.ndarray) -> np.ndarray:
        """Return the matches (k, s) int32 of the nodes (k,). The nodes may be in any order, and may repeat."""
        wanted = np.zeros(len(self.match), dtype=bool)
        wanted[nodes] = True
        new = np.flatnonzero(wanted & ~self._asked)
        if len(new):
            self.match[new] = self._find(new)
            self._asked[new] = True
        return self.match[nodes]

    def all(self) -> Hypotheses:
        """Return the hypotheses (possible matches) of every node."""
        return Hypotheses(self.ask(np.arange(len(self.match))), self.subsets)


def _refuse_mismatch(
    source_descriptor: np.ndarray,
    target_surface: Surface,
    target_descriptor: np.ndarray,
    subsets: np.ndarray,
    predicted_m: np.ndarray | None,
) -> None:
    if target_descriptor.shape[0] != len(target_surface) or target_descriptor.shape[1:] != source_descriptor.shape[1:]:
        raise ValueError(
            f"descriptors {source_descriptor.shape} and {target_descriptor.shape} do not fit"
            f" {len(target_surface)} nodes"
        )
    if len(subsets) and not ((subsets >= 0) & (subsets < source_descriptor.shape[1])).all():
        raise ValueError(f"subsets name anchors beyond the {source_descriptor.shape[1]} of the descriptor")
    if predicted_m is not None and predicted_m.shape != (len(source_descriptor), 3):
        raise ValueError(f"predicted_m is {predicted_m.shape}, wanted ({len(source_descriptor)}, 3)")
