"""Define the input of each format's writer (the data of a results folder) and its result (a report on the written
files).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import LOST, STATE_NAMES
from anchorpose.results.tables import ANGLES_FILE, JOINTS_FILE, JointTable, read_angles, read_joints
from anchorpose.results.verify import require_own

STATE_CODES: Final = ", ".join(f"{code} {state}" for code, state in enumerate(STATE_NAMES))
"""The codes of the states in words; formats that hold only numbers store the codes."""


class Format(StrEnum):
    """The formats of ``anchorpose export``, with the names that its option ``--to`` accepts."""

    TRC = "trc"
    MOT = "mot"
    C3D = "c3d"
    CSV = "csv"
    BVH = "bvh"
    BIDS = "bids"


WITHOUT_ANGLES: Final = frozenset({Format.TRC, Format.MOT, Format.BVH})
"""Formats that hold joints or poses only, so that angles are not read for them."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Joints and angles of every frame.

    time_s (n,) float64, increasing; position_m (n, 21, 3) world, NaN where missing; joint_sigma_m (n, 21);
    joint_state_code (n, 21) int8, index into ``STATE_NAMES``; degrees, sigma_deg, angle_state_code (n, a): value, sigma
    and state code of the angles named in ``angles``.
    """

    time_s: np.ndarray
    position_m: np.ndarray
    joint_sigma_m: np.ndarray
    joint_state_code: np.ndarray
    angles: tuple[str, ...]
    degrees: np.ndarray
    sigma_deg: np.ndarray
    angle_state_code: np.ndarray

    def rows(self, rows: slice) -> Samples:
        """Return the samples of the frames ``rows``."""
        arrays = {name: getattr(self, name)[rows] for name in self.__slots__ if name != "angles"}
        return replace(self, **arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """The data of a results folder that exports need."""

    folder: Path
    frame: np.ndarray  # (n,) int32
    samples: Samples


def read_source(folder: Path, kind: Format) -> Source:
    """Read the joints of a results folder, and the angles if the folder has any and the format ``kind`` includes
    angles.

    Raises InputError for tables that cannot be read.
    """
    require_own(folder, [table.name for table in folder.glob("*.parquet")])
    joints = read_joints(folder / JOINTS_FILE)
    angles = _no_angles(joints) if kind in WITHOUT_ANGLES else _angles(folder / ANGLES_FILE, joints)
    samples = Samples(joints.time_s, joints.position_m, joints.sigma_m, joints.state_code, *angles)
    return Source(folder, joints.frame, samples)


_Angles = tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]


def _no_angles(joints: JointTable) -> _Angles:
    empty = np.empty((len(joints.frame), 0))
    return (), empty, empty, empty.astype(np.int8)


def _angles(path: Path, joints: JointTable) -> _Angles:
    """Read the names of the angles, and their degrees, sigma and state code (n, a) in each frame of the joints; a frame
    without angles gets NaN and the code of the state ``lost``.
    """
    if not path.exists():
        return _no_angles(joints)
    angles = read_angles(path)
    row = np.searchsorted(joints.frame, angles.frame)
    if not np.array_equal(joints.frame[np.minimum(row, len(joints.frame) - 1)], angles.frame):
        raise InputError(
            path, f"has frames that are not in {JOINTS_FILE}", "run 'anchorpose measure' on its folder again"
        )
    if len(row) == len(joints.frame):
        return angles.names, angles.degrees, angles.sigma_deg, angles.state_code
    shape = (len(joints.frame), len(angles.names))
    degrees, sigma_deg, state_code = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, LOST, np.int8)
    degrees[row], sigma_deg[row], state_code[row] = angles.degrees, angles.sigma_deg, angles.state_code
    return angles.names, degrees, sigma_deg, state_code


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """The report of a format's writer on the files that it wrote, for export.json. axes, units: descriptions in words.

    time: a description of how the times were changed; missing: the mark of a missing value; counts: numbers by which
    the files can be checked, such as the number of frames written; notes: further information for people.
    """

    axes: str
    units: str
    time: str
    missing: str
    counts: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    tools: tuple[str, ...] = ()  # packages besides anchorpose that wrote the files


def number_text(value: float) -> str:
    """Return a number as the shortest decimal text that gives the same double when read; empty for NaN."""
    if math.isnan(value):
        return ""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(float(value))


def rounded_text(value: float, digits: int, missing: str) -> str:
    """Format a number with at most ``digits`` digits after the point, without trailing zeros; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    text = f"{value:.{digits}f}"
    if digits:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def write_text(path: Path, text: str) -> None:
    """Write a text with the same bytes on every system."""
    path.write_text(text, encoding="utf-8", newline="\n")


def write_rows(path: Path, separator: str, *parts: Iterable[Iterable[str]]) -> None:
    """Write the rows of all ``parts`` one by one, each as a line of cells that ends with a line feed."""
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        for rows in parts:
            stream.writelines(separator.join(row) + "\n" for row in rows)
