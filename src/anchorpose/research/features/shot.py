"""Compute signatures of histograms of orientations (SHOT): the normals' directions in each of 32 sectors of a sphere.

Source: Tombari, Salti, Di Stefano 2010 (doi:10.1007/978-3-642-15558-1_26), in the version of PCL 1.13, which comes from
the authors: signatures have unit length, and each of the four interpolations passes a part of a vote to one
neighbouring bin.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.circle import HALF_PI, ONE, PI, ZERO, angle_of
from anchorpose.research.features.local_frame import FEWEST, as_frames, local_frames
from anchorpose.research.features.neighbours import Neighbours, as_oriented, find_neighbours
from anchorpose.settings import Positive, settings

# Number of sectors (8 around z times 2 outwards times 2 along z); number of intervals of the cosine of the angle
# between a normal and z
SECTORS, LEANS = 32, 10
COLUMNS = LEANS + 1  # columns of each sector, one for each end of an interval
SIZE = SECTORS * COLUMNS
_HALF = np.float32(0.5)
_TO_SECTOR = np.float32(4.0 / np.pi)
_LEANS = np.float32(LEANS)
_TWO = np.float32(2.0)


@settings
class ShotConfig:
    """Settings of SHOT, whose descriptors have 352 numbers."""

    # m, radius of the sphere, also for the local frame. The sphere contains a limb with its edges; with a radius of 15
    # cm, errors of matches are 1.5 times as large
    radius_m: Positive = 0.20
    # True: z points to the normal's side; False: to the side with most points, as in the authors' program
    z_by_normal: bool = False


def shot(
    points_m: np.ndarray, normals: np.ndarray, config: ShotConfig | None = None, frames: np.ndarray | None = None
) -> np.ndarray:
    """Return the signatures (n, 352) float32, of unit length.

    points_m, normals (n, 3) are in one frame, and normals have unit length; NaN = unknown. A node without position is
    left out, and a node without normal casts no vote. frames (n, 3, 3): the axes x, y, z as rows; None = the result of
    ``local_frames``. Each sector s has 11 columns: s & 1 is 1 in the upper half, s >> 1 & 1 is 1 in the outer half, and
    s >> 2 is the eighth of a turn, counted from -x. A row is NaN if the node has no frame, fewer than four other
    nodes are within the radius, or none of these nodes has a normal.
    """
    config = config or ShotConfig()
    points, unit = as_oriented(points_m, normals)
    near = find_neighbours(points, config.radius_m)
    if frames is None:
        frames = local_frames(points, near, unit if config.z_by_normal else None)
    frames = as_frames(frames, len(points))
    return _signatures(np.concatenate([points, unit], axis=1), near, frames)


@njit(cache=True, error_model="numpy")
def _signatures(oriented: np.ndarray, neighbours: Neighbours, frames: np.ndarray) -> np.ndarray:
    start, node, distance2 = neighbours.start, neighbours.node, neighbours.distance2_m2
    per_radius = np.float32(1.0 / neighbours.radius_m)
    result = np.zeros((len(oriented), SIZE), np.float32)
    most = 1
    for c in range(len(oriented)):
        most = max(most, start[c + 1] - start[c])
    near, away2 = np.empty(most, np.uint32), np.empty(most, np.float32)
    place = np.empty((4, most), np.float32)
    for c in range(len(oriented)):
        count = 0
        for m in range(start[c], start[c + 1]):
            near[count], away2[count] = node[m], distance2[m]
            count += (distance2[m] > ZERO) & np.isfinite(oriented[node[m], 3])
        if count == 0 or start[c + 1] - start[c] < FEWEST - 1 or not np.isfinite(frames[c, 0, 0]):
            result[c] = np.nan
            continue
        _locate(oriented, c, near[:count], away2, per_radius, frames[c], place)
        for m in range(count):
            _vote(place[0, m], place[1, m], place[2, m], place[3, m], result[c])
        _normalize(result[c])
    return result


@njit(cache=True, error_model="numpy")
def _locate(
    oriented: np.ndarray,
    own: int,
    near: np.ndarray,
    away2: np.ndarray,
    per_radius: np.float32,
    frame: np.ndarray,
    place: np.ndarray,
) -> None:
    """Fill place (4, k) with the position of each neighbour's vote in the histograms.

    The rows are: direction about z, in eighths of a turn from -x; distance, as a share of the radius; inclination from
    z, in radians; cosine of the angle between the neighbour's normal and z, mapped from [-1, 1] to [0, ``LEANS``].
    """
    px, py, pz = oriented[own, 0], oriented[own, 1], oriented[own, 2]
    x0, x1, x2 = frame[0, 0], frame[0, 1], frame[0, 2]
    y0, y1, y2 = frame[1, 0], frame[1, 1], frame[1, 2]
    z0, z1, z2 = frame[2, 0], frame[2, 1], frame[2, 2]
    for m in range(len(near)):
        q = near[m]
        dx, dy, dz = oriented[q, 0] - px, oriented[q, 1] - py, oriented[q, 2] - pz
        x, y, z = dx * x0 + dy * x1 + dz * x2, dx * y0 + dy * y1 + dz * y2, dx * z0 + dy * z1 + dz * z2
        lean = oriented[q, 3] * z0 + oriented[q, 4] * z1 + oriented[q, 5] * z2
        place[0, m] = (angle_of(y, x) + PI) * _TO_SECTOR
        place[1, m] = np.sqrt(away2[m]) * per_radius
        place[2, m] = angle_of(np.sqrt(x * x + y * y), z)
        place[3, m] = (ONE + min(max(lean, -ONE), ONE)) * _LEANS * _HALF


@njit(cache=True, error_model="numpy")
def _vote(turn: np.float32, out: np.float32, inclination: np.float32, lean: np.float32, row: np.ndarray) -> None:
    """Add one neighbour's votes to ``row``: to the neighbour's own bin and, in each of the four interpolations, to at
    most one adjacent bin.
    """
    eighth = min(np.int32(turn), np.int32(7))
    outer, upper = np.int32(out > _HALF), np.int32(inclination < HALF_PI)
    sector = (eighth << 2) | (outer << 1) | upper
    step = np.int32(lean + _HALF)
    column = sector * COLUMNS + step
    off = lean - np.float32(step)
    # the columns of a sector wrap around as in the authors' program, in which column 0, not 10, follows column 9
    beside = (0 if step == LEANS - 1 else step + 1) if off > ZERO else (LEANS - 1 if step == 0 else step - 1)
    row[sector * COLUMNS + beside] += abs(off)
    weight = ONE - abs(off)

    off = _TWO * out - _HALF - np.float32(outer)  # neighbour's distance from its shell's middle, in widths of a shell
    inwards = off > ZERO if outer == 0 else off < ZERO  # whether the neighbour lies between the middles of both shells
    row[column + (2 * COLUMNS if outer == 0 else -2 * COLUMNS)] += abs(off) if inwards else ZERO
    weight += ONE - abs(off)

    middle = HALF_PI * _HALF if upper else HALF_PI * (ONE + _HALF)
    off = (inclination - middle) / HALF_PI
    inwards = off > ZERO if upper else off < ZERO
    row[column + (-COLUMNS if upper else COLUMNS)] += abs(off) if inwards else ZERO
    weight += ONE - abs(off)

    off = min(max(turn - np.float32(eighth) - _HALF, -_HALF), _HALF)
    beside = (eighth + 1) & 7 if off > ZERO else (eighth - 1) & 7
    row[column + (beside - eighth) * 4 * COLUMNS] += abs(off)
    row[column] += weight + ONE - abs(off)


@njit(cache=True, error_model="numpy")
def _normalize(row: np.ndarray) -> None:
    length2 = 0.0
    for column in range(SIZE):
        length2 += row[column] * row[column]
    share = np.float32(1.0 / np.sqrt(length2))
    for column in range(SIZE):
        row[column] *= share
