"""Edge-preserving smoothing of the depth picture, scaled by the noise the frame itself shows.

Raw sensor noise lengthens geodesics by about a tenth; smoothing comes before anything that measures the surface.

Where in the picture there is anything to do: the patient fills a tenth of it, and looking elsewhere costs time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True)
def extent(mask: np.ndarray) -> tuple:
    """(top, bottom, left, right), past the last, of the positive entries of (height, width); all 0 without any."""
    height, width = mask.shape
    columns = np.zeros(width, np.uint8)
    top, bottom = height, 0
    for row in range(height):
        inked = np.uint8(0)
        for col in range(width):
            hit = np.uint8(mask[row, col] > 0)
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


@njit(cache=True)
def span(mask: np.ndarray, row: int, left: int, right: int) -> tuple:
    """(first, last), past the last, of the nonzero entries of a row between two columns; (right, right) for none."""
    while left < right and not mask[row, left] > 0:
        left += 1
    if left == right:
        return right, right
    while not mask[row, right - 1] > 0:
        right -= 1
    return left, right


MAD_TO_SIGMA = 1.4826  # median absolute deviation of a normal distribution to its standard deviation
SECOND_DIFFERENCE_GAIN = 6.0**0.5  # standard deviation of z[-1] - 2 z[0] + z[1] over that of z


@dataclass(frozen=True, slots=True, kw_only=True)
class DenoiseConfig:
    """How far the smoothing reaches, in pixels and in noise standard deviations."""

    radius_px: int = 2  # a 5x5 window: below the width of a finger at 2.4 m, enough to bring path error to about 1 %
    range_sigmas: float = 6.0  # where the biweight ends; twice the usual 3 because the centre pixel is as noisy
    max_step: float = 0.02  # of the depth: coarser steps than any sensor's are edges of the body, not of its numbers
    quantised_share: float = 0.3  # equal neighbours beyond this share mean the depth steps, not the noise, are seen

    def __post_init__(self) -> None:
        if self.radius_px < 1:
            raise ValueError(f"radius_px must be at least 1, got {self.radius_px}")
        if not self.range_sigmas > 0:
            raise ValueError(f"range_sigmas must be positive, got {self.range_sigmas}")
        for name in ("max_step", "quantised_share"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie in (0, 1], got {getattr(self, name)}")


def estimate_noise(depth_m: np.ndarray, mask: np.ndarray, config: DenoiseConfig | None = None) -> float:
    """Noise coefficient a of the frame: a reading at depth z has a standard deviation of about ``a * z**2`` metres.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool, the pixels to look at. The robust spread
    of second differences along rows, or the height of the depth steps where those exceed the noise. 0 for a frame
    without noise or with fewer than three readings in a row anywhere.
    """
    config = config or DenoiseConfig()
    bend, step = _differences(depth_m, mask, *extent(mask))
    if len(bend) == 0:
        return 0.0
    noise = MAD_TO_SIGMA * float(np.median(bend)) / SECOND_DIFFERENCE_GAIN
    if np.count_nonzero(step[:, 0] == 0) > config.quantised_share * len(step):
        stepped = step[(step[:, 0] > 0) & (step[:, 0] <= config.max_step), 1]
        if len(stepped) > 0:
            return max(noise, float(np.median(stepped)) / 2.0)  # what quantising hides each way
    return noise


def denoise(
    depth_m: np.ndarray, mask: np.ndarray, noise: float | None = None, config: DenoiseConfig | None = None
) -> np.ndarray:
    """Bilateral filter of the masked depth; pixels outside the mask or without reading are 0.

    depth_m (height, width) metres, 0 = no reading; mask (height, width) bool. noise: coefficient of
    ``estimate_noise``, estimated here when None. Returns (height, width) float32 metres.
    Source: Tomasi and Manduchi 1998 (doi:10.1109/ICCV.1998.710815), with Tukey's biweight as range kernel.
    """
    config = config or DenoiseConfig()
    if depth_m.shape != mask.shape:
        raise ValueError(f"depth is {depth_m.shape}, mask is {mask.shape}")
    if noise is None:
        noise = estimate_noise(depth_m, mask, config)
    box = extent(mask)
    masked = np.zeros(depth_m.shape, np.float32)
    _copy_masked(depth_m, mask, masked, *box)
    if noise <= 0:
        return masked
    return _bilateral(masked, np.float32(noise * config.range_sigmas), _spatial(config.radius_px), *box)


def _spatial(radius: int) -> np.ndarray:
    """(side, side) float32 Gaussian weights whose spread is half the window."""
    across = np.arange(-radius, radius + 1) ** 2
    return np.exp(-0.5 * (across[:, None] + across) / (0.5 * len(across)) ** 2).astype(np.float32)


@njit(cache=True)
def _copy_masked(
    depth: np.ndarray, mask: np.ndarray, masked: np.ndarray, top: int, bottom: int, left: int, right: int
) -> None:
    for row in range(top, bottom):
        for col in range(np.uint64(left), np.uint64(right)):
            masked[row, col] = depth[row, col] if mask[row, col] else 0.0


@njit(cache=True, error_model="numpy")
def _differences(depth: np.ndarray, mask: np.ndarray, top: int, bottom: int, left: int, right: int) -> tuple:
    """Of three readings in a row about z: (k,) second difference over z**2; (k, 2) step over z and over z**2."""
    bend = np.empty(max((bottom - top) * (right - left), 0))
    step = np.empty((len(bend), 2))
    count = 0
    for row in range(top, bottom):
        for col in range(left + 1, right - 1):
            near, z, far = np.float64(depth[row, col - 1]), np.float64(depth[row, col]), np.float64(depth[row, col + 1])
            if mask[row, col - 1] and mask[row, col] and mask[row, col + 1] and near > 0.0 and z > 0.0 and far > 0.0:
                bend[count] = abs(near - 2.0 * z + far) / z**2
                step[count, 0] = abs(far - z) / z
                step[count, 1] = abs(far - z) / z**2
                count += 1
    return bend[:count], step[:count]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def _bilateral(
    depth: np.ndarray, reach: Any, spatial: np.ndarray, top: int, bottom: int, left: int, right: int
) -> np.ndarray:
    """reach: where the biweight ends, metres per squared metre of depth. A row at once, neighbour by neighbour."""
    radius, width = len(spatial) // 2, depth.shape[1]
    smooth = np.zeros_like(depth)
    inverse, total, weights = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for row in range(top, bottom):
        first, last = span(depth, row, left, right)
        for col in range(first, last):
            inverse[col] = np.float32(1.0) / (reach * depth[row, col] * depth[row, col])
            total[col], weights[col] = 0.0, 0.0
        for i in range(max(0, row - radius), min(depth.shape[0], row + radius + 1)):
            for j in range(-radius, radius + 1):
                low, high = max(first, -j), min(last, width - j)
                near = spatial[i - row + radius, j + radius]
                _add_tap(
                    depth, np.uint64(row), np.uint64(i), np.uint64(low), np.uint64(low + j),
                    np.uint64(max(high - low, 0)), near, inverse, total, weights,
                )  # fmt: skip
        for col in range(first, last):
            if depth[row, col] > 0.0:
                smooth[row, col] = depth[row, col] + total[col] / weights[col]
    return smooth


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def _add_tap(
    depth: np.ndarray, row: Any, i: Any, at: Any, there: Any, count: Any, near: Any, inverse: np.ndarray,
    total: np.ndarray, weights: np.ndarray,
) -> None:  # fmt: skip
    """One neighbour of each pixel of a row; unsigned, so that no index can mean one from the end."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for k in range(count):
        z = depth[i, there + k]
        offset = z - depth[row, at + k]
        share = offset * inverse[at + k]
        closeness = max(one - share * share, zero)
        weight = closeness * closeness * near if z > zero else zero
        total[at + k] += weight * offset
        weights[at + k] += weight
