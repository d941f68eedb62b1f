"""Compare a result with the truth of a simulated session: the events, and the times of independence (such as the time
for which a knee is extended without help). The session's truth.npz states the events in which something went wrong, and
the contacts with the patient.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGION_BONES, REGIONS
from anchorpose.errors import InputError
from anchorpose.joints import STATE_CODE, JointState
from anchorpose.recording.regular_file import read_arrays
from anchorpose.results.frame_time import runs_of
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import (
    CONTACTS_FILE,
    EVENT_KINDS,
    PERSON,
    Contact,
    Episode,
    Measure,
    read_contacts,
    read_equipment_names,
)
from anchorpose.results.stand_training.event import fast_enough
from anchorpose.results.stand_training.stance import Session
from anchorpose.results.tables import JointTable
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table
from anchorpose.results.truth import FOOT_BONES
from anchorpose.results.uncertainty import NORMAL_95

NEAR_S: Final = 0.5
"""Maximum time in s between found and true onset for both to be the same event; a knee does not give way twice within
this time.
"""

IN_TIME_S: Final = 0.1
"""Maximum time in s between found and true onset for an event to count as found in time: three frames at 30 per second.
"""

EXACT_M: Final = 1e-6
"""Sigma in m that is given to true joints: practically zero."""

INDEPENDENCE: Final = ("_extended_", "hands_free_upright_", "_hands_time", "_hand_time")
"""Parts of the names of measures. A measure whose name contains one of these parts is a time of independence (without
help).
"""


_EVENTS: Final = ("event_kind", "event_start_s", "event_end_s", "event_depth")
_TOUCH: Final = ("touched_regions", "region_names", "on_equipment", "equipment_names", "part_names", "time")
TRUTH_REMEDY: Final = "give the truth.npz of a simulated session as it was written"


@dataclass(frozen=True, slots=True)
class TrueEvent:
    """A true event. kind: a kind of event in episodes.parquet, or clonus_left, clonus_right. start_s, end_s: beginning
    and end, on the truth's clock. depth: in the unit of events of this kind.
    """

    kind: str
    start_s: float
    end_s: float
    depth: float


def read_true_events(path: Path) -> tuple[TrueEvent, ...] | None:
    """Return the true events in the order of the file; None if the file is not the truth of a session.

    Raises InputError if the arrays of the file do not fit each other.
    """
    arrays = read_arrays(path, _EVENTS, TRUTH_REMEDY)
    if not arrays:
        return None
    columns = [arrays.get(name, np.zeros(0)) for name in _EVENTS]
    alike = all(column.ndim == 1 and len(column) == len(columns[0]) for column in columns)
    if not alike or any(column.dtype.kind not in "fiu" or not np.isfinite(column).all() for column in columns[1:]):
        raise InputError(path, "its arrays event_kind, _start_s, _end_s and _depth do not fit", TRUTH_REMEDY)
    rows = zip(columns[0].tolist(), *(column.tolist() for column in columns[1:]), strict=True)
    return tuple(TrueEvent(str(kind), *numbers) for kind, *numbers in rows)


def read_true_contacts(
    path: Path, rows: np.ndarray, frame: np.ndarray, time_s: np.ndarray
) -> tuple[tuple[Contact, ...], tuple[str, ...]]:
    """Return the true contacts of each region of the body with people and with each part of the equipment, and the
    names of all parts of the equipment. Only the frames ``rows`` (t,) of the truth count; contacts get the numbers
    frame (t,) and the times time_s (t,) of the matching frames of the result.

    Raises InputError if the arrays do not fit each other.
    """
    arrays = read_arrays(path, _TOUCH, TRUTH_REMEDY)
    touched, on_equipment = arrays.get("touched_regions"), arrays.get("on_equipment")
    regions, bones, parts = (
        tuple(map(str, arrays.get(name, np.zeros(0)).ravel()))
        for name in ("region_names", "part_names", "equipment_names")
    )
    frames = len(arrays["time"])
    if touched is None or on_equipment is None or set(regions) - set(REGIONS):
        raise InputError(path, "lacks touched_regions and on_equipment of a session", TRUTH_REMEDY)
    if touched.shape[::2] != (frames, len(regions)) or on_equipment.shape != (frames, len(parts), len(bones)):
        raise InputError(path, "its touched_regions and on_equipment do not fit", TRUTH_REMEDY)
    numbered, found = (frame, time_s), list[Contact]()
    for column, region in enumerate(regions):
        found += _contacts(touched[rows][:, :, column].any(axis=1), numbered, region, PERSON)
    for column, part in enumerate(parts):
        for region, own in _judged_regions(bones):
            found += _contacts(on_equipment[rows][:, column, own].any(axis=1), numbered, region, part)
    return tuple(found), parts


def _judged_regions(bones: tuple[str, ...]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the regions of the body that consist of bones (knees do not), with the indices (k,) of these bones in
    ``bones``. Feet are left out, since they always touch something.
    """
    for region, names in REGION_BONES.items():
        if not region.startswith("knee") and not set(names) & FOOT_BONES:
            yield region, np.flatnonzero([bone in names for bone in bones])


