"""Grow regions: pixels without a clear owner join the person to whom they are connected, up to the nearest crease.

A valley is a strip of surface farther from the camera than the surface on both sides. A crease is a valley deeper than
noise causes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.isolation.ownership import NOBODY
from anchorpose.isolation.scene import Pieces

# additional cost of a step into a crease, for each standard deviation by which the crease is deeper than
# ``CREASE_SIGMAS``; a step to the next pixel outside creases costs 1
CREASE_COST: Final = 4.0
# pixels, the width of a finger at 2.5 m; a pixel's depth is compared with the depths this far away on both sides
CREASE_PX: Final = 3
CREASE_SIGMAS: Final = 2.0  # standard deviations of the noise; a valley deeper than this is a crease
# maximum additional cost of a step into a crease: as much as 60 steps outside creases, which is the length of a forearm
# in pixels
DEEPEST: Final = 60


def grow_regions(pixels: Pieces, owner: np.ndarray, crease_cost: float = CREASE_COST) -> np.ndarray:
    """Spread owners from decided to undecided pixels along the cheapest paths, until two owners' regions meet or the
    depth jumps.

    owner (n,) uint8: the person to whom each foreground pixel belongs, ``NOBODY`` if undecided. A step to the next
    pixel costs 1, and more in a valley, where the surface lies behind its neighbours on both sides: two bodies that
    touch meet in such a valley. Return (n,) uint8; ``NOBODY`` remains at pixels that are not connected to any owner.
    """
    limit, noise = pixels.sensor.jump_limit, float(np.sqrt(1.5)) * pixels.sensor.noise_per_m
    surface = _Surface(pixels.index, pixels.depth_m, pixels.row, pixels.column, limit.square, limit.slope, noise)
    grown = owner.copy()
    _grow(surface, grown, crease_cost)
    return grown


def smooth_contact_m(pixels: Pieces, owner: np.ndarray, count: int) -> np.ndarray:
    """Return (count, count) metres: length of the border across which the surfaces of two owners continue without a
    crease.

    owner (n,) int: the number of the owner of each foreground pixel, 0 to ``count`` - 1, or -1 = nobody. Two touching
    bodies meet in a crease; a border without a crease divides a single body.
    """
    limit, noise = pixels.sensor.jump_limit, float(np.sqrt(1.5)) * pixels.sensor.noise_per_m
    surface = _Surface(pixels.index, pixels.depth_m, pixels.row, pixels.column, limit.square, limit.slope, noise)
    size_per_m = np.sqrt(pixels.area_m2) / np.maximum(pixels.depth_m[pixels.row, pixels.column], 1e-6)
    return _contacts(surface, owner.astype(np.int64), size_per_m.astype(np.float64), count)


class _Surface(NamedTuple):
    """The fields of ``Pieces`` that region growing needs, and the sensor's limits for steps in depth."""

    number: np.ndarray  # the field ``index``
    depth: np.ndarray
    row: np.ndarray
    column: np.ndarray
    square: float
    slope: float
    noise: float  # 1/m; the standard deviation of a valley's depth is ``noise z^2``


class _Queue(NamedTuple):
    """The queue of Dijkstra's algorithm: pixels and their new owners, in a ring of buckets by cost; each bucket is a
    linked list.
    """

    head: np.ndarray  # (buckets,) the first entry of each bucket, -1 = none
    after: np.ndarray  # (capacity,) the entry that follows each entry in its bucket
    pixel: np.ndarray  # (capacity,) the pixel of each entry
    owner: np.ndarray  # (capacity,) the new owner of this pixel; ``NOBODY``: the pixel keeps its owner


@njit(cache=True, nogil=True)
def _push(queue: _Queue, used: int, bucket: int, pixel: int, owner: int) -> int:
    """Add an entry to a bucket; return the number of all entries ever added."""
    queue.pixel[used], queue.owner[used], queue.after[used] = pixel, owner, queue.head[bucket]
    queue.head[bucket] = used
    return used + 1


