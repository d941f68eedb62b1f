"""Whether a depth image is a measurement, by its content alone.

A sensor that is blinded, covered or broken still delivers whole files. What they hold does not look like any scene: no
readings, one value everywhere, or neighbours that have nothing in common. Such an image is left out like one that was
never delivered. Nothing here is a prediction: the laws hold for every room and every pose.
"""

from __future__ import annotations

from typing import Final

import numpy as np

FARTHEST_M: Final = 20.0
"""No depth camera for indoor use measures farther: such a value is an error code, or light from outside."""

SATURATED: Final = np.iinfo(np.uint16).max  # the largest value that the file can hold is a code, not a distance
ROWS: Final = 128  # that are looked at, evenly spaced: surfaces are many rows high
LEAST_READ: Final = 0.001  # of the pixels; a person alone, who is far away, fills 0.03 of them
ENOUGH: Final = 4000  # readings: in fewer, chance may look like anything, and a drawing like a clipped image
MOST_ALIKE: Final = 0.98  # of the readings with one value; a whole body on a coarse scale has 0.3
LEAST_BESIDE: Final = 0.5  # of the readings with one beside them in the row; 0.93 and more in real images
JUMP: Final = 0.1  # of the distance: more than any surface that is not seen edge-on changes from pixel to pixel
MOST_JUMPS: Final = 0.25  # of neighbouring readings; 0.03 at most in real images of cluttered rooms


def measured_m(grey: np.ndarray, depth_scale: float) -> np.ndarray:
    """(height, width) float32 metres of grey values (height, width) uint16; 0 where there is no measurement.

    That is no reading, the largest value of the file, and all that is beyond ``FARTHEST_M``.
    """
    depth_m = grey.astype(np.float32) * np.float32(depth_scale)
    depth_m[(grey == SATURATED) | (depth_m > FARTHEST_M)] = 0.0
    return depth_m


def content_problem(grey: np.ndarray, depth_m: np.ndarray) -> str:
    """Why an image is not a measurement, as the end of a sentence that begins with its name; empty where it may be one.

    grey (height, width) uint16 as the file has it; depth_m (height, width) float32 metres of it, 0 = no reading.
    """
    step = max(1, len(depth_m) // ROWS)
    values, rows = grey[::step], depth_m[::step]
    read = rows > 0
    count = int(np.count_nonzero(read))
    beside = read[:, :-1] & read[:, 1:]
    if count <= LEAST_READ * rows.size or not _three_in_a_row(read):
        lost = int(np.count_nonzero((values > 0) & ~read))
        return "is saturated or beyond the range of the camera" if 2 * lost > rows.size else "holds no readings"
    if count < ENOUGH:
        return ""
    if int(np.bincount(values[read]).max()) > MOST_ALIKE * count:
        return "has the same value nearly everywhere, so that the sensor was blinded or its values are clipped"
    near, next_to = rows[:, :-1][beside], rows[:, 1:][beside]
    jumps = int(np.count_nonzero(np.abs(near - next_to) > JUMP * np.minimum(near, next_to)))
    if len(near) < LEAST_BESIDE * count or jumps > MOST_JUMPS * len(near):
        return "is noise: neighbouring readings have nothing in common"
    return ""


def _three_in_a_row(read: np.ndarray) -> bool:
    """Whether three neighbouring pixels have a reading anywhere: without them there is no surface."""
    return bool((read[:, :-2] & read[:, 1:-1] & read[:, 2:]).any())
