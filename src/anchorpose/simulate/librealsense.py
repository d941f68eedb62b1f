"""Imitate librealsense's post-processing of depth: decimation, spatial and temporal smoothing.

Both smoothing filters work on disparity. They blend only values that differ by less than a threshold. Source: Intel
RealSense SDK 2.0, post-processing filters (spatial: Gastal and Oliveira 2011, doi:10.1145/1964921.1964964).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numba as nb
import numpy as np

from anchorpose.simulate.sensor import SensorSpec, sense

HALF: Final = 2  # pixels; each block of 2 x 2 pixels of the imager becomes one pixel of the image
# Recordings do not state the settings of the real filters; the values below blur a depth edge over 12 pixels, as in
# real recordings.
SMOOTHING: Final = 0.3  # weight of a pixel's own disparity; the previous pixel's result has the remaining weight
# pixels, maximum step of disparity that is smoothed; only surfaces nearer than 1.1 m can cause a greater step
JOINED_PX: Final = 25.0
PASSES: Final = 2  # number of passes of the spatial filter
FILLED_PX: Final = 16  # pixels, maximum distance into a gap that is filled with the last value before the gap
STEPS: Final = 8.0  # steps per pixel of disparity; the result is rounded to multiples of 1 / STEPS pixel
TEMPORAL: Final = 0.4  # weight of the newest frame; the blend of earlier frames has the remaining weight
STILL_PX: Final = 0.6  # pixels of disparity, maximum change of a pixel that is smoothed over time
MEMORY: Final = 4  # number of frames that are blended; older frames would have a weight below a tenth


def decimated_mm(rng: np.random.Generator, spec: SensorSpec, depth_m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return sensed depth (height, width) uint16 mm: each pixel is the median of 2 x 2 pixels of an imager that is
    twice as wide and high.
    """
    imager = replace(spec, width=HALF * spec.width, height=HALF * spec.height, focal_px=HALF * spec.focal_px)
    fine = [np.repeat(np.repeat(layer, HALF, axis=0), HALF, axis=1) for layer in (depth_m, cosine)]
    reading = sense(rng, imager, fine[0], fine[1], np.zeros_like(fine[0])).astype(np.float32)
    height, width = depth_m.shape
    fours = reading.reshape(height, HALF, width, HALF).transpose(0, 2, 1, 3).reshape(height, width, HALF * HALF)
    known = np.where(fours > 0, fours, np.nan)
    some = (fours > 0).any(axis=2)
    median = np.zeros((height, width))
    median[some] = np.nanmedian(known[some], axis=1)
    return median.astype(np.uint16)


def smoothed_mm(spec: SensorSpec, readings_mm: Sequence[np.ndarray]) -> np.ndarray:
    """Return the last of consecutive depth images (height, width) uint16 mm, smoothed in the image and over time."""
    gain = np.float32(HALF * spec.focal_px * spec.baseline_m * 1000.0)
    blended: np.ndarray | None = None
    for reading in readings_mm[-MEMORY:]:
        disparity = np.divide(gain, reading, out=np.zeros(reading.shape, np.float32), where=reading > 0)
        for _ in range(PASSES):
            for image in (disparity, disparity[:, ::-1], disparity.T, disparity[::-1].T):
                _smooth_rows(image, SMOOTHING, JOINED_PX, FILLED_PX)
        blended = disparity if blended is None else _blend(blended, disparity)
    if blended is None:
        raise ValueError("smoothing needs at least one depth image")
    rounded = np.rint(blended * STEPS) / STEPS
    return np.where(rounded > 0, np.rint(gain / np.maximum(rounded, 1e-3)), 0.0).clip(0, 65535).astype(np.uint16)


def _blend(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Blend the disparities of two frames. A pixel without a reading in ``now`` keeps its previous disparity."""
    still = (before > 0) & (now > 0) & (np.abs(before - now) < STILL_PX)
    mixed = np.where(still, TEMPORAL * now + (1.0 - TEMPORAL) * before, now)
    return np.where(now > 0, mixed, before).astype(np.float32)


@nb.njit(cache=True)
def _smooth_rows(disparity: np.ndarray, weight: float, joined: float, filled: int) -> None:
    """Smooth each row in place by a recursive filter. The first ``filled`` pixels of a gap get the last value before
    the gap. weight: weight of a pixel's own disparity (``SMOOTHING``); joined: maximum step of disparity, in pixels,
    that is smoothed (``JOINED_PX``).
    """
    for row in range(disparity.shape[0]):
        last, gap = disparity[row, 0], 0
        for column in range(1, disparity.shape[1]):
            value = disparity[row, column]
            if value > 0.0:
                if last > 0.0 and abs(value - last) < joined:
                    value = weight * value + (1.0 - weight) * last
                    disparity[row, column] = value
                last, gap = value, 0
            elif last > 0.0:
                gap += 1
                if gap <= filled:
                    disparity[row, column] = last
