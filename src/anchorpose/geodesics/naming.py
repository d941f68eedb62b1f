"""Which extremum is the head, which the hands and feet: by the body's proportions, by its paths, by the prediction.

Three kinds of evidence vote. Where the extremum is: how far from the centre, how high above the middle of the body and
how far to its left. How its path to the centre runs: where it enters the trunk, and how far it is from the head along
the paths; both hold in any pose. And how near it is to where the anchor is expected; this vote is bounded, so that it
decides where the others cannot, and yet a wrong prediction does not prove itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.geodesics.center import CenterField
from anchorpose.geodesics.extrema import Cap, seen_mean
from anchorpose.geodesics.limb_paths import limb_path
from anchorpose.surface.surface import Surface

HEAD: Final = 0
LIMBS: Final = 4  # hands and feet, after it

PLACES: Final = np.array(
    # from the centre along the surface; above the middle, to its left; the same of where the path enters the trunk
    [
        [0.42, 0.38, 0.00, 0.19, 0.00],
        [0.55, 0.05, 0.22, 0.15, 0.09],
        [0.55, 0.05, -0.22, 0.15, -0.09],
        [0.64, -0.52, 0.07, -0.16, 0.05],
        [0.64, -0.52, -0.07, -0.16, -0.05],
    ]
)
"""Where the anchors of a person are, over the body height: medians of simulated people (order of ``ANCHOR_NAMES``)."""

TOLERANCES: Final = np.array(
    [
        [0.10, 0.10, 0.12, 0.08, 0.06],
        [0.12, 0.27, 0.20, 0.08, 0.06],
        [0.12, 0.27, 0.20, 0.08, 0.06],
        [0.12, 0.12, 0.12, 0.10, 0.06],
        [0.12, 0.12, 0.12, 0.10, 0.06],
    ]
)
"""By how much those vary: arms move a lot, head and feet hardly."""

FROM_HEAD: Final = np.array([0.47, 0.47, 0.92, 0.92])
"""How far hands and feet are from the head along their paths, over the body height; 0.25 for a hand above the head."""

FROM_HEAD_TOLERANCE: Final = 0.20
# Costs, in tolerances
MISSED: Final = 4.0  # of an anchor that no extremum is: what would cost more is missed
PREDICTION: Final = 1.5  # added at most where the anchor is not at its predicted place
UNPREDICTED: Final = 1.0  # added where nothing is predicted, so that an anchor is at most 3 tolerances off
AT_PREDICTION: Final = 3.5  # the most at the predicted place, so that an end there is the anchor in any pose
CLEAR: Final = 2.0  # farther off than so, nothing is named in spite of its prediction
FARTHEST_OFF: Final = 3.0  # tolerances; what is farther off, one crossed arm or one wrong path, weighs no more
HEADLESS: Final = 1.5  # tolerances: added for hands and feet where no head is found to measure from
ENTRY: Final = 0.20  # of the height, from the centre: shoulders, neck and groin; there a path enters the trunk
STEP: Final = 0.05  # of the height, between the places of a path that are compared


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The axes and the length that places are measured by: up, left (3,) unit, world; height_m the subject's."""

    up: np.ndarray
    left: np.ndarray
    height_m: float


