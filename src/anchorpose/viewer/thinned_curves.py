"""Angle curves with no more points than a screen shows; where the frames are fewer, all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.results.frame_table import StoredFrames
from anchorpose.results.tables import AngleTable

INTERVALS: Final = 800
"""Of the time that is drawn: a chart is some 400 pixels wide."""

KEPT: Final = 5
"""Frames of an interval at most, per angle: the least and the largest value, the widest sigma, the first frame in which
the angle is unknown and the first in which it is inferred. So no peak, no gap and no inferred frame disappears."""

AT_ONCE: Final = 2048  # frames


@dataclass(frozen=True, slots=True, eq=False)
class ThinnedCurves:
    """The points of all angles, one angle after the other, each in the order of time.

    start (a + 1,) int32: where each angle's points begin. row (m,) int32 of the results' frames, degrees and sigma_deg
    (m,) float32, state (m,) uint8: as in that very frame.
    """

    start: np.ndarray
    row: np.ndarray
    degrees: np.ndarray
    sigma_deg: np.ndarray
    state: np.ndarray


def thin_curves(angles: StoredFrames[AngleTable], first: int, stop: int) -> ThinnedCurves:
    """The frames from row ``first`` to row ``stop``."""
    size = max(1, (stop - first) // INTERVALS)  # frames in an interval
    size = 1 if size <= KEPT else size
    found: list[list[tuple[np.ndarray, ...]]] = [[] for _ in angles.names]
    step = max(1, AT_ONCE // size) * size
    for begin in range(first, stop, step):
        table = angles.rows(begin, min(begin + step, stop))
        for number, kept in enumerate(_kept(table, size)):
            values = (table.degrees[kept, number], table.sigma_deg[kept, number], table.state_code[kept, number])
            found[number].append((begin + kept, *values))
    curves = [[np.concatenate(part) for part in zip(*parts, strict=True)] for parts in found]
    joined = [np.concatenate(part) for part in zip(*curves, strict=True)] or [np.empty(0)] * 4
    return ThinnedCurves(
        start=np.cumsum([0, *(len(curve[0]) for curve in curves)]).astype(np.int32),
        row=joined[0].astype(np.int32),
        degrees=joined[1].astype(np.float32),
        sigma_deg=joined[2].astype(np.float32),
        state=joined[3].astype(np.uint8),
    )


def _kept(table: AngleTable, size: int) -> list[np.ndarray]:
    """For each angle the rows of the table that are kept, in their order."""
    count, angles = table.degrees.shape
    if size == 1:
        return [np.arange(count)] * angles
    unknown = _intervals(np.isnan(table.degrees), size, False)
    degrees = _intervals(table.degrees, size, np.nan)
    chosen = (
        np.where(np.isnan(degrees), np.inf, degrees).argmin(axis=1),
        np.where(np.isnan(degrees), -np.inf, degrees).argmax(axis=1),
        np.nan_to_num(_intervals(table.sigma_deg, size, np.nan), nan=-1.0).argmax(axis=1),
        unknown.argmax(axis=1),
        _intervals(table.state_code > 0, size, False).argmax(axis=1),
    )
    starts = size * np.arange(degrees.shape[0])[:, None]
    rows = np.minimum(np.stack([starts + each for each in chosen]), count - 1)  # (KEPT, intervals, angles)
    return [np.unique(rows[..., number]) for number in range(angles)]


def _intervals(values: np.ndarray, size: int, fill: float | bool) -> np.ndarray:
    """(intervals, size, angles) of values (n, angles); the last interval is filled up."""
    missing = -len(values) % size
    return np.pad(values, ((0, missing), (0, 0)), constant_values=fill).reshape(-1, size, values.shape[1])
