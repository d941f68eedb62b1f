"""Of the frames in which tracking may begin, the one in which a body explains what is seen.

A therapist who holds the patient may be taken for a part of him; which frame shows him alone is told by fitting him.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.recording.reader import read_frames
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.opening import Opening
from anchorpose.tracker.room import Room
from anchorpose.tracker.start import NoStart, find_start
from anchorpose.tracker.stopwatch import Stopwatch

WELL: Final = 0.90  # of the patient's surface explained: alone he has 92 to 100 %, with a therapist's arm 70
WHOLE: Final = 0.8  # of the surface that is usually seen of him: a sliver behind a therapist is explained by anything
TRIES: Final = 6  # frames, a second or two of fitting each
APART: Final = 0.25  # of the frames' span: what spoils a frame spoils those around it


def with_best_opening(room: Room, config: TrackConfig) -> Room:
    """The room with the best of its openings first. One person alone cannot be mistaken, and is not fitted."""
    if config.patient_xz_m is not None or max((one.people for one in room.openings), default=0) < 2:
        return room

    def explained(opening: Opening) -> float:
        frame_set = next(iter(read_frames(room.recording, opening.frame, opening.frame + 1)))
        start = find_start(frame_set, room, opening.choice, None, config, Stopwatch())
        return 0.0 if isinstance(start, NoStart) else start.explained

    best = best_of(room.openings, explained)
    return replace(room, openings=(best, *(one for one in room.openings if one is not best)))


def best_of(openings: Sequence[Opening], explained: Callable[[Opening], float]) -> Opening:
    """The first that shows him whole and is explained well, or of ``TRIES`` the best; explained: share of his surface.

    After the best by score come those that are far from all that were tried.
    """
    left, tried = list(openings), list[tuple[float, Opening]]()
    while left and len(tried) < TRIES:
        opening = max(left, key=lambda one: _worth(one, [other for _, other in tried], openings))
        left.remove(opening)
        share = explained(opening)
        if share >= WELL and opening.whole >= WHOLE:
            return opening
        tried.append((share * opening.whole, opening))
    return max(tried, key=lambda one: one[0])[1]


def _worth(opening: Opening, tried: Sequence[Opening], openings: Sequence[Opening]) -> float:
    """Score, less near a frame that was tried."""
    if not tried:
        return opening.score
    span = APART * max(1, np.ptp([one.frame for one in openings]))
    gap = min(abs(opening.frame - other.frame) for other in tried)
    return opening.score * min(1.0, gap / span)
