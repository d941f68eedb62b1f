"""Clean a depth frame before it is meshed: estimate its noise, smooth it without blurring edges, drop flying pixels.

Raw sensor noise lengthens geodesics (the shortest paths along the surface) by about a tenth. All computation is limited
to the patient's pixels, a tenth of the frame.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit

MAD_TO_SIGMA: Final = 1.4826  # factor from median absolute deviation to standard deviation of a normal distribution
SECOND_DIFFERENCE_GAIN: Final = 6.0**0.5  # standard deviation of z[-1] - 2 z[0] + z[1], divided by that of z
# largest step between grey values of a depth image, divided by depth; a larger difference between readings is an edge
# of the body
MAX_STEP: Final = 0.02
# maximum share of readings that equal the reading two pixels further in the row; if more are equal, readings differ by
# whole grey values, not by noise
QUANTISED_SHARE: Final = 0.3
# sigmas of the noise; a neighbour whose depth differs from the centre pixel's by more has no weight. The limit is twice
# the usual 3 sigmas, since the centre pixel is noisy, too
RANGE_SIGMAS: Final = 6.0
# degrees, maximum slant of a surface whose neighbouring pixels are connected; steeper skin is few pixels wide, and at
# the edge of an arm the depth jumps by more than on such a slope
MAX_SLANT_DEG: Final = 76.0
# sigmas of the raw noise, allowance for noise in the jump limit (the largest depth difference between neighbouring
# pixels on the same skin). Beside an edge, smoothing halves the noise, so two sigmas of raw noise are about four sigmas
# of the smoothed depth
JUMP_SIGMAS: Final = 2.0


def estimate_noise(depth_m: np.ndarray, mask: np.ndarray) -> float:
    """Return the noise coefficient a: a reading at depth z has a standard deviation of about ``a * z**2`` metres.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool: the pixels to use. The coefficient is
    computed from the median of the absolute second differences along rows, which edges hardly affect. If the image is
    coarse (many readings are equal, ``QUANTISED_SHARE``), the coefficient is at least half the depth step between grey
    values, divided by z**2. The coefficient is 0 for a frame without noise or without three neighbouring readings in a
    row.
    """
    bend, step, step_per_z2 = _differences(depth_m, mask)
    if len(bend) == 0:
        return 0.0
    noise = MAD_TO_SIGMA * float(np.median(bend)) / SECOND_DIFFERENCE_GAIN
    if np.count_nonzero(step == 0) > QUANTISED_SHARE * len(step):
        stepped = step_per_z2[(step > 0) & (step <= MAX_STEP)]
        if len(stepped) > 0:
            return max(noise, float(np.median(stepped)) / 2.0)  # half a step is the largest rounding error
    return noise


def denoise(depth_m: np.ndarray, mask: np.ndarray, noise: float | None = None, radius_px: int = 2) -> np.ndarray:
    """Smooth the masked depth by a bilateral filter; pixels outside the mask or without a reading are 0.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool. noise: coefficient of ``estimate_noise``,
    estimated here when None; radius_px: radius of the window. Return (height, width) float32 metres. Source: Tomasi and
    Manduchi 1998 (doi:10.1109/ICCV.1998.710815), with Tukey's biweight as range kernel.
    """
    if depth_m.shape != mask.shape:
        raise ValueError(f"depth is {depth_m.shape}, mask is {mask.shape}")
    if noise is None:
        noise = estimate_noise(depth_m, mask)
    top, bottom, left, right = extent(mask)
    inside = np.s_[top:bottom, left:right]
    masked = np.zeros(depth_m.shape, np.float32)
    masked[inside] = np.where(mask[inside], depth_m[inside], 0.0)
    if noise <= 0:
        return masked
    return _bilateral(masked, np.float32(noise * RANGE_SIGMAS), _spatial(radius_px), top, bottom, left, right)


def jump_coefficients(focal_px: float, noise: float) -> tuple[float, float]:
    """Return (slope, spread) of the jump limit: neighbouring pixels at depth z are on the same skin if their depths
    differ by at most ``slope * z + spread * z**2``.
    """
    return float(np.tan(np.radians(MAX_SLANT_DEG))) / focal_px, JUMP_SIGMAS * noise


def drop_flying_pixels(depth_m: np.ndarray, slope: float, spread: float, min_support: int) -> np.ndarray:
    """Return the depth without flying pixels, whose readings lie between two surfaces.

    depth_m (height, width) float32 metres, 0 = no reading. A pixel stays if the depth of at least ``min_support`` of
    its eight neighbours is within the jump limit (``jump_coefficients``).
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    return _supported(depth, np.float32(slope), np.float32(spread), min_support, *extent(depth > 0))


@njit(cache=True, nogil=True)
def extent(mask: np.ndarray) -> tuple:
    """Return the bounding box (top, bottom, left, right) of the True entries of (height, width) bool. Bottom and right
    are one past the last entry; all are 0 without a True entry.
    """
    height, width = mask.shape
    columns = np.zeros(width, np.uint8)
    top, bottom = height, 0
    for row in range(height):
        inked = np.uint8(0)
        for col in range(width):
            hit = np.uint8(mask[row, col])
            columns[col] |= hit
            inked |= hit
        if inked:
            top, bottom = min(top, row), row + 1
    if bottom == 0:
        return 0, 0, 0, 0
    left, right = 0, width
    while columns[left] == 0:
        left += 1
    while columns[right - 1] == 0:
        right -= 1
    return top, bottom, left, right


