"""Find the clock of another device's file from common movement, common pulses or time stamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.clock import Clock, NoCommonMovement, OtherClock, on_grid
from anchorpose.calibration.clock_lags import DRIFT_SIGMA
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import SyncSettings
from anchorpose.recording.document import read_document
from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument
from anchorpose.results.run_record import RUN_FILE, hash_files, read_run
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.verify import require_own
from anchorpose.sync.csv_file import read_csv
from anchorpose.sync.laboratory_files import read_edf, read_xdf
from anchorpose.sync.limb import SEGMENTS, SMOOTHING_S, angular_velocity, one_way_sigma_s, specific_force
from anchorpose.sync.movement import SHORT_S, find_sensor_clock
from anchorpose.sync.pulses import MOST_PULSES, Pulses, find_pulse_clock, pulses_of_signal
from anchorpose.sync.recorded_pulses import first_frame_s, recorded_pulses
from anchorpose.sync.streams import OtherFile

MOVEMENT, PULSES, STAMPS = "movement", "pulses", "stamps"
"""The ways in which a clock can be found, as clock.json states them."""

STAMP_SIGMA_S: Final = 0.02
"""Sigma in s of an image's time stamp, since an image is stamped when it arrives, 10 to 50 ms after it was taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Synchronised:
    """Results and another file, with the clock that relates them.

    method: how the clock was found; compared: what was compared, in words; notes: sentences for the user.
    """

    results: Path
    joints: JointTable
    other: OtherFile
    clock: OtherClock
    method: str
    compared: str
    notes: tuple[str, ...] = ()


def synchronise(results: Path, other: Path, settings: SyncSettings) -> Synchronised:
    """Find the clock of the file ``other``; raises InputError if a file cannot be used, or if it has no movement,
    pulses or time in common with the results.
    """
    way = _way(settings)
    require_own(results, (JOINTS_FILE,))
    joints, read = read_joints(results / JOINTS_FILE), read_other(other, settings.time)
    found = WAYS[way](results, joints, read, settings)
    return replace(found, notes=(*read.notes, *found.notes))


def read_other(path: Path, time_column: str | None = None) -> OtherFile:
    """Read the signals of a .csv, .xdf, .edf or .bdf file. time_column: name of a CSV's column of times, None for a
    usual name. Raises InputError for other endings, or if ``time_column`` is given for a file that is not a CSV.
    """
    ending = path.suffix.lower()
    if time_column is not None and ending != ".csv":
        raise InputError(path, "is not a CSV", "leave out --time")
    match ending:
        case ".csv":
            return read_csv(path, time_column)
        case ".xdf":
            return read_xdf(path)
        case ".edf" | ".bdf":
            return read_edf(path)
    raise InputError(path, f"ends in '{path.suffix}'", "give a .csv, .xdf, .edf or .bdf")


def _way(settings: SyncSettings) -> str:
    """Return the name of the option that selects how the clocks are compared; raises AnchorposeError unless exactly one
    such option is given, with all other options that it needs.
    """
    given = [way for way in WAYS if getattr(settings, way)]
    if len(given) != 1:
        instead = f", not {' and '.join(f'--{way}' for way in given)} together" if given else ""
        raise AnchorposeError(f"Give one of {', '.join(f'--{way}' for way in WAYS)}{instead}.")
    if given[0] == "pulses" and settings.pulse_times is None:
        raise AnchorposeError("--pulses needs --pulse-times: the same pulses on the recording's clock.")
    if given[0] in ("acceleration", "gyroscope") and settings.segment is None:
        raise AnchorposeError(f"--{given[0]} needs --segment: the part of the body that the sensor is strapped to.")
    return given[0]


def _by_movement(results: Path, joints: JointTable, other: OtherFile, settings: SyncSettings) -> Synchronised:
    segment = settings.segment
    assert segment is not None  # checked in _way
    names = settings.acceleration or settings.gyroscope
    measured = specific_force if settings.acceleration else angular_velocity
    ours, theirs = measured(joints, segment), on_grid(*other.take(names), SMOOTHING_S)
    try:
        clock = find_sensor_clock(ours, theirs, settings.near, has_gravity=len(settings.acceleration) == 3)
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


