"""Where in the picture there is anything to do: the patient fills a tenth of it, and looking elsewhere costs time."""

from __future__ import annotations

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
