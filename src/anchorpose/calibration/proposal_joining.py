"""Complete proposed parts: join pieces of a bar, extend bars and posts, test whether rays pass through parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.calibration.proposal_readings import UNREAD_M, Readings
from anchorpose.calibration.proposal_shape import LEAST_SUPPORT, REACH_M, Fit

# m, limits for pieces of one bar: OFF_LINE_M is the distance of one piece from the line of the other piece,
# LARGEST_CUT_M the gap between the pieces (a leg's breadth)
OFF_LINE_M, LARGEST_CUT_M = 0.02, 0.30
SEEN_THROUGH: Final = 4  # minimum number of rays through a gap that show that the gap is empty
# m; a reading within this distance of a bar's extension belongs to the bar; this is also the step along the bar
ALONG_M: Final = 0.01
# minimum number of readings per step along a bar for the bar to continue; a bar one pixel wide at 3 m has five
DENSE: Final = 3
# m above the floor; if the unseen lower side of a level bar is below this height, the bar lies on the floor
LIES_M: Final = 0.06
# m above the floor; an upright bar that ends below this height stands on the floor, or in a runner (a bar on the floor)
TO_FLOOR_M: Final = 0.12


def extended(fit: Fit, points: np.ndarray, free: np.ndarray) -> Fit:
    """Extend a bar at both ends as far as readings continue within its cross-section.

    free (n,) bool: readings that do not belong to another part. A bar is extended across readings of other parts, too,
    so that a runner (a bar on the floor) continues behind a post that stands on it. But a bar never ends in readings of
    another part.
    """
    if fit.plate:
        return fit
    local = points @ fit.rotation
    in_line = ((local > fit.low - ALONG_M) & (local < fit.high + ALONG_M))[:, :2].all(axis=1)
    low, high = fit.low.copy(), fit.high.copy()
    low[2] -= _run_m(low[2] - local[in_line, 2], free[in_line])
    high[2] += _run_m(local[in_line, 2] - high[2], free[in_line])
    return replace(fit, low=low, high=high)


def _run_m(beyond_m: np.ndarray, free: np.ndarray) -> float:
    """Return how far (m) readings continue beyond a bar's end. The bar is followed in steps of ``ALONG_M``; it ends
    where two steps in a row have fewer than ``DENSE`` readings. The last step of the extension must have enough
    readings that belong to no other part (``free``).
    """
    steps = (beyond_m / ALONG_M).astype(int)
    ahead = beyond_m > 0
    count = int(steps[ahead].max(initial=0)) + 2
    filled = np.bincount(steps[ahead], minlength=count) >= DENSE
    gaps = np.flatnonzero(~(filled | np.append(filled[1:], False)))  # one empty step may be noise, two are the end
    own = np.flatnonzero(np.bincount(steps[ahead & free], minlength=count)[: gaps[0]] >= DENSE)
    return ALONG_M * float(own[-1] + 1) if len(own) else 0.0


def merged(fits: Sequence[Fit], readings: Readings) -> list[Fit]:
    """Join the seen pieces of a bar whose middle another object hides, unless rays pass between the pieces."""
    fits = list(fits)
    for first in range(len(fits)):
        for second in range(first + 1, len(fits)):
            joined = _join(fits[first], fits[second], readings)
            if joined is not None:
                rest = [fit for index, fit in enumerate(fits) if index not in (first, second)]
                return merged([*rest, joined], readings)
    return fits


def _join(one: Fit, other: Fit, readings: Readings) -> Fit | None:
    if one.plate or other.plate or abs(one.axis @ other.axis) < np.cos(np.radians(3.0)):
        return None
    offset = (other.center_m - one.center_m) @ one.rotation
    gap = abs(offset[2]) - (one.size_m[2] + other.size_m[2]) / 2.0
    if np.abs(offset[:2]).max() > OFF_LINE_M or gap > LARGEST_CUT_M:
        return None
    long, short = (one, other) if one.size_m[2] >= other.size_m[2] else (other, one)
    ends = np.concatenate(
        [[long.low[2], long.high[2]], long.axis @ short.axis * np.array([short.low[2], short.high[2]])]
    )
    between = np.sort(ends)[1:3]
    if gap > 0 and _seen_through(long, between, readings):
        return None
    low, high = long.low.copy(), long.high.copy()
    low[2], high[2] = ends.min(), ends.max()
    return replace(long, low=low, high=high, round=False)


def _seen_through(bar: Fit, between: np.ndarray, readings: Readings) -> bool:
    """Return whether rays pass through the gap in a bar, which shows that the gap is empty."""
    low, high = _core(bar)
    margin = min(0.01, 0.2 * float(np.ptp(between)))
    low[2], high[2] = between[0] + margin, between[1] - margin
    passing, _ = _rays_through(bar.rotation, low, high, readings)
    return passing >= SEEN_THROUGH


def hollow_share(fit: Fit, readings: Readings) -> float:
    """Return the share of the rays through a part's core that end beyond it: about 0 for a real part."""
    passing, ending = _rays_through(fit.rotation, *_core(fit), readings)
    return passing / max(passing + ending, 1)


