"""The measures of stand training as tables: value, uncertainty, how much of it is inferred, or why there is none.

The words of each measure are short forms of docs/measures.md, which has the thresholds and the sources.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from markupsafe import Markup

from anchorpose.report.session import Session
from anchorpose.report.words import PERCENT, Form, decimals_for, figure, named_part, spaced
from anchorpose.results.records import Measure
from anchorpose.results.stand_training.extension import SIDED, UNSIDED
from anchorpose.results.uncertainty import NORMAL_95


class Words(NamedTuple):
    """What people call a measure, and what it is in one sentence."""

    title: str
    meaning: str


_STANDING: Final = {
    "recorded_time": Words("time recorded", "From the first frame to the last."),
    "found_time": Words("time in which the patient was found", "The patient was found, or at least one joint."),
    "unknown_time": Words(
        "time in which posture is not known", "It is not known whether the patient was upright, or frames are missing."
    ),
    "upright_time": Words(
        "time upright", "By thighs, hips and trunk; also in a frame or hoist, whoever carries the weight."
    ),
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
                f"{verb}: {title}", "From the pelvis leaving one height until it reaches the other."
            )
            for which, title in _LENGTHS.items()
        },
    }.items()
}

_EXTENSION: Final = {
    f"{joint}_flexion_upright_{which}": Words(f"{joint} flexion while upright, {title}", meaning + beyond)
    for joint, beyond in (("knee", " Negative: bent backwards."), ("hip", " Negative: thigh behind the trunk."))
    for which, title, meaning in (
        ("mean", "mean", "Mean angle in the frames in which the patient was upright; 0° is straight."),
        ("least", "least", "The angle that 5 of 100 upright frames stay below; 0° is straight."),
        ("greatest", "greatest", "The angle that 5 of 100 upright frames exceed; 0° is straight."),
    )
} | {"knee_straight_time": Words("time with the knee straight", "Time upright in which the knee was nearly straight.")}

_BALANCE: Final = {
    "sway_time": Words("time that sway is taken from", "The upright bouts that are long enough and lose no joint."),
    "sway_path": Words("sway, path", "Path of the body's estimated centre of mass over the floor, low-pass filtered."),
    "sway_velocity": Words("sway, mean speed", "The path divided by its time."),
    "sway_rms_ap": Words("sway forwards and backwards", "Root mean square distance from the bout's mean, that way."),
    "sway_rms_ml": Words("sway sideways", "Root mean square distance from the bout's mean, that way."),
    "sway_ellipse_area": Words(
        "sway, area of the 95 % ellipse", "The ellipse on the floor that holds the centre of mass 95 of 100 times."
    ),
    "sway_path_noise": Words("sway, path from noise alone", "The path that errors of measurement alone would make."),
}

_SYMMETRY: Final = {
    "knee_flexion_difference": Words("knee flexion, left minus right", "Mean difference while upright."),
    "hip_flexion_difference": Words("hip flexion, left minus right", "Mean difference while upright."),
    "load_share": Words(
        "estimated share of the load", "From where the centre of mass lies between the ankles; no force is measured."
    ),
}

_RANGES: Final = {
    f"{angle}_range": Words(
        f"range of motion, {spaced(angle)}", "From its lowest to its highest angle, each held for a tenth of a second."
    )
    for angle in (*SIDED, *UNSIDED)
}

_TASKS: Final = {
    "five_times_sit_to_stand": Words(
        "five times sit to stand", "From leaving the seat first to standing for the fifth time, without a pause."
    ),
    "functional_reach": Words("functional reach", "How far the wrist of a raised arm went forward, feet in place."),
    "single_leg_stance": Words("standing on one leg", "The longest time with the other foot off the floor."),
}

_STEPS: Final = {
    "step_count": Words("steps", "Steps seen from foot off to foot strike while upright."),
    "swing_time_mean": Words("swing time, mean", "From foot off to foot strike."),
    "step_length_mean": Words("step length, mean", "Between both ankles at foot strike, in the direction of the step."),
    "step_time_mean": Words("step time, mean", "From one foot strike to that of the other foot."),
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
    "Range of motion": _RANGES,
    "Tests that the recording shows": _TASKS,
    "Steps": _STEPS,
    "Help by others": _HELP,
}

OTHERS: Final = "Other measures"

_WORDS: Final = {name: words for members in GROUPS.values() for name, words in members.items()}

_UNITS: Final = {"1": (100.0, " %"), "deg": (1.0, "°"), "deg/s": (1.0, "°/s"), "count": (1.0, ""), "cm2": (1.0, " cm²")}


def grouped_measures(measures: Sequence[Measure]) -> dict[str, list[Measure]]:
    """Heading to its measures, both in reading order; empty groups are left out."""
    groups: dict[str, list[Measure]] = {heading: [] for heading in (*GROUPS, OTHERS)}
    order = {name: position for position, name in enumerate(_WORDS)}
    for measure in sorted(measures, key=lambda m: (m.part is not None, order.get(m.measure, len(order)))):
        heading = next((title for title, members in GROUPS.items() if measure.measure in members), OTHERS)
        groups[heading].append(measure)
    return {heading: members for heading, members in groups.items() if members}


def words_of(name: str) -> Words:
    """What people call a measure; one that this version does not know keeps its own name."""
    return _WORDS.get(name, Words(spaced(name), "See docs/measures.md."))


def unit_of(unit: str) -> tuple[float, str]:
    """By what a value is multiplied, and what is written after it."""
    return _UNITS.get(unit, (1.0, f" {unit}"))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureRow:
    """The left and the right of a measure, or all measures without a value for one and the same reason.

    why: there is no value, empty where there is one; values: one, or left and right.
    """

    title: str
    why: str = ""
    meaning: str = ""
    values: Sequence[Markup] = ()
    inferred: str = ""
    frames: str = ""


class MeasureGroup(NamedTuple):
    """Measures that stand together."""

    heading: str
    rows: list[MeasureRow]


class MeasureSection(NamedTuple):
    """whole: measures of the session and of parts of the body; detail: of single persons; words: what they mean."""

    whole: list[MeasureGroup]
    detail: list[MeasureGroup]
    words: list[Words]


def measure_section(session: Session) -> MeasureSection:
    """All measures of a session."""
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
    """Which measure, of which side and part, by whom."""
    words = [words_of(measure.measure).title]
    words += [named_part(measure.part)] if measure.part else [measure.side] if measure.side else []
    words += [f"by {measure.person}"] if measure.person else []
    return ", ".join(words)


def value_form(measure: Measure) -> Form:
    """As many digits as its uncertainty carries."""
    times, after = unit_of(measure.unit)
    reach = None if measure.sigma is None else NORMAL_95 * measure.sigma * times
    value = times * (measure.value or 0.0)
    whole = reach is None and abs(value - round(value)) < 1e-9
    return Form(decimals=0 if whole else decimals_for(reach, value), times=times, after=after)


def _groups(measures: Sequence[Measure]) -> list[MeasureGroup]:
    groups = grouped_measures(measures).items()
    return [MeasureGroup(heading, [_row(entry) for entry in _entries(members)]) for heading, members in groups]


def _entries(measures: Sequence[Measure]) -> list[list[Measure]]:
    """The measures of each row, see ``MeasureRow``."""
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
    """A measure that has a value, and 1.96 times its sigma; a sigma of 0 is left out: nothing is that certain."""
    form = value_form(measure)
    value = figure(measure.value, form)
    if not measure.sigma:
        return value
    reach = Form(decimals=form.decimals, times=form.times * NORMAL_95, before="± ", after=form.after)
    return Markup("{} {}").format(value, figure(measure.sigma, reach))


def inferred_share(measure: Measure, after: str = " %") -> Markup:
    """How much of a measure is inferred; empty where that is not known."""
    if measure.inferred_share is None:
        return Markup()
    return figure(measure.inferred_share, Form(times=100.0, after=after, share=True))


PRINTED: Final = (
    "recorded_time",
    "found_time",
    "unknown_time",
    "upright_time",
    "upright_share",
    "longest_upright_bout",
    "sit_to_stand_count",
    "sit_to_stand_duration_mean",
    "stand_to_sit_count",
    "stand_to_sit_duration_mean",
    "knee_flexion_upright_mean",
    "knee_flexion_upright_least",
    "hip_flexion_upright_mean",
    "knee_straight_time",
    "knee_flexion_difference",
    "load_share",
    "sway_velocity",
    "sway_ellipse_area",
    "five_times_sit_to_stand",
    "functional_reach",
    "single_leg_stance",
    "step_count",
    "assistance_time",
    "hands_free_upright_time",
    "hands_on_at_once_most",
)
"""The measures that are printed, in this order; all others are in measures.parquet."""

ROUNDING_S: Final = 0.001  # less unknown time than this is rounding


def measure_rows(measures: Sequence[Measure]) -> list[tuple[str, str, str, str]]:
    """Return a row of texts per printed measure: title, value with its error, inferred share, why there is no value."""
    rows, lower_bounds = [], _lower_bounds(measures)
    for name in PRINTED:
        for row in measures:
            if row.measure == name and not (name == "assistance_time" and row.person and row.part):
                inferred = "" if row.inferred_share is None else PERCENT.write(row.inferred_share)
                at_least = "at least " if row.value is not None and name in lower_bounds else ""
                rows.append((title_of(row), at_least + _value_text(row), inferred, row.why or ""))
    return rows


def _value_text(measure: Measure) -> str:
    if measure.value is None:
        return "unknown"
    form = value_form(measure)
    spread = f" ± {form.write(NORMAL_95 * measure.sigma)}" if measure.sigma else ""
    return form.write(measure.value) + spread


def _lower_bounds(measures: Sequence[Measure]) -> set[str]:
    """Return the measures whose true value may be larger, since part of the recording is unknown."""
    seconds = {row.measure: row.value for row in measures if row.value is not None and row.unit == "s"}
    found: set[str] = set()
    if seconds.get("unknown_time", 0.0) > ROUNDING_S:
        found |= {"upright_time", "sit_to_stand_count", "stand_to_sit_count"}
    if seconds.get("recorded_time", 0.0) - seconds.get("found_time", 0.0) > ROUNDING_S:
        found |= {"assistance_time"}
    return found
