"""Find which joint or bone each label of another system's file stands for."""

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
    "Hip": ("{s}HJC", "{s}FEP"),
    "Knee": ("{s}KJC", "{s}FEO"),
    "Ankle": ("{s}AJC", "{s}TIO"),
    "Shoulder": ("{s}SJC", "{s}CLO"),
    "Elbow": ("{s}EJC", "{s}HUO"),
    "Wrist": ("{s}WJC", "{s}RAO"),
}
"""Labels of each joint's centre in Plug-in Gait, Conventional Gait Model 2 or Visual3D, by joint; ``{s}`` is L or R."""

_PAIRS: Final = {
    "Knee": (
        ("{s}KNE", "{s}LFE", "{s}FLE", "{s}LKNE", "{s}LFC", "{s}KNEELAT", "{s}KNEELATERAL", "{s}KNEE"),
        ("{s}KNM", "{s}MFE", "{s}FME", "{s}MKNE", "{s}MFC", "{s}KNEEMED", "{s}KNEEMEDIAL"),
    ),
    "Ankle": (
        ("{s}ANK", "{s}LM", "{s}FAL", "{s}LANK", "{s}LMAL", "{s}ANKLELAT", "{s}ANKLELATERAL", "{s}ANKLE"),
        ("{s}MED", "{s}MM", "{s}TAM", "{s}MANK", "{s}MMAL", "{s}ANM", "{s}ANKLEMED", "{s}ANKLEMEDIAL"),
    ),
    "Elbow": (
        ("{s}ELB", "{s}HLE", "{s}LELB", "{s}ELBOWLAT", "{s}ELBOWLATERAL", "{s}ELBOW"),
        ("{s}ELM", "{s}HME", "{s}MELB", "{s}ELBOWMED", "{s}ELBOWMEDIAL"),
    ),
    "Wrist": (
        ("{s}WRA", "{s}RSP", "{s}WRISTRAD", "{s}WRISTLAT", "{s}WRISTLATERAL", "{s}WRIST"),
        ("{s}WRB", "{s}USP", "{s}WRISTULN", "{s}WRISTMED", "{s}WRISTMEDIAL"),
    ),
}
"""Labels of each joint's lateral and of its medial marker, by joint; the point midway between the two markers is used
as the joint's centre. In Cortex, a label that is only the joint's name belongs to the lateral marker: ``R.Knee`` is
lateral, ``R.Knee.Medial`` is medial.
"""

_PELVIS: Final = {"ASIS": ("{s}ASI", "{s}ASIS", "{s}IAS"), "PSIS": ("{s}PSI", "{s}PSIS", "{s}IPS")}

_THIGH: Final = re.compile(r"^([LR])(THI|THAP|THAD|TH|THIGH)\d*$")  # labels of markers on the thigh

_SPELT: Final = re.compile(r"^([LR])(HIP|KNEE|ANKLE|SHOULDER|ELBOW|WRIST)(JC|JOINT)?(CENTER|CENTRE)?$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Marking:
    """The joint or bone that each label of a file stands for.

    centres: the label of each joint's centre, by joint. midpoints: the labels of points whose mean position is the
    joint's centre, by joint. pelvis: labels of the markers on the left ASIS, right ASIS, left PSIS and right PSIS
    (front and back spines of the pelvis); None if one of the four is missing. thighs: labels of the markers on the
    ``Left`` and the ``Right`` thigh. assumed: joints in ``centres`` whose label does not state that it is a centre.
    """

    centres: dict[str, str]
    midpoints: dict[str, tuple[str, ...]]
    pelvis: tuple[str, str, str, str] | None
    thighs: dict[str, tuple[str, ...]]
    assumed: frozenset[str] = frozenset()

    @property
    def empty(self) -> bool:
        """Return whether these labels determine no joint."""
        return not self.centres and not self.midpoints and self.pelvis is None


def known_marking(labels: tuple[str, ...]) -> Marking:
    """Return the meaning of labels that are in common use; other labels are ignored. Case, dots, dashes and underscores
    make no difference.
    """
    own = {_plain(label): label for label in reversed(labels)}
    centres = {name: own[name.upper()] for name in JOINT_NAMES if name.upper() in own}
    midpoints, named = dict[str, tuple[str, ...]](), dict[str, str]()
    for plain, label in own.items():
        if spelt := _SPELT.match(plain):
            stated = centres if spelt[3] or spelt[4] else named
            stated.setdefault(f"{spelt[2].capitalize()}{SIDES[spelt[1]]}", label)
    for side, name in SIDES.items():
        for joint, patterns in _CENTRES.items():
            centre = _first(own, patterns, side)
            if centre is not None:
                centres.setdefault(f"{joint}{name}", centre)
        for joint, (lateral, medial) in _PAIRS.items():
            pair = (_first(own, lateral, side), _first(own, medial, side))
            if f"{joint}{name}" not in centres and pair[0] is not None and pair[1] is not None:
                midpoints[f"{joint}{name}"] = (pair[0], pair[1])
    assumed = {joint: label for joint, label in named.items() if joint not in centres and joint not in midpoints}
    pelvis = [_first(own, _PELVIS[bone], side) for bone in ("ASIS", "PSIS") for side in SIDES]
    whole = all(label is not None for label in pelvis)
    return Marking(
        centres=centres | assumed,
        midpoints=midpoints,
        pelvis=tuple(pelvis) if whole else None,  # type: ignore[arg-type]  # four strings if all are known
        thighs={name: _thigh(own, midpoints, side, name) for side, name in SIDES.items()},
        assumed=frozenset(assumed),
    )


def _plain(label: str) -> str:
    """Return a label in capitals, without dots, dashes and underscores, and with L or R for the side at its start."""
    return re.sub(r"^(L|R)(?:EFT|IGHT)", r"\1", re.sub(r"[^A-Z0-9]", "", label.upper()))


def given_marking(path: Path, labels: tuple[str, ...]) -> Marking:
    """Read the user's table: rows ``joint,label``; if a joint has several rows, its centre is the mean of the points
    with these labels.

    In place of a joint, a row may name ASISLeft, ASISRight, PSISLeft, PSISRight, ThighLeft or ThighRight. Raises
    InputError for an unknown joint or label.
    """
    remedy = "give rows joint,label with the name of a joint in the results and a label of the reference"
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
    """Return the markers that move with the thigh: thigh markers, and both knee markers."""
    cluster = [label for plain, label in own.items() if (match := _THIGH.match(plain)) and match[1] == side]
    return (*sorted(cluster), *midpoints.get(f"Knee{name}", ()))
