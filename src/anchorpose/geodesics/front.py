"""The front of fast marching, in rounds: all nodes within a narrow band offer their distance to their rings at once.

A heap fixes one node after the other, and nothing in that order can be computed side by side. Here every node that
fell below the round's threshold makes its offers, eight abreast in the processor's vector registers; whoever gets
nearer by an offer waits for a later round, again if it had its turn before. The band is narrower than an edge, so that
hardly 2 nodes in 100 have a second turn. Within a round nobody sees another's new distance, which makes the result
independent of the order of the nodes.
Sources: the offers of Kimmel and Sethian 1998 (doi:10.1073/pnas.95.15.8431) with the point source of Novotni and Klein
2002; the rounds after Kim 2001 (doi:10.1137/S1064827500367130).

What a marching front needs to know of a node's ring: eight edges and sixteen triangles, eight abreast.

Lanes: the ring places E N W S NE NW SW SE, the four sides of the grid first, because every triangle through which a
node offers a distance has its third corner on such a side: to NE it is the triangle with E or with N, to E the one with
N or with S, whose right angle is at the node. So each lane has a triangle to its left, counter-clockwise, and one to
its right.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

LANES = 8
PLACE = np.array([0, 2, 4, 6, 1, 3, 5, 7])  # ring place of each lane
LEFT = np.array([1, 2, 3, 0, 1, 2, 3, 0])  # lane of the side that the triangle to the left stands on
RIGHT = np.array([3, 0, 1, 2, 0, 1, 2, 3])
EDGE2, DOT_LEFT, DOT_RIGHT, FAN = 0, 8, 16, 24  # columns of a fan: squared edges, dot products with the sides; width

AWAY = np.float32(1e6)  # metres; farther than anything, yet its square is a float32
SMALLEST = np.float32(1e-12)  # square metres; nodes that coincide are a micrometre apart, or they would divide by zero


@njit(cache=True, error_model="numpy")
def lay_fan(
    points: np.ndarray, ring: np.ndarray, node: int, near: np.ndarray, fan: np.ndarray, edge: np.ndarray
) -> bool:
    """Fill in the neighbours and edges of one node; whether the surface ends at it.

    points (n, 3) float32; ring (n, 8) int32. near (n, 8) uint32 gets the neighbour in each lane, n where there is none;
    fan (n, 24) float32 the columns above. A triangle exists when all its three edges do: the dot product of any other
    is NaN, which no comparison lets pass. A missing neighbour is ``AWAY``.
    """
    nobody = len(points)
    rim = False
    for lane in range(LANES):
        other = ring[node, PLACE[lane]]
        near[node, lane] = nobody if other < 0 else other
        rim |= other < 0
        for axis in range(3):
            edge[lane, axis] = points[max(other, 0), axis] - points[node, axis]
        length2 = edge[lane, 0] * edge[lane, 0] + edge[lane, 1] * edge[lane, 1] + edge[lane, 2] * edge[lane, 2]
        fan[node, EDGE2 + lane] = AWAY * AWAY if other < 0 else max(length2, SMALLEST)
    for lane in range(LANES):
        other, place = ring[node, PLACE[lane]], PLACE[lane]
        left, right = LEFT[lane], RIGHT[lane]
        dot_left = edge[lane, 0] * edge[left, 0] + edge[lane, 1] * edge[left, 1] + edge[lane, 2] * edge[left, 2]
        dot_right = edge[lane, 0] * edge[right, 0] + edge[lane, 1] * edge[right, 1] + edge[lane, 2] * edge[right, 2]
        whole_left = other >= 0 and ring[other, (place + 3) & 7] == ring[node, PLACE[left]]
        whole_right = other >= 0 and ring[other, (place + 5) & 7] == ring[node, PLACE[right]]
        fan[node, DOT_LEFT + lane] = dot_left if whole_left else np.nan
        fan[node, DOT_RIGHT + lane] = dot_right if whole_right else np.nan
    return rim


# columns of a desk, on which a round's nodes are worked out one row each: the fan; the sides' edges, distances and
# bends, those to the right from two before the end of those to the left; the ring's; the answers; the node's own
SIDE2_LEFT, SIDE2_RIGHT, SIDE_LEFT, SIDE_RIGHT, BEND_LEFT, BEND_RIGHT = 24, 30, 38, 44, 52, 58
BEFORE, OFFER, OFFER_BEND, OWN, OWN_BEND, OWN_RIM, TAKERS, DESK = 66, 74, 82, 90, 91, 92, 93, 96
WIDE = 4  # columns that are copied as one number

ZERO: Any
ONE: Any
TWO: Any
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)  # a literal would make everything float64

FULL_TURN = np.float32(1.0 / (1.0 - np.cos(np.radians(4.0))))
"""Over how sharp a turn at the surface's rim the front starts anew there: one that pixels do not make by chance."""

