"""Find and name the anchors: head, hands and feet as extrema of the geodesic distance from the body's centre (paper,
Definition 2, Section IV-B). An extremum is a node farther from the centre, along the surface, than all nodes around it.

Three kinds of evidence decide which anchor (which body part) an extremum is. (1) Its place: the distance from the
centre, the height above the body's middle, and the distance to the left of the middle. (2) Its path to the centre:
where the path enters the trunk, and the distance from the head along the paths; both are valid in any pose. (3) Its
distance from the place that tracking predicts for the anchor. Each kind of evidence adds to the cost of giving an
anchor's name to an extremum. The cost of the third kind is bounded, so the prediction decides only if place and path
leave open which anchor the extremum is. A wrong prediction therefore does not confirm itself.

The module also computes the anchor descriptor f (paper, Definition 3): every node's geodesic distance to every anchor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.geodesics.center import CenterField, center_field, limb_path
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import Cap, find_caps, geodesic_extrema, seen_mean
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.settings import Positive, settings
from anchorpose.surface.surface import Surface

HEAD: Final = 0  # index of the head among the anchors
LIMBS: Final = 4  # number of hands and feet, which follow the head

PLACES: Final = np.array(
    # the five columns of ``PLACES``: distance of the extremum from the centre along the surface; height of the extremum
    # above the body's middle, and its distance to the left of the middle; height and distance to the left of the place
    # where the path from the extremum to the centre enters the trunk
    [
        [0.42, 0.38, 0.00, 0.19, 0.00],
        [0.55, 0.05, 0.22, 0.15, 0.09],
        [0.55, 0.05, -0.22, 0.15, -0.09],
        [0.64, -0.52, 0.07, -0.16, 0.05],
        [0.64, -0.52, -0.07, -0.16, -0.05],
    ]
)
"""Usual places of the anchors, in body heights: medians of simulated people, in the order ``ANCHOR_NAMES``."""

TOLERANCES: Final = np.array(
    [
        [0.10, 0.10, 0.12, 0.08, 0.06],
        [0.12, 0.27, 0.20, 0.08, 0.06],
        [0.12, 0.27, 0.20, 0.08, 0.06],
        [0.12, 0.12, 0.12, 0.10, 0.06],
        [0.12, 0.12, 0.12, 0.10, 0.06],
    ]
)
"""Usual spread (tolerance) of each value in ``PLACES``, divided by the body height: large for arms, which move a lot,
small for head and feet.
"""

FROM_HEAD: Final = np.array([0.47, 0.47, 0.92, 0.92])
"""Usual distances of hands and feet from the head along their paths, in body heights, in the order of ``ANCHOR_NAMES``;
a hand raised above the head has 0.25.
"""

FROM_HEAD_TOLERANCE: Final = 0.20  # spread of each distance in ``FROM_HEAD``, divided by the body height
# tolerances (the unit of all costs: 1 is the usual spread of a value, as in ``TOLERANCES``), cost of an anchor that is
# not found; if every extremum costs more than this, the anchor is missed
MISSED: Final = 4.0
PREDICTION: Final = 1.5  # tolerances, maximum cost added for an extremum's distance from the anchor's predicted place
# tolerances, cost added if an anchor has no predicted place; an extremum may then differ from the anchor's usual place
# by up to 3 tolerances before its cost reaches ``MISSED``
UNPREDICTED: Final = 1.0
# tolerances, maximum cost of an extremum near an anchor's predicted place (within ``AnchorConfig.gate``, for the head
# ``HEAD_GATE``); it is less than ``MISSED``, so that such an extremum can be the anchor in any pose
AT_PREDICTION: Final = 3.5
# tolerances, maximum difference from an anchor's usual place (``PLACES`` and, for hands and feet, ``FROM_HEAD``) at
# which an extremum can get the anchor's name although it is farther from the anchor's predicted place than
# ``AnchorConfig.gate`` (``HEAD_GATE`` for the head)
CLEAR: Final = 2.0
# tolerances, maximum difference from a usual value that is counted; larger differences are reduced to it, since a
# single value may be far off if an arm is crossed over the body or a path is wrong
FARTHEST_OFF: Final = 3.0
# tolerances, cost added for hands and feet if no head is found, in place of the cost of their distances from the head
HEADLESS: Final = 1.5
# distance from the body's centre along the surface, divided by the body height, at which the path from an extremum is
# assumed to enter the trunk
ENTRY: Final = 0.20
# distance along a path, divided by the body height, between the places that are compared with the places of other paths
STEP: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The patient's upward and leftward directions and height; places on the surface are measured along these
    directions, as fractions of this height.
    """

    up: np.ndarray  # (3,) unit vector, world
    left: np.ndarray  # (3,) unit vector, world
    height_m: float  # the subject's height


