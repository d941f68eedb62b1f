"""TRC and MOT as OpenSim reads them, and a plain CSV: points and angles over time."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.agreement.captured import METRES, Captured, checked, metres_per_unit, repeated_label
from anchorpose.errors import InputError
from anchorpose.recording.document import read_rows, read_text
from anchorpose.recording.regular_file import LARGEST_TABLE

AXES: Final = ("x", "y", "z")

CSV_REMEDY: Final = (
    "give columns time_s, and for each point NAME_x_mm, NAME_y_mm, NAME_z_mm (or _m), for each angle NAME_deg"
)


def read_lines(path: Path) -> list[str]:
    """The lines of a text file; raises InputError where it cannot be read as text."""
    return read_text(path, LARGEST_TABLE).splitlines()


def read_trc(path: Path, unit: str | None = None) -> Captured:
    """Markers of a TRC; empty cells, NaN, and three zeros stand for a missing marker."""
    remedy = "export it again as TRC"
    lines = read_lines(path)
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
    """Coordinates of a MOT or STO as angles, in degrees; translations (``_tx`` and so on) are left out."""
    lines = read_lines(path)
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
    """Columns as ``CSV_REMEDY`` says; lengths whose columns have no unit need ``unit``; empty cells are missing."""
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
    """Some programs leave out empty cells at the end of a line."""
    return [*cells, *[""] * (length - len(cells))][:length]


def _numbers(path: Path, rows: list[list[str]], remedy: str) -> np.ndarray:
    """(rows, columns) float64, NaN for an empty cell."""
    try:
        return np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise InputError(path, f"holds something that is not a number ({str(error)[:60]})", remedy) from None