_BITS = (np.arange(256)[:, None] >> np.arange(LANES)) & 1
TAKER = np.argsort(1 - _BITS, axis=1, kind="stable").astype(np.uint8)  # (256, 8): the lanes whose bits are set, first
TAKEN = _BITS.sum(axis=1).astype(np.uint8)  # (256,): how many
FUSED = {"contract", "nsz", "arcp"}  # fused and reordered products, but NaN stays NaN


@njit(cache=True)
def march_on(
    points: np.ndarray,
    ring: np.ndarray,
    link_start: np.ndarray,
    link_node: np.ndarray,
    link_length: np.ndarray,
    fans: tuple,
    state: tuple,
    work: tuple,
    reach: Any,
    band: float,
    field: np.ndarray,
    level: float,
) -> bool:
    """March until every node within ``reach`` has its distance, or one among them has ``field`` of ``level`` or more.

    fans: near (n, 8) uint32, fan (n, 24) float32, rim (n,) uint8, 2 where not laid yet, and scratch, of ``lay_fan``.
    state: distance (n + 1,) float32, ``AWAY`` but at the sources; bend (n + 1,) float32, the distance at which the
    front last turned around the surface's rim; queued (n + 1,) uint8, 1 for the sources; waiting (n + 9,) uint32, the
    sources first; size (1,), their number. work: turn (n,) uint32, desk (n, 96) float32, the same flat,
    and desk and fan as complex numbers (n, 24) and (n, 6), of which each is four columns that are copied at once.
    Returns whether such a node was met; a source never is. A field of no length is none.
    """
    distance, bend, queued, waiting, size = state
    near, fan, rim, edge = fans
    turn, desk, flat, wide_desk, wide_fan = work
    while size[0] > 0:
        count, low = _take_turn(distance, queued, waiting, size, turn, band)
        if low > reach:
            break
        if len(field) > 0 and _meets(field, level, distance, reach, turn, count):
            return True
        _lay_fans(points, ring, turn, count, near, fan, rim, edge)
        _set_desk(near, fan, rim, distance, bend, turn, count, desk, wide_desk, wide_fan)
        _work_out(flat, count)
        _settle(near, turn, count, desk, distance, bend, queued, waiting, size)
        if len(link_node) > 0:
            _follow_links(link_start, link_node, link_length, turn, count, desk, distance, bend, queued, waiting, size)
    return False


@njit(cache=True)
def _take_turn(
    distance: np.ndarray, queued: np.ndarray, waiting: np.ndarray, size: np.ndarray, turn: np.ndarray, band: float
) -> tuple:
    """Move the nodes within the band above the nearest from waiting to turn; their number, and the nearest distance."""
    low, waits = AWAY, size[0]
    for k in range(waits):
        own = distance[waiting[k]]
        low = own if own < low else low
    threshold = low + np.float32(band)
    count, left = np.int64(0), np.int64(0)
    for k in range(waits):
        node = waiting[k]
        now = np.uint8(distance[node] <= threshold)
        turn[count] = node
        waiting[left] = node
        count += np.int64(now)
        left += 1 - np.int64(now)
        queued[node] = 1 - now
    size[0] = left
    return count, low


