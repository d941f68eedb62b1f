"""Read labelled points and angles over time from another motion capture system's file (C3D, TRC, MOT, STO or CSV)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError, MissingPackage
from anchorpose.recording.document import read_rows, read_text
from anchorpose.recording.regular_file import LARGEST_TABLE, require_regular

METRES: Final[Mapping[str, float]] = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "metres": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "millimeters": 0.001,
    "millimetres": 0.001,
    "centimeters": 0.01,
    "centimetres": 0.01,
}
"""Length of each unit in metres, by the unit's name in files."""

# s (one day), maximum duration of a recording; if the file's times span more, they are not in seconds
LONGEST_S: Final = 86_400.0
# m, degrees: maximum coordinate and angle; larger values mean a wrong unit or a damaged file
FARTHEST_M, LARGEST_DEG = 1e4, 1e5


@dataclass(frozen=True, slots=True, eq=False)
class Captured:
    """A recording of another motion capture system. time_s (t,): increasing times on the clock of the file.

    point_m (t, p, 3): the points with the labels ``points``, metres in the file's frame of reference; degrees (t, a):
    the angles with the labels ``angles``. Missing points and angles are NaN.
    """

    path: Path
    time_s: np.ndarray
    points: tuple[str, ...]
    point_m: np.ndarray
    angles: tuple[str, ...]
    degrees: np.ndarray

    def point(self, label: str) -> np.ndarray:
        """Return the positions (t, 3), in metres, of the point with this label."""
        return self.point_m[:, self.points.index(label)]


def metres_per_unit(path: Path, unit: str | None, stated: str | None) -> float:
    """Return the length in metres of the file's unit of length.

    unit: the unit that the file states, None if it states none; stated: the unit that the user states, which takes
    precedence. Raises InputError if neither unit is given, or if the unit is unknown.
    """
    name = stated if stated is not None else unit
    if not name:
        raise InputError(path, "does not state its unit of length", "give it with --unit mm, --unit cm or --unit m")
    scale = METRES.get(name.strip().lower())
    if scale is None:
        raise InputError(path, f"has lengths in '{name}'", "give the unit with --unit mm, --unit cm or --unit m")
    return scale


def checked(captured: Captured) -> Captured:
    """Return the recording unchanged. Raises InputError if the recording has no known point or angle, only a single
    frame, times that do not increase or span more than ``LONGEST_S``, or values beyond ``FARTHEST_M`` or
    ``LARGEST_DEG``.
    """
    path, known = captured.path, np.isfinite(captured.point_m).all(axis=2).any(axis=0)
    if not known.any() and not np.isfinite(captured.degrees).any():
        what = "holds no markers, joint centres or angles" if not captured.points else "has only markers without values"
        raise InputError(path, what, "export the labelled trajectories of the other system and give that file")
    if len(captured.time_s) < 2:
        raise InputError(path, "has a single frame", "give the file of a movement")
    if not (np.isfinite(captured.time_s).all() and (np.diff(captured.time_s) > 0).all()):
        raise InputError(path, "has times that do not increase", "export it again with a time for each frame")
    lasts_s = captured.time_s[-1] - captured.time_s[0]
    if lasts_s > LONGEST_S:
        raise InputError(path, f"lasts {lasts_s:.3g} s by its times", "give its times in seconds")
    with np.errstate(invalid="ignore"):
        far = (np.abs(captured.point_m) > FARTHEST_M).any() or (np.abs(captured.degrees) > LARGEST_DEG).any()
    if far:
        problem = f"has points over {FARTHEST_M:g} m away, or angles over {LARGEST_DEG:g} degrees"
        raise InputError(path, problem, "check its unit of length, or give it with --unit mm, --unit cm or --unit m")
    return captured


def repeated_label(path: Path, labels: tuple[str, ...]) -> None:
    """Raise InputError if two columns have the same label."""
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(path, f"has the label '{label}' twice", "rename one of them in the other system")


