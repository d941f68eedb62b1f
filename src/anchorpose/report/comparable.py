"""Decide which sessions may be compared and which changes are tested, and list the differences between sessions that a
reader must know.

Some measures grow when the recording is longer, or when the posture is known for a longer part of it: for example time
upright, number of rises, longest time upright, path and extent of the sway. Between sessions of different lengths, a
change of such a measure says nothing about the patient, so it is shown but not tested. Shares, speeds, percentiles, and
means of angles and durations do not grow with time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from anchorpose.errors import InputError
from anchorpose.report.session import Session
from anchorpose.report.words import listed, number
from anchorpose.results.records import MEASURES_FILE, Measure
from anchorpose.results.run_record import recording_digest
from anchorpose.results.tables import JOINTS_FILE
from anchorpose.results.uncertainty import NORMAL_95

ALIKE: Final = 0.05
"""Maximum difference between two comparable spans of time, as a share of the longer span. A smaller difference widens
the limit of what counts as a change (``TimeGap.share``).
"""

_SWAY: Final = ("sway_path", "sway_path_noise", "sway_rms_ap", "sway_rms_ml", "sway_ellipse_area")
"""Measures of sway that grow with the time over which sway is computed: in a longer time, the body drifts farther."""

SCATTERING: Final = (*_SWAY, "sway_velocity")
"""Measures that vary from minute to minute far more than their errors of measurement: the area of the sway ellipse
varies by a third although the patient is unchanged. A change of such a measure between two sessions is tested only
against the minimal detectable change from repeated sessions.
"""

SCATTERS: Final = "sway scatters from minute to minute, and no repeated sessions are given (--reliability)"

_LARGEST: Final = ("functional_reach", "single_leg_stance")  # measures whose value is the patient's best attempt

# measures whose unit is a count, but whose value is a mean, so the value does not grow with time
_AVERAGED: Final = ("hands_on_at_once_mean",)

_EXTREMES: Final = (
    "_shortest",
    "_longest",
    "_most",
    "_largest",
    "_range",
    "_amplitude",
)  # endings of the names of measures that are an extreme of all repetitions: more repetitions give a more extreme value


class Span(NamedTuple):
    """A span of time over which measures are taken: its name in words, and its length in s, None if unknown."""

    words: str
    seconds: float | None


def grows_with_time(measure: Measure) -> bool:
    """Return whether a measure's value would be larger (or more extreme) if the training took twice as long. Latencies
    (times until an event) grow with time because a short trial lacks the events that occur late.
    """
    name = measure.measure
    grows = name.endswith(("_time", "_latency", *_EXTREMES)) or name.startswith("longest_") or measure.unit == "count"
    return (grows or name in (*_SWAY, *_LARGEST)) and name not in _AVERAGED


class TimeGap(NamedTuple):
    """The difference in time between two sessions (or conditions) that matters to a measure.

    why: the reason why a change of the measure is not tested, since the recorded times, or the times with known
    posture, differ or are unknown; None if it is tested. share: the relative difference of the times, as a share of the
    longer time (the largest, if several times matter). A measure that grows with time may differ by this share only
    because a session lasted longer.
    """

    why: str | None
    share: float


def time_gap(measure: Measure, first: Sequence[Measure], later: Sequence[Measure]) -> TimeGap:
    """Return the difference between two sessions (or conditions) in the time over which a measure is taken; (None, 0)
    for a measure that does not grow with time. first, later: all measures of each session or condition.
    """
    if not grows_with_time(measure):
        return TimeGap(None, 0.0)
    pairs = list(zip(_spans_of(measure, first), _spans_of(measure, later), strict=True))
    why = next((words for words in (_unlike(old, new) for old, new in pairs) if words), None)
    return TimeGap(why, max(_apart(old.seconds, new.seconds) for old, new in pairs))


def _apart(old_s: float | None, new_s: float | None) -> float:
    """Return the difference of two spans as a share of the longer span; 0 if a span is unknown or 0."""
    if old_s is None or new_s is None or not max(old_s, new_s):
        return 0.0
    return abs(new_s - old_s) / max(old_s, new_s)


def span_sentences(first: Sequence[Measure], later: Sequence[Measure]) -> list[str]:
    """Return a sentence for each time span whose length differs between two sessions: the time recorded, the time with
    known posture, and the time over which sway is computed.
    """
    return [
        f"{old.words}: {number(new.seconds, 1)} instead of {number(old.seconds, 1)} s, so that measures that "
        "grow with it are not tested"
        for old, new in zip(_spans(first), _spans(later), strict=True)
        if old.seconds is not None and new.seconds is not None and _differ(old.seconds, new.seconds)
    ]


def _spans(measures: Sequence[Measure]) -> tuple[Span, Span, Span]:
    value = {m.measure: m.value for m in measures if m.part is None and m.person is None}
    recorded, unknown = value.get("recorded_time"), value.get("unknown_time")
    known = None if recorded is None or unknown is None else recorded - unknown
    return Span("recorded", recorded), Span("with posture known", known), Span("for sway", value.get("sway_time"))


def _spans_of(measure: Measure, measures: Sequence[Measure]) -> tuple[Span, ...]:
    recorded, known, sway = _spans(measures)
    return (sway,) if measure.measure in _SWAY else (recorded, known)


def _unlike(old: Span, new: Span) -> str | None:
    if old.seconds is None or new.seconds is None:
        return f"the time {old.words} is not known"
    if not _differ(old.seconds, new.seconds):
        return None
    return f"{'more' if new.seconds > old.seconds else 'less'} time {old.words}"


def _differ(old_s: float, new_s: float) -> bool:
    return _apart(old_s, new_s) > ALIKE


MIXED: Final = 0.1
"""Limit of the difference between two recordings in the share of the recording that the trials of a condition take up.
The page states only differences above this limit. If a condition changes an angle by 10 degrees, a difference of a
tenth shifts the mean over the recording by 1 degree, which is about the error of this mean.
"""

MOST_NAMES: Final = 8  # maximum number of differing settings that a sentence names; further settings are only counted


def require_comparable(sessions: Sequence[Session]) -> None:
    """Raise InputError if two sessions come from the same recording, or if their measures are defined
    differently.
    """
    first = sessions[0]
    for later in sessions[1:]:
        what = _other_definition(first, later)
        if what is not None:
            problem = f"cannot be compared with that of {first.folder} ({what})"
            remedy = "run 'anchorpose measure' on all of these folders with this version of the program"
            raise InputError(later.folder / MEASURES_FILE, problem, remedy)
    _require_different(sessions)


def differences(sessions: Sequence[Session], labels: Sequence[str]) -> list[str]:
    """Return sentences on how each later session differs from the first: in program version, settings, cameras, frame
    rate, time spans, time in each condition and the patient's learnt height.
    """
    first, notes = sessions[0], []
    for later, label in zip(sessions[1:], labels[1:], strict=True):
        sentences = [
            *_versions(first.run, later.run),
            *_settings(first.run, later.run),
            *_cameras(first.run, later.run),
            *_rates(first.joints.time_s, later.joints.time_s),
            *span_sentences(first.measures, later.measures),
            *_conditions(first, later),
            *_bodies(first.run, later.run),
        ]
        ended = [sentence if sentence.endswith("?") else f"{sentence}." for sentence in sentences]
        notes += [f"{label} against {labels[0]}: {sentence}" for sentence in ended]
    return notes


def _other_definition(first: Session, later: Session) -> str | None:
    """Return a text on how the definitions of two sessions' measures differ; None if the definitions are equal."""
    old, new = first.definition, later.definition
    if old is None or new is None:
        return "one of them does not state how it was computed"
    if old.anchorpose != new.anchorpose:
        return f"measured by anchorpose {new.anchorpose} instead of {old.anchorpose}"
    others = _changed(old.config, new.config)
    if others:
        return f"other definitions: {_some(others)}"
    units, own = _units(first), _units(later)
    missing = sorted(set(units) ^ set(own))
    if missing:
        return f"{missing[0]} is in only one of them"
    return next((f"{name} has another unit" for name in units if units[name] != own[name]), None)


