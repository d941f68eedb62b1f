"""Find when and where the feet of a captured movement stand, step and leave the floor, and keep standing feet still.

A Kinect v2 records ankle movements of centimetres even while a foot stands still. A standing foot is therefore kept in
one place, a rising heel turns about the ball of the foot, and only a foot that clearly leaves the floor moves freely.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.simulate.movement_file import CLIP_HZ
from anchorpose.simulate.timeline import STEP_HEIGHT_M, ease

WAVER_M: Final = 0.06  # m, maximum rise of a standing foot's captured ankle; a rise as small as this is noise
# m; an ankle's rise above its height on the floor counts as a lift of the foot: not at all up to ``WAVER_M``, fully
# from ``WAVER_M`` + ``CLEAR_M`` on, and in part between these limits
CLEAR_M: Final = 0.06
# m, maximum rise and travel of an ankle if only the heel has left the floor
HIGHEST_HEEL_M, FARTHEST_HEEL_M = 0.15, 0.15
MOVING_M_S: Final = 0.30  # m/s; a foot that moves faster than this has left the floor
SHORTEST_STAND_S: Final = 0.25  # s, minimum time for which a standing foot stays in one place
SAME_PLACE_M: Final = 0.08  # m, maximum distance between two places of a foot that count as the same place
EASE_S: Final = 0.15  # s, duration of the transitions between standing and stepping
YAW_LIMIT: Final = 0.5  # rad, maximum angle of a standing foot from straight ahead, to the left or right

Spans = list[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class Footing:
    """Places and angles of both feet in n frames at CLIP_HZ. The second axis is the side, left first."""

    # (n, 2, 3) place of the ankle if the foot were flat; y = 0 is the height of a standing foot's ankle
    place_m: np.ndarray
    stands: np.ndarray  # (n, 2) from 0 (the foot is in the air) to 1 (it stands)
    yaw: np.ndarray  # (n, 2) rad, direction of the foot, positive to the left
    heel: np.ndarray  # (n, 2) rad, rotation of a standing foot about its ball that raises the heel; 0 = flat


def find_footing(ankle_m: np.ndarray, height_m: np.ndarray, toes: np.ndarray, foot_m: float) -> Footing:
    """Compute places and angles of both feet from captured ankles (n, 2, 3).

    height_m (n, 2): captured height of the ankles; toes (n, 2, 3): directions of the feet; foot_m: horizontal distance
    from the ankle to the ball of the foot.
    """
    lift, heel_m = _lift(ankle_m, height_m)
    spans = [_stands(ankle_m[:, side], lift[:, side]) for side in (0, 1)]
    if not any(spans):
        spans = [[(0, len(ankle_m))]] * 2
    place = np.stack([_places(ankle_m[:, side], spans[side]) for side in (0, 1)], axis=1)
    stands = np.stack([_weights(spans[side], len(ankle_m)) for side in (0, 1)], axis=1)
    place[..., 1] = np.maximum(lift * (1.0 - stands), _step_lift(place, stands))
    yaw = np.stack([_yaws(toes[:, side], spans[side]) for side in (0, 1)], axis=1)
    return Footing(place, stands, yaw, np.arcsin(np.clip(heel_m / foot_m, 0.0, 0.8)))


def _lift(ankle_m: np.ndarray, height_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays (n, 2), metres: the height of each foot in the air, and the rise of its heel while its toes are
    on the floor.
    """
    floor = np.percentile(height_m, 10.0, axis=0)
    # a foot that is always in the air does not show the floor's height, so its floor is assumed to be at most
    # ``WAVER_M`` above the floor at the other foot
    above = height_m - np.minimum(floor, floor.min() + WAVER_M)
    lift = above * ease((above - WAVER_M) / CLEAR_M)
    heel = np.zeros_like(lift)
    for side in (0, 1):
        for a, b in _spans(lift[:, side] > 0.0):
            travel = np.ptp(ankle_m[max(a - 3, 0) : b + 3, side][:, [0, 2]], axis=0)
            if lift[a:b, side].max() < HIGHEST_HEEL_M and np.linalg.norm(travel) < FARTHEST_HEEL_M:
                heel[a:b, side], lift[a:b, side] = lift[a:b, side], 0.0
    return lift, heel