def _contacts(flags: np.ndarray, numbered: tuple[np.ndarray, np.ndarray], part: str, with_: str) -> Iterator[Contact]:
    """Yield the contacts of a region: one for each run of True in ``flags`` (t,). Their ``seen_share`` is 1, as if
    cameras had seen them completely. numbered: frame numbers (t,) and times (t,).
    """
    frame, time_s = numbered
    for run in runs_of(flags):
        first, last = run.start, run.stop - 1
        yield Contact(
            part=part,
            person="a person" if with_ == PERSON else None,
            with_=with_,
            first_frame=int(frame[first]),
            last_frame=int(frame[last]),
            start_s=float(time_s[first]),
            end_s=float(time_s[last]),
            seen_share=1.0,
            area_cm2=0.0,
            gap_mm=0.0,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EventScore:
    """Scores of the events of one kind. found: number of true events that were found, with an onset within ``NEAR_S``
    of the true onset; in_time: number of these whose found onset is within ``IN_TIME_S`` of the true onset. false:
    number of reported events that match no true event. late_s: mean delay of the found onsets after the true onsets;
    None if no event was found.
    """

    true: int
    found: int
    in_time: int
    false: int
    late_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeScore:
    """Scores of the times of independence (such as the time upright without help) in the whole recording and in every
    trial. Times that are 0 or unknown in both result and truth are left out.

    within: number of measures that differ from the truth by at most 1.96 sigma; refused: number of measures that have a
    value only in the result or only in the truth.
    """

    compared: int
    within: int
    refused: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionEvaluation:
    """Scores of a session. events: one score per kind of event that occurs in the truth within the recorded time, or in
    the result; empty if frames are too far apart to find events.
    """

    seconds: float
    events: tuple[tuple[str, EventScore], ...]
    times: TimeScore | None  # None if the result has no table of contacts


def score_session(
    results: Path, truth: Path, joints: JointTable, position_m: np.ndarray, rows: np.ndarray
) -> SessionEvaluation | None:
    """Compute the measures from the found and from the true joints of the same frames, and compare them. Return None if
    the truth is not that of a simulated session.

    joints: the found joints in t frames; position_m (t, 21, 3): the true joints at the frames ``rows`` (t,) of the
    truth.
    """
    true_events = read_true_events(truth)
    if true_events is None:
        return None
    trials = read_trial_table(results / TRIALS_FILE) if (results / TRIALS_FILE).exists() else None
    (held, parts), path = read_true_contacts(truth, rows, joints.frame, joints.time_s), results / CONTACTS_FILE
    contacts, names = (read_contacts(path), read_equipment_names(path)) if path.exists() else (None, ())
    config, exact = MeasureConfig(), true_joints(joints, position_m)
    session, measures = measure_session(joints, joint_angles(joints), contacts, config, trials, names)
    _, ideal = measure_session(exact, joint_angles(exact), held, config, trials, parts)
    return SessionEvaluation(
        seconds=float(session.seconds.sum()),
        events=score_events(session, true_events),
        times=None if contacts is None else score_times(measures, ideal),
    )


def true_joints(like: JointTable, position_m: np.ndarray) -> JointTable:
    """Return true joints (t, 21, 3) as a table with a sigma of almost 0, at the frames of the found joints. Joints with
    an unknown position are lost.
    """
    unknown = ~np.isfinite(position_m).all(axis=2)
    codes = np.where(unknown, STATE_CODE[JointState.LOST], STATE_CODE[JointState.OBSERVED]).astype(np.int8)
    sigma_m = np.where(unknown, np.nan, EXACT_M)
    return replace(like, position_m=position_m, sigma_m=sigma_m, state_code=codes)


def score_events(session: Session, true_events: Sequence[TrueEvent]) -> tuple[tuple[str, EventScore], ...]:
    """Return the score of each kind of event that occurs in the truth within the recorded time, or in the result.

    The result is empty if the frames are too far apart to find events.
    """
    if not fast_enough(session.joints.time_s):
        return ()
    first_s, last_s = session.joints.time_s[[0, -1]]
    inside = [event for event in true_events if first_s <= event.start_s and event.end_s <= last_s]
    scores = [(kind, _of_kind(session.episodes, inside, kind)) for kind in EVENT_KINDS]
    return tuple((kind, score) for kind, score in scores if score.true or score.false)


def _of_kind(episodes: Sequence[Episode], true_events: Sequence[TrueEvent], kind: str) -> EventScore:
    left = [episode for episode in episodes if episode.kind == kind]
    due, late_s = [event for event in true_events if event.kind == kind], list[float]()
    for event in due:
        near = [episode for episode in left if abs(episode.start_s - event.start_s) <= NEAR_S]
        late = [episode.start_s - event.start_s for episode in near]
        if near:
            nearest = int(np.argmin(np.abs(late)))
            left.remove(near[nearest])
            late_s.append(late[nearest])
    return EventScore(
        true=len(due),
        found=len(late_s),
        in_time=sum(abs(each) <= IN_TIME_S for each in late_s),
        false=len(left),
        late_s=float(np.mean(late_s)) if late_s else None,
    )


def score_times(found: Sequence[Measure], true: Sequence[Measure]) -> TimeScore:
    """Compare the times of independence (such as the time upright without help) with the truth, and score them. The
    means over the trials of a condition are left out.
    """
    pairs = [(one, other) for one, other in _paired(found, true) if one.value or other.value]
    known = [(one, other) for one, other in pairs if one.value is not None and other.value is not None]
    within = sum(is_within(one, other) for one, other in known)
    return TimeScore(compared=len(known), within=within, refused=len(pairs) - len(known))


def _paired(found: Sequence[Measure], true: Sequence[Measure]) -> list[tuple[Measure, Measure]]:
    of_truth = {(row.key, row.condition, row.trial): row for row in true}
    asked = [row for row in found if row.unit == "s" and any(part in row.measure for part in INDEPENDENCE)]
    # measures of the recording and of single trials; means over the trials of a condition are left out
    whole = [row for row in asked if (row.condition is None) == (row.trial is None)]
    return [(row, of_truth[row.key, row.condition, row.trial]) for row in whole]


def is_within(found: Measure, true: Measure) -> bool:
    """Return whether the values of both measures differ by at most 1.96 sigma of ``found``, or, if sigma is None,
    whether they are equal. Both values must be known.
    """
    assert found.value is not None
    assert true.value is not None
    return abs(found.value - true.value) <= NORMAL_95 * (found.sigma or 0.0) + 1e-9