def place_costs(surface: Surface, field: CenterField, caps: list[Cap], frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return how much the place of each extremum differs from the usual place of each anchor, and the distances between
    the extrema. An extremum is the tip (the farthest node) of a cap in ``caps``.

    The first result is (k, 5), with one row per extremum and one column per anchor, in squared tolerances. It compares
    five values of an extremum, such as its height above the body's middle, with their usual values at an anchor, a row
    of ``PLACES``: the differences, each limited to ``FARTHEST_OFF`` tolerances, are squared and summed. The second
    result is (k, k): the distances between the extrema, in body heights. A distance between two extrema runs from the
    first extremum along its path towards the centre, straight across the trunk, and along the path of the second
    extremum to this extremum.
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
    """Return (k, l) int: for each extremum, the nodes of its path at the distances 0, ``step_m``, 2 ``step_m`` and so
    on from the centre. Where the path is shorter, its end, the extremum, is repeated.
    """
    levels = (step_m * np.arange(max(reach_m / step_m, ENTRY / STEP + 1.0))).astype(np.float32)
    nodes = np.empty((len(tips), len(levels)), np.int64)
    for row, tip in enumerate(tips):
        path = limb_path(surface, field, tip)[::-1]
        nodes[row] = path[np.minimum(np.searchsorted(field.distance_m[path], levels), len(path) - 1)]
    return nodes


def _apart(points_m: np.ndarray, from_center_m: np.ndarray, reach_m: np.ndarray) -> np.ndarray:
    """Return the distance (k, k) between extrema: the least length of a way along the path of one extremum, straight
    from a place on this path to a place on the path of the other extremum, and along the other path. points_m (k, l,
    3): l places on the path of each extremum; from_center_m (k, l): their distances from the centre; reach_m (k,): the
    distances of the extrema.
    """
    left_m = reach_m[:, None] - from_center_m
    straight = np.linalg.norm(points_m[:, None, :, None] - points_m[None, :, None, :], axis=4)
    apart: np.ndarray = (left_m[:, None, :, None] + left_m[None, :, None, :] + straight).min(axis=(2, 3))
    return apart


def name_extrema(off2: np.ndarray, apart: np.ndarray, away: np.ndarray, excluded: np.ndarray) -> np.ndarray:
    """Return (5,) int: the number of the extremum that is assigned to each anchor, -1 if the anchor is missed. The
    assignment has the least total cost of all five anchors.

    off2 (k, 5): squared difference of each extremum from each anchor's usual place; apart (k, k): distances between the
    extrema; both are from ``place_costs``. away (k, 5): distance of each extremum from the anchor's predicted place,
    divided by the gate (the distance within which the prediction supports the name); NaN without a prediction. excluded
    (k, 5) bool: extrema that cannot be the anchor. The cost of an extremum as an anchor is its difference from the
    anchor's usual place, plus at most ``PREDICTION`` for the distance from the predicted place. The difference is the
    square root of the value in ``off2``; for hands and feet, the value of ``_off_head2`` is added under the root. A
    missed anchor costs ``MISSED``. If an extremum is farther than the gate from an anchor's predicted place, it gets
    the anchor's name only if this name is clear: the difference from the anchor's usual place is at most ``CLEAR``, and
    the extremum is not closer to the usual place of another anchor. The costs of hands and feet depend on which
    extremum is the head. So an assignment is computed for each extremum as the head, and for a missing head; the
    assignment with the least cost is returned.
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
    """Return the cost (k, 5) of each extremum as each anchor, from its distances from the usual place and from the
    predicted place; inf if the extremum is beyond the gate and the anchor's name is not clear (``name_extrema``). off
    (k, 5): distance from the usual place, in tolerances; away (k, 5): distance from the predicted place, in units of
    the gate.
    """
    cost = off + np.where(np.isnan(away), UNPREDICTED, PREDICTION * np.minimum(away, 1.0))
    cost = np.where(away < 1.0, np.minimum(cost, AT_PREDICTION), cost)
    unclear = (off > CLEAR) | (off > off.min(axis=1, keepdims=True))
    return np.where((away >= 1.0) & unclear, np.inf, cost)


def _off_head2(apart: np.ndarray) -> np.ndarray:
    """Return (k, 4) squared tolerances: how much each extremum's distance from the head, ``apart`` (k,), differs from
    the usual distance (``FROM_HEAD``) of each hand and foot.
    """
    off: np.ndarray = np.minimum(((apart[:, None] - FROM_HEAD) / FROM_HEAD_TOLERANCE) ** 2, FARTHEST_OFF**2)
    return off


def _assign(cost: np.ndarray) -> np.ndarray:
    """Return (m,) int: for each column (anchor) of ``cost`` (k, m), the row (extremum) that is assigned to it, -1 =
    none, so that the total cost is least. A row and a column are not paired if this costs ``MISSED`` or more.
    """
    bounded = np.minimum(cost, MISSED)
    chosen = np.full(cost.shape[1], -1)
    for row, column in zip(*linear_sum_assignment(bounded), strict=True):
        if bounded[row, column] < MISSED:
            chosen[column] = row
    return chosen


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """The five anchors (head, hands, feet) of a surface. An anchor that was not found is marked as missed, and its
    place is never guessed.
    """

    # (5,) int32, index into the surface, -1 = missed: the node nearest to the centre of the anchor's cap (the surface
    # around the extremum). The centre of a cap is steadier than the extremum: from frame to frame, distances of other
    # nodes from the node at the centre change half as much as their distances from the extremum.
    node: np.ndarray
    # (5, 3) float64 world, centre of the anchor's cap (the surface around the extremum); NaN if missed
    position_m: np.ndarray
    sigma_m: np.ndarray  # (5,) float64, standard deviation of the centre per axis; NaN if missed
    # caps of the extrema that got no anchor's name although a limb ends there (``_no_end_of_a_limb``); the cap of the
    # extremum farthest from the centre comes first
    free: tuple[Cap, ...] = ()

    @property
    def found(self) -> np.ndarray:
        """Return (5,) bool: anchors that were found."""
        return self.node >= 0


@settings
class AnchorConfig:
    """Settings for finding the anchors. Each length is divided by the subject's height (paper, Section VI)."""

    radius: Positive = 0.5 / 1.75  # r of Definition 2: 0.5 m on a person of 1.75 m
    # depth of an extremum's cap (the surface around it), measured from the tip towards the body's centre (6 cm, about a
    # fist)
    cap: Positive = 0.06 / 1.75
    # distance from an anchor's predicted place within which an extremum is accepted as this anchor in any pose; half
    # the length of forearm and hand
    gate: Positive = 0.25 / 1.75


# gate of the head: the distance from its predicted place, divided by the body height, within which an extremum is
# accepted as the head in any pose. This gate is smaller than the gate of a hand: a head moves less, and the neck of a
# hidden head, 20 cm away, must not be mistaken for the head
HEAD_GATE: Final = 0.18 / 1.75
# distance divided by the body height; an extremum within this distance of an anchor's predicted place can be the anchor
# even if an object cuts the surface off there, or if hidden skin continues beyond it
END_GATE: Final = 0.09 / 1.75


def find_anchors(
    surface: Surface,
    up: np.ndarray,
    facing: np.ndarray,
    height_m: float = 1.75,
    cut: np.ndarray | None = None,
    predicted_m: np.ndarray | None = None,
    config: AnchorConfig | None = None,
    missing: np.ndarray | None = None,
) -> Anchors:
    """Find the anchors: decide which extrema of the surface are the head, the hands and the feet. All other extrema get
    no name.

    up, facing (3,): unit vectors, world, against gravity and in the direction in which the patient faces; height_m: the
    subject's height. cut (n,) bool: nodes at a border where something else cuts the surface (``surface.border``); an
    extremum there is not an anchor, unless another camera sees that the limb really ends. predicted_m (5, 3) world: the
    predicted place of each anchor, NaN if unknown; None without predictions. missing (5,) bool: anchors of limbs that
    the patient lacks.

    The anchors' names are assigned to extrema so that the total cost is least (``name_extrema``). An anchor is missed
    if the cost of every extremum is too high. On a surface without seen nodes, all anchors are missed. The direction
    ``facing`` decides which side is left. If this direction is wrong by half a turn, left and right of all anchors are
    exchanged, and the result does not show this.
    """
    config = config or AnchorConfig()
    if surface.seen_count == 0:
        return no_anchors()
    center = center_field(surface)
    extrema = geodesic_extrema(surface, center.distance_m, config.radius * height_m)
    caps = find_caps(surface, center.distance_m, extrema, config.cap * height_m, cut)
    if not caps:
        return no_anchors()
    frame = Frame(up, np.cross(up, facing), height_m)
    no_end = _no_end_of_a_limb(surface, center, caps)
    away = _off_prediction(caps, predicted_m) / height_m
    # an extremum near its predicted place is not excluded: the rail that a hand holds cuts the surface off at the hand
    excluded = no_end & ~(away < END_GATE)
    excluded |= False if missing is None else missing
    away /= np.array([HEAD_GATE, *[config.gate] * LIMBS])
    chosen = name_extrema(*place_costs(surface, center, caps, frame), away, excluded)
    free = tuple(cap for number, cap in enumerate(caps) if number not in chosen and not no_end[number, -1])
    return _named(surface, caps, chosen, free)


def _off_prediction(caps: Sequence[Cap], predicted_m: np.ndarray | None) -> np.ndarray:
    """Return the distance (k, 5), in metres, from the centre of each cap (the surface around an extremum) to the
    predicted place of each anchor; NaN without a prediction.
    """
    if predicted_m is None:
        return np.full((len(caps), len(ANCHOR_NAMES)), np.nan)
    centers = np.array([cap.center_m for cap in caps])
    away: np.ndarray = np.linalg.norm(centers[:, None] - predicted_m[None], axis=2)
    return away


def anchor_descriptor(
    surface: Surface, anchors: Anchors, distance: Callable[[Surface, np.ndarray], np.ndarray] = geodesic_distance
) -> np.ndarray:
    """Return the geodesic distances (n, 5) float32, metres, from each node to each anchor (order ``ANCHOR_NAMES``).

    The column of a missed anchor is NaN; a distance is inf if the node's piece of surface is not connected to the
    anchor.
    """
    descriptor = np.full((len(surface), len(anchors.node)), np.nan, np.float32)
    descriptor[:, anchors.found] = distance(surface, anchors.node[anchors.found]).T
    return descriptor


def _named(surface: Surface, caps: Sequence[Cap], chosen: np.ndarray, free: tuple[Cap, ...]) -> Anchors:
    """Return the anchors at the chosen caps (a cap is the surface around an extremum). chosen (5,) int: for each
    anchor, the index of its cap in ``caps``, -1 = missed; free: the caps without a name, for ``Anchors``.
    """
    anchors = replace(no_anchors(), free=free)
    for name, number in enumerate(chosen):
        if number >= 0:
            anchors.node[name] = _nearest(surface, caps[number].nodes, caps[number].center_m)
            anchors.position_m[name] = caps[number].center_m
            anchors.sigma_m[name] = caps[number].sigma_m
    return anchors


def no_anchors() -> Anchors:
    """Return five missed anchors."""
    count = len(ANCHOR_NAMES)
    return Anchors(np.full(count, -1, np.int32), np.full((count, 3), np.nan), np.full(count, np.nan))


def _no_end_of_a_limb(surface: Surface, field: CenterField, caps: Sequence[Cap]) -> np.ndarray:
    """Return (k, 5) bool: True where a cap (the surface around an extremum) cannot be an anchor, since the limb does
    not end there.

    If the cap's connected piece of surface contains hidden (predicted) skin, this skin decides whether the limb
    continues beyond the cap, since it is more reliable than an edge in the depth frame. But hidden skin continues
    beyond every head, so it never prevents a cap from being the head.
    """
    hidden = np.unique(field.piece[surface.seen_count :])
    closed = np.isin(field.piece[[cap.tip for cap in caps]], hidden)
    wrong = np.where(closed, [cap.continues for cap in caps], [cap.stump for cap in caps])
    excluded = np.repeat(wrong[:, None], len(ANCHOR_NAMES), axis=1)
    excluded[closed, HEAD] = False
    return excluded


def _nearest(surface: Surface, nodes: np.ndarray, point_m: np.ndarray) -> int:
    return int(nodes[np.argmin(((surface.points_m[nodes] - point_m) ** 2).sum(axis=1))])


@dataclass(frozen=True, slots=True, eq=False)
class SeenAnchors:
    """The patient's surface in one frame, and the anchors that were found on it."""

    whole: Surface  # nodes that cameras saw, then nodes of hidden skin, inferred from the predicted body
    anchors: Anchors
