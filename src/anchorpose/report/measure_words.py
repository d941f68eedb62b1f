"""Which measures stand together, what each is called and means, and how its unit is written.

The meanings are short forms of those in docs/measures.md, which has the thresholds and the sources.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from anchorpose.report.words import spaced
from anchorpose.results.measures import Measure


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
