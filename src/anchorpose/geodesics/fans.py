"""Prepare the neighbourhood (fan) of each node, and compute the distances from the source that the node can pass on to
its neighbours. A node's fan is its ring of up to eight neighbours, with the edges and triangles between them.

The ring of a node is numbered counter-clockwise: places 0 to 7 are the neighbours E NE N NW W SW S SE. Its eight edges
and sixteen triangles are computed in parallel, one neighbour per lane of the processor's vector registers, in the order
E N W S NE NW SW SE. The four sides (the neighbours E N W S) come first, because every triangle consists of the node,
the neighbour that gets a distance, and a side. If NE gets the distance, the side is E or N; if E gets it, the side is N
or S. So each lane has two triangles: the left triangle (counter-clockwise from the lane's neighbour) and the right
triangle. Sources: Kimmel and Sethian 1998 (doi:10.1073/pnas.95.15.8431), with the point source of Novotni and Klein
2002.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.surface.surface import MeshArrays

LANES: Final = 8
PLACE: Final = np.array([0, 2, 4, 6, 1, 3, 5, 7])  # for each lane, its neighbour's place in the ring
LEFT: Final = np.array([1, 2, 3, 0, 1, 2, 3, 0])  # for each lane, the lane of its left triangle's side
RIGHT: Final = np.array([3, 0, 1, 2, 0, 1, 2, 3])
# first column of each kind of value in a fan; each kind has eight columns, one per lane, that is, per neighbour of the
# node. The values are the squared length of the edge from the node to the lane's neighbour, and the dot products of
# this edge with the edges from the node to the sides of the left and of the right triangle. FAN is the number of
# columns of a fan
EDGE2, DOT_LEFT, DOT_RIGHT, FAN = 0, 8, 16, 24

# first column of each further kind of value in a row of ``Rows``, after the fan. SIDE2, SIDE and BEND are the squared
# length of the edge to a side, and the distance and bend (as in ``Front``) of this side; each exists per lane for the
# left and for the right triangle. Also per lane, BEFORE is the present distance of the lane's neighbour, and CANDIDATE
# and CANDIDATE_BEND are its candidate distance and the bend of this candidate. (The sides in the right triangles of the
# first two lanes are the sides in the left triangles of the last two lanes, so they share columns.) After these columns
# come OWN, OWN_BEND and OWN_RIM, the node's own distance, bend and rim mark, and UPDATED, whose bits are the lanes to
# update. ROW is the number of columns of a row
SIDE2_LEFT, SIDE2_RIGHT, SIDE_LEFT, SIDE_RIGHT, BEND_LEFT, BEND_RIGHT = (np.int64(c) for c in (24, 30, 38, 44, 52, 58))
BEFORE, CANDIDATE, CANDIDATE_BEND, OWN, OWN_BEND, OWN_RIM, UPDATED, ROW = 66, 74, 82, 90, 91, 92, 93, 96
WIDE: Final = 4  # number of float32 columns in a complex128 number, the unit in which rows are copied

AWAY: Any = np.float32(1e6)  # metres; larger than any real distance, but its square fits into a float32
# m2, minimum squared distance of two nodes (a micrometre), to avoid a division by 0
SMALLEST: Any = np.float32(1e-12)
NOT_FILLED: Any = np.uint8(2)

ZERO: Any
ONE: Any
TWO: Any
# numbers in single precision, since literals in the code would convert all results to float64
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)

FULL_TURN: Any = np.float32(1.0 / (1.0 - np.cos(np.radians(4.0))))
"""Factor on 1 - cos of the angle by which a path turns at the surface's rim. The product is 1 at 4 degrees. At larger
angles, the front starts again from the rim as from a source. A straight rim consists of pixel steps, which turn paths
by less than 4 degrees.
"""

# LLVM's flags for faster arithmetic: a product and a sum may be computed in a single step, a division may become a
# product with the reciprocal, and the sign of zero is ignored; NaN stays NaN
FUSED: Final = {"contract", "nsz", "arcp"}


class Fans(NamedTuple):
    """The fans of all n nodes: each node's ring of neighbours, with the edges and triangles between them. The fan of a
    node is filled in when a front first reaches the node.
    """

    near: np.ndarray  # (n, 8) uint32, the neighbour in each lane; n = missing
    fan: np.ndarray  # (n, 24) float32, columns from ``EDGE2``, ``DOT_LEFT`` and ``DOT_RIGHT`` on
    rim: np.ndarray  # (n,) uint8, 1 where the surface ends; ``NOT_FILLED`` at first
    edge: np.ndarray  # (8, 3) float32, working memory for the edges of one node
    wide: np.ndarray  # (n, 6) complex128, the same memory as ``fan``; each number holds four of its columns


class Rows(NamedTuple):
    """The values from which a round of the front computes candidate distances, one row per active node (a node that
    passes its distance on to its neighbours in this round).
    """

    table: np.ndarray  # (n, 96) float32, with the columns defined above, from ``EDGE2`` to ``UPDATED``
    flat: np.ndarray  # the same memory as ``table``, in one dimension
    wide: np.ndarray  # (n, 24) complex128, the same memory; each number holds four columns of ``table``


@njit(cache=True)
def empty_fans(count: int) -> Fans:
    """Return the fans (neighbourhoods) of a surface of ``count`` nodes, none of which is filled in yet."""
    near, fan = np.empty((count, LANES), np.uint32), np.empty((count, FAN), np.float32)
    return Fans(near, fan, np.full(count, NOT_FILLED), np.empty((LANES, 3), np.float32), fan.view(np.complex128))


@njit(cache=True)
def empty_rows(count: int) -> Rows:
    """Return a table with uninitialised rows for all ``count`` nodes; a round uses only a few of them."""
    table = np.empty((count, ROW), np.float32)
    return Rows(table, table.ravel(), table.view(np.complex128))


@njit(cache=True)
def fill_fans(mesh: MeshArrays, active: np.ndarray, fans: Fans) -> None:
    """Fill the fans (neighbourhoods) of all active nodes whose fans no earlier round filled. Fans are not filled in
    advance, so that a front that stops early fills few fans.
    """
    for k in range(len(active)):
        node = active[k]
        if fans.rim[node] == NOT_FILLED:
            fans.rim[node] = _fill_fan(mesh, node, fans)


@njit(cache=True, error_model="numpy", inline="always")
def _fill_fan(mesh: MeshArrays, node: int, fans: Fans) -> bool:
    """Write the neighbours of one node, and the values of its edges and triangles, to ``fans``. Return whether the
    surface ends at this node, that is, whether a neighbour is missing.

    A triangle exists if its three edges exist; otherwise NaN stands for the dot product of its two edges at the node,
    so that every comparison with this dot product is False. The edge to a missing neighbour has the length ``AWAY``,
    which is larger than any real length. The function is inlined, since at each call numba would count the references
    to eleven arrays, which takes time.
    """
    points, ring = mesh.points_m, mesh.ring
    near, fan, edge = fans.near, fans.fan, fans.edge
    nowhere = len(points)
    rim = False
    for lane in range(LANES):
        other = ring[node, PLACE[lane]]
        near[node, lane] = nowhere if other < 0 else other
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


@njit(cache=True)
def gather(fans: Fans, distance: np.ndarray, bend: np.ndarray, active: np.ndarray, rows: Rows) -> None:
    """Copy the values from which the candidate distances of the active nodes' neighbours are computed to the first k
    rows of the table, before the round changes any distance. active (k,) uint32: the active nodes, one per row.

    distance, bend (n + 1,) float32: the fields of ``Front``: each node's distance from the source, and the distance at
    which the front last turned on its way to the node.
    """
    near, fan, table = fans.near, fans.fan, rows.table
    for k in range(len(active)):
        node = active[k]
        for part in range(FAN // WIDE):
            rows.wide[k, part] = fans.wide[node, part]
        e, n, w, s = near[node, 0], near[node, 1], near[node, 2], near[node, 3]
        _to_lanes(table, k, SIDE2_LEFT, fan[node, 0], fan[node, 1], fan[node, 2], fan[node, 3])
        _to_lanes(table, k, SIDE_LEFT, distance[e], distance[n], distance[w], distance[s])
        for lane in range(LANES):
            table[k, BEFORE + lane] = distance[near[node, lane]]
        _to_lanes(table, k, BEND_LEFT, bend[e], bend[n], bend[w], bend[s])
        table[k, OWN], table[k, OWN_BEND], table[k, OWN_RIM] = distance[node], bend[node], fans.rim[node]


@njit(cache=True)
def _to_lanes(table: np.ndarray, k: int, at: Any, e: float, n: float, w: float, s: float) -> None:
    """Copy a value of each of the four sides (the neighbours E, N, W and S of a node) to row k of the table, for every
    lane. The eight columns from ``at`` on get the value of the side in the lane's left triangle (``LEFT``), and the
    eight columns from ``at + 6`` on the value of the side in the lane's right triangle (``RIGHT``). Both groups share
    two columns, which have the same values in both.
    """
    table[k, at], table[k, at + 1], table[k, at + 2], table[k, at + 3] = n, w, s, e
    table[k, at + 4], table[k, at + 5], table[k, at + 6], table[k, at + 7] = n, w, s, e
    table[k, at + 8], table[k, at + 9], table[k, at + 10], table[k, at + 11] = n, w, e, n
    table[k, at + 12], table[k, at + 13] = w, s


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def find_candidates(table: np.ndarray, count: int) -> None:
    """Compute, in the first ``count`` rows of ``Rows.flat``, the candidate distances of each node's neighbours, and
    mark the neighbours that these distances may update.

    The inner loop has no branch and reads a single array, so that the compiler vectorises it.
    """
    for k in range(count):
        row = k * ROW
        own, own_bend, rim = table[row + OWN], table[row + OWN_BEND], table[row + OWN_RIM]
        updated = np.int32(0)
        for lane in range(LANES):
            at = row + lane
            arm2 = table[at + EDGE2]
            arm = np.sqrt(arm2)
            side, side_bend = table[at + SIDE_LEFT], table[at + BEND_LEFT]
            side2, dot = table[at + SIDE2_LEFT], table[at + DOT_LEFT]
            left, left_bend, left_turn = _through(own, own_bend, arm2, arm, side, side_bend, side2, dot)
            side, side_bend = table[at + SIDE_RIGHT], table[at + BEND_RIGHT]
            side2, dot = table[at + SIDE2_RIGHT], table[at + DOT_RIGHT]
            right, right_bend, right_turn = _through(own, own_bend, arm2, arm, side, side_bend, side2, dot)
            turn = max(min(left_turn, right_turn, ONE), ZERO)
            candidate, turned = own + arm, own_bend + (own - own_bend) * turn * rim
            turned = left_bend if left < candidate else turned
            candidate = min(candidate, left)
            turned = right_bend if right < candidate else turned
            candidate = min(candidate, right)
            table[at + CANDIDATE], table[at + CANDIDATE_BEND] = candidate, turned
            updated += np.int32(candidate <= table[at + BEFORE]) << np.int32(lane)
        table[row + UPDATED] = updated


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def _through(
    own: float, own_bend: float, arm2: float, arm: float, side: float, side_bend: float, side2: float, dot: float
) -> tuple:
    """Return the candidate distance of a neighbour of the node, by a path through the triangle of the node, this
    neighbour and a side (E, N, W or S), and the bend (as in ``Front``) of this path. Also return how sharply the path
    from the source to the node would turn there in order to run along the edge to the neighbour: (1 - cos of this
    angle) times ``FULL_TURN``, or 1 if the triangle or the distance of the side is missing.

    own, side: distances of the node and of the side from the source; arm: length of the edge from the node to the
    neighbour; side2: squared length of the edge from the node to the side; dot: the dot product of these two edges. The
    triangle is laid flat with the node at the origin, the side at (c, 0), and the neighbour above the edge between node
    and side. In this plane, the front comes from a point (x, -y) below this edge, where ``towards`` = 2 c x and
    ``beside`` = 2 c y; ``area`` is c times the neighbour's height over the edge. If the front has turned around the
    rim, it comes from the turning point. So the distance at this point (``since``) is subtracted first and added again
    at the end. The candidate is ``AWAY`` if the straight line from that point to the neighbour misses the edge.
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
    candidate = straight if hits else AWAY
    return candidate, own_bend + (side_bend - own_bend) * (crossing / width), turn if known else ONE
