"""Declare settings that users give as options on the command line, and the allowed ranges of their numbers.

The text below a field is the help text of its option. No numerical library is imported here: importing such a library
takes time, and help should appear at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter, Token
from cyclopts.validators import Number

from anchorpose.errors import AnchorposeError

DAY_S: Final = 86_400.0
TALLEST_M: Final = 3.0  # m, maximum height of a person that is accepted from the user
FARTHEST_M: Final = 100.0
"""Maximum accepted coordinate in m; no room is larger, and places given in millimetres by mistake exceed it."""

FASTEST_HZ: Final = 1000.0  # Hz, maximum frame rate that is accepted
FARTHEST_CLOCK_S: Final = 1e11
"""Maximum accepted difference in s between two clocks; seconds since any epoch in use are at most a fifth of it."""

MOST_FRAMES: Final = 10**9
MOST_PROCESSES: Final = 1024
LARGEST_SEED: Final = 2**63 - 1
LARGEST_PORT: Final = 65535

COMMAND_LINE: Final = "cli"  # cyclopts's name for the command line as the source of a token (the text of a value)
OUTPUT: Final = Parameter(name=["--output", "-o"])
SIGNED: Final = Parameter(allow_leading_hyphen=True)  # declaration of an option whose value may begin with a minus sign


def positive(most: float) -> Parameter:
    """Return the declaration of a numeric option whose value must be above zero and at most ``most``; NaN is refused,
    too.
    """
    return Parameter(validator=Number(gt=0, lte=most), converter=_as_number)


def between(least: float, most: float) -> Parameter:
    """Return the declaration of a numeric option whose value must be from ``least`` to ``most``, limits included."""
    return Parameter(validator=Number(gte=least, lte=most), converter=_as_number)


def whole(least: int, most: int) -> Parameter:
    """Return the declaration of an option that is a whole number from ``least`` to ``most``. Other numbers are refused;
    cyclopts alone would round 1.7 to 2.
    """
    return Parameter(validator=Number(gte=least, lte=most), converter=_as_whole)


def _as_number(kind: Any, tokens: Sequence[Token]) -> float:
    try:
        return plain_number(tokens[0].value)
    except ValueError:
        raise ValueError(f"{_shown(tokens[0])} is not a number") from None


def plain_number(text: str) -> float:
    """Parse a number written in ASCII characters without underscores. Raises ValueError for a text that is not such a
    number, and for NaN.
    """
    number = float(text)
    if "_" in text or not text.isascii() or math.isnan(number):
        raise ValueError
    return number


def _as_whole(kind: Any, tokens: Sequence[Token]) -> int:
    try:
        plain_number(tokens[0].value)
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{_shown(tokens[0])} is not a whole number") from None


def _shown(token: Token) -> str:
    """Return the value that a user gave, in the form in which an error message shows it: with the name of the settings
    file if the value comes from such a file.
    """
    return f'"{token.value[:40]}"' + (f" from {token.source}" if token.source != COMMAND_LINE else "")


def parse_intrinsics(text: str) -> tuple[float, float, float, float]:
    """Parse the text ``fx,fy,cx,cy``, pixels; raises AnchorposeError if it is anything else."""
    try:
        fx, fy, cx, cy = (float(part) for part in text.split(","))
    except ValueError:
        fx = fy = cx = cy = -1.0
    if not (0 < fx < 1e5 and 0 < fy < 1e5 and abs(cx) < 1e5 and abs(cy) < 1e5):
        raise AnchorposeError(f"--intrinsics is '{text}'; write fx,fy,cx,cy in pixels, for example 504,504,320,288.")
    return fx, fy, cx, cy


def _as_intrinsics(kind: Any, tokens: Sequence[Token]) -> tuple[float, float, float, float]:
    return parse_intrinsics(tokens[0].value)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ConvertOptions:
    """Facts about a recording that the recorder's files may lack, for ``anchorpose convert``."""

    intrinsics: Annotated[
        tuple[float, float, float, float] | None,
        Parameter(converter=_as_intrinsics, n_tokens=1, metavar="STR", allow_leading_hyphen=True),
    ] = None
    """The lens as fx,fy,cx,cy in pixels of the depth image, for files that have none."""

    depth_scale: Annotated[float | None, positive(1.0)] = None
    """Metres per grey value, for example 0.001 where depth is in millimetres; where given, it replaces the file's."""

    fps: Annotated[float | None, positive(FASTEST_HZ)] = None
    """Depth images per second, for files that have no times."""

    rotate: Literal[0, 90, 180, 270] = 0
    """Turn the images clockwise by this many degrees, if the camera was mounted on its side or upside down."""

    mirror: bool = False
    """Exchange left and right, if the recorder mirrored its images: depth alone cannot show this."""