def _units(session: Session) -> dict[str, str]:
    """Return the unit of each measure that is not about a single body part or person. Every session has these measures.
    Measures about a body part or person exist only in sessions in which this part was touched, or this person touched
    the patient.
    """
    return {m.measure: m.unit for m in session.measures if m.part is None and m.person is None}


def _require_different(sessions: Sequence[Session]) -> None:
    seen = dict[str, Session]()
    for session in sessions:
        place, recording = (
            str(session.folder.resolve()),
            recording_digest((file, sha) for file, (sha,) in session.inputs),
        )
        if place in seen:
            raise InputError(session.folder, "is given twice", "give each session once")
        if recording is not None and recording in seen:
            problem = f"was made from the same recording as {seen[recording].folder}"
            raise InputError(session.folder / JOINTS_FILE, problem, "compare results of different recordings")
        seen |= {place: session} if recording is None else {place: session, recording: session}


def _versions(first: dict[str, Any], later: dict[str, Any]) -> list[str]:
    old, new = (run.get("versions", {}).get("anchorpose", "an unknown version") for run in (first, later))
    return [] if old == new else [f"tracked by anchorpose {new} instead of {old}"]


def _settings(first: dict[str, Any], later: dict[str, Any]) -> list[str]:
    names = _changed(first.get("config"), later.get("config"))
    return [f"other settings: {_some(names)}"] if names else []