def _by_pulses(results: Path, joints: JointTable, other: OtherFile, settings: SyncSettings) -> Synchronised:
    path, name = settings.pulse_times, settings.pulses
    assert path is not None  # checked in _way
    assert name is not None
    ours, theirs = recorded_pulses(path, results, joints, name, settings.pulse_type), other_pulses(other, name)
    counts = [max(len(reading.start_s) for reading in readings) for readings in (ours, theirs)]
    for file, count in zip((path, other.path), counts, strict=True):
        if not 0 < count <= MOST_PULSES:
            problem = f"has {count} pulses in {name}"
            raise InputError(file, problem, f"name a signal, or a stream of markers, with 1 to {MOST_PULSES} pulses")
    try:
        clock, matched = find_pulse_clock(ours, theirs, settings.near)
    except NoCommonMovement as error:
        remedy = (
            "give pulses at uneven distances, in an events.tsv that states how long each lasts, or state --near SECONDS"
        )
        raise InputError(other.path, f"does not have the pulses of {path}: {error}", remedy) from None
    compared = f"{matched} pulses of {path.name} ({counts[0]}) with those of {name} ({counts[1]})"
    return Synchronised(results, joints, other, clock, PULSES, compared)


def other_pulses(other: OtherFile, name: str) -> tuple[Pulses, ...]:
    """Return the pulses in the stream of markers or in the signal called ``name``; for a signal, return both readings,
    in which its rising edges are the starts or the ends of pulses. Raises InputError if the file has no such stream or
    signal.
    """
    markers = [each for each in other.markers if each.name == name]
    if markers:
        return (Pulses(np.unique(np.concatenate([each.time_s for each in markers]))),)
    time_s, values = other.take((name,))
    return pulses_of_signal(time_s, values[:, 0])


def _by_stamps(results: Path, joints: JointTable, other: OtherFile, settings: SyncSettings) -> Synchronised:
    recording = settings.stamps
    assert recording is not None  # checked in _way
    path = recording / RECORDING_FILE
    start = read_document(path, RecordingDocument).start
    if start is None or start.lsl_s is None:
        remedy = "record with 'anchorpose record' where the package pylsl is installed, or compare pulses or movement"
        raise InputError(path, "does not state its start by the clock of the Lab Streaming Layer", remedy)
    known = read_run(results / RUN_FILE).get("inputs_sha256", {}).get(RECORDING_FILE)
    if known not in (None, dict(hash_files([path], recording))[RECORDING_FILE]):
        raise InputError(path, f"is not of the recording that {results} was made from", "give that recording")
    first_s = first_frame_s(results, joints)
    clock = OtherClock(
        offset_s=start.lsl_s - first_s,
        offset_sigma_s=STAMP_SIGMA_S,
        drift=0.0,
        drift_sigma=DRIFT_SIGMA,
        middle_s=first_s,
        overlap_s=_common(joints, other, start.lsl_s - first_s),
    )
    return Synchronised(results, joints, other, clock, STAMPS, f"the start that {path.name} states")


def _common(joints: JointTable, other: OtherFile, offset_s: float) -> tuple[float, float]:
    """Return the first and the last time, on the recording's clock, at which both devices recorded; raises InputError
    if they have no time in common.
    """
    times_s = [*(each.time_s for each in other.streams), *(each.time_s for each in other.markers)]
    ends = [each[[0, -1]] - offset_s for each in times_s]
    from_s = max(float(joints.time_s[0]), min(float(first) for first, _ in ends))
    to_s = min(float(joints.time_s[-1]), max(float(last) for _, last in ends))
    if from_s >= to_s:
        problem = "was recorded at another time than the results, by its time stamps"
        raise InputError(other.path, problem, "give an XDF file that the same computer recorded meanwhile")
    return from_s, to_s


Way = Callable[[Path, JointTable, OtherFile, SyncSettings], Synchronised]

WAYS: Final[dict[str, Way]] = {
    "acceleration": _by_movement,
    "gyroscope": _by_movement,
    "pulses": _by_pulses,
    "stamps": _by_stamps,
}
"""The function that compares the clocks, by the option that selects this comparison."""