class HipCentre(StrEnum):
    """The way in which hip centres are found if another system's files lack them."""

    HARRINGTON = "harrington"
    FUNCTIONAL = "functional"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReferenceSettings:
    """Settings for reading the files of another motion capture system, for ``anchorpose evaluate``."""

    unit: Literal["mm", "cm", "m"] | None = None
    """The unit of the reference's lengths, where its file does not state it."""

    names: Path | None = None
    """A CSV with the columns joint,label: the labels of the reference that stand for each joint."""

    hip: HipCentre = HipCentre.HARRINGTON
    """Hip centres from pelvis markers: by the regression of Harrington et al. 2007, or from the thigh's movement."""

    transform: Path | None = None
    """A JSON file with reference_to_world, if the position of the reference's axes is known."""

    exchange_sides: bool = False
    """Exchange left and right of the reference, if they are the wrong way round."""


Segment = Literal[
    "pelvis",
    "trunk",
    "upper_arm_left",
    "upper_arm_right",
    "forearm_left",
    "forearm_right",
    "thigh_left",
    "thigh_right",
    "shank_left",
    "shank_right",
    "foot_left",
    "foot_right",
]
"""A part of the body that an inertial sensor is strapped to."""


def _as_names(kind: Any, tokens: Sequence[Token]) -> tuple[str, ...]:
    names = tuple(name.strip() for name in tokens[0].value.split(","))
    if not all(names) or len(names) > 3 or len(set(names)) < len(names):
        raise ValueError(f'"{tokens[0].value[:40]}" is not one to three names with commas between them')
    return names


SIGNALS: Final = Parameter(converter=_as_names, n_tokens=1, metavar="NAME,NAME,NAME")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SyncSettings:
    """Settings for finding the clock of another device's file, for ``anchorpose sync``."""

    segment: Segment | None = None
    """With --acceleration or --gyroscope: the part of the body that the sensor is strapped to."""

    acceleration: Annotated[tuple[str, ...], SIGNALS] = ()
    """The accelerometer's signals in the other file, for example ax,ay,az; in any unit, one to three axes."""

    gyroscope: Annotated[tuple[str, ...], SIGNALS] = ()
    """The gyroscope's signals in the other file, for example gx,gy,gz."""

    pulses: str | None = None
    """The signal or stream of markers in the other file that holds pulses which both devices recorded; needs
    --pulse-times.
    """

    pulse_times: Path | None = None
    """With --pulses: the same pulses on the recording's clock, as onsets of an events.tsv, or as a CSV with a column
    time_s and the signal."""

    pulse_type: str | None = None
    """With an events.tsv: the trial_type of the rows that are pulses; by default all rows."""

    stamps: Path | None = None
    """The recording of the results. Its recording.json states its start on the clock of the Lab Streaming Layer; an XDF
    file written on the same computer has its times on this clock.
    """

    near: Annotated[float | None, SIGNED, between(-FARTHEST_CLOCK_S, FARTHEST_CLOCK_S)] = None
    """Seconds by which the other clock is ahead, known to half a second; give it if the movement repeats itself."""

    time: str | None = None
    """With a CSV: the column of the times in seconds; by default time_s, time or Time."""


class CoordinateModel(StrEnum):
    """The OpenSim models whose coordinates a MOT file can have; the models differ in the sign of the knee angle."""

    RAJAGOPAL = "rajagopal"
    GAIT2392 = "gait2392"


def _label(prefix: str) -> Parameter:
    """Return the declaration of an option for a BIDS label, which may be given with or without its prefix."""
    return Parameter(converter=lambda kind, tokens: tokens[0].value.removeprefix(prefix))


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ExportConfig:
    """Options that only some formats of ``anchorpose export`` use.

    Raises AnchorposeError for a label that BIDS does not allow.
    """

    subject: Annotated[str, _label("sub-")] = "01"
    """Pseudonym of the patient for bids, letters and digits only."""

    session: Annotated[str | None, _label("ses-")] = None
    """Label of the session for bids, letters and digits only; left out by default."""

    task: Annotated[str, _label("task-")] = "standing"
    """What the patient did, for bids; letters and digits only."""

    model: CoordinateModel = CoordinateModel.RAJAGOPAL
    """The model whose signs mot and model.osim follow: rajagopal (a bent knee is positive) or gait2392 (negative)."""

    def __post_init__(self) -> None:
        for name in ("subject", "session", "task"):
            label = getattr(self, name)
            if label is not None and not (label.isascii() and label.isalnum()):
                raise AnchorposeError(f"--{name} is '{label}', and BIDS allows letters and digits only.")
