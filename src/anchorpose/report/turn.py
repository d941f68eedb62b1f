"""Angles that pass from 180 to -180 degrees, on the side of the circle where they lie together.

A patient who faces against X has a pelvis that turns by 179 in one frame and by -179 in the next: two degrees, of which
the lowest and the highest number would make a whole turn.
"""

from __future__ import annotations

import numpy as np

TURN_DEG = 360.0


def on_shortest_arc(degrees: np.ndarray) -> np.ndarray:
    """degrees (n,) from -180 to 180, NaN where not known: the same angles on the shortest arc that holds all of them.

    Some are a whole turn further than their number says, or less far, such that the median is from -180 to 180. Angles
    whose numbers lie within half a turn stay as they are.
    """
    known = np.sort(degrees[np.isfinite(degrees)])
    if len(known) < 2:
        return degrees
    gaps = np.diff(known)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= TURN_DEG - (known[-1] - known[0]):
        return degrees
    moved = np.where(degrees <= known[widest], degrees + TURN_DEG, degrees)
    return moved - TURN_DEG if np.nanmedian(moved) > TURN_DEG / 2 else moved
