"""Write the measures of stand training as tables. Each row states value, uncertainty and the share of frames with
inferred joints, or the reason why the value is missing.

Title and meaning of each measure are in measures.csv. docs/measures.md describes the measures at length, with
thresholds and sources.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import itemgetter
from typing import Final, NamedTuple

from markupsafe import Markup

from anchorpose.report.session import Session
from anchorpose.report.words import PERCENT, Form, decimals_for, figure, named_part, read_words, spaced
from anchorpose.results.records import Measure
from anchorpose.results.uncertainty import NORMAL_95


class Words(NamedTuple):
    """The usual name of a measure, and one sentence that explains the measure."""

    title: str
    meaning: str


_ROWS: Final = read_words("anchorpose.report", "measures.csv")
_WORDS: Final = {row["measure"]: Words(row["title"], row["meaning"]) for row in _ROWS}

GROUPS: Final = {heading: [row["measure"] for row in rows] for heading, rows in groupby(_ROWS, itemgetter("group"))}
"""Heading of each table, and the names of its measures."""

PRINTED: Final = [row["measure"] for row in sorted(_ROWS, key=lambda row: int(row["printed"] or 0)) if row["printed"]]
"""Names of the main measures in the order in which they are printed; measures.parquet has all measures."""

COMPARED: Final = [name for name in PRINTED if name not in ("recorded_time", "found_time", "unknown_time", "sway_time")]
"""Names of the main measures, without times that depend on the recording and not on the patient. By default, only these
measures are compared between conditions; only these measures are followed over dates.
"""

OTHERS: Final = "Other measures"

_UNITS: Final = {
    "1": (100.0, " %"),
    "deg": (1.0, "°"),
    "deg/s": (1.0, "°/s"),
    "count": (1.0, ""),
    "score": (1.0, ""),
    "cm2": (1.0, " cm²"),
}


def grouped_measures(measures: Sequence[Measure]) -> dict[str, list[Measure]]:
    """Return the measures under each heading of measures.csv, in the order of this file. Measures about a part of the
    body come last under their heading; headings without measures are left out.
    """
    groups: dict[str, list[Measure]] = {heading: [] for heading in (*GROUPS, OTHERS)}
    order = {name: position for position, name in enumerate(_WORDS)}
    for measure in sorted(measures, key=lambda m: (m.part is not None, order.get(m.measure, len(order)))):
        heading = next((title for title, members in GROUPS.items() if measure.measure in members), OTHERS)
        groups[heading].append(measure)
    return {heading: members for heading, members in groups.items() if members}


def words_of(name: str) -> Words:
    """Return the words for a measure; if measures.csv lacks the measure, its title is its name."""
    return _WORDS.get(name, Words(spaced(name), "See docs/measures.md."))


def unit_of(unit: str) -> tuple[float, str]:
    """Return the factor from a table's unit to the printed unit, and the printed unit as text."""
    return _UNITS.get(unit, (1.0, f" {unit}"))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureRow:
    """A table row, which shows one measure, the left and right side of a measure, or several measures that lack a value
    for the same reason.

    why: the reason why values are missing, else empty; values: one value, or left and right.
    """

    title: str
    why: str = ""
    meaning: str = ""
    values: Sequence[Markup] = ()
    inferred: str = ""
    frames: str = ""


class MeasureSection(NamedTuple):
    """The content of the section on measures: rows by heading, and the usual names and explanations of the measures.
    whole: measures about the session or a part of the body; detail: measures about single persons who touched the
    patient, and numbers of contacts of each part.
    """

    whole: dict[str, list[MeasureRow]]
    detail: dict[str, list[MeasureRow]]
    words: list[Words]


def measure_section(session: Session) -> MeasureSection:
    """Return the section with all measures of a session."""
    whole = [measure for measure in session.measures if not _is_detail(measure)]
    detail = [measure for measure in session.measures if _is_detail(measure)]
    return MeasureSection(
        whole=_groups(whole),
        detail=_groups(detail),
        words=[words_of(name) for name in dict.fromkeys(measure.measure for measure in session.measures)],
    )


def _is_detail(measure: Measure) -> bool:
    return measure.person is not None or (measure.part is not None and measure.measure == "contacts")


def title_of(measure: Measure) -> str:
    """Return the title of a measure, with the side, part of the body and person that it is about."""
    words = [words_of(measure.measure).title]
    words += [named_part(measure.part)] if measure.part else [measure.side] if measure.side else []
    words += [f"by {measure.person}"] if measure.person else []
    return ", ".join(words)


def value_form(measure: Measure) -> Form:
    """Return the form in which a measure's value is written: its unit, and as many digits as its sigma justifies."""
    times, after = unit_of(measure.unit)
    reach = None if measure.sigma is None else NORMAL_95 * measure.sigma * times
    value = times * (measure.value or 0.0)
    whole = reach is None and abs(value - round(value)) < 1e-9
    return Form(decimals=0 if whole else decimals_for(reach, value), times=times, after=after)


