"""Which labels of another system are which joint: names in common use, or a table that the user gives."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.document import read_rows

SIDES: Final = {"L": "Left", "R": "Right"}

_CENTRES: Final = {
    "Hip": ("{s}HJC", "{s}FEP"), "Knee": ("{s}KJC", "{s}FEO"), "Ankle": ("{s}AJC", "{s}TIO"),
    "Shoulder": ("{s}SJC", "{s}CLO"), "Elbow": ("{s}EJC", "{s}HUO"), "Wrist": ("{s}WJC", "{s}RAO"),
}  # fmt: skip
"""Joint centres as Plug-in Gait, the Conventional Gait Model 2 and Visual3D name them."""

_PAIRS: Final = {
    "Knee": (("{s}KNE", "{s}LFE", "{s}FLE", "{s}LKNE", "{s}LFC", "{s}KNEELAT"),
             ("{s}KNM", "{s}MFE", "{s}FME", "{s}MKNE", "{s}MFC", "{s}KNEEMED")),
    "Ankle": (("{s}ANK", "{s}LM", "{s}FAL", "{s}LANK", "{s}LMAL", "{s}ANKLELAT"),
              ("{s}MED", "{s}MM", "{s}TAM", "{s}MANK", "{s}MMAL", "{s}ANM", "{s}ANKLEMED")),
    "Elbow": (("{s}ELB", "{s}HLE", "{s}LELB", "{s}ELBOWLAT"), ("{s}ELM", "{s}HME", "{s}MELB", "{s}ELBOWMED")),
    "Wrist": (("{s}WRA", "{s}RSP", "{s}WRISTRAD"), ("{s}WRB", "{s}USP", "{s}WRISTULN")),
}  # fmt: skip
"""Lateral and medial markers of joints whose centre is taken midway between the two."""

_PELVIS: Final = {
    "ASIS": ("{s}ASI", "{s}ASIS", "{s}IAS"), "PSIS": ("{s}PSI", "{s}PSIS", "{s}IPS"),
}  # fmt: skip

_THIGH: Final = re.compile(r"^([LR])(THI|THAP|THAD|TH|THIGH)\d*$")

_SPELT: Final = re.compile(r"^(L|R|LEFT|RIGHT)(HIP|KNEE|ANKLE|SHOULDER|ELBOW|WRIST)(JC|JOINT)?(CENTER|CENTRE)?$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Marking:
    """Labels of the file by what they stand for.

    centres: joint to the label of its centre. midpoints: joint to the labels whose mean is its centre. pelvis: ASIS
    left and right, PSIS left and right; None where one is missing. thighs: for left and right the markers on the thigh.
    """

    centres: dict[str, str]
    midpoints: dict[str, tuple[str, ...]]
    pelvis: tuple[str, str, str, str] | None
    thighs: dict[str, tuple[str, ...]]

    @property
    def empty(self) -> bool:
        """No joint follows from these labels."""
        return not self.centres and not self.midpoints and self.pelvis is None


def known_marking(labels: tuple[str, ...]) -> Marking:
    """What labels in common use stand for; upper or lower case, dots, dashes and underscores do not matter."""
    own = {re.sub(r"[^A-Z0-9]", "", label.upper()): label for label in reversed(labels)}
    centres = {name: own[name.upper()] for name in JOINT_NAMES if name.upper() in own}
    midpoints = dict[str, tuple[str, ...]]()
    for plain, label in own.items():
        spelt = _SPELT.match(plain)
        if spelt is not None:
            centres.setdefault(f"{spelt[2].capitalize()}{SIDES[spelt[1][0]]}", label)
    for side, name in SIDES.items():
        for joint, patterns in _CENTRES.items():
            centre = _first(own, patterns, side)
            if centre is not None:
                centres.setdefault(f"{joint}{name}", centre)
        for joint, (lateral, medial) in _PAIRS.items():
            pair = (_first(own, lateral, side), _first(own, medial, side))
            if f"{joint}{name}" not in centres and pair[0] is not None and pair[1] is not None:
                midpoints[f"{joint}{name}"] = (pair[0], pair[1])
    pelvis = [_first(own, _PELVIS[bone], side) for bone in ("ASIS", "PSIS") for side in SIDES]
    whole = all(label is not None for label in pelvis)
    return Marking(
        centres=centres,
        midpoints=midpoints,
        pelvis=tuple(pelvis) if whole else None,  # type: ignore[arg-type]  # four texts where all are known
        thighs={name: _thigh(own, midpoints, side, name) for side, name in SIDES.items()},
    )


def given_marking(path: Path, labels: tuple[str, ...]) -> Marking:
    """The user's table: rows ``joint,label``; several rows of a joint mean the middle of these labels.

    ASISLeft, ASISRight, PSISLeft and PSISRight may stand in place of a joint, and ThighLeft, ThighRight. Raises
    InputError for an unknown joint or label.
    """
    remedy = "give rows joint,label with our joint's name and a label of the reference"
    rows = [row for _, row in read_rows(path)]
    if not rows or [cell.lower() for cell in rows[0]] != ["joint", "label"]:
        raise InputError(path, "does not begin with the line joint,label", remedy)
    found = dict[str, list[str]]()
    bones = [f"{bone}{side}" for bone in ("ASIS", "PSIS", "Thigh") for side in SIDES.values()]
    for row in rows[1:]:
        joint, label = [*row, "", ""][:2]
        if joint not in JOINT_NAMES and joint not in bones:
            raise InputError(path, f"names the unknown joint '{joint}'", f"use {', '.join((*JOINT_NAMES, *bones))}")
        if label not in labels:
            raise InputError(path, f"names '{label}', which the reference does not have", remedy)
        found.setdefault(joint, []).append(label)
    pelvis = tuple(found[bone][0] for bone in bones[:4] if bone in found)
    return Marking(
        centres={name: each[0] for name, each in found.items() if name in JOINT_NAMES and len(each) == 1},
        midpoints={name: tuple(each) for name, each in found.items() if name in JOINT_NAMES and len(each) > 1},
        pelvis=pelvis if len(pelvis) == 4 else None,
        thighs={side: tuple(found.get(f"Thigh{side}", ())) for side in SIDES.values()},
    )


def _first(own: dict[str, str], patterns: tuple[str, ...], side: str) -> str | None:
    return next((own[pattern.format(s=side)] for pattern in patterns if pattern.format(s=side) in own), None)


def _thigh(own: dict[str, str], midpoints: dict[str, tuple[str, ...]], side: str, name: str) -> tuple[str, ...]:
    """Markers that move with the thigh: those on it, and both of the knee."""
    cluster = [label for plain, label in own.items() if (match := _THIGH.match(plain)) and match[1] == side]
    return (*sorted(cluster), *midpoints.get(f"Knee{name}", ()))
