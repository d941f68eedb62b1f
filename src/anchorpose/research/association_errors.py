"""How far off descriptors are: e_1, e_2 and e_max estimated from matched nodes (paper, error analysis of Section III).

Between two frames the distance of one skin point to anchor j changes by e_1, what the anchor's localisation adds for
all nodes alike, and by e_2, what the surface between adds, more the farther the anchor is. Occlusions (e_3) are
outliers to the fit. What all nodes of a frame share counts as e_1, be it the anchor's or the surface's beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.optimize import nnls

MAD_OF_NORMAL = 0.6745  # median absolute value of a standard normal variable
ROUNDS = 4  # between e_1 and the scale of e_2; both settle after two or three


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorConfig:
    """How the errors are fitted."""

    least_nodes: int = 30  # in a pair of frames, so that the anchor's part stands out of the surface's
    bins: int = 10  # of equal size over distance: a line needs few, a median many in each
    least_range_m: float = 0.3  # of distance: a slope from less is noise
    sigmas: float = 2.0  # the bound holds for 95 of 100 if errors are normal

    def __post_init__(self) -> None:
        if self.least_nodes < 2 or self.bins < 3:
            raise ValueError(f"least_nodes and bins must be 2 and 3 at least, got {self.least_nodes} and {self.bins}")
        for name in ("least_range_m", "sigmas"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """Standard deviations of a descriptor's change between two frames of one skin point, metres.

    anchor_m (k,): of e_1 for each anchor, the change of both frames together (one frame's localisation is 0.71 of it);
    NaN where the anchor was never seen twice. surface_offset_m and surface_per_m: of e_2, offset plus slope times
    distance. pairs: of frames; differences: node and anchor pairs that were used. sigmas: of the bound.
    """

    anchor_m: np.ndarray
    surface_offset_m: float
    surface_per_m: float
    pairs: int
    differences: int
    sigmas: float

    def e_max_m(self, distance_m: np.ndarray) -> np.ndarray:
        """(..., k) bound on |e_1 + e_2| for distances (..., k) to the anchors; NaN where nothing is known."""
        surface = self.surface_offset_m + self.surface_per_m * np.asarray(distance_m, dtype=np.float64)
        return self.sigmas * (self.anchor_m + surface)

    @property
    def anchor_bound_m(self) -> float:
        """The bound's part that does not depend on distance, of a typical anchor; ``GateConfig`` has its like."""
        return self.sigmas * (float(np.nanmedian(self.anchor_m)) + self.surface_offset_m)

    @property
    def surface_bound_per_m(self) -> float:
        """The bound's part for each metre to the anchor; ``GateConfig`` has its like."""
        return self.sigmas * self.surface_per_m


class NoErrorModel(StrEnum):
    """Why the errors were not estimated: a result."""

    FEW = "no anchor was seen from enough matched nodes in both frames"
    NARROW = "the distances to the anchors are too much alike to tell a slope"


def estimate_errors(
    before: np.ndarray, after: np.ndarray, pair: np.ndarray | None = None, config: ErrorConfig | None = None
) -> ErrorModel | NoErrorModel:
    """The error model of matched nodes.

    before, after (m, k) metres: descriptors of the two nodes of each match in a frame and the next; NaN or inf where
    an anchor is missed or not reached. pair (m,) int: which pair of frames a match belongs to; None = one pair.
    For each pair and anchor e_1 is the weighted median change; the scale of what is left, the median absolute value in
    bins of distance, gives e_2's line; both in turns.
    """
    config = config or ErrorConfig()
    pair = np.zeros(len(before), np.int64) if pair is None else np.asarray(pair)
    if before.shape != after.shape or before.ndim != 2 or pair.shape != before.shape[:1]:
        raise ValueError(f"descriptors {before.shape} and {after.shape} with pairs {pair.shape} are no matches")
    change, distance, group = _changes(np.asarray(before, np.float64), np.asarray(after, np.float64), pair, config)
    if len(change) == 0:
        return NoErrorModel.FEW
    edges = np.quantile(distance, np.linspace(0.0, 1.0, config.bins + 1))
    if edges[-2] - edges[1] < config.least_range_m:
        return NoErrorModel.NARROW
    bin_of = np.clip(np.searchsorted(edges, distance, side="right") - 1, 0, config.bins - 1)
    groups, of_group = np.unique(group, return_inverse=True)
    line = np.array([1.0, 0.0])
    for _ in range(ROUNDS):
        weight = 1.0 / np.maximum(line[0] + line[1] * distance, 1e-6)
        shift = np.array([_weighted_median(change[rows], weight[rows]) for rows in _rows(of_group, len(groups))])
        line = _scale_line(np.abs(change - shift[of_group]), distance, bin_of, config.bins)
    anchor = groups % before.shape[1]
    spread = [
        np.median(np.abs(shift[anchor == j])) / MAD_OF_NORMAL if (anchor == j).any() else np.nan
        for j in range(before.shape[1])
    ]
    pairs = len(np.unique(groups // before.shape[1]))
    return ErrorModel(np.array(spread), float(line[0]), float(line[1]), pairs, len(change), config.sigmas)


def _changes(
    before: np.ndarray, after: np.ndarray, pair: np.ndarray, config: ErrorConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(d,) changes, distances and groups (pair times anchors plus anchor); small groups are left out."""
    known = np.isfinite(before) & np.isfinite(after)
    anchors = before.shape[1]
    group = np.unique(pair, return_inverse=True)[1].reshape(-1, 1) * anchors + np.arange(anchors)
    large = np.bincount(group[known], minlength=group.max(initial=-1) + 1) >= config.least_nodes
    used = known & large[group] if len(group) else known
    return before[used] - after[used], (before[used] + after[used]) / 2.0, group[used]


def _rows(of_group: np.ndarray, count: int) -> list[np.ndarray]:
    order = np.argsort(of_group, kind="stable")
    return np.split(order, np.searchsorted(of_group[order], np.arange(1, count)))


def _weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2.0)])


def _scale_line(left: np.ndarray, distance: np.ndarray, bin_of: np.ndarray, bins: int) -> np.ndarray:
    """(2,) offset and slope, neither negative, of the standard deviation over distance; relative errors count."""
    filled = [rows for rows in _rows(bin_of, bins) if len(rows)]
    scale = np.array([np.median(left[rows]) for rows in filled]) / MAD_OF_NORMAL
    middle = np.array([np.median(distance[rows]) for rows in filled])
    weight = 1.0 / np.maximum(scale, 1e-9 + 0.1 * scale.max())
    return nnls(np.stack([weight, weight * middle], axis=1), weight * scale)[0]