def _groups(measures: Sequence[Measure]) -> dict[str, list[MeasureRow]]:
    groups = grouped_measures(measures).items()
    return {heading: [_row(entry) for entry in _entries(members)] for heading, members in groups}


def _entries(measures: Sequence[Measure]) -> list[list[Measure]]:
    """Group the measures into lists, one list for each table row (see ``MeasureRow``)."""
    entries: list[list[Measure]] = []
    for measure in measures:
        last = entries[-1][-1] if entries else None
        if last is not None and (_other_side(last, measure) or (measure.why is not None and measure.why == last.why)):
            entries[-1].append(measure)
        else:
            entries.append([measure])
    return entries


def _other_side(left: Measure, right: Measure) -> bool:
    alike = (left.measure, left.part, left.person) == (right.measure, right.part, right.person)
    return alike and (left.side, right.side) == ("left", "right") and left.value is not None is not right.value


def _row(entry: Sequence[Measure]) -> MeasureRow:
    first = entry[0]
    if first.value is None:
        titles = "; ".join(dict.fromkeys(title_of(measure) for measure in entry))
        return MeasureRow(title=titles, why=str(first.why))
    frames = [figure(measure.frames, Form()) for measure in entry]
    return MeasureRow(
        title=title_of(first) if len(entry) == 1 else words_of(first.measure).title,
        meaning=words_of(first.measure).meaning,
        values=[value_and_error(measure) for measure in entry],
        inferred=Markup(" / ").join(filter(None, (inferred_share(measure) for measure in entry))),
        frames=Markup(" / ").join(dict.fromkeys(frames)),
    )


def value_and_error(measure: Measure) -> Markup:
    """Return the text of a measure's value with 1.96 times its sigma. A sigma of 0 is not printed, since every value
    has an error.
    """
    form = value_form(measure)
    value = figure(measure.value, form)
    if not measure.sigma:
        return value
    reach = Form(decimals=form.decimals, times=form.times * NORMAL_95, before="± ", after=form.after)
    return Markup("{} {}").format(value, figure(measure.sigma, reach))


def form_within(like: Measure, value: float | None, low: float | None, high: float | None) -> Form:
    """Return the form in which a number is written: with the unit of the measure ``like`` and, if the number has a 95 %
    interval (``low`` to ``high``), with as many digits as this interval justifies.
    """
    sigma = None if low is None or high is None else (high - low) / 2.0 / NORMAL_95
    return value_form(replace(like, value=value or 0.0, sigma=sigma or None, why=None))


def value_and_interval(like: Measure, value: float, low: float | None, high: float | None) -> Markup:
    """Return the text of a difference with its sign and, if known, its 95 % interval; like: a measure with the unit of
    the difference.
    """
    form = form_within(like, value, low, high)
    text = Markup("{}{}").format("+" if value > 0 else "", figure(value, form))
    if low is None or high is None:
        return text
    return Markup("{} ({} to {})").format(text, figure(low, form), figure(high, form))


def inferred_share(measure: Measure, after: str = " %") -> Markup:
    """Return the percentage of a measure's frames with an inferred joint, followed by ``after``; empty if unknown."""
    if measure.inferred_share is None:
        return Markup()
    return figure(measure.inferred_share, Form(times=100.0, after=after, share=True))


# s; a time with unknown posture, or without the patient, that is shorter than this is a rounding error
ROUNDING_S: Final = 0.001


def measure_rows(measures: Sequence[Measure]) -> list[tuple[str, str, str, str]]:
    """Return a row per printed measure: title, value with its error, share of frames with inferred joints, and the
    reason if the value is missing.
    """
    rows, lower_bounds = [], _lower_bounds(measures)
    for name in PRINTED:
        for row in measures:
            if row.measure == name and not (name == "assistance_time" and row.person and row.part):
                inferred = "" if row.inferred_share is None else PERCENT.write(row.inferred_share)
                at_least = "at least " if row.value is not None and name in lower_bounds else ""
                rows.append((title_of(row), at_least + value_text(row), inferred, row.why or ""))
    return rows


def value_text(measure: Measure) -> str:
    """Return ``value_and_error`` as plain text; "unknown" without a value."""
    if measure.value is None:
        return "unknown"
    form = value_form(measure)
    spread = f" ± {form.write(NORMAL_95 * measure.sigma)}" if measure.sigma else ""
    return form.write(measure.value) + spread


def _lower_bounds(measures: Sequence[Measure]) -> set[str]:
    """Return the names of measures whose values are only lower bounds, since the posture is unknown or the patient not
    found in part of the recording.
    """
    seconds = {row.measure: row.value for row in measures if row.value is not None and row.unit == "s"}
    found: set[str] = set()
    if seconds.get("unknown_time", 0.0) > ROUNDING_S:
        found |= {"upright_time", "sit_to_stand_count", "stand_to_sit_count"}
    if seconds.get("recorded_time", 0.0) - seconds.get("found_time", 0.0) > ROUNDING_S:
        found |= {"assistance_time"}
    return found
