"""Link parts of the surface that are separate in the depth frame but connected on the body.

For example, a bar in front of the shins hides a strip of the leg, and a chin stands out in front of the neck, so that
the depth jumps there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from anchorpose.surface.links import add_links, pieces, straight_m
from anchorpose.surface.surface import Surface, SurfaceConfig

# maximum distance of a node on one side of a gap from the tangent plane of the node on the other side, as a share of
# the gap's width. On both sides of a bar, two nodes on the same shin are nearer than this to each other's tangent
# plane; two nodes on different legs are much farther away from it
MAX_DEPARTURE: Final = 0.35
# m, added to the maximum distance from the tangent plane (``MAX_DEPARTURE``), to allow for soft tissue and noise beside
# a narrow bar
SLACK_M: Final = 0.015
MARGIN_PX: Final = 4  # pixels, width of the strip beside a bar in which readings are lost or removed

FORWARD: Final = ((0, 1), (-1, 1), (-1, 0), (-1, -1))
"""Row and column offsets of the neighbours E, NE, N, NW; with these, every pair of grid neighbours occurs once."""

# maximum width of the gap between two pieces at a link, divided by the gap's least width. Where the gap between two
# pieces is wider than this, one piece merely stands in front of the other piece, and no link is made
SPREAD: Final = 1.5


def bridge_pairs(
    index: np.ndarray,
    hidden: np.ndarray,
    points_m: np.ndarray,
    normals: np.ndarray,
    focal_px: float,
    config: SurfaceConfig,
) -> np.ndarray:
    """Return pairs of nodes that face each other across pixels hidden by equipment, along rows, columns and diagonals
    of the grid.

    index (rows, cols) int32: node on the grid of every ``step``-th pixel, -1 = none; hidden (height, width) bool:
    pixels hidden by equipment; points_m (n, 3), n > 0, and normals float32, camera frame; focal_px: the longer focal
    length. Returns (m, 2) int32.
    """
    step, max_width_m = config.step, config.bridge_max_width_m
    spacing_m = step * float(points_m[:, 2].min()) / focal_px  # minimum distance between two neighbours on the grid
    longest = int(np.ceil(max_width_m / max(spacing_m, 1e-4))) + 1
    return _facing_pairs(index, hidden, points_m, normals, step, longest, -(-MARGIN_PX // step), float(max_width_m))


@njit(cache=True, nogil=True)
def _facing_pairs(
    index: np.ndarray,
    hidden: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    step: int,
    longest: int,
    margin: int,
    max_width: float,
) -> np.ndarray:
    """Compute ``bridge_pairs`` in compiled code: the nodes of a pair are at most ``longest`` + 2 ``margin`` grid steps
    apart. The places of the grid between them have no node; at most 2 ``margin`` of these places may be visible, that
    is, not hidden by equipment.
    """
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
                        if covered > 0 and _belong(points, normals, node, other, max_width):
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


@njit(cache=True, nogil=True)
def _belong(points: np.ndarray, normals: np.ndarray, p: int, q: int, max_width: float) -> bool:
    """Return whether two nodes may belong to the same surface: they are at most ``max_width`` apart, their normals
    differ by less than a right angle, and each lies near the other's tangent plane.
    """
    width2, from_p, from_q, turn = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        gap = np.float64(points[q, axis]) - np.float64(points[p, axis])
        width2 += gap * gap
        from_p += gap * normals[p, axis]
        from_q += gap * normals[q, axis]
        turn += normals[p, axis] * normals[q, axis]
    width = np.sqrt(width2)
    allowed = SLACK_M + MAX_DEPARTURE * width
    return width <= max_width and turn > 0.0 and abs(from_p) <= allowed and abs(from_q) <= allowed


def join_pieces(surface: Surface, step: int, max_gap_m: float) -> Surface:
    """Return one camera's surface, on the grid of every ``step``-th pixel, with its pieces linked where they are
    nearest to each other.

    All pieces with nodes that show points of the expected skin count as one piece. So they are not linked to each
    other: hidden skin connects them better.
    """
    piece = pieces(surface)
    known = np.unique(piece[surface.skin >= 0])
    if len(known):
        piece = np.where(np.isin(piece, known), known[0], piece)
    if len(piece) == 0 or (piece == piece[0]).all():
        return surface
    index = np.full(surface.pixel.max(axis=0) // step + 1, -1, np.int32)
    index[surface.pixel[:, 0] // step, surface.pixel[:, 1] // step] = np.arange(len(surface))
    seams = join_pairs(index, surface.points_m, piece, max_gap_m)
    start, node, length = add_links(surface, seams, straight_m(surface.points_m, seams), len(surface))
    return replace(surface, link_start=start, link_node=node, link_length_m=length)


def join_rest(surface: Surface, max_gap_m: float) -> Surface:
    """Return the surface with each separate piece that contains seen nodes linked to the largest piece, where the two
    pieces are nearest to each other.

    Links are at most ``max_gap_m`` long; a piece farther away stays separate, with infinite distances.
    """
    seen = surface.seen_count
    if seen == 0:
        return surface
    piece = pieces(surface)
    size = np.bincount(piece[:seen], minlength=piece.max() + 1)
    rest = np.setdiff1d(piece[:seen], size.argmax())
    if len(rest) == 0:
        return surface
    main = np.flatnonzero(piece == size.argmax())
    tree = KDTree(surface.points_m[main])
    pairs = []
    for number in rest:
        own = np.flatnonzero(piece == number)
        away, nearest = tree.query(surface.points_m[own])
        if away.min() <= max_gap_m:
            pairs.append([own[away.argmin()], main[nearest[away.argmin()]]])
    added = np.array(pairs, np.int32).reshape(-1, 2)
    start, node, length = add_links(surface, added, straight_m(surface.points_m, added), len(surface))
    return replace(surface, link_start=start, link_node=node, link_length_m=length)


def join_pairs(index: np.ndarray, points_m: np.ndarray, piece: np.ndarray, max_gap_m: float) -> np.ndarray:
    """Return pairs (m, 2) int32 of nodes that join two pieces of surface where the gap between these pieces is
    shortest. The nodes of a pair are neighbours on the grid, and at most ``max_gap_m`` apart.

    index (rows, cols) int32: node on the grid, -1 = none; points_m (n, 3); piece (n,) int32: number of each node's
    piece, from ``pieces``. Gaps are closed in the order of their width (Kruskal's rule), and a gap between two pieces
    that other pieces connect already is not closed. So an arm in front of the trunk is not joined to the trunk directly
    if the shoulder connects them.
    """
    pair = _seams(index, piece)
    gap = np.linalg.norm(points_m[pair[:, 0]] - points_m[pair[:, 1]], axis=1)
    pair, gap = pair[gap <= max_gap_m], gap[gap <= max_gap_m]
    sides = np.sort(piece[pair], axis=1)
    merged = np.arange(piece.max(initial=-1) + 1)
    chosen = np.zeros(len(pair), bool)
    for place in np.argsort(gap, kind="stable"):
        one, two = sides[place]
        if merged[one] != merged[two]:
            merged[merged == merged[two]] = merged[one]
            chosen |= (sides == sides[place]).all(axis=1) & (gap <= SPREAD * gap[place])
    return pair[chosen].astype(np.int32)


def _seams(index: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Return pairs (k, 2) of nodes that are grid neighbours but on different pieces of surface."""
    rows, cols = index.shape
    found = []
    for down, right in FORWARD:
        here = index[max(0, -down) :, max(0, -right) : cols - max(0, right)]
        there = index[: rows + down, max(0, right) : cols + min(0, right)]
        both = (here >= 0) & (there >= 0)
        pair = np.stack([here[both], there[both]], axis=1)
        found.append(pair[piece[pair[:, 0]] != piece[pair[:, 1]]])
    return np.concatenate(found)
