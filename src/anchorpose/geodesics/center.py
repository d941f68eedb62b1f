"""Compute the geodesic distance (along the surface) of every node from the body's centre, and the paths from the ends
of limbs to the centre, along which this distance decreases.

The paper measures from a single node, V_c (Section IV-B), so pieces of surface that are not connected to this node have
no distance and no extremum (a node farther from the centre than all nodes around it). Here the distance on such a
separate piece, for example a forearm beyond a bar, is measured from the piece's node nearest to the other pieces. So
the farthest node of the piece lies at the limb's end and not at the bar.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.distance import geodesic_distance, geodesic_distance_to_set, mean_edge_m
from anchorpose.geodesics.extrema import surface_center
from anchorpose.geodesics.paths import apart
from anchorpose.surface.links import pieces
from anchorpose.surface.surface import MeshArrays, Surface

LEAST_AREA_M2: Final = 0.0020  # m2, minimum area of a measured piece: half a palm, as ``SurfaceConfig.min_piece_m2``


@dataclass(frozen=True, slots=True, eq=False)
class CenterField:
    """The geodesic distance of each node from the centre, and the connected pieces of surface on which the distance was
    measured.
    """

    distance_m: np.ndarray  # (n,) float32, inf on pieces that show less than ``LEAST_AREA_M2`` of skin
    piece: np.ndarray  # (n,) int32, number of each node's piece, as in ``surface.links.pieces``
    # (p,) int32, the node of each piece from which distances on the piece are measured: V_c on the main piece, -1 on a
    # piece that shows less than ``LEAST_AREA_M2`` of skin
    root: np.ndarray
    # (p,) int32, for each piece, the node of another piece on the other side of the gap, opposite ``root``; -1 for the
    # main piece and for pieces without a root
    before: np.ndarray

    @property
    def center(self) -> int:
        """Return the index of V_c, the node at the centre of the surface."""
        return int(self.root[(self.root >= 0) & (self.before < 0)][0])


def center_field(surface: Surface) -> CenterField:
    """Return the geodesic distance of every node from the centre. It is finite on every connected piece of surface that
    shows enough skin.

    The main piece of the surface is the piece with the most seen nodes; the centre, V_c, is its node nearest to the
    average position of all seen nodes. The other pieces are joined one after another. The next piece is always the
    piece with the narrowest gap to the joined pieces (Euclidean distance of nodes, hidden skin included). The distance
    at a node of such a piece is the sum of the distance at the gap's other side, the width of the gap, and the distance
    along the piece. A piece that shows less than ``LEAST_AREA_M2`` is left out. Raises DegenerateGeometry on a surface
    without seen nodes.
    """
    if surface.seen_count == 0:
        raise DegenerateGeometry("a surface without seen nodes has no centre")
    center = surface_center(surface)
    field = geodesic_distance(surface, np.array([center]))[0]
    if np.isfinite(field).all():
        none = np.full(1, -1, np.int32)
        return CenterField(field, np.zeros(len(surface), np.int32), np.array([center], np.int32), none)
    return _over_gaps(surface, center, field)


def _over_gaps(surface: Surface, center: int, field: np.ndarray) -> CenterField:
    """Compute ``center_field`` of a surface that consists of several unconnected pieces. field (n,): distance from
    ``center``, known only on the centre's own piece.
    """
    piece = pieces(surface)
    seen = np.bincount(piece[: surface.seen_count], minlength=piece.max() + 1)
    main = int(seen.argmax())
    if piece[center] != main:
        center = surface_center(surface, piece == main)
        field = geodesic_distance(surface, np.array([center]))[0]
    root, before = np.full(len(seen), -1, np.int32), np.full(len(seen), -1, np.int32)
    root[main] = center
    least = LEAST_AREA_M2 / mean_edge_m(surface.arrays) ** 2
    order = _join(surface.points_m, piece, main, np.flatnonzero((seen >= least) & (root < 0)), root, before)
    apart = geodesic_distance_to_set(surface, root[order])
    for number in order:
        own = piece == number
        gap_m = np.linalg.norm(surface.points_m[root[number]] - surface.points_m[before[number]])
        field[own] = apart[own] + field[before[number]] + gap_m
    return CenterField(field, piece, root, before)


def _join(
    points_m: np.ndarray, piece: np.ndarray, main: int, others: np.ndarray, root: np.ndarray, before: np.ndarray
) -> list[int]:
    """Join the pieces ``others`` to the piece ``main``, one after another, across the narrowest gaps (Prim's
    algorithm). Write ``root`` and ``before`` (as in ``CenterField``) of each joined piece, and return the pieces in the
    order in which they were joined.
    """
    if len(others) == 0:
        return []
    nodes = {number: np.flatnonzero(piece == number) for number in (main, *others.tolist())}
    gap = dict.fromkeys(others.tolist(), np.inf)
    order, newest = list[int](), main
    while gap:
        tree = KDTree(points_m[nodes[newest]])
        for number in gap:
            away, nearest = tree.query(points_m[nodes[number]], distance_upper_bound=gap[number])
            place = int(away.argmin())
            if away[place] < gap[number]:
                gap[number] = float(away[place])
                root[number], before[number] = nodes[number][place], nodes[newest][nearest[place]]
        newest = min(gap, key=lambda number: gap[number])
        order.append(newest)
        del gap[newest]
    return order


def limb_path(surface: Surface, field: CenterField, end: int) -> np.ndarray:
    """Return the path from the node ``end`` to the centre: nodes (k,) int32, whose distance from the centre decreases
    along the path.

    From every node the path continues to the neighbour, on the grid or across a link, through which the way to the
    centre is shortest; at the root of a separate piece (the node from which distances on the piece are measured), the
    path continues on the other side of the gap. The path consists of nodes, so it is up to 8 % longer than the
    geodesic. Raises ValueError if ``end`` is not connected to the centre.
    """
    if not (0 <= end < len(surface) and np.isfinite(field.distance_m[end])):
        raise ValueError(f"node {end} of {len(surface)} has no distance from the centre")
    mesh, steps = surface.arrays, list[np.ndarray]()
    node = int(end)
    while node >= 0:
        steps.append(_descend(mesh, field.distance_m, node))
        node = int(field.before[field.piece[steps[-1][-1]]])
    return np.concatenate(steps)


@njit(cache=True, error_model="numpy")
def _descend(mesh: MeshArrays, distance: np.ndarray, start: int) -> np.ndarray:
    """Return the path (k,) int32 from a node towards the centre; it ends at the first node that has no nearer
    neighbour.
    """
    points, ring, link_start, link_node = mesh.points_m, mesh.ring, mesh.link_start, mesh.link_node
    path = np.empty(len(ring), np.int32)
    count, node = 0, np.int64(start)
    while node >= 0:
        path[count] = node
        count += 1
        best, following = np.inf, np.int64(-1)
        for k in range(8):
            other = np.int64(ring[node, k])
            if other >= 0 and distance[other] < distance[node]:
                reached = distance[other] + apart(points, node, other)
                if reached < best:
                    best, following = reached, other
        for k in range(link_start[node], link_start[node + 1]):
            other = np.int64(link_node[k])
            if distance[other] < distance[node]:
                reached = np.float64(distance[other]) + mesh.link_length_m[k]
                if reached < best:
                    best, following = reached, other
        node = following
    return path[:count].copy()
