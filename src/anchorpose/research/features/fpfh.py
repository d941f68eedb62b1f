"""Compute fast point feature histograms (FPFH): the angles between the normals around a node.

Source: Rusu, Blodow, Beetz 2009 (doi:10.1109/ROBOT.2009.5152473), as PCL 1.13 and Open3D implement it: neighbours are
weighted by their inverse squared distance, and each of the three angles has its own histogram, which sums to 100.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from anchorpose.research.features.circle import ONE, PI, ZERO, angle_of
from anchorpose.research.features.neighbours import Neighbours, as_oriented, find_neighbours
from anchorpose.settings import Positive, settings

BINS = 11
SIZE = 3 * BINS
_PADDED = 40  # number of columns of a row; more than the 33 needed, to fill whole vector registers
_TWO_PI, _HALF, _BINS = np.float32(2 * np.pi), np.float32(0.5), np.float32(BINS)
_FULL, _DEGENERATE = np.float32(100.0), np.float32(1e-12)


@settings
class FpfhConfig:
    """Settings of FPFH, whose descriptors consist of 3 histograms of 11 bins."""

    # m, radius within which a node's simplified histogram counts other nodes. A descriptor averages the simplified
    # histograms of the nodes within this radius, so it depends on the surface within twice the radius. With a radius of
    # 10 cm, the errors of matches are twice as large.
    radius_m: Positive = 0.15
    own_histogram: bool = False  # True: the node's own histogram is added, as in the paper and Open3D, but not in PCL


def fpfh(points_m: np.ndarray, normals: np.ndarray, config: FpfhConfig | None = None) -> np.ndarray:
    """Return (n, 33) float32: the histograms of three angles, 11 bins each.

    points_m, normals (n, 3) are in one frame, and normals have unit length. A node whose position or normal is NaN is
    left out of all histograms. Each histogram sums to 100, or to 200 if the node's own histogram is added. The row of a
    node without position, normal or neighbour is NaN.
    """
    config = config or FpfhConfig()
    points, unit = as_oriented(points_m, normals)
    near = find_neighbours(points, config.radius_m)
    oriented = np.concatenate([points, unit], axis=1)
    simple, pairs = _simplified(oriented, near.start, near.node)
    return _weighted(simple, pairs, near, config.own_histogram)


@njit(cache=True)
def _simplified(oriented: np.ndarray, start: np.ndarray, node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the simplified histograms (n, 40) float32, and the number of pairs (n,) int32 of each node.

    A pair is a node and a neighbour. Each of the three histograms sums to 100; the columns from 33 on are empty. Each
    pair is computed once for both of its nodes, since both have the same angles.
    """
    simple, pairs = np.zeros((len(oriented), _PADDED), np.float32), np.zeros(len(oriented), np.int32)
    longest = 0
    for p in range(len(oriented)):
        longest = max(longest, start[p + 1] - start[p])
    others, bins = np.empty(longest + 1, np.uint32), np.empty((3, longest + 1), np.int32)
    for p in range(len(oriented)):
        count = 0
        for m in range(start[p], start[p + 1]):
            q = node[m]
            others[count] = q
            both = np.isfinite(oriented[p, 3]) & np.isfinite(oriented[q, 3])
            count += both & (q > p)
        _pair_bins(oriented, p, others, count, bins)
        for c in range(count):
            q = others[c]
            for angle in range(3):
                column = angle * BINS + bins[angle, c]
                simple[p, column] += ONE
                simple[q, column] += ONE
            pairs[q] += 1
        pairs[p] += count
    for p in range(len(oriented)):
        share = _FULL / np.float32(max(pairs[p], 1))
        for column in range(_PADDED):
            simple[p, column] *= share
    return simple, pairs


@njit(cache=True, error_model="numpy")
def _pair_bins(oriented: np.ndarray, p: int, others: np.ndarray, count: int, bins: np.ndarray) -> None:
    """Fill bins (3, count): for each of the three angles, the bin of each pair of node p and one of ``others``.

    The angles are defined as by Rusu et al. 2009, in Darboux's frame at the node whose normal n has the smaller angle
    with the direction d between the two nodes. With unit normals, v = d x n / |d x n| and w = n x v, all angles follow
    from products of d, n and the other normal.
    """
    x, y, z = oriented[p, 0], oriented[p, 1], oriented[p, 2]
    nx, ny, nz = oriented[p, 3], oriented[p, 4], oriented[p, 5]
    for c in range(count):
        q = others[c]
        dx, dy, dz = oriented[q, 0] - x, oriented[q, 1] - y, oriented[q, 2] - z
        mx, my, mz = oriented[q, 3], oriented[q, 4], oriented[q, 5]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        shorten = ONE / (length if length > ZERO else ONE)
        dx, dy, dz = dx * shorten, dy * shorten, dz * shorten
        here, there = nx * dx + ny * dy + nz * dz, mx * dx + my * dy + mz * dz
        from_other = abs(here) < abs(there)
        tilt = -there if from_other else here
        other = -here if from_other else there
        cosine = nx * mx + ny * my + nz * mz
        twist = dx * (ny * mz - nz * my) + dy * (nz * mx - nx * mz) + dz * (nx * my - ny * mx)
        sine2 = ONE - tilt * tilt
        defined = (length > ZERO) & (sine2 > _DEGENERATE)
        sine = np.sqrt(sine2 if defined else ONE)
        theta = angle_of(other - tilt * cosine, cosine * sine)
        alpha, phi = (twist / sine if defined else ZERO), (tilt if defined else ZERO)
        theta = theta if defined else ZERO
        first = np.int32(_BINS * ((theta + PI) / _TWO_PI))
        second, third = np.int32(_BINS * ((alpha + ONE) * _HALF)), np.int32(_BINS * ((phi + ONE) * _HALF))
        bins[0, c] = min(max(first, 0), BINS - 1)
        bins[1, c] = min(max(second, 0), BINS - 1)
        bins[2, c] = min(max(third, 0), BINS - 1)


@njit(cache=True, error_model="numpy")
def _weighted(simple: np.ndarray, pairs: np.ndarray, near: Neighbours, own: bool) -> np.ndarray:
    """Return the descriptors (n, 33): sums of the neighbours' histograms, weighted by inverse squared distance.

    Each of the three histograms is scaled to sum to 100.
    """
    start, node, distance2 = near.start, near.node, near.distance2_m2
    result, mixed = np.empty((len(simple), SIZE), np.float32), np.empty(_PADDED, np.float32)
    for p in range(len(simple)):
        mixed[:] = ZERO
        for m in range(start[p], start[p + 1]):
            weight = ONE / distance2[m] if distance2[m] > ZERO else ZERO
            row = simple[np.uint32(node[m])]
            for column in range(_PADDED):
                mixed[column] += weight * row[column]
        for angle in range(3):
            total = ZERO
            for column in range(angle * BINS, (angle + 1) * BINS):
                total += mixed[column]
            share = _FULL / total if total > ZERO and pairs[p] > 0 else np.float32(np.nan)
            for column in range(angle * BINS, (angle + 1) * BINS):
                result[p, column] = mixed[column] * share + (simple[p, column] if own else ZERO)
    return result
