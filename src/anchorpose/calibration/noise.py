"""What the depth frames of one camera show by themselves: how noisy they are, and what stays in place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

MAD_OF_NORMAL: Final = 0.6745  # median of |x| of a standard normal
STAYS_SHARE: Final = 0.3  # of the frames: a surface read so often is the room, even where people stand in front of it
SAME_M, SAME_SIGMAS = 0.02, 3.0  # readings of one surface differ by less


def noise_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Factor a of the sensor's noise law sigma(z) = a z^2 (unit 1/m), from second differences along rows.

    depths_m: depth frames (height, width) float32, 0 = no reading. A plane has no second difference, so what is left
    is noise; medians ignore edges. The step of the grey values enters as the deviation of a uniform error.
    Source of the law: Khoshelham and Elberink 2012 (doi:10.3390/s120201437).
    Raises ValueError where no three neighbouring pixels have a reading.
    """
    ratios = []
    for depth in depths_m:
        depth = depth.astype(np.float64)
        left, middle, right = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
        seen = (left > 0) & (middle > 0) & (right > 0)
        ratios.append(np.abs(left - 2 * middle + right)[seen] / middle[seen] ** 2)
    every = np.concatenate(ratios) if ratios else np.empty(0)
    if not every.size:
        raise ValueError("no three neighbouring pixels have a reading: the noise cannot be measured")
    white = float(np.median(every)) / (MAD_OF_NORMAL * np.sqrt(6.0))
    return float(np.hypot(white, step_per_m(depths_m) / np.sqrt(12.0)))


def step_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Factor of the step between neighbouring grey values, ``step_per_m z^2`` (unit 1/m); 0 where there is one value.

    depths_m: as for ``noise_per_m``. Cameras that measure disparity have steps that grow with the square of distance.
    """
    steps = []
    for depth in depths_m:
        values = np.unique(depth[depth > 0].astype(np.float64))
        if len(values) > 1:
            steps.append(np.median(np.diff(values) / values[1:] ** 2))
    return float(np.median(steps)) if steps else 0.0


def what_stays(frames_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """(height, width) float32: per pixel, the farthest surface that is read in ``STAYS_SHARE`` of the frames.

    frames_m (n, height, width), 0 = no reading. People stand in front of the room, never behind it; an edge pixel of a
    bar, which reads sometimes the bar and sometimes what is behind it, counts as bar if it reads the bar most of the
    time. 0 where less than that share of the frames has a reading.
    """
    if len(frames_m) == 1:
        return frames_m[0]
    rising = np.sort(frames_m, axis=0)
    count = (rising > 0).sum(axis=0)
    needed = np.maximum(np.ceil(STAYS_SHARE * np.maximum(count, 1)).astype(np.int64), 1)
    level = np.take_along_axis(rising, (len(rising) - needed)[None], axis=0)[0]
    near = np.abs(rising - level) < SAME_M + SAME_SIGMAS * noise_per_m * level**2
    near &= rising > 0
    total = np.where(near, rising, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return np.where(count >= STAYS_SHARE * len(frames_m), total, 0.0).astype(np.float32)