def _changed(old: Any, new: Any) -> list[str]:
    """Return the dotted names of all settings that differ between two nested configs, or are in only one of them."""
    flat, own = _flat(old), _flat(new)
    return [name for name in dict.fromkeys([*flat, *own]) if flat.get(name) != own.get(name)]


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{', '.join(names[:MOST_NAMES])}{more}"


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(value, dict):
        return {name: value}
    return {
        path: item for key, below in value.items() for path, item in _flat(below, f"{name}.{key}".strip(".")).items()
    }


def _cameras(first: dict[str, Any], later: dict[str, Any]) -> list[str]:
    old, new = ([str(camera["name"]) for camera in run.get("cameras", [])] for run in (first, later))
    return [] if old == new or not old or not new else [f"other cameras: {listed(new)} instead of {listed(old)}"]


def _rates(first_s: np.ndarray, later_s: np.ndarray) -> list[str]:
    old, new = _rate_hz(first_s), _rate_hz(later_s)
    if old is None or new is None or abs(old - new) < 0.1 * old:
        return []
    return [f"{new:.0f} instead of {old:.0f} frames a second: paths and speeds depend on that"]


def _rate_hz(time_s: np.ndarray) -> float | None:
    return None if len(time_s) < 2 else (len(time_s) - 1) / float(time_s[-1] - time_s[0])


def _conditions(first: Session, later: Session) -> list[str]:
    old, new = _condition_times_s(first), _condition_times_s(later)
    names = list(dict.fromkeys([*old, *new]))
    old_s, new_s = (_spans(each.measures)[0].seconds or math.nan for each in (first, later))
    alike = all(abs(new.get(name, 0.0) / new_s - old.get(name, 0.0) / old_s) <= MIXED for name in names)
    if bool(old) == bool(new) and alike:
        return []
    times = [_condition_words(each, names, whole_s) for each, whole_s in ((new, new_s), (old, old_s))]
    return [
        f"{' instead of '.join(times)}: measures of the whole recording mix the conditions, so these times alone may "
        "change them"
    ]


def _condition_times_s(session: Session) -> dict[str, float]:
    """Return the recorded time of all trials by condition; empty for a session without trials."""
    found: dict[str, float] = {}
    for row in session.trial_measures:
        if row.measure == "recorded_time" and row.condition is not None and row.trial is not None:
            found[row.condition] = found.get(row.condition, 0.0) + (row.value or 0.0)
    return found


def _condition_words(times_s: dict[str, float], names: Sequence[str], whole_s: float) -> str:
    if not times_s:
        return "no trials"
    times = [f"{number(times_s.get(name, 0.0), 1)} s of {name}" for name in names]
    return f"{listed(times)} in {number(whole_s, 1)} s"


def _bodies(first: dict[str, Any], later: dict[str, Any]) -> list[str]:
    old, new = first.get("body"), later.get("body")
    if old is None or new is None:
        return []
    reach = NORMAL_95 * math.hypot(old["height_sigma_m"], new["height_sigma_m"])
    change = abs(new["height_m"] - old["height_m"])
    if change <= reach:
        return []
    return [f"the learnt heights differ by {100 * change:.1f} cm, more than their errors: is it the same patient?"]