def read_c3d(path: Path, unit: str | None = None) -> Captured:
    """Read the points and angles of a C3D file. unit: the file's unit of length, needed if the file states none or a
    wrong one.

    A point is missing (NaN) in each frame in which the file gives the point a negative residual: this is how C3D marks
    missing points. Points without a name, whose label is empty or begins with ``*`` (such as ``*12``), are left out. A
    subject's name before a label is removed: ``Anna:LASI`` becomes ``LASI``. Raises InputError for a file that cannot
    be used, and MissingPackage if ezc3d is not installed.
    """
    try:
        import ezc3d
    except ImportError:
        raise MissingPackage("evaluate --reference with a C3D", "ezc3d", "c3d") from None
    try:
        require_regular(path, LARGEST_TABLE)
        file = ezc3d.c3d(str(path))
        group = file["parameters"]["POINT"]
        places = np.asarray(file["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
        residual = np.asarray(file["data"]["meta_points"]["residuals"], dtype=np.float64)[0].T
        if residual.shape != places.shape[:2]:
            raise ValueError("points and residuals are not of one size")
        rate_hz, first = float(file["header"]["points"]["frame_rate"]), int(file["header"]["points"]["first_frame"])
    except (OSError, RuntimeError, KeyError, IndexError, ValueError, SystemError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0][:80]
        raise InputError(path, f"cannot be read as C3D ({reason})", "export it again from the other system") from None
    if rate_hz <= 0:
        raise InputError(path, "states no frame rate", "export it again from the other system")
    labels, listed = _labels(group)[: places.shape[1]], _texts(group, "ANGLES")
    places = np.where((residual < 0)[:, :, None], np.nan, places)
    angles = [k for k, label in enumerate(labels) if label in listed]
    own = [k for k, label in enumerate(labels) if label and not label.startswith("*") and k not in angles]
    scale = metres_per_unit(path, (_texts(group, "UNITS") or (None,))[0], unit) if own else 1.0
    names, angle_names = (tuple(_plain(labels[k]) for k in chosen) for chosen in (own, angles))
    repeated_label(path, names)
    time_s = (first + np.arange(len(places))) / rate_hz
    return checked(Captured(path, time_s, names, scale * places[:, own], angle_names, places[:, angles, 0]))


def _labels(group: Any) -> tuple[str, ...]:
    """Return the labels of all points, in order. From the 256th label on, C3D files store labels in further entries:
    LABELS2, LABELS3, ...
    """
    names = [name for name in group if name.startswith("LABELS")]
    return tuple(label for name in sorted(names, key=lambda one: (len(one), one)) for label in _texts(group, name))


def _texts(group: Any, name: str) -> tuple[str, ...]:
    return tuple(str(text).strip() for text in group[name]["value"]) if name in group else ()


def _plain(label: str) -> str:
    return label.rsplit(":", 1)[-1]


AXES: Final = ("x", "y", "z")

CSV_REMEDY: Final = (
    "give columns time_s, and for each point NAME_x_mm, NAME_y_mm, NAME_z_mm (or _m), for each angle NAME_deg"
)


def read_trc(path: Path, unit: str | None = None) -> Captured:
    """Read the markers of a TRC file. unit: the file's unit of length, needed if the file states no unit or a wrong
    unit. A marker is missing (NaN) in frames in which its three cells are all zero, or any of them is empty or NaN.
    """
    remedy = "export it again as TRC"
    lines = read_text(path, LARGEST_TABLE).splitlines()
    if len(lines) < 6 or not lines[0].lower().startswith("pathfiletype"):
        raise InputError(path, "is not a TRC file", remedy)
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    names = tuple(cell.strip() for cell in lines[3].split("\t")[2:] if cell.strip())
    repeated_label(path, names)
    rows = [line.split("\t") for line in lines[5:] if line.strip()]
    table = _numbers(path, [_padded(row[1:], 1 + 3 * len(names)) for row in rows], remedy)
    point = table[:, 1:].reshape(len(table), len(names), 3) if len(names) else np.empty((len(table), 0, 3))
    point = np.where((point == 0.0).all(axis=2)[:, :, None], np.nan, point)
    scale = metres_per_unit(path, header.get("Units"), unit)
    return checked(Captured(path, table[:, 0], names, scale * point, (), np.empty((len(table), 0))))


def read_mot(path: Path) -> Captured:
    """Read the joint angles of OpenSim's MOT or STO file, in degrees; translations (``_tx`` and so on) are left out."""
    lines = read_text(path, LARGEST_TABLE).splitlines()
    end = next((row for row, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or len(lines) < end + 3:
        raise InputError(path, "is not a MOT file with values", "export it again from OpenSim")
    head = [line.replace(" ", "").lower() for line in lines[:end]]
    names = tuple(lines[end + 1].split())
    table = _numbers(path, [line.split() for line in lines[end + 2 :] if line.strip()], "export it again from OpenSim")
    if table.shape[1] != len(names) or names[0].lower() != "time":
        raise InputError(path, "its columns do not fit their names", "export it again from OpenSim")
    factor = 1.0 if "indegrees=yes" in head else float(np.degrees(1.0))
    angle = [column for column, name in enumerate(names) if column and not name.endswith(("_tx", "_ty", "_tz"))]
    degrees = factor * table[:, angle]
    chosen = tuple(names[column] for column in angle)
    return checked(Captured(path, table[:, 0], (), np.empty((len(table), 0, 3)), chosen, degrees))


def read_csv(path: Path, unit: str | None = None) -> Captured:
    """Read a CSV file with a column of times, three columns for each point, and one column for each angle;
    ``CSV_REMEDY`` states their names. Empty cells are missing values. unit: the unit of all lengths, needed if the
    names of the columns state no unit or a wrong unit.
    """
    rows = [row for _, row in read_rows(path)]
    if len(rows) < 2:
        raise InputError(path, "has no rows", CSV_REMEDY)
    head = rows[0]
    repeated_label(path, tuple(head))
    clock = next((name for name in ("time_s", "time", "Time") if name in head), None)
    if clock is None:
        raise InputError(path, "has no column time_s", CSV_REMEDY)
    table = _numbers(path, [_padded(row, len(head)) for row in rows[1:]], CSV_REMEDY)
    points, angles = dict[str, list[np.ndarray]](), dict[str, np.ndarray]()
    for column, name in enumerate(head):
        stem, _, ending = name.rpartition("_")
        if ending == "deg" and stem:
            angles[stem] = table[:, column]
            continue
        own_unit = ending if ending in METRES else None
        label, _, axis = (stem if own_unit else name).rpartition("_")
        if label and axis.lower() in AXES:
            scale = metres_per_unit(path, own_unit, unit)
            points.setdefault(label, [np.full(len(table), np.nan)] * 3)[AXES.index(axis.lower())] = (
                scale * table[:, column]
            )
    position = np.stack([np.stack(each, axis=1) for each in points.values()], axis=1) if points else None
    return checked(
        Captured(
            path,
            table[:, head.index(clock)],
            tuple(points),
            np.empty((len(table), 0, 3)) if position is None else position,
            tuple(angles),
            np.stack(list(angles.values()), axis=1) if angles else np.empty((len(table), 0)),
        )
    )


def _padded(cells: list[str], length: int) -> list[str]:
    """Return the row with exactly ``length`` cells, since some programs leave out empty cells at the end of a line."""
    return [*cells, *[""] * (length - len(cells))][:length]


def _numbers(path: Path, rows: list[list[str]], remedy: str) -> np.ndarray:
    """Convert rows of text cells to numbers (rows, columns) float64, NaN for an empty cell."""
    try:
        return np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise InputError(path, f"holds something that is not a number ({str(error)[:60]})", remedy) from None


def read_captured(path: Path, unit: str | None = None) -> Captured:
    """Read the points and angles of a .c3d, .trc, .csv, .mot or .sto file. unit: unit of length, needed if the file
    states none or a wrong one.

    Raises InputError if the file's name has another ending, or the file cannot be used.
    """
    match path.suffix.lower():
        case ".c3d":
            return read_c3d(path, unit)
        case ".trc":
            return read_trc(path, unit)
        case ".csv":
            return read_csv(path, unit)
        case ".mot" | ".sto":
            return read_mot(path)
    raise InputError(path, f"ends in '{path.suffix}'", "give a reference as .c3d, .trc, .csv, .mot or .sto")