@njit(cache=True, nogil=True)
def _span(depth: np.ndarray, row: int, left: int, right: int) -> tuple:
    """Return (first, last) of the positive entries of a row between two columns; last is one past the last entry. Both
    are ``right`` if no entry is positive.
    """
    while left < right and not depth[row, left] > 0:
        left += 1
    if left == right:
        return right, right
    while not depth[row, right - 1] > 0:
        right -= 1
    return left, right


def _spatial(radius: int) -> np.ndarray:
    """Return (side, side) float32 Gaussian weights; their standard deviation is half of the window's width."""
    across = np.arange(-radius, radius + 1) ** 2
    return np.exp(-0.5 * (across[:, None] + across) / (0.5 * len(across)) ** 2).astype(np.float32)


def _differences(depth: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three arrays (k,), with one value for every three neighbouring readings a, z, b of a row. They are the
    second difference ``|a - 2 z + b| / z**2``, and the differences ``|b - a| / z`` and ``|b - a| / z**2``.
    """
    top, bottom, left, right = extent(mask)
    inside = np.s_[top:bottom, left:right]
    reading = np.where(mask[inside], depth[inside], 0.0)
    near, middle, far = reading[:, :-2], reading[:, 1:-1], reading[:, 2:]
    whole = (near > 0.0) & (middle > 0.0) & (far > 0.0)
    near, z, far = (part[whole].astype(np.float64) for part in (near, middle, far))
    return abs(near - 2.0 * z + far) / z**2, abs(far - z) / z, abs(far - z) / z**2


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _bilateral(
    depth: np.ndarray, reach: Any, spatial: np.ndarray, top: int, bottom: int, left: int, right: int
) -> np.ndarray:
    """Return the depth smoothed by the bilateral filter, computed row by row and, within a row, neighbour by neighbour.
    reach: neighbours whose depth differs from a pixel's depth z by more than ``reach * z**2`` have the weight 0.
    """
    radius, width = len(spatial) // 2, depth.shape[1]
    smooth = np.zeros_like(depth)
    inverse, total, weights = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for row in range(top, bottom):
        first, last = _span(depth, row, left, right)
        for col in range(first, last):
            inverse[col] = np.float32(1.0) / (reach * depth[row, col] * depth[row, col])
            total[col], weights[col] = 0.0, 0.0
        for i in range(max(0, row - radius), min(depth.shape[0], row + radius + 1)):
            for j in range(-radius, radius + 1):
                low, high = max(first, -j), min(last, width - j)
                near = spatial[i - row + radius, j + radius]
                count = np.uint64(max(high - low, 0))
                own, tap = (np.uint64(row), np.uint64(low)), (np.uint64(i), np.uint64(low + j))
                _add_tap(depth, own, tap, count, near, inverse, total, weights)
        for col in range(first, last):
            if depth[row, col] > 0.0:
                smooth[row, col] = depth[row, col] + total[col] / weights[col]
    return smooth


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _add_tap(
    depth: np.ndarray,
    own_place: Any,
    tap_place: Any,
    count: Any,
    near: Any,
    inverse: np.ndarray,
    total: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Add one neighbour of each pixel of a row, at the same offset for all pixels, to the pixel's sums of weights and
    of weighted depth differences.

    own_place, tap_place: row and column of the first pixel, and of its neighbour. Indices are unsigned: for signed
    indices, the compiled code would first test whether an index is negative and so counts from the end of the array.
    """
    row, at = own_place
    i, there = tap_place
    zero, one = np.float32(0.0), np.float32(1.0)
    for k in range(count):
        z = depth[i, there + k]
        offset = z - depth[row, at + k]
        share = offset * inverse[at + k]
        closeness = max(one - share * share, zero)
        weight = closeness * closeness * near if z > zero else zero
        total[at + k] += weight * offset
        weights[at + k] += weight


@njit(cache=True, nogil=True)
def _supported(
    depth: np.ndarray, slope: Any, spread: Any, min_support: int, top: int, bottom: int, left: int, right: int
) -> np.ndarray:
    kept, width = np.zeros_like(depth), depth.shape[1]
    limit, support = np.empty(width, np.float32), np.empty(width, np.int32)
    for row in range(top, bottom):
        first, last = _span(depth, row, left, right)
        for col in range(first, last):
            limit[col] = slope * depth[row, col] + spread * depth[row, col] * depth[row, col]
            support[col] = -1  # leave out the pixel itself
        for i in range(max(0, row - 1), min(depth.shape[0], row + 2)):
            for j in range(-1, 2):
                low, high = max(first, -j), min(last, width - j)
                count = np.uint64(max(high - low, 0))
                _count_tap(
                    depth, np.uint64(row), np.uint64(i), np.uint64(low), np.uint64(low + j), count, limit, support
                )
        for col in range(first, last):
            if depth[row, col] > 0.0 and support[col] >= min_support:
                kept[row, col] = depth[row, col]
    return kept


@njit(cache=True, nogil=True)
def _count_tap(
    depth: np.ndarray, row: Any, i: Any, at: Any, there: Any, count: Any, limit: np.ndarray, support: np.ndarray
) -> None:
    """Add 1 to ``support`` at each pixel of a row whose depth differs by at most ``limit`` from the depth of its
    neighbour at an offset that is the same for all pixels. row, at: row and column of the first pixel; i, there: row
    and column of its neighbour; all are unsigned, as in ``_add_tap``.
    """
    for k in range(count):
        z = depth[i, there + k]
        support[at + k] += np.int32((z > np.float32(0.0)) & (abs(z - depth[row, at + k]) <= limit[at + k]))
