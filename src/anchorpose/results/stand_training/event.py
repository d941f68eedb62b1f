"""Define events of stand training (a buckling knee, a failed stand, a recovery step), and how large they must be to
count.

An event is reported if it exceeds both a limit and the errors of measurement. Limits without a named source are this
project's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from anchorpose.results.frame_time import usual_step_s
from anchorpose.results.records import Episode
from anchorpose.results.stand_training.upright import episode
from anchorpose.results.tables import JointTable
from anchorpose.settings import Positive, settings

LEAST_HZ: Final = 10.0
"""Minimum frame rate in Hz; at a lower rate, the fast part of an event has fewer than four frames."""

TOO_SLOW: Final = f"events need {LEAST_HZ:g} frames a second or more"

ONSET_SIGMA_S: Final = 0.04
"""Standard deviation in s of the error of an event's onset, measured on constructed events (docs/measures.md)."""

BRIEF_SHARE: Final = 0.7
"""Share of the variance of an angle's error that is common to two frames of a buckle, about 0.4 s apart. Half of the
variance is systematic, so it is common to both frames. Of the random half, the part that does not change between the
two frames (correlation time ``CORRELATION_S``) is added.
"""

CHANGE_SHARE: Final = float(np.sqrt(2.0 * (1.0 - BRIEF_SHARE)))
"""Ratio of the sigma of an angle's change between two frames to the sigma of the angle. The ratio is below sqrt(2),
since both values have most of their error in common.
"""


@settings
class EventConfig:
    """Settings of how large a buckle, a failed stand or a recovery step must be to count as an event."""

    # degrees, minimum depth of a buckle; in walking, a knee that takes over the load bends by 5 to 20 degrees, usually
    # 15
    buckle_deg: Annotated[float, Field(gt=0, lt=90)] = 20.0
    fast_s: Positive = 0.4  # s, maximum time in which the knee bends by buckle_deg
    # degrees, minimum bend of a buckling knee beyond the other knee's; with less, the movement is a squat
    lead_deg: Annotated[float, Field(gt=0, lt=90)] = 10.0
    # minimum rise of a failed stand, as a share of the height from the seat to straight legs; about 12 cm
    failed_rise: Annotated[float, Field(gt=0, lt=1)] = 0.3
    # m, minimum distance by which the extrapolated centre of mass (displaced in proportion to its speed) lies outside
    # the feet's outline; less may be an error of the outline
    beyond_m: Positive = 0.05
    # minimum depth of an event in sigmas. In ten minutes, two knees are tested in 3000 windows of 0.4 s; on average,
    # errors alone reach the minimum depth in 0.7 of these 3000 windows.
    times_sigma: Positive = 3.5


@dataclass(frozen=True, slots=True)
class Event:
    """An event. frames: rows from onset to greatest depth (of a recovery step: foot strike). kind: one of
    ``EPISODE_KINDS``.

    depth, sigma: in ``unit``: degrees for a buckle, share of the way from the seat to standing for a failed stand,
    millimetres beyond the feet for a recovery step. state_code: the worst state of the joints by which the event was
    recognised.
    """

    kind: str
    frames: slice
    depth: float
    sigma: float
    unit: str
    state_code: int


def event_episodes(joints: JointTable, events: Sequence[Event]) -> tuple[Episode, ...]:
    """Return events as rows of episodes.parquet."""
    return tuple(_episode(joints, event) for event in events)


def _episode(joints: JointTable, event: Event) -> Episode:
    side = next((side for side in ("left", "right") if event.kind.endswith(f"_{side}")), None)
    found = episode(event.kind, joints, event.frames, event.state_code)
    return replace(found, side=side, depth=event.depth, sigma=event.sigma, unit=event.unit)


def fast_enough(time_s: np.ndarray, least_hz: float = LEAST_HZ) -> bool:
    """Return whether the frame rate, by the times (n,) of the frames, is at least ``least_hz``; False for a single
    frame.
    """
    return bool(usual_step_s(time_s) <= 1.0 / least_hz + ROUNDING_S)


ROUNDING_S: Final = 0.001
"""Tolerance in s, since time stamps are often rounded to the millisecond."""


EARLY, LATE = 0.1, 0.4
"""Shares of an event's depth. The onset of the event is extrapolated from the times at which the movement reaches these
two shares. Below ``EARLY``, noise hides the movement; beyond ``LATE``, the patient may already have caught themselves.
"""


def onset_row(time_s: np.ndarray, values: np.ndarray, base: float, rows: slice) -> int:
    """Return the row at which a movement begins. time_s, values (n,); base: the value before the movement; rows: range
    of rows that contains the onset and ends where the movement is deepest.

    The movement accelerates from rest, so its depth grows with the square of the time. If the movement reaches a tenth
    of its depth at t1 and four tenths at t2, the onset is at 2 t1 - t2.
    """
    depth = float(values[rows.stop - 1]) - base
    late = rows.start + int(np.argmax(values[rows] >= base + LATE * depth))
    below = np.flatnonzero(values[rows.start : late + 1] <= base + EARLY * depth)
    early = rows.start + (int(below[-1]) if len(below) else 0)
    t_early, t_late = (
        _crossing(time_s, values, row, base + share * depth) for row, share in ((early, EARLY), (late - 1, LATE))
    )
    return int(np.abs(time_s - (2.0 * t_early - t_late)).argmin())


def _crossing(time_s: np.ndarray, values: np.ndarray, row: int, level: float) -> float:
    """Return the time, interpolated between a row and the next row, at which the values pass ``level``."""
    row = min(max(row, 0), len(values) - 2)
    step = values[row + 1] - values[row]
    share = float(np.clip((level - values[row]) / step, 0.0, 1.0)) if step > 0 else 0.0
    return float(time_s[row] + share * (time_s[row + 1] - time_s[row]))


NO_ONSET: Final = "no frame shows the onset"


def latency_sigma_s(time_s: np.ndarray, sigma_s: float) -> float:
    """Return the standard deviation (sigma) of a latency: the time from the start of a recording or trial until an
    event or an extension begins. The result combines sigma_s, the sigma of the latency's end, with the uncertainty of
    the latency's beginning, which may lie up to one frame before the first frame.
    """
    return float(np.hypot(sigma_s, usual_step_s(time_s) / np.sqrt(3.0)))
