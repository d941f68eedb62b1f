"""Recorders that are meant to be carried: did the camera stand still?"""

from __future__ import annotations

from typing import Final

import numpy as np

STANDS_STILL_M: Final = 0.03  # a phone on a tripod; its own estimate of where it is wanders by some millimetres


def movement_note(positions_m: np.ndarray) -> tuple[str, ...]:
    """A sentence where a camera at ``positions_m`` (n, 3) was moved; NaN rows are unknown."""
    known = positions_m[np.isfinite(positions_m).all(axis=1)]
    if len(known) == 0:
        return ()
    moved_m = float(np.linalg.norm(known - np.median(known, axis=0), axis=1).max())
    if moved_m <= STANDS_STILL_M:
        return ()
    return (f"The camera was moved by {moved_m:.2f} m while it recorded: tracking needs one that stands still.",)
