"""Links across what hides the skin: a bar before the shins or an arm before the belly does not cut the body.

From every node at the rim of the mesh a straight walk over the picture crosses whatever stands in front, until it meets
the patient again. Whether both ends belong together, the expected skin says; where no skin is expected, their tangent
planes do, and then only across equipment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from anchorpose.surface.kinship import way_over_skin

WAYS = np.array([(0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2)], np.int64)
"""Row and column of a step of a walk. Together with the ways back a straight line is 1 % too long on average."""

ALONG = np.array([(0, 0), (6, 6), (7, 7), (5, 5), (0, 7), (6, 7), (6, 5), (5, 4)], np.int64)
"""Ring places whose edges lead the way of a step; where one is missing, a walk begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GapConfig:
    """How wide a hidden strip may be crossed, and when both sides belong together."""

    max_width_m: float = 0.30  # the paper's largest hole; wider, the straight line says little of the body
    max_unexpected_m: float = 0.15  # where no skin is expected: a padded knee rest with its shadow
    max_departure: float = 0.35  # from either tangent plane, over the width: a shin bends less, two legs far more
    slack_m: float = 0.015  # soft tissue and noise beside a narrow bar
    margin_px: int = 4  # readings lost or removed beside what hides
    behind_m: float = 0.05  # what is so much farther than the skin does not hide it

    def __post_init__(self) -> None:
        for name in ("max_width_m", "max_unexpected_m", "max_departure", "slack_m", "behind_m"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.margin_px < 0:
            raise ValueError(f"margin_px must not be negative, got {self.margin_px}")


@njit(cache=True)
def facing_pairs(
    index: np.ndarray, ring: np.ndarray, pixel: np.ndarray, depth: np.ndarray, hidden: np.ndarray, equipment: np.ndarray,
    points: np.ndarray, normals: np.ndarray, skin: np.ndarray, landmarks: np.ndarray, step: int, spacing: float,
    max_width: float, max_unexpected: float, max_departure: float, slack: float, margin: int, behind: float,
    kin_slack: float, kin_stretch: float, ways: np.ndarray, along: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """(m, 2) int32 pairs of nodes that face each other across hidden pixels or a jump, (m,) float32 their distances.

    index (rows, cols): node on the grid, -1 = none; depth (height, width) metres, raw; hidden, equipment (height,
    width) bool: pixels where something may stand before the patient, and where that is equipment.
    """
    rows, cols = index.shape
    pairs = np.empty((8 * len(points), 2), np.int32)
    lengths = np.empty(8 * len(points), np.float32)
    count = 0
    for p in range(len(points)):
        row, col = pixel[p, 0] // step, pixel[p, 1] // step
        own = depth[pixel[p, 0], pixel[p, 1]]
        for way in range(len(ways)):
            if ring[p, along[way, 0]] >= 0 and ring[p, along[way, 1]] >= 0:
                continue
            down, right = ways[way, 0], ways[way, 1]
            stride = spacing * np.sqrt(np.float64(down * down + right * right))
            longest = int(max_width / stride) + 1
            covered, bare = 0, 0
            for walk in range(1, longest + 2 * margin + 1):
                i, j = row + walk * down, col + walk * right
                if i >= rows or j < 0 or j >= cols:
                    break
                q = index[i, j]
                there = depth[i * step, j * step]
                if q >= 0:
                    if q == ring[p, along[way, 0]] or q == ring[p, along[way, 1]]:
                        break
                    length = _hidden_length(points, normals, skin, landmarks, p, q, covered > 0, max_width,
                                            max_unexpected, max_departure, slack, kin_slack, kin_stretch)  # fmt: skip
                    if length < np.inf:
                        pairs[count, 0], pairs[count, 1], lengths[count] = p, q, length
                        count += 1
                        break
                    if there > own - behind:
                        break
                elif hidden[i * step, j * step] and there < own + behind:
                    covered += equipment[i * step, j * step]
                else:
                    bare += 1
                    if bare > 2 * margin or there > own + behind:
                        break
    return pairs[:count].copy(), lengths[:count].copy()


@njit(cache=True)
def _hidden_length(
    points: np.ndarray, normals: np.ndarray, skin: np.ndarray, landmarks: np.ndarray, p: int, q: int, covered: bool,
    max_width: float, max_unexpected: float, max_departure: float, slack: float, kin_slack: float, kin_stretch: float,
) -> float:  # fmt: skip
    """How far it is from p to q over skin that is not seen, inf where the two do not belong together."""
    width2, from_p, from_q, turn = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        gap = np.float64(points[q, axis]) - np.float64(points[p, axis])
        width2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
        turn += normals[p, axis] * normals[q, axis]
    width = np.sqrt(width2)
    if skin[p] >= 0 and skin[q] >= 0:
        way = way_over_skin(landmarks, skin[p], skin[q])
        return max(width, 0.95 * way - 0.02) if width <= max_width and way <= kin_slack + kin_stretch * width else np.inf
    allowed = slack + max_departure * width
    plane = turn > 0.0 and abs(from_p) <= allowed and abs(from_q) <= allowed
    return width if covered and width <= max_unexpected and plane else np.inf
