"""What the columns of the tables mean, for data_dictionary.csv."""

from __future__ import annotations

from typing import Final

from anchorpose.exports.source import STATES

_STATE_MEANING: Final = f"how it is known: {', '.join(STATES)}; or, of intervals, seen or inferred"

# Column: unit and meaning, the same in every table that has it.
_MEANING: Final = {
    "frame": ("", "frame of the first camera, counted from 0"),
    "time_s": ("s", "time on the clock of the first camera"),
    "joint": ("", "one of the 21 joints; Left and Right are the patient's"),
    "x_m": ("m", "forward"),
    "y_m": ("m", "up"),
    "z_m": ("m", "to the patient's right"),
    "state": ("", _STATE_MEANING),
    "sigma_m": ("m", "one standard deviation of the error along each axis"),
    "angle": ("", "name of the angle; docs/angles.md of anchorpose defines it"),
    "degrees": ("deg", "the angle"),
    "sigma_deg": ("deg", "one standard deviation of the angle's error"),
    "processing": ("", "measured, smoothed or filled"),
    "part": ("", "region of the patient's body"),
    "person": ("", "who touches; the same name as long as this person is followed"),
    "first_frame": ("", "first frame of the interval; it belongs to it"),
    "last_frame": ("", "last frame of the interval; it belongs to it"),
    "start_s": ("s", "time of the first frame"),
    "end_s": ("s", "time of the last frame"),
    "seen_share": ("1", "share of the touching skin that a camera saw"),
    "area_cm2": ("cm2", "skin of the patient in reach, mean over the frames"),
    "gap_mm": ("mm", "least distance of the two skins"),
    "bone": ("", "bone of the learnt body"),
    "qw": ("1", "quaternion of the turn from the upright rest pose to the world, real part"),
    "qx": ("1", "the same, part along X"),
    "qy": ("1", "the same, part along Y"),
    "qz": ("1", "the same, part along Z"),
    "axial_sigma_rad": ("rad", "one standard deviation of the turn about the bone's own long axis"),
    "anchor": ("", "geodesic extremum: head, hands or feet"),
    "com_x_m": ("m", "estimated centre of mass of the body, forward"),
    "com_y_m": ("m", "estimated centre of mass of the body, up"),
    "com_z_m": ("m", "estimated centre of mass of the body, to the patient's right"),
    "com_sigma_m": ("m", "one standard deviation of the centre of mass along each axis"),
    "upright": ("", "whether the patient stands upright"),
    "kind": ("", "what the interval is: upright, sit_to_stand or stand_to_sit"),
    "measure": ("", "name of the measure; docs/measures.md of anchorpose defines it"),
    "side": ("", "left or right, the patient's"),
    "value": ("see column unit", "the measure"),
    "unit": ("", "unit of value and sigma"),
    "sigma": ("see column unit", "one standard deviation of the value"),
    "frames": ("", "how many frames the value rests on"),
    "inferred_share": ("1", "share of those frames in which a joint was inferred"),
    "why": ("", "why there is no value"),
}  # fmt: skip

_WIDE: Final = (
    ("_sigma_m", "sigma_m"), ("_sigma_deg", "sigma_deg"), ("_x_m", "x_m"), ("_y_m", "y_m"), ("_z_m", "z_m"),
    ("_state", "state"), ("_deg", "degrees"),
)  # fmt: skip

MISSING: Final = "empty cell"


def describe_column(name: str, kind: str) -> tuple[str, str, str, str, str]:
    """Name, type, unit, meaning and what missing looks like; a column that is not known has no meaning written."""
    unit, meaning = _MEANING.get(name, ("", ""))
    return name, kind, unit, meaning, MISSING


def describe_wide_column(name: str) -> tuple[str, str, str, str, str]:
    """The same of a column of a wide table, which has its joint or angle in front."""
    for ending, column in _WIDE:
        if name.endswith(ending):
            unit, meaning = _MEANING[column]
            return (
                name,
                "text" if column == "state" else "number",
                unit,
                f"{name.removesuffix(ending)}: {meaning}",
                MISSING,
            )
    return describe_column(name, "whole number" if name == "frame" else "number")
