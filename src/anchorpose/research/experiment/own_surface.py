"""Match nodes of a frame with skin points of the body model, by geodesic distances in this frame alone.

The paper matches nodes of one frame with nodes of the next (Section IV-D). Distances to the anchors are nearly the same
in every pose, but also nearly the same on the front and on the back of the body. The angles from the direction to one
anchor to the direction to another anchor (``turns``) distinguish front and back: seen from outside, the left hand is to
the right of the head on the front, and to the left of the head on the back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Final

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from anchorpose.body.constraints import anchor_points, thin
from anchorpose.body.skin_points import Body
from anchorpose.geodesics.anchors import Anchors
from anchorpose.geodesics.paths import unfolded
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.surface.surface import Surface

NODES: Final = 400  # maximum number of nodes of a frame that are matched, 5 cm apart; 250 nodes are almost as good
TRIED: Final = 1200  # maximum number of skin points with which nodes are compared, 4 cm apart
LEAST_DISTANCES: Final = 3  # minimum number of known distances to anchors that determine a place (Section IV-D)
SIGMA_M: Final = 0.02  # m, standard deviation of a distance due to fast marching and the anchors' jitter
# standard deviation of a distance in m per m of its length, added to SIGMA_M in quadrature; it allows for bent limbs
# and for the inexact sizes of the body model
SIGMA_PER_M: Final = 0.02
# Standard deviation of a turn, the sine of the angle between the directions away from two anchors (see ``turns``). The
# value is larger than the error of a single turn, 0.4, since a node has ten turns but only four of them are
# independent.
TURN_SIGMA: Final = 0.6
# Medians, in m, of the amount by which distances to each anchor are longer in a frame than on the body model, for
# simulated people. Distances to head and feet are shorter, since the anchors found there lie short of the tips.
# Distances to a hand are longer, since paths lead only over the seen side of the arm
LONGER_M: Final = np.array([-0.06, 0.06, 0.06, -0.05, -0.05])
ROUNDS: Final = 2  # number of rounds of matching; in the second round, medians of the first round replace ``LONGER_M``
# Limit of the amount by which a skin point's sum of squared deviations (each divided by its variance) exceeds the sum
# of the best skin point. Below this limit, a skin point counts as fitting a node almost as well as the best skin point.
ALMOST: Final = 2.0
# m, maximum spread (standard deviation of the places) of the skin points that fit a node almost as well as the best
# point; a node with a greater spread has no match. This maximum spread is the width of a thigh.
CLEAR_M: Final = 0.10
LEAST_NODES: Final = 40  # minimum number of nodes, a tenth of ``NODES``, for a median that replaces ``LONGER_M``
# Maximum change in m of a distance in a sweep, for distances to count as converged. The error that a converged distance
# still has is a hundredth of ``SIGMA_M``, the standard deviation of a distance.
SETTLED_M: Final = 1e-4
MOST_SWEEPS: Final = 30  # maximum number of sweeps, for distances that do not converge earlier

MIRRORED: Final = np.array(  # indices of the anchors, with left and right exchanged
    [ANCHOR_NAMES.index(name) for name in ("Head", "HandRight", "HandLeft", "FootRight", "FootLeft")]
)
PAIRS: Final = tuple(combinations(range(len(ANCHOR_NAMES)), 2))
_FIRST, _SECOND = (np.array(column) for column in zip(*PAIRS, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class OwnSurface:
    """The p skin points of a body: their distances to the tips of head, hands and feet, and their turns (``turns``:
    sines of the angles between the directions away from two tips).
    """

    distance_m: np.ndarray  # (p, 5), distances along the skin in the rest pose to the tips of head, hands and feet
    turns: np.ndarray  # (p, 10), see ``turns``


@dataclass(frozen=True, slots=True, eq=False)
class SeenGeodesics:
    """The patient's surface in one frame, with its anchors and the distances to them."""

    whole: Surface  # seen skin and inferred hidden skin; the nodes of the hidden skin come last
    anchors: Anchors
    # (n, 5) metres from each seen node to each anchor; inf if no path leads there, NaN if the anchor is missed or the
    # distance is not trusted
    descriptor: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class SkinMatches:
    """The m matches of a frame's nodes with skin points of the body model."""

    node: np.ndarray  # (m,), node of the seen surface
    point: np.ndarray  # (m,), skin point that each node shows
    spread_m: np.ndarray  # (m,), standard deviation of the places of skin points that fit almost as well as ``point``


