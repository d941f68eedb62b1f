"""Depth in metres as floating-point numbers, to grey values."""

from __future__ import annotations

from typing import Final

import numpy as np

_LARGEST: Final = 65534  # 65535 stands for no reading in some formats
_SCALES: Final = (0.00025, 0.0005, 0.001)  # metres; up to 16, 33 and 65 m. The first is finer than any depth camera
_WHOLE_MM: Final = 0.01  # of a millimetre: float32 is that exact up to 65 m
_SPARE: Final = 1.25  # how much farther than the first image later ones may see

GREY_M: Final = _SCALES[0]
"""A grey value where only reading all of a file would tell how far it sees: 16.4 m, rounded to an eighth of a
millimetre at most."""


def scale_of(metres: np.ndarray) -> float | None:
    """Metres per grey value that keep an image: a millimetre where all are whole millimetres; None without a reading.

    Otherwise the finest of a few that reaches a quarter farther than the image does.
    """
    given = metres[np.isfinite(metres)].astype(np.float64)
    if given.size == 0:
        return None
    if np.abs(given * 1000.0 - np.round(given * 1000.0)).max() < _WHOLE_MM:
        return 0.001
    return next((scale for scale in _SCALES if given.max() * _SPARE <= _LARGEST * scale), _SCALES[-1])


def grey_of_metres(metres: np.ndarray, scale: float) -> tuple[np.ndarray, int]:
    """(height, width) uint16, 0 = no reading, and how many readings are too far for the scale: they are 0."""
    with np.errstate(invalid="ignore"):
        grey = np.round(metres.astype(np.float64) / scale)
    too_far = np.isfinite(grey) & (grey > _LARGEST)
    grey[~np.isfinite(grey) | too_far | (grey < 0.0)] = 0.0
    return grey.astype(np.uint16), int(too_far.sum())


def to_grey(depth_m: np.ndarray) -> np.ndarray:
    """(height, width) metres to uint16 in steps of ``GREY_M``; 0 where there is no reading, and beyond 16.4 m."""
    return grey_of_metres(np.asarray(depth_m), GREY_M)[0]
