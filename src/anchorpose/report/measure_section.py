"""The measures of stand training as tables: value, how sure, how much of it inferred, or why there is none.

Which measures stand together, what each is called and means, and how its unit is written.

The meanings are short forms of those in docs/measures.md, which has the thresholds and the sources.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from anchorpose.report.ledger import Form, Ledger, Rows, Taking
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, decimals_for, escape, heading_row, named_part, spaced, table
from anchorpose.results.records import MEASURES_FILE, Measure


class Words(NamedTuple):
    """What people call a measure, and what it is in one sentence."""

    title: str
    meaning: str


_STANDING: Final = {
    "recorded_time": Words("time recorded", "From the first frame to the last."),
    "found_time": Words("time in which the patient was found", "The patient was found, or at least one joint."),
    "unknown_time": Words(
        "time in which posture is not known",
        "It could not be told whether the patient was upright, or frames are missing.",
    ),
    "upright_time": Words("time upright", "By thighs, hips and trunk; also in a frame or hoist: not who carries."),
    "upright_share": Words("share of known time upright", "Time upright, of the time in which posture is known."),
    "upright_bouts": Words("bouts of being upright", "How often the patient was upright without a break."),
    "longest_upright_bout": Words("longest time upright without a break", "The longest bout of being upright."),
}

_LENGTHS: Final = {"mean": "mean duration", "shortest": "shortest", "longest": "longest"}

_TRANSITIONS: Final = {
    f"{kind}_{which}": words
    for kind, verb in (("sit_to_stand", "standing up"), ("stand_to_sit", "sitting down"))
    for which, words in {
        "count": Words(
            f"{verb}: how often", "Changes between sitting and standing that were seen from beginning to end."
        ),
        **{
            f"duration_{which}": Words(
                f"{verb}: {title}", "From the pelvis leaving one height to its reaching the other."
            )
            for which, title in _LENGTHS.items()
        },
    }.items()
}

_EXTENSION: Final = {
    f"{joint}_flexion_upright_{which}": Words(f"{joint} flexion while upright, {title}", meaning + beyond)
    for joint, beyond in (("knee", " Below it: bent backwards."), ("hip", " Below it: thigh behind the trunk."))
    for which, title, meaning in (
        ("mean", "mean", "Mean angle in the frames in which the patient was upright; 0° is straight."),
        ("least", "least", "The angle that 5 of 100 upright frames stay below; 0° is straight."),
        ("greatest", "greatest", "The angle that 5 of 100 upright frames exceed; 0° is straight."),
    )
} | {"knee_straight_time": Words("time with the knee straight", "Time upright in which the knee was nearly straight.")}

_BALANCE: Final = {
    "sway_time": Words("time that sway is taken from", "The upright bouts that are long enough and lose no joint."),
    "sway_path": Words("sway, path", "Way of the body's estimated centre of mass over the floor, low-passed."),
    "sway_velocity": Words("sway, mean speed", "The path divided by its time."),
    "sway_rms_ap": Words("sway forwards and backwards", "Root mean square distance from the bout's mean, that way."),
    "sway_rms_ml": Words("sway sideways", "Root mean square distance from the bout's mean, that way."),
    "sway_ellipse_area": Words(
        "sway, area of the 95 % ellipse", "The ellipse on the floor that holds the centre of mass 95 of 100 times."
    ),
    "sway_path_noise": Words(
        "of the path, what noise alone would draw", "The path that errors of measurement alone would make."
    ),
}

_SYMMETRY: Final = {
    "knee_flexion_difference": Words("knee flexion, left minus right", "Mean difference while upright."),
    "hip_flexion_difference": Words("hip flexion, left minus right", "Mean difference while upright."),
    "load_share": Words(
        "estimated share of the load", "From where the centre of mass lies between the ankles; no force is measured."
    ),
}

_HELP: Final = {
    "assistance_time": Words("time with hands on", "Time in which anybody touches the patient, or the part named."),
    "contacts": Words("contacts", "How many contacts there were."),
    "assistance_share_upright": Words("share of upright time with hands on", "Of the time upright, with any contact."),
    "hands_free_upright_time": Words("time upright without hands on", "Time upright without any contact."),
    "hands_free_upright_share": Words(
        "share of upright time without hands on", "Of the time upright, with no contact."
    ),
    "hands_on_at_once_mean": Words(
        "contacts at once while upright, mean", "How many there were at one time, on average."
    ),
    "hands_on_at_once_most": Words("contacts at once while upright, most", "The most contacts at one time."),
}

GROUPS: Final = {
    "Standing": _STANDING,
    "Standing up and sitting down": _TRANSITIONS,
    "Knees and hips while upright": _EXTENSION,
    "Balance: sway of the body's centre of mass": _BALANCE,
    "Left and right while upright": _SYMMETRY,
    "Help by others": _HELP,
}

OTHERS: Final = "Other measures"

_WORDS: Final = {name: words for members in GROUPS.values() for name, words in members.items()}

_UNITS: Final = {
    "1": (100.0, " %"), "deg": (1.0, "°"), "deg/s": (1.0, "°/s"), "count": (1.0, ""), "cm2": (1.0, " cm²"),
}  # fmt: skip


def grouped_measures(measures: Sequence[Measure]) -> dict[str, list[Measure]]:
    """Heading to its measures, both in the order in which people read them; groups without any are left out."""
    groups: dict[str, list[Measure]] = {heading: [] for heading in (*GROUPS, OTHERS)}
    order = {name: position for position, name in enumerate(_WORDS)}
    for measure in sorted(measures, key=lambda m: (m.part is not None, order.get(m.measure, len(order)))):
        heading = next((title for title, members in GROUPS.items() if measure.measure in members), OTHERS)
        groups[heading].append(measure)
    return {heading: members for heading, members in groups.items() if members}


def words_of(name: str) -> Words:
    """Of a measure that this page does not know: its own name, and where to look."""
    return _WORDS.get(name, Words(spaced(name), "See docs/measures.md."))


def unit_of(unit: str) -> tuple[float, str]:
    """By what a value is multiplied, and what is written after it."""
    return _UNITS.get(unit, (1.0, f" {unit}"))


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
