"""Find the clock of another device's file by one of the ways to do so."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.clock import Clock, NoCommonMovement, OtherClock, on_grid
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import Segment, SyncSettings
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.verify import require_own
from anchorpose.sync.limb import SEGMENTS, SMOOTHING_S, angular_velocity, one_way_sigma_s, specific_force
from anchorpose.sync.movement import SHORT_S, find_sensor_clock
from anchorpose.sync.reading import read_other
from anchorpose.sync.streams import OtherFile

MOVEMENT: Final = "movement"


@dataclass(frozen=True, slots=True, eq=False)
class Synchronised:
    """Results and another file with the clock that joins them.

    method: how it was found; compared: what with what; notes: sentences on what the user should know.
    """

    results: Path
    joints: JointTable
    other: OtherFile
    clock: OtherClock
    method: str
    compared: str
    notes: tuple[str, ...] = ()


def synchronise(results: Path, other: Path, settings: SyncSettings) -> Synchronised:
    """Find the clock of ``other``; raises InputError where a file cannot be used or the two have nothing in common."""
    ways = {"--acceleration": settings.acceleration, "--gyroscope": settings.gyroscope}
    given = [name for name, value in ways.items() if value]
    if len(given) != 1:
        raise AnchorposeError(f"{' and '.join(given) or 'No signals'} were given; give one of {', '.join(ways)}.")
    if settings.segment is None:
        raise AnchorposeError(f"{given[0]} needs --segment: the part of the body that the sensor is strapped to.")
    require_own(results, (JOINTS_FILE,))
    joints = read_joints(results / JOINTS_FILE)
    return _by_movement(results, joints, read_other(other, settings.time), settings, settings.segment)


def _by_movement(
    results: Path, joints: JointTable, other: OtherFile, settings: SyncSettings, segment: Segment
) -> Synchronised:
    names = settings.acceleration or settings.gyroscope
    measured = specific_force if settings.acceleration else angular_velocity
    ours, theirs = measured(joints, segment), on_grid(*other.take(names), SMOOTHING_S)
    try:
        clock = find_sensor_clock(ours, theirs, settings.near)
    except NoCommonMovement as error:
        problem = f"shares no movement of the segment {segment} with {results / JOINTS_FILE}: {error}"
        remedy = "give the file of this recording with some seconds of different movements, or state --near SECONDS"
        raise InputError(other.path, problem, remedy) from None
    one_way_s = one_way_sigma_s(joints, segment, *clock.overlap_s)
    clock = replace(clock, offset_sigma_s=float(np.hypot(clock.offset_sigma_s, one_way_s)))
    upper, lower = SEGMENTS[segment]
    what = "acceleration" if settings.acceleration else "angular velocity"
    compared = f"{what} of the segment {segment} ({upper} to {lower}) with {', '.join(names)}"
    return Synchronised(results, joints, other, clock, MOVEMENT, compared, _short(clock))


def _short(clock: Clock) -> tuple[str, ...]:
    common_s = clock.overlap_s[1] - clock.overlap_s[0]
    if common_s >= SHORT_S:
        return ()
    return (
        f"Only {common_s:.1f} s of movement are common: the file of another recording of the same exercise might fit "
        "as well",
    )
