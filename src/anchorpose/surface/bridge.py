"""Links across equipment: a bar in front of the shins hides a strip of leg, it does not cut the leg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeConfig:
    """How wide a hidden strip may be crossed, and when both sides belong together."""

    max_width_m: float = 0.15  # a padded knee rest with its shadow; beyond it the leg's bend is anyone's guess
    max_departure: float = 0.35  # from either tangent plane, over the width: a shin bends less, two legs far more
    slack_m: float = 0.015  # soft tissue and noise beside a narrow bar
    margin_px: int = 4  # readings lost or removed beside the bar

    def __post_init__(self) -> None:
        for name in ("max_width_m", "max_departure", "slack_m"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.margin_px < 0:
            raise ValueError(f"margin_px must not be negative, got {self.margin_px}")


def bridge_pairs(
    index: np.ndarray,
    hidden: np.ndarray,
    points_m: np.ndarray,
    normals: np.ndarray,
    step: int,
    spacing_m: float,
    config: BridgeConfig,
) -> np.ndarray:
    """Pairs of nodes that face each other across hidden pixels, along rows, columns and diagonals.

    index (rows, cols) int32: node on the grid of every ``step``-th pixel, -1 = none; hidden (height, width) bool:
    pixels where equipment stands before whatever is behind; points_m, normals (n, 3) float32, one frame.
    spacing_m: the smallest distance of two grid neighbours, which bounds the length of the walk.
    Returns (m, 2) int32.
    """
    longest = int(np.ceil(config.max_width_m / max(spacing_m, 1e-4))) + 1
    return _facing_pairs(
        index,
        hidden,
        points_m,
        normals,
        step,
        longest,
        -(-config.margin_px // step),
        np.float64(config.max_width_m),
        np.float64(config.max_departure),
        np.float64(config.slack_m),
    )


@njit(cache=True)
def _facing_pairs(
    index: np.ndarray,
    hidden: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    step: int,
    longest: int,
    margin: int,
    max_width: float,
    max_departure: float,
    slack: float,
) -> np.ndarray:
    rows, cols = index.shape
    pairs = np.empty((4 * len(points), 2), np.int32)
    count = 0
    for way in range(4):
        down, right = (0, 1, 1, 1)[way], (1, 0, 1, -1)[way]
        for row in range(rows):
            for col in range(cols):
                node = index[row, col]
                if node < 0:
                    continue
                covered, bare = 0, 0
                for walk in range(1, longest + 2 * margin + 1):
                    i, j = row + walk * down, col + walk * right
                    if i >= rows or j < 0 or j >= cols:
                        break
                    other = index[i, j]
                    if other >= 0:
                        if covered > 0 and _belong(points, normals, node, other, max_width, max_departure, slack):
                            pairs[count, 0], pairs[count, 1] = node, other
                            count += 1
                        break
                    if hidden[i * step, j * step]:
                        covered += 1
                    else:
                        bare += 1
                        if bare > 2 * margin:
                            break
    return pairs[:count].copy()


@njit(cache=True)
def _belong(
    points: np.ndarray, normals: np.ndarray, p: int, q: int, max_width: float, max_departure: float, slack: float
) -> bool:
    width2, from_p, from_q, turn = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        gap = np.float64(points[q, axis]) - np.float64(points[p, axis])
        width2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
        turn += normals[p, axis] * normals[q, axis]
    width = np.sqrt(width2)
    allowed = slack + max_departure * width
    return width <= max_width and turn > 0.0 and abs(from_p) <= allowed and abs(from_q) <= allowed
