"""The error of descriptors: e_1, e_2 and e_max estimated from matched nodes (paper, error analysis of Section III).

Between two frames the distance of one skin point to anchor j changes by e_1, the error of the anchor's localisation,
which all nodes share, and by e_2, the error of the surface in between, which grows with the distance. Occlusions (e_3)
are outliers to the fit. All that the nodes of a frame share counts as e_1, also errors of the surface at the anchor.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.optimize import nnls

MAD_OF_NORMAL: Final = 0.6745  # median absolute value of a standard normal variable
ROUNDS: Final = 4  # alternating between e_1 and the scale of e_2; both settle after two or three
LEAST_NODES: Final = 30  # in a pair of frames, so that the anchor's error can be separated from the surface's
BINS: Final = 10  # of equal size over distance: a line needs few bins, a median many values in each
LEAST_RANGE_M: Final = 0.3  # of distance: a slope from less is noise
SIGMAS: Final = 2.0  # the bound holds for 95 of 100 if errors are normal


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """Standard deviations of a descriptor's change between two frames of one skin point, metres.

    anchor_m (k,): of e_1 for each anchor, the change of both frames together (one frame's localisation is 0.71 of it);
    NaN where the anchor was never seen twice. surface_offset_m and surface_per_m: of e_2, offset plus slope times
    distance. pairs: number of pairs of frames; differences: number of node and anchor pairs that were used.
    """

    anchor_m: np.ndarray
    surface_offset_m: float
    surface_per_m: float
    pairs: int
    differences: int

    def e_max_m(self, distance_m: np.ndarray) -> np.ndarray:
        """(..., k) bound on |e_1 + e_2| for distances (..., k) to the anchors; NaN for an anchor without an error."""
        surface = self.surface_offset_m + self.surface_per_m * np.asarray(distance_m, dtype=np.float64)
        return SIGMAS * (self.anchor_m + surface)

    @property
    def anchor_bound_m(self) -> float:
        """The part of a typical anchor's bound that does not depend on distance, as in ``GateConfig``."""
        return SIGMAS * (float(np.nanmedian(self.anchor_m)) + self.surface_offset_m)

    @property
    def surface_bound_per_m(self) -> float:
        """The part of the bound for each metre to the anchor, as in ``GateConfig``."""
        return SIGMAS * self.surface_per_m


class NoErrorModel(StrEnum):
    """Why the errors could not be estimated."""

    FEW = "no anchor was seen from enough matched nodes in both frames"
    NARROW = "the distances to the anchors are too similar to estimate a slope"


def estimate_errors(before: np.ndarray, after: np.ndarray, pair: np.ndarray | None = None) -> ErrorModel | NoErrorModel:
    """The error model of matched nodes.

    before, after (m, k) metres: descriptors of the two nodes of each match in a frame and the next; NaN or inf where
    an anchor is missed or not reached. pair (m,) int: the pair of frames that a match belongs to; None = one pair.
    For each pair and anchor e_1 is the weighted median change; the median absolute residual in bins of distance gives
    the line of e_2; the two steps alternate.
    """
    pair = np.zeros(len(before), np.int64) if pair is None else np.asarray(pair)
    if before.shape != after.shape or before.ndim != 2 or pair.shape != before.shape[:1]:
        raise ValueError(f"descriptors {before.shape} and {after.shape} with pairs {pair.shape} are not matches")
    change, distance, group = _changes(np.asarray(before, np.float64), np.asarray(after, np.float64), pair)
    if len(change) == 0:
        return NoErrorModel.FEW
    edges = np.quantile(distance, np.linspace(0.0, 1.0, BINS + 1))
    if edges[-2] - edges[1] < LEAST_RANGE_M:
        return NoErrorModel.NARROW
    bin_of = np.clip(np.searchsorted(edges, distance, side="right") - 1, 0, BINS - 1)
    groups, of_group = np.unique(group, return_inverse=True)
    line = np.array([1.0, 0.0])
    for _ in range(ROUNDS):
        weight = 1.0 / np.maximum(line[0] + line[1] * distance, 1e-6)
        shift = np.array([_weighted_median(change[rows], weight[rows]) for rows in _rows(of_group, len(groups))])
        line = _scale_line(np.abs(change - shift[of_group]), distance, bin_of)
    anchor = groups % before.shape[1]
    spread = [
        np.median(np.abs(shift[anchor == j])) / MAD_OF_NORMAL if (anchor == j).any() else np.nan
        for j in range(before.shape[1])
    ]
    pairs = len(np.unique(groups // before.shape[1]))
    return ErrorModel(np.array(spread), float(line[0]), float(line[1]), pairs, len(change))


def _changes(before: np.ndarray, after: np.ndarray, pair: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(d,) changes, distances and groups (pair times anchors plus anchor); small groups are left out."""
    known = np.isfinite(before) & np.isfinite(after)
    anchors = before.shape[1]
    group = np.unique(pair, return_inverse=True)[1].reshape(-1, 1) * anchors + np.arange(anchors)
    large = np.bincount(group[known], minlength=group.max(initial=-1) + 1) >= LEAST_NODES
    used = known & large[group] if len(group) else known
    return before[used] - after[used], (before[used] + after[used]) / 2.0, group[used]


def _rows(of_group: np.ndarray, count: int) -> list[np.ndarray]:
    """The rows of each of the groups 0 to count - 1."""
    order = np.argsort(of_group, kind="stable")
    return np.split(order, np.searchsorted(of_group[order], np.arange(1, count)))


def _weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2.0)])


def _scale_line(residual: np.ndarray, distance: np.ndarray, bin_of: np.ndarray) -> np.ndarray:
    """(2,) offset and slope, neither negative, of the standard deviation over distance, fitted to relative errors."""
    filled = [rows for rows in _rows(bin_of, BINS) if len(rows)]
    scale = np.array([np.median(residual[rows]) for rows in filled]) / MAD_OF_NORMAL
    middle = np.array([np.median(distance[rows]) for rows in filled])
    weight = 1.0 / np.maximum(scale, 1e-9 + 0.1 * scale.max())
    return nnls(np.stack([weight, weight * middle], axis=1), weight * scale)[0]