@lru_cache(maxsize=4)
def own_surface(body: Body) -> OwnSurface:
    """Return the distances of a body's skin points to the tips of head, hands and feet, and the points' turns (sines of
    angles, see ``turns``); the results for the last four bodies are cached.
    """
    vertices, points = body.mesh.vertices, body.points
    distance = skin_distance(vertices, points.asset.faces, points.vertex[anchor_points(points)])
    around = points.asset.faces[points.faces_of].reshape(len(points.vertex), -1)
    found = turns(vertices, body.rest_normals, points.vertex, around, distance.T)
    return OwnSurface(distance[:, points.vertex].T.copy(), found)


def skin_distance(vertices: np.ndarray, faces: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Return (s, v) metres along a triangle mesh from each source to each vertex; inf if no path leads there.

    Distances are first computed along the edges, then shortened across the triangles, as fast marching does
    (``geodesics.paths.unfolded``), until they have converged.
    """
    sides = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1).astype(np.int64)
    edges = np.stack(np.divmod(np.unique(sides @ [len(vertices), 1]), len(vertices)), axis=1)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = csr_array((length, edges.T), shape=(len(vertices), len(vertices)))
    fields = np.atleast_2d(dijkstra(graph, directed=False, indices=sources))
    corner = faces.ravel()
    order = np.argsort(corner, kind="stable")
    start = np.searchsorted(corner[order], np.arange(len(vertices) + 1))
    opposite = np.stack([np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()], axis=1)[order]
    for field in fields:
        _relax(vertices, start, opposite, np.argsort(field, kind="stable"), field)
    return fields


@njit(cache=True, nogil=True, error_model="numpy")
def _relax(points: np.ndarray, start: np.ndarray, opposite: np.ndarray, order: np.ndarray, field: np.ndarray) -> None:
    """Shorten the distances ``field`` (v,) from a source across triangles, until they have converged.

    The triangles at vertex i are the rows start[i] to start[i + 1] of opposite (c, 2); a row has the other two corners
    of a triangle. order (v,): the vertices by distance.
    """
    for _ in range(MOST_SWEEPS):
        most = 0.0
        for node in order:
            for k in range(start[node], start[node + 1]):
                a, b = opposite[k, 0], opposite[k, 1]
                if field[a] < field[node] and field[b] < field[node]:
                    reached, _ = unfolded(points, field, node, a, b)
                    if reached < field[node]:
                        most = max(most, field[node] - reached)
                        field[node] = reached
        if most < SETTLED_M:
            return


def turns(
    places_m: np.ndarray, normals: np.ndarray, nodes: np.ndarray, around: np.ndarray, distance_m: np.ndarray
) -> np.ndarray:
    """Return (k, 10): for each node and pair of anchors, the sine of the angle from the direction away from the first
    anchor to the direction away from the second.

    Directions are tangents of the skin; angles are counter-clockwise as seen from outside. places_m (n, 3): places of
    all nodes. distance_m (n, 5): geodesic distance of each node from each anchor. nodes (k,): the chosen nodes. normals
    (k, 3): their normals. around (k, f): nodes near each chosen node, -1 = none. A turn is NaN if an anchor's distances
    around the node are unknown.
    """
    offset = places_m[around] - places_m[nodes][:, None]
    side = _sideways(normals)
    flat = np.stack([(offset * side[:, None]).sum(axis=2), (offset * np.cross(normals, side)[:, None]).sum(axis=2)], 2)
    with np.errstate(invalid="ignore"):
        rise = distance_m[around] - distance_m[nodes][:, None]
    known = np.isfinite(rise) & (around >= 0)[:, :, None]
    rise = np.where(known, rise, 0.0)
    squares = np.einsum("kfi,kfj,kfa->kaij", flat, flat, known)
    pull = np.einsum("kfi,kfa->kai", flat, rise)
    x = squares[..., 1, 1] * pull[..., 0] - squares[..., 0, 1] * pull[..., 1]
    y = squares[..., 0, 0] * pull[..., 1] - squares[..., 0, 1] * pull[..., 0]
    length = np.hypot(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y = np.where(length > 0.0, [x, y] / length, np.nan)
    return np.asarray(x[:, _FIRST] * y[:, _SECOND] - y[:, _FIRST] * x[:, _SECOND])


def _sideways(normals: np.ndarray) -> np.ndarray:
    """Return (k, 3) unit vectors perpendicular to unit normals (k, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(axis, normals)
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


def match_skin(body: Body, seen: SeenGeodesics, mirrored: bool = False) -> SkinMatches:
    """Match up to ``NODES`` seen nodes with skin points of the body model that have similar distances to the anchors
    and similar turns (sines of the angles between the directions away from two anchors).

    mirrored: True = the left and right anchors are exchanged. A node with fewer than three known distances to anchors
    has no match, nor does a node that fits several places on the skin.
    """
    chosen = thin(len(seen.descriptor), NODES)
    distance = _finite_or_nan(seen.descriptor[:, MIRRORED] if mirrored else seen.descriptor)
    chosen = chosen[np.isfinite(distance[chosen]).sum(axis=1) >= LEAST_DISTANCES]
    if not len(chosen):
        return SkinMatches(chosen, chosen, np.zeros(0))
    whole, own, tried = seen.whole, own_surface(body), thin(len(body.rest_m), TRIED)
    around = np.where(whole.ring[chosen] < len(distance), whole.ring[chosen], -1)
    turned = turns(
        whole.points_m.astype(np.float64), whole.normals[chosen].astype(np.float64), chosen, around, distance
    )
    measured = distance[chosen]
    sigma = np.hstack([np.hypot(SIGMA_M, SIGMA_PER_M * measured), np.full(turned.shape, TURN_SIGMA)])
    table, longer = _table(np.hstack([own.distance_m, own.turns])[tried]), LONGER_M
    for _ in range(ROUNDS):
        off2 = _off2(np.hstack([measured - longer, turned]), sigma, table)
        best = off2.argmin(axis=1)
        longer = _longer(measured - own.distance_m[tried[best]])
    spread = _spread(off2, off2[np.arange(len(best)), best], body.rest_m[tried])
    clear = spread < CLEAR_M
    return SkinMatches(chosen[clear], tried[best[clear]], spread[clear])


def _finite_or_nan(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan).astype(np.float64)


def _table(own: np.ndarray) -> np.ndarray:
    """Return a table (2 c, p) float32 for ``_off2``: the squares, then the values, of the skin points' distances and
    turns ``own`` (p, c); unknown values are 0.
    """
    known = np.nan_to_num(own)
    return np.ascontiguousarray(np.hstack([known**2, known]).T, dtype=np.float32)


def _off2(seen: np.ndarray, sigma: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return (k, p) float32: for each node and skin point, the sum of ((seen - own) / sigma)^2, where ``seen`` has the
    distances to the anchors and the turns (see ``turns``) of the node, and ``own`` has the same values of the skin
    point.

    The term (seen / sigma)^2 is left out, since it is the same for all skin points. The sum is over the columns of seen
    and sigma (k, c) that are not NaN. table: the distances and turns of the skin points in the form that ``_table``
    returns.
    """
    known = np.isfinite(seen)
    weight, value = np.where(known, 1.0 / sigma**2, 0.0), np.where(known, seen, 0.0)
    return np.asarray(np.hstack([weight, -2.0 * weight * value]).astype(np.float32) @ table)


def _longer(off_m: np.ndarray) -> np.ndarray:
    """Return (5,) medians of off_m: how much longer distances to each anchor are in the frame than on the body model.

    off_m (k, 5): the difference for each matched node. An anchor with fewer than ``LEAST_NODES`` known differences gets
    its value of ``LONGER_M`` instead of a median.
    """
    known = np.isfinite(off_m).sum(axis=0)
    longer = LONGER_M.copy()
    for anchor in np.flatnonzero(known >= LEAST_NODES):
        longer[anchor] = np.nanmedian(off_m[:, anchor])
    return longer


def _spread(off2: np.ndarray, least: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Return (k,) metres: for each node, the standard deviation of the places of the skin points that fit the node
    almost as well as the best skin point.

    places_m (p, 3): places of the skin points. off2 (k, p): the result of ``_off2``, how badly each skin point fits
    each node. least (k,): the value in ``off2`` of the best skin point of each node.
    """
    near = (off2 < least[:, None] + np.float32(ALMOST)).astype(np.float32)
    sums = near @ np.column_stack([places_m, (places_m**2).sum(axis=1), np.ones(len(places_m))]).astype(np.float32)
    mean = sums[:, :4] / sums[:, 4:]
    return np.asarray(np.sqrt(np.maximum(mean[:, 3] - (mean[:, :3] ** 2).sum(axis=1), 0.0)))
