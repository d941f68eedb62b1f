"""Find recovery steps, in which the patient stands still, loses balance, and catches the body by placing a foot.

Balance is lost where the extrapolated centre of mass leaves the base of support (Hof et al. 2005,
doi:10.1016/j.jbiomech.2004.03.025): a body that moves with speed v falls like a resting body that is displaced by v /
w, where w = sqrt(g / l) is the frequency of a pendulum whose length l is the height of the centre of mass. This project
itself defines the limits of time and distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.frame_time import followed, longest_dropped_s, unbroken_runs, usual_step_s
from anchorpose.results.records import RECOVERY_LEFT, RECOVERY_RIGHT
from anchorpose.results.stand_training.event import Event, EventConfig, fast_enough
from anchorpose.results.stand_training.stance import ANKLES, Session
from anchorpose.results.stand_training.steps import Step

KINDS: Final = {"left": RECOVERY_LEFT, "right": RECOVERY_RIGHT}

GRAVITY_M_S2: Final = 9.81

SMOOTHING_S: Final = 0.05
"""Standard deviation in s of the kernel that smooths the centre of mass, so that its speed is not mostly noise."""

FOOT_M: Final = 0.05
"""Length in m by which the sole extends beyond the joints of a foot: the heel behind the ankle, the toes in front of
the toe base.
"""

STILL_S: Final = 1.0
"""Minimum time in s without another step before a recovery step: steps in quick succession are walking."""

WITHIN_S: Final = 1.2
"""Maximum time in seconds from the loss of balance to foot strike; a longer fall is not caught by a step."""

_FEET: Final = [*ANKLES, JOINT_INDEX["FootLeft"], JOINT_INDEX["FootRight"]]

_TURN: Final = np.radians(np.arange(0.0, 360.0, 5.0))
DIRECTIONS: Final = np.stack([np.cos(_TURN), np.sin(_TURN)])
"""Directions (2, 72): unit vectors at equal angles. The distance of a point from a convex outline is the largest
amount, over all directions, by which the point lies beyond the outline in this direction. With 72 directions, the error
of the distance is at most 0.1 %.
"""


def find_recovery_steps(session: Session, steps: Sequence[Step], config: EventConfig) -> list[Event]:
    """Return the recovery steps in the order of time; each event lasts from the loss of balance to foot strike."""
    if not fast_enough(session.joints.time_s) or not steps:
        return []
    extrapolated_m = _extrapolated(session)
    found = [_recovery(session, step, extrapolated_m, config) for step in _after_standing(session, steps)]
    return [event for event in found if event is not None]


def recovery_watched(session: Session, config: EventConfig) -> np.ndarray:
    """Return (n,) bool: frames in which a recovery step could begin and be found. In such a frame, the patient is
    upright, an extrapolated centre of mass (displaced in proportion to its speed) that lies ``beyond_m`` outside the
    feet could be distinguished from errors of measurement, and the joints used are known in all frames of the next
    ``WITHIN_S``. Dropped frames are allowed, one at a time.
    """
    clear = session.upright & (config.times_sigma * _sigma_m(session) <= config.beyond_m)
    return np.asarray(clear & followed(np.isfinite(_sigma_m(session)), session.joints.time_s, WITHIN_S))


def _sigma_m(session: Session) -> np.ndarray:
    """Return sigma (n,) of the distance between the centre of mass and the feet's outline; NaN where a joint is
    lost.
    """
    feet = session.joints.sigma_m[:, _FEET]
    return np.asarray(np.hypot(session.posture.com_sigma_m, np.sqrt((feet**2).mean(axis=1))))


def _extrapolated(session: Session) -> np.ndarray:
    """Return the extrapolated centre of mass (displaced in proportion to its speed), x and z (n, 2) on the floor, NaN
    where unknown.
    """
    time_s, com_m = session.joints.time_s, session.posture.com_m
    step_s, found = usual_step_s(time_s), np.full((len(time_s), 2), np.nan)
    ankles_m = session.joints.position_m[:, ANKLES, 1].min(axis=1)
    known = np.isfinite(com_m).all(axis=1) & (com_m[:, 1] > ankles_m)
    for run in unbroken_runs(known, time_s, longest_dropped_s(time_s)):
        if run.stop - run.start > 2:
            floor_m = gaussian_filter1d(com_m[run][:, [0, 2]], SMOOTHING_S / step_s, axis=0, mode="nearest")
            frequency = np.sqrt(GRAVITY_M_S2 / np.median(com_m[run, 1] - ankles_m[run]))
            found[run] = floor_m + np.gradient(floor_m, time_s[run], axis=0) / frequency
    return found


def _after_standing(session: Session, steps: Sequence[Step]) -> list[Step]:
    """Return the steps that follow at least ``STILL_S`` without a foot in the air."""
    time_s = session.joints.time_s
    ends = np.array([time_s[step.frames.stop - 1] for step in steps])
    starts = np.array([time_s[step.frames.start] for step in steps])
    return [
        step
        for step, start_s in zip(steps, starts.tolist(), strict=True)
        if not ((ends > start_s - STILL_S) & (starts < start_s)).any()
    ]


def _recovery(session: Session, step: Step, extrapolated_m: np.ndarray, config: EventConfig) -> Event | None:
    """Return a step's event, if balance was lost before foot off and at most ``WITHIN_S`` before foot strike."""
    time_s, off, strike = session.joints.time_s, step.frames.start, step.frames.stop - 1
    first = int(np.searchsorted(time_s, time_s[strike] - WITHIN_S))
    feet_m = session.joints.position_m[first : off + 1][:, _FEET][:, :, [0, 2]]
    if off <= first or not session.upright[first : off + 1].all() or not np.isfinite(feet_m).all():
        return None
    outline = np.median(feet_m[: max((off - first) // 2, 1)], axis=0)
    reach = (extrapolated_m[first : off + 1] @ DIRECTIONS - (outline @ DIRECTIONS).max(axis=0)).max(axis=1)
    beyond_m = reach - FOOT_M
    inside = np.flatnonzero(beyond_m <= 0.0)
    if not len(inside) or not np.isfinite(beyond_m).all():
        return None  # the extrapolated centre was always beyond the feet (leaning on a rail), or is unknown
    onset, depth_m = first + int(inside[-1]) + 1, float(beyond_m[inside[-1] :].max())
    sigma_m = float(_sigma_m(session)[first : off + 1].mean())
    if depth_m < max(config.beyond_m, config.times_sigma * sigma_m):
        return None
    frames = slice(onset, strike + 1)
    codes = np.maximum(session.posture.state_code, session.joints.state_code[:, _FEET].max(axis=1))
    return Event(KINDS[step.side], frames, 1000.0 * depth_m, 1000.0 * sigma_m, "mm", int(codes[frames].max()))