def place_costs(surface: Surface, field: CenterField, caps: list[Cap], frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """How many tolerances each extremum is off from each anchor's usual place, and how far it is from each other one.

    Returns squared tolerances (k, 5), the sum over five measures of which each is bounded, and distances (k, k) over
    the body height along the paths to the centre and across the trunk between them.
    """
    middle, height = seen_mean(surface), frame.height_m
    reach = np.array([cap.reach_m for cap in caps])
    nodes = _path_nodes(surface, field, [cap.tip for cap in caps], STEP * height, float(reach.max()))
    points = surface.points_m[nodes].astype(np.float64)
    entry = points[:, round(ENTRY / STEP)] - middle
    place = np.array([cap.center_m for cap in caps]) - middle
    seen = np.stack([reach, place @ frame.up, place @ frame.left, entry @ frame.up, entry @ frame.left], axis=1)
    off = (seen[:, None] / height - PLACES) / TOLERANCES
    return np.minimum(off**2, FARTHEST_OFF**2).sum(axis=2), _apart(points, field.distance_m[nodes], reach) / height


def _path_nodes(surface: Surface, field: CenterField, tips: list[int], step_m: float, reach_m: float) -> np.ndarray:
    """(k, l) int: the nodes of each extremum's path at every step from the centre; the extremum itself beyond it."""
    levels = (step_m * np.arange(max(reach_m / step_m, ENTRY / STEP + 1.0))).astype(np.float32)
    nodes = np.empty((len(tips), len(levels)), np.int64)
    for row, tip in enumerate(tips):
        path = limb_path(surface, field, tip)[::-1]
        nodes[row] = path[np.minimum(np.searchsorted(field.distance_m[path], levels), len(path) - 1)]
    return nodes


def _apart(points_m: np.ndarray, from_center_m: np.ndarray, reach_m: np.ndarray) -> np.ndarray:
    """(k, k): how far extrema are apart over any two places (k, l, 3) of their paths and straight between these."""
    left_m = reach_m[:, None] - from_center_m
    straight = np.linalg.norm(points_m[:, None, :, None] - points_m[None, :, None, :], axis=4)
    apart: np.ndarray = (left_m[:, None, :, None] + left_m[None, :, None, :] + straight).min(axis=(2, 3))
    return apart


def name_extrema(off2: np.ndarray, apart: np.ndarray, away: np.ndarray, excluded: np.ndarray) -> np.ndarray:
    """(5,) int: the extremum that each anchor is, -1 where it is missed; the least total cost over all five.

    off2 (k, 5), apart (k, k): of ``place_costs``. away (k, 5): distance from the anchor's prediction in gates, NaN
    where nothing is predicted. excluded (k, 5) bool: what cannot be that anchor. An anchor costs the root of its
    squared tolerances, for hands and feet with that of the distance from the head, plus at most ``PREDICTION`` for the
    prediction; a missed one costs ``MISSED``. What is not at its predicted place is named only where it is clear: few
    tolerances off, and more off from every other name. Every extremum is tried as the head, and none.
    """
    best, least = np.full(1 + LIMBS, -1), np.inf
    for head in range(-1, len(off2)):
        squares = off2.copy()
        squares[:, HEAD + 1 :] += HEADLESS**2 if head < 0 else _off_head2(apart[head])
        cost = np.where(excluded, np.inf, _with_prediction(np.sqrt(squares), away))
        first = cost[head, HEAD] if head >= 0 else MISSED
        if head >= 0:
            cost[head] = np.inf
        limbs = _assign(cost[:, HEAD + 1 :])
        total = first + sum(MISSED if row < 0 else cost[row, HEAD + 1 + name] for name, row in enumerate(limbs))
        if first <= MISSED and total < least:
            best, least = np.array([head, *limbs]), total
    return best


def _with_prediction(off: np.ndarray, away: np.ndarray) -> np.ndarray:
    """(k, 5): the cost of being so many tolerances (k, 5) and gates (k, 5) off."""
    cost = off + np.where(np.isnan(away), UNPREDICTED, PREDICTION * np.minimum(away, 1.0))
    cost = np.where(away < 1.0, np.minimum(cost, AT_PREDICTION), cost)
    unclear = (off > CLEAR) | (off > off.min(axis=1, keepdims=True))
    return np.where((away >= 1.0) & unclear, np.inf, cost)


def _off_head2(apart: np.ndarray) -> np.ndarray:
    """(k, 4) squared tolerances of the distance (k,) from the head."""
    off: np.ndarray = np.minimum(((apart[:, None] - FROM_HEAD) / FROM_HEAD_TOLERANCE) ** 2, FARTHEST_OFF**2)
    return off


def _assign(cost: np.ndarray) -> np.ndarray:
    """(m,) int: row of cost (k, m) that each column takes, -1 = none, at the least total; no pair above ``MISSED``."""
    bounded = np.minimum(cost, MISSED)
    chosen = np.full(cost.shape[1], -1)
    for row, column in zip(*linear_sum_assignment(bounded), strict=True):
        if bounded[row, column] < MISSED:
            chosen[column] = row
    return chosen
