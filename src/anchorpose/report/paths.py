"""Curves, bands and areas as SVG paths in whole units, from left to right and from the top down."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from anchorpose.report.axis import UNITS, Axis
from anchorpose.report.bins import Bins, Envelope

Points = list[tuple[int, int]]


def line_paths(curve: Envelope, seen: np.ndarray, bins: Bins, axis: Axis) -> tuple[str, str]:
    """The stretches whose groups are ``seen`` (b,) throughout, and the others; nothing is drawn across a gap."""
    across, first, second = _corners(curve, bins, axis)
    paths: dict[bool, list[str]] = {True: [], False: []}
    for start, stop in _runs(np.isfinite(curve.low), bins.after_pause):
        for begin, end, kind in _same_kind(seen, start, stop):
            points: Points = []
            for k in range(begin, end):
                points += [(across[k], first[k])] + ([(across[k], second[k])] if second[k] != first[k] else [])
            paths[kind].append(_trace(points))
    return "".join(paths[True]), "".join(paths[False])


def band_path(low: np.ndarray, high: np.ndarray, bins: Bins, axis: Axis) -> str:
    """A filled outline between two curves (b,), one for each stretch without a gap."""
    across = np.round(UNITS * bins.place).astype(int).tolist()
    finite = np.isfinite(low) & np.isfinite(high)
    top, bottom = (_whole(axis.down(np.where(finite, edge, axis.low))) for edge in (high, low))
    outlines = []
    for start, stop in _runs(finite, bins.after_pause):
        group = range(start, stop)
        outline = [(across[k], top[k]) for k in group] + [(across[k], bottom[k]) for k in reversed(group)]
        outlines.append(_trace(outline) + "z")
    return "".join(outlines)


def step_path(level: np.ndarray, bins: Bins) -> str:
    """Columns from the bottom up, each as wide as its group, ``level`` (b,) of the height; 0 draws nothing."""
    edge = np.round(UNITS * _edges(bins)).astype(int).tolist()
    height = np.round(UNITS * np.nan_to_num(level)).astype(int).tolist()  # a group without a value draws nothing
    parts, k = [], 0
    while k < len(height):
        end = k + 1
        while end < len(height) and height[end] == height[k] and not bins.after_pause[end]:
            end += 1
        right = edge[end] if end == len(height) or not bins.after_pause[end] else round(UNITS * bins.place[end - 1])
        if height[k] > 0:
            parts.append(f"M{edge[k]} {UNITS}v{-height[k]}h{max(1, right - edge[k])}v{height[k]}z")
        k = end
    return "".join(parts)


def _edges(bins: Bins) -> np.ndarray:
    """(b + 1,) where columns meet: halfway between neighbours, at a group's own place after a pause."""
    place = bins.place
    inner = np.where(bins.after_pause[1:], place[1:], (place[1:] + place[:-1]) / 2.0)
    return np.concatenate([[0.0], inner, [1.0]])


def _corners(curve: Envelope, bins: Bins, axis: Axis) -> tuple[list[int], list[int], list[int]]:
    finite = np.isfinite(curve.low)
    low, high = (np.where(finite, edge, axis.low) for edge in (curve.low, curve.high))
    first, second = np.where(curve.rising, low, high), np.where(curve.rising, high, low)
    return np.round(UNITS * bins.place).astype(int).tolist(), _whole(axis.down(first)), _whole(axis.down(second))


def _whole(values: np.ndarray) -> list[int]:
    return [int(value) for value in values]


def _runs(known: np.ndarray, after_pause: np.ndarray) -> Iterator[tuple[int, int]]:
    """(start, stop) of each stretch of known groups without a pause."""
    start = None
    for k, (here, paused) in enumerate(zip(known.tolist(), after_pause.tolist(), strict=True)):
        if start is not None and (paused or not here):
            yield start, k
            start = None
        if here and start is None:
            start = k
    if start is not None:
        yield start, len(known)


def _same_kind(seen: np.ndarray, start: int, stop: int) -> Iterator[tuple[int, int, bool]]:
    """Splits a run so that neighbouring pieces share a group; a link is seen where both of its ends are."""
    if stop - start == 1:
        yield start, stop, bool(seen[start])
        return
    link = (seen[start : stop - 1] & seen[start + 1 : stop]).tolist()
    begin = 0
    for k in range(1, len(link) + 1):
        if k == len(link) or link[k] != link[begin]:
            yield start + begin, start + k + 1, link[begin]
            begin = k


def _trace(points: Points) -> str:
    """Relative steps: shorter than places. A point alone is a step of no length, which round caps show as a dot."""
    x, y = points[0]
    steps = [f"M{x} {y}l"]
    for next_x, next_y in points[1:] or points:
        steps.append(f"{next_x - x} {next_y - y}")
        x, y = next_x, next_y
    return steps[0] + " ".join(steps[1:])
