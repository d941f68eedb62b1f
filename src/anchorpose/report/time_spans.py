"""Which measures grow with the time that they are taken over, and whether two sessions give them the same time.

Time upright, how often the patient stood up, the longest bout and the sway's path all grow when more was recorded, or
when more of what was recorded is known. Between sessions of different lengths such a change is not the patient's, so
it is shown and not tested. Shares, means, speeds and percentiles do not grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from anchorpose.report.words import number
from anchorpose.results.measures import Measure

ALIKE: Final = 0.05
"""Share of the longer one by which two spans of time may differ. Changes of a twentieth are rarely above the errors."""

_SWAY: Final = ("sway_path", "sway_path_noise")

_AVERAGED: Final = ("hands_on_at_once_mean",)  # the only count that is a mean

_EXTREMES: Final = ("_shortest", "_longest", "_most")  # of more of them there is a more extreme one


class Span(NamedTuple):
    """A time that measures are taken over: what of it there is, in words, and its seconds, None where not known."""

    words: str
    seconds: float | None


def grows_with_time(measure: Measure) -> bool:
    """Whether twice the time of the same training would give a larger (or more extreme) number."""
    name = measure.measure
    grows = name.endswith(("_time", *_EXTREMES)) or name.startswith("longest_") or measure.unit == "count"
    return (grows or name in _SWAY) and name not in _AVERAGED


def unlike_time(measure: Measure, first: Sequence[Measure], later: Sequence[Measure]) -> str | None:
    """Why a change of this measure between two sessions says nothing of the patient; None where it may.

    first, later: all measures of the two sessions. Where it is not known how long a session was, nothing is claimed.
    """
    if not grows_with_time(measure):
        return None
    pairs = zip(_spans_of(measure, first), _spans_of(measure, later), strict=True)
    return next((words for words in (_unlike(old, new) for old, new in pairs) if words), None)


def span_sentences(first: Sequence[Measure], later: Sequence[Measure]) -> list[str]:
    """What a reader must know of the times of two sessions, one sentence for each that differs."""
    return [
        f"{old.words}: {number(new.seconds, 1)} instead of {number(old.seconds, 1)} s, so that times, counts, extremes "
        "and paths taken over it are not tested"
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
        return f"not tested: the time {old.words} is not known"
    if not _differ(old.seconds, new.seconds):
        return None
    return f"not tested: {'more' if new.seconds > old.seconds else 'less'} time {old.words}"


def _differ(old_s: float, new_s: float) -> bool:
    return abs(new_s - old_s) > ALIKE * max(old_s, new_s)