@njit(cache=True)
def _meets(field: np.ndarray, level: float, distance: np.ndarray, reach: float, turn: np.ndarray, count: int) -> bool:
    met = False
    for k in range(count):
        met |= field[turn[k]] >= level and 0.0 < distance[turn[k]] < reach
    return met


@njit(cache=True)
def _lay_fans(
    points: np.ndarray, ring: np.ndarray, turn: np.ndarray, count: int, near: np.ndarray, fan: np.ndarray,
    rim: np.ndarray, edge: np.ndarray,
) -> None:  # fmt: skip
    """Those of this round's nodes that no earlier field laid: a march that stops early pays for what it touches."""
    for k in range(count):
        node = turn[k]
        if rim[node] == 2:
            rim[node] = lay_fan(points, ring, node, near, fan, edge)


@njit(cache=True)
def _set_desk(
    near: np.ndarray, fan: np.ndarray, rim: np.ndarray, distance: np.ndarray, bend: np.ndarray, turn: np.ndarray,
    count: int, desk: np.ndarray, wide_desk: np.ndarray, wide_fan: np.ndarray,
) -> None:  # fmt: skip
    """Copy together what this round's nodes need. Before anybody's distance changes."""
    for k in range(count):
        node = turn[k]
        for part in range(FAN // WIDE):
            wide_desk[k, part] = wide_fan[node, part]
        e, n, w, s = near[node, 0], near[node, 1], near[node, 2], near[node, 3]
        _deal(desk, k, SIDE2_LEFT, fan[node, 0], fan[node, 1], fan[node, 2], fan[node, 3])
        _deal(desk, k, SIDE_LEFT, distance[e], distance[n], distance[w], distance[s])
        for lane in range(LANES):
            desk[k, BEFORE + lane] = distance[near[node, lane]]
        _deal(desk, k, BEND_LEFT, bend[e], bend[n], bend[w], bend[s])
        desk[k, OWN], desk[k, OWN_BEND], desk[k, OWN_RIM] = distance[node], bend[node], rim[node]


@njit(cache=True)
def _deal(desk: np.ndarray, k: int, at: int, e: float, n: float, w: float, s: float) -> None:
    """The four sides' values to the lanes whose triangles stand on them: ``LEFT``, from the seventh on ``RIGHT``."""
    desk[k, at], desk[k, at + 1], desk[k, at + 2], desk[k, at + 3] = n, w, s, e
    desk[k, at + 4], desk[k, at + 5], desk[k, at + 6], desk[k, at + 7] = n, w, s, e
    desk[k, at + 8], desk[k, at + 9], desk[k, at + 10], desk[k, at + 11] = n, w, e, n
    desk[k, at + 12], desk[k, at + 13] = w, s


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def _through(
    own: float, own_bend: float, arm2: float, arm: float, side: float, side_bend: float, side2: float, dot: float
) -> tuple:
    """Offer through one triangle; the bend that goes with it; how much the way turns at the node if it cannot.

    The triangle is laid flat, the node at the origin and the side at (c, 0): the point from which the front seems to
    come is (x, -y), with ``towards`` = 2 c x and ``beside`` = 2 c y; the neighbour's height over the edge times c is
    ``area``. A front that turned around the rim comes from there, so ``own_bend`` is taken off the distances and put
    back on. ``AWAY`` where the straight line misses the edge between node and side.
    """
    since = min(own_bend, side_bend)
    radius = own - since
    area = np.sqrt(max(arm2 * side2 - dot * dot, ZERO))
    towards = (own - side) * (own + side - TWO * since) + side2
    beside = np.sqrt(max(TWO * TWO * side2 * radius * radius - towards * towards, ZERO))
    gain = (area * beside - dot * towards) / side2
    straight = since + np.sqrt(max(radius * radius + (arm2 + gain), ZERO))
    crossing, width = towards * area + dot * beside, side2 * (beside + TWO * area)
    known = (side < AWAY) & (dot == dot)  # NaN: no triangle
    hits = known & (crossing >= ZERO) & (crossing <= width)
    turn = (ONE - gain / (TWO * radius * arm + SMALLEST)) * FULL_TURN
    offer = straight if hits else AWAY
    return offer, own_bend + (side_bend - own_bend) * (crossing / width), turn if known else ONE


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def _work_out(desk: np.ndarray, count: int) -> None:
    """Each row's offers; the inner loop has no branch and one array, so that it becomes vector instructions."""
    for k in range(count):
        row = k * DESK
        own, own_bend, rim = desk[row + OWN], desk[row + OWN_BEND], desk[row + OWN_RIM]
        takers = np.int32(0)
        for lane in range(LANES):
            at = row + lane
            arm2 = desk[at + EDGE2]
            arm = np.sqrt(arm2)
            left, left_bend, left_turn = _through(
                own, own_bend, arm2, arm, desk[at + SIDE_LEFT], desk[at + BEND_LEFT], desk[at + SIDE2_LEFT],
                desk[at + DOT_LEFT],
            )  # fmt: skip
            right, right_bend, right_turn = _through(
                own, own_bend, arm2, arm, desk[at + SIDE_RIGHT], desk[at + BEND_RIGHT], desk[at + SIDE2_RIGHT],
                desk[at + DOT_RIGHT],
            )  # fmt: skip
            turn = max(min(left_turn, right_turn, ONE), ZERO)
            offer, turned = own + arm, own_bend + (own - own_bend) * turn * rim
            turned = left_bend if left < offer else turned
            offer = min(offer, left)
            turned = right_bend if right < offer else turned
            offer = min(offer, right)
            desk[at + OFFER], desk[at + OFFER_BEND] = offer, turned
            takers += np.int32(offer <= desk[at + BEFORE]) << np.int32(lane)
        desk[row + TAKERS] = takers


@njit(cache=True)
def _settle(
    near: np.ndarray, turn: np.ndarray, count: int, desk: np.ndarray, distance: np.ndarray, bend: np.ndarray,
    queued: np.ndarray, waiting: np.ndarray, size: np.ndarray,
) -> None:  # fmt: skip
    """Hand the offers to the rings; whoever gets nearer waits. No branches: every second would be guessed wrong."""
    end = size[0]
    for k in range(count):
        takers = np.int64(desk[k, TAKERS])
        for spot in range(TAKEN[takers]):
            lane = TAKER[takers, spot]
            other = near[turn[k], lane]
            offer, turned = desk[k, OFFER + lane], desk[k, OFFER_BEND + lane]
            before, before_bend, waits = distance[other], bend[other], queued[other]
            nearer = np.uint8(offer < before) | (np.uint8(offer == before) & np.uint8(turned < before_bend))
            distance[other] = min(offer, before)
            bend[other] = turned if nearer else before_bend
            waiting[end] = other
            end += np.int64(nearer & (waits ^ np.uint8(1)))
            queued[other] = waits | nearer
    size[0] = end


@njit(cache=True)
def _follow_links(
    link_start: np.ndarray, link_node: np.ndarray, link_length: np.ndarray, turn: np.ndarray, count: int,
    desk: np.ndarray,
    distance: np.ndarray, bend: np.ndarray, queued: np.ndarray, waiting: np.ndarray, size: np.ndarray,
) -> None:  # fmt: skip
    """Along a link the way is the link's own length."""
    for k in range(count):
        node, own, turned = turn[k], desk[k, OWN], desk[k, OWN_BEND]
        for spot in range(link_start[node], link_start[node + 1]):
            other = link_node[spot]
            offer = own + link_length[spot]
            if offer < distance[other] or (offer == distance[other] and turned < bend[other]):
                distance[other], bend[other] = offer, turned
                if not queued[other]:
                    queued[other] = 1
                    waiting[size[0]] = other
                    size[0] += 1
