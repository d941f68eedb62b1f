"""Where in a recording to look at the clocks: a few short windows in which much moves, not every picture."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from anchorpose.recording.footage import Footage

STEP_PX = 8  # every eighth pixel of every eighth row tells how much moves
APART_S = 0.2  # between the two pictures that are compared
LEAST_CHANGE_M, MOST_CHANGE_M = 0.02, 0.15  # noise; and another surface that appears


def busiest_times(
    footage: Footage, reference: int, span_s: tuple[float, float], windows: int, places: int
) -> list[tuple[float, float]]:
    """(time on the reference clock, how much moves there in m^3) of the busiest place of each of ``windows`` parts.

    Each part of ``span_s`` is looked at in ``places`` places, two pictures each; a part without pictures has no entry.
    """
    edges = np.linspace(*span_s, windows + 1)
    found = []
    for begin_s, end_s in pairwise(edges):
        looked = begin_s + (np.arange(places) + 0.5) * (end_s - begin_s) / places
        amounts = [(_amount(footage, reference, time_s), float(time_s)) for time_s in looked]
        amount, time_s = max(amounts)
        if amount >= 0:
            found.append((time_s, amount))
    return found


def pictures_between(footage: Footage, camera: int, begin_s: float, end_s: float) -> list[tuple[float, np.ndarray]]:
    """(time, depth) of the usable pictures of a camera between two times of its own clock."""
    times_s = footage.times_s[camera]
    first, last = np.searchsorted(times_s, [begin_s, end_s])
    found = ((float(times_s[k]), footage.read(camera, k)) for k in range(first, last))
    return [(time_s, depth) for time_s, depth in found if depth is not None]


def _amount(footage: Footage, camera: int, time_s: float) -> float:
    """Area times change between two pictures at a time; -1 where they are missing."""
    times_s = footage.times_s[camera]
    first, last = np.clip(np.searchsorted(times_s, [time_s, time_s + APART_S]), 0, len(times_s) - 1)
    if first == last:
        return -1.0
    before, after = footage.read(camera, int(first)), footage.read(camera, int(last))
    if before is None or after is None:
        return -1.0
    lens = footage.cameras[camera].intrinsics
    before, after = before[::STEP_PX, ::STEP_PX], after[::STEP_PX, ::STEP_PX]
    change = np.abs(after - before)
    moved = (before > 0) & (after > 0) & (change > LEAST_CHANGE_M)
    near = np.minimum(before, after)[moved]
    return float((np.minimum(change[moved], MOST_CHANGE_M) * near**2).sum() * STEP_PX**2 / (lens.fx * lens.fy))