def _core(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    trim = 0.15 * fit.size_m
    return fit.low + trim, fit.high - trim


def _rays_through(rotation: np.ndarray, low: np.ndarray, high: np.ndarray, readings: Readings) -> tuple[int, int]:
    """Return, for the rays that meet a box, how many end beyond the box, and how many end in it or just before it."""
    origin, ray = readings.origin_m @ rotation, readings.ray @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - origin) / ray, (high - origin) / ray
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    meets = (enter < leave) & (enter > 0) & (readings.depth_m < UNREAD_M)
    slack = 3.0 * readings.sigma_m + REACH_M
    passing = meets & (readings.depth_m > leave + slack)
    ending = meets & ~passing & (readings.depth_m > enter - slack)
    return int(np.count_nonzero(passing)), int(np.count_nonzero(ending))


def on_its_feet(fit: Fit, readings: Readings, floor_height_m: float) -> Fit:
    """Extend a part to the floor if its lower end is so near to the floor that the floor's noise or a runner (a bar on
    the floor) may hide the rest; cut off what lies below the floor.
    """
    upright = np.abs(fit.rotation[1])
    axis = int(np.argmax(upright))
    if upright[axis] < 0.95 or (fit.round and axis < 2):
        return fit
    low, high = fit.low.copy(), fit.high.copy()
    sign = np.sign(fit.rotation[1, axis])
    face = low if sign > 0 else high
    height = sign * face[axis] - floor_height_m
    stands = axis == 2 and not fit.plate
    if height > (TO_FLOOR_M if stands else LIES_M) or (not stands and _lifted(fit, axis, height, readings)):
        return fit
    face[axis] = sign * floor_height_m
    return replace(fit, low=low, high=high)


def _lifted(fit: Fit, axis: int, height_m: float, readings: Readings) -> bool:
    """Return whether rays pass between a level part and the floor below it."""
    if height_m < 2.0 * ALONG_M:
        return False
    low, high = _core(fit)
    if fit.rotation[1, axis] > 0:
        low[axis], high[axis] = fit.low[axis] - height_m + ALONG_M, fit.low[axis] - ALONG_M / 2.0
    else:
        low[axis], high[axis] = fit.high[axis] + ALONG_M / 2.0, fit.high[axis] + height_m - ALONG_M
    passing, ending = _rays_through(fit.rotation, low, high, readings)
    return passing >= SEEN_THROUGH and passing > ending


def guessed_lengths(fit: Fit, floor_height_m: float) -> tuple[str, ...]:
    """Return the names of lengths that no camera sees. These are lengths along an axis in whose direction all cameras
    look, and lengths with an end that has no readings.

    The end of a part on the floor counts as seen.
    """
    names = ("breadth", "thickness", "length") if not fit.plate else ("length", "breadth", "thickness")
    unplaced = fit.support < LEAST_SUPPORT
    ends = (2,) if not fit.plate else (0, 1)
    unknown = set(np.flatnonzero(fit.blind).tolist())
    unknown |= {
        axis for axis in ends if unplaced[axis].any() and not _on_floor(fit, axis, unplaced[axis], floor_height_m)
    }
    return tuple(names[axis] for axis in sorted(unknown) if not (fit.round and axis < 2))


def _on_floor(fit: Fit, axis: int, sides: np.ndarray, floor_height_m: float) -> bool:
    """Return whether the only unseen face along this axis lies on the floor."""
    upright = fit.rotation[1, axis]
    if abs(upright) < 0.99 or sides.all():
        return False
    face = (fit.low if sides[0] else fit.high)[axis] * np.sign(upright)
    return bool(abs(face - floor_height_m) < 0.03)