@njit(cache=True, nogil=True)
def _grow(surface: _Surface, owner: np.ndarray, crease_cost: float) -> None:
    """Write to ``owner`` the new owner of each pixel that is reached, by Dijkstra's algorithm with a ring of buckets;
    costs are whole numbers of steps.
    """
    ring = DEEPEST + 2
    owned = 0
    for pixel in range(len(owner)):
        owned += owner[pixel] != NOBODY
    capacity = 4 * (len(owner) - owned) + owned + 1
    after, pixels = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    queue = _Queue(np.full(ring, -1, np.int32), after, pixels, np.empty(capacity, np.uint8))
    used = 0
    for pixel in range(len(owner) - 1, -1, -1):
        if owner[pixel] != NOBODY and _beside_open(surface, owner, pixel):
            used = _push(queue, used, 0, pixel, NOBODY)
    level, left = 0, used
    while left > 0:
        bucket = level % ring
        while queue.head[bucket] >= 0:
            entry = queue.head[bucket]
            queue.head[bucket] = queue.after[entry]
            left -= 1
            pixel = queue.pixel[entry]
            if queue.owner[entry] != NOBODY:
                if owner[pixel] != NOBODY:
                    continue
                owner[pixel] = queue.owner[entry]
            for d_r, d_c in ((0, -1), (-1, 0), (0, 1), (1, 0)):
                other, steps = _step(surface, owner, pixel, d_r, d_c, crease_cost)
                if other >= 0:
                    used = _push(queue, used, (level + steps) % ring, other, owner[pixel])
                    left += 1
        level += 1


@njit(cache=True, nogil=True)
def _beside_open(surface: _Surface, owner: np.ndarray, pixel: int) -> bool:
    """Return whether any of a pixel's four neighbours is foreground without an owner."""
    height, width = surface.number.shape
    for d_r, d_c in ((0, -1), (-1, 0), (0, 1), (1, 0)):
        r, c = surface.row[pixel] + d_r, surface.column[pixel] + d_c
        if 0 <= r < height and 0 <= c < width:
            other = surface.number[r, c]
            if other >= 0 and owner[other] == NOBODY:
                return True
    return False


@njit(cache=True, nogil=True)
def _step(surface: _Surface, owner: np.ndarray, pixel: int, d_r: int, d_c: int, crease_cost: float) -> tuple[int, int]:
    """Return the number of a pixel's neighbour in a direction, and the cost of the step to this neighbour. The number
    is -1 if the region of the pixel's owner cannot grow there.
    """
    depth = surface.depth
    r, c = surface.row[pixel], surface.column[pixel]
    nr, nc = r + d_r, c + d_c
    if nr < 0 or nc < 0 or nr >= depth.shape[0] or nc >= depth.shape[1]:
        return -1, 0
    other = surface.number[nr, nc]
    if other < 0 or owner[other] != NOBODY:
        return -1, 0
    far = max(depth[r, c], depth[nr, nc])
    if abs(depth[r, c] - depth[nr, nc]) > surface.square * far * far + surface.slope * far:
        return -1, 0
    valley = _valley(surface.number, depth, nr, nc, d_r, d_c) / (surface.noise * far * far)
    return other, 1 + min(int(crease_cost * max(valley - CREASE_SIGMAS, 0.0)), DEEPEST)


@njit(cache=True, nogil=True)
def _valley(index: np.ndarray, depth: np.ndarray, r: int, c: int, d_r: int, d_c: int) -> float:
    """Return a pixel's depth minus the mean of the depths ``CREASE_PX`` pixels away in the direction (d_r, d_c) and in
    the opposite direction, metres; 0 if unknown.
    """
    height, width = index.shape
    r1, c1, r2, c2 = r - CREASE_PX * d_r, c - CREASE_PX * d_c, r + CREASE_PX * d_r, c + CREASE_PX * d_c
    if min(r1, r2, c1, c2) < 0 or max(r1, r2) >= height or max(c1, c2) >= width:
        return 0.0
    if index[r1, c1] < 0 or index[r2, c2] < 0:
        return 0.0
    return depth[r, c] - 0.5 * (depth[r1, c1] + depth[r2, c2])


@njit(cache=True, nogil=True)
def _contacts(surface: _Surface, owner: np.ndarray, size_per_m: np.ndarray, count: int) -> np.ndarray:
    """Compute ``smooth_contact_m``; size_per_m (n,): width of a pixel divided by its depth."""
    index, depth = surface.number, surface.depth
    length = np.zeros((count, count))
    for pixel in range(len(owner)):
        if owner[pixel] < 0:
            continue
        r, c = surface.row[pixel], surface.column[pixel]
        for d_r, d_c in ((0, 1), (1, 0)):
            nr, nc = r + d_r, c + d_c
            if nr >= depth.shape[0] or nc >= depth.shape[1]:
                continue
            other = index[nr, nc]
            if other < 0 or owner[other] < 0 or owner[other] == owner[pixel]:
                continue
            far = max(depth[r, c], depth[nr, nc])
            if abs(depth[r, c] - depth[nr, nc]) > surface.square * far * far + surface.slope * far:
                continue
            if _valley(index, depth, nr, nc, d_r, d_c) > CREASE_SIGMAS * surface.noise * far * far:
                continue
            length[owner[pixel], owner[other]] += size_per_m[pixel] * depth[r, c]
    return length + length.T
