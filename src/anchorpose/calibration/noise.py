"""How noisy a depth camera is, measured on its own pictures: sigma = noise_per_m * z^2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

MAD_OF_NORMAL = 0.6745  # median of |x| of a standard normal


def noise_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Factor a of the sensor's noise law sigma(z) = a z^2 (unit 1/m), from second differences along rows.

    depths_m: pictures (height, width) float32, 0 = no reading. A plane has no second difference, so what is left is
    noise; medians pass over edges. The grey value's step enters as the deviation of a uniform error.
    Source of the law: Khoshelham and Elberink 2012 (doi:10.3390/s120201437).
    Raises ValueError where no three neighbouring pixels have a reading.
    """
    ratios, steps = [], []
    for depth in depths_m:
        depth = depth.astype(np.float64)
        left, middle, right = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
        seen = (left > 0) & (middle > 0) & (right > 0)
        ratios.append(np.abs(left - 2 * middle + right)[seen] / middle[seen] ** 2)
        values = np.unique(depth[depth > 0])
        if len(values) > 1:
            steps.append(np.median(np.diff(values) / values[1:] ** 2))
    every = np.concatenate(ratios) if ratios else np.empty(0)
    if not every.size:
        raise ValueError("no three neighbouring pixels have a reading: the noise cannot be measured")
    white = float(np.median(every)) / (MAD_OF_NORMAL * np.sqrt(6.0))
    step = float(np.median(steps)) / np.sqrt(12.0) if steps else 0.0
    return float(np.hypot(white, step))
