"""The measures of stand training as tables: value, how sure, how much of it inferred, or why there is none."""

from __future__ import annotations

from collections.abc import Sequence

from anchorpose.report.ledger import Form, Ledger, Rows, Taking
from anchorpose.report.measure_words import grouped_measures, unit_of, words_of
from anchorpose.report.session import Session
from anchorpose.report.table import heading_row, table
from anchorpose.report.words import COVERAGE, decimals_for, escape, named_part
from anchorpose.results.measures import MEASURES_FILE, Measure

_TITLES = ("measure", "value, or left", "right", "inferred", "frames", "source")

Entry = list[Measure]
"""What stands in one row: the left and the right of a measure, or those without a value for one and the same reason."""


def measure_section(session: Session) -> str:
    """HTML: the measures of the session and of parts of the body, those of single persons folded; what they mean."""
    if not session.measures:
        return "<p>measures.parquet holds no measures.</p>"
    ledger = session.ledger
    main = [measure for measure in session.measures if not _is_detail(measure)]
    detail = [measure for measure in session.measures if _is_detail(measure)]
    whole, title = (
        _table(ledger, "Measures of the training", main),
        "Help in detail: contacts by part, and each person's",
    )
    folded = f"<details><summary>{escape(title)}</summary>{_table(ledger, title, detail)}</details>" if detail else ""
    return whole + folded + _meanings(session.measures)


def _is_detail(measure: Measure) -> bool:
    return measure.person is not None or (measure.part is not None and measure.measure == "contacts")


def rows_of(measure: Measure) -> Rows:
    """The row of measures.parquet that a measure stands in."""
    keys = ("measure", "side", "part", "person")
    return Rows(MEASURES_FILE, tuple((key, getattr(measure, key)) for key in keys))


def title_of(measure: Measure) -> str:
    """In words: which measure, of which side and part, by whom."""
    words = [words_of(measure.measure).title]
    words += [named_part(measure.part)] if measure.part else [measure.side] if measure.side else []
    words += [f"by {measure.person}"] if measure.person else []
    return ", ".join(words)


def value_form(measure: Measure) -> Form:
    """As many digits as its uncertainty carries."""
    times, after = unit_of(measure.unit)
    reach = None if measure.sigma is None else COVERAGE * measure.sigma * times
    value = times * (measure.value or 0.0)
    whole = reach is None and abs(value - round(value)) < 1e-9
    return Form(decimals=0 if whole else decimals_for(reach, value), times=times, after=after)


def _table(ledger: Ledger, title: str, measures: Sequence[Measure]) -> str:
    groups = grouped_measures(measures).items()
    bodies = [
        heading_row(heading, len(_TITLES)) + "".join(_row(ledger, entry) for entry in _entries(members))
        for heading, members in groups
    ]
    return table(title, _TITLES, "".join(f"<tbody>{body}</tbody>" for body in bodies), "measures")


def _entries(measures: Sequence[Measure]) -> list[Entry]:
    entries: list[Entry] = []
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


def _row(ledger: Ledger, entry: Entry) -> str:
    sources = "".join(ledger.link(rows_of(measure)) for measure in entry)
    first = entry[0]
    if first.value is None:
        titles = "; ".join(dict.fromkeys(title_of(measure) for measure in entry))
        why = f"<td colspan='3' class='why'>no value: {escape(first.why)}</td>"
        return f"<tr><th scope='row'>{escape(titles)}</th>{why}<td></td><td>{sources}</td></tr>"
    title = title_of(first) if len(entry) == 1 else words_of(first.measure).title
    frames = [ledger.figure(rows_of(measure), Taking(column="frames"), Form()) for measure in entry]
    values = [value_and_error(ledger, measure) for measure in entry]
    inferred = " / ".join(filter(None, (_inferred(ledger, measure) for measure in entry)))
    cells = {"left" if len(values) == 2 else "value": values[0], "right": "".join(values[1:]), "inferred": inferred,
             "frames": " / ".join(dict.fromkeys(frames)), "source": sources}  # fmt: skip
    name = f"<th scope='row' title='{escape(words_of(first.measure).meaning)}'>{escape(title)}</th>"
    return f"<tr>{name}{''.join(f'<td data-label={label!r}>{cell}</td>' for label, cell in cells.items())}</tr>"


def value_and_error(ledger: Ledger, measure: Measure) -> str:
    """HTML: a measure that has a value, and 1.96 times its sigma; a sigma of 0 is left out: nothing is that sure."""
    rows, form = rows_of(measure), value_form(measure)
    value = ledger.figure(rows, Taking(column="value"), form)
    if not measure.sigma:
        return value
    reach = Form(decimals=form.decimals, times=form.times * COVERAGE, before="± ", after=form.after)
    return f"{value} {ledger.figure(rows, Taking(column='sigma'), reach)}"


def _inferred(ledger: Ledger, measure: Measure) -> str:
    share = Form(times=100.0, after=" %", share=True)
    known = measure.inferred_share is not None
    return ledger.figure(rows_of(measure), Taking(column="inferred_share"), share) if known else ""


def _meanings(measures: Sequence[Measure]) -> str:
    words = [words_of(name) for name in dict.fromkeys(measure.measure for measure in measures)]
    items = "".join(f"<dt>{escape(title)}</dt><dd>{escape(meaning)}</dd>" for title, meaning in words)
    where = "<p class='hint'>With thresholds and sources: docs/measures.md.</p>"
    return f"<details><summary>What the measures mean</summary>{where}<dl>{items}</dl></details>"