def _spans(chosen: np.ndarray) -> Spans:
    """Return the first row, and one past the last row, of each unbroken series of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int64)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _stands(ankle_m: np.ndarray, lift_m: np.ndarray) -> Spans:
    """Return the spans of rows in which a foot stands. Two spans at the same place are merged if the foot stays on the
    floor between them.

    ankle_m (n, 3): ankle of one foot; lift_m (n,): height of this foot in the air, 0 on the floor.
    """
    course = gaussian_filter1d(ankle_m[:, [0, 2]], 2.0, axis=0)
    speed = np.linalg.norm(np.gradient(course, axis=0), axis=1) * CLIP_HZ
    spans = [span for span in _spans((speed < MOVING_M_S) & (lift_m <= 0.0)) if _lasts(span)]
    merged: Spans = []
    for a, b in spans:
        if merged:
            before, after = (np.median(ankle_m[i:j], axis=0) for i, j in (merged[-1], (a, b)))
            if np.linalg.norm((after - before)[[0, 2]]) < SAME_PLACE_M and lift_m[merged[-1][1] : a].max() <= 0.0:
                merged[-1] = (merged[-1][0], b)
                continue
        merged.append((a, b))
    return merged


def _lasts(span: tuple[int, int]) -> bool:
    return span[1] - span[0] >= SHORTEST_STAND_S * CLIP_HZ


def _weights(stands: Spans, rows: int) -> np.ndarray:
    """Return (n,): 1 while the foot stands, 0 during a step, with smooth transitions that last ``EASE_S`` seconds."""
    row, weight, fade = np.arange(rows), np.zeros(rows), EASE_S * CLIP_HZ
    for a, b in stands:
        came = np.ones(rows) if a == 0 else ease((row - a) / fade + 1.0)
        goes = np.ones(rows) if b == rows else ease((b - 1 - row) / fade + 1.0)
        weight = np.maximum(weight, came * goes)
    return weight


def _places(ankle_m: np.ndarray, stands: Spans) -> np.ndarray:
    """Return the ankle's path (n, 3): constant while the foot stands. Between two places at which the foot stands, the
    path is the captured path, shifted so that it begins and ends at these places.
    """
    rows, course = np.arange(len(ankle_m)), ankle_m.copy()
    between = np.ones(len(rows), dtype=bool)
    known, offset = [], []
    for a, b in stands:
        place = np.median(ankle_m[a:b], axis=0)
        course[a:b], between[a:b] = place, False
        known += [a, b - 1]
        offset += [place - ankle_m[a], place - ankle_m[b - 1]]
    for axis in range(3) if known else ():
        shift = np.interp(rows, known, [gap[axis] for gap in offset])
        course[between, axis] += shift[between]
    return course


def _step_lift(place_m: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Return the minimum height (n, 2), metres, of each foot during a step. This height grows with the foot's speed."""
    speed = np.linalg.norm(np.gradient(place_m[..., [0, 2]], axis=0), axis=2) * CLIP_HZ
    speed = gaussian_filter1d(speed, 2.0, axis=0)
    return np.asarray((1.0 - stands) * 0.5 * STEP_HEIGHT_M * np.clip(speed / MOVING_M_S, 0.0, 1.0))


def _yaws(toes: np.ndarray, stands: Spans) -> np.ndarray:
    """Return the foot's direction (n,), radians to the left of +X, constant while the foot stands. toes (n, 3):
    captured directions of the foot.
    """
    yaw = np.arctan2(-toes[:, 2], toes[:, 0])
    known, value = [], []
    for a, b in stands:
        known += [a, b - 1]
        value += [float(np.median(yaw[a:b]).clip(-YAW_LIMIT, YAW_LIMIT))] * 2
    if not known:
        return np.full(len(yaw), float(np.median(yaw).clip(-YAW_LIMIT, YAW_LIMIT)))
    return np.interp(np.arange(len(yaw)), known, value)
