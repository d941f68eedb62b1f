"""Read signals from a CSV: a line of column names, a column of times in seconds, and a column of numbers per signal."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from pyarrow import csv

from anchorpose.errors import InputError
from anchorpose.recording.document import read_content, require_distinct
from anchorpose.recording.regular_file import LARGEST_TABLE
from anchorpose.sync.streams import OtherFile, Stream, checked

TIME_COLUMNS: Final = ("time_s", "time", "Time")

REMEDY: Final = "write one line of names, then numbers with commas between them, the time in seconds in a column time_s"

MISSING: Final = ("", "NaN", "nan", "NA", "n/a")


def read_csv(path: Path, time_column: str | None = None) -> OtherFile:
    """Read the columns of a CSV. time_column: name of the column of times, None for the first of ``TIME_COLUMNS``
    that the file has.

    Empty cells, NaN, NA and n/a count as missing values. Raises InputError naming the file and the remedy.
    """
    content = read_content(path, LARGEST_TABLE)
    head = _head(path, content)
    time_name = time_column or next((name for name in TIME_COLUMNS if name in head), None)
    if time_name is None or time_name not in head:
        raise InputError(path, f"has no column {time_name or 'time_s'}", "name the column of the times with --time")
    channels = tuple(name for name in head if name != time_name)
    if not channels:
        raise InputError(path, "has no column beside its times", REMEDY)
    table = _table(path, content, head)
    values = np.stack([_column(table, name) for name in channels], axis=1)
    return OtherFile(path, (checked(path, Stream("", _column(table, time_name), channels, values)),))


def _head(path: Path, content: bytes) -> list[str]:
    try:
        first = content[: 1 << 20].split(b"\n", 1)[0].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(path, "is not text in UTF-8", REMEDY) from None
    head = [name.strip().strip('"') for name in first.rstrip("\r").split(",")]
    if not first.rstrip("\r").replace("\t", "").isprintable():
        raise InputError(path, "is not a CSV file", REMEDY)
    if len(head) < 2 or not all(head):
        raise InputError(path, f"begins with the line {first[:40]!r}", REMEDY)
    require_distinct(path, head)
    return head


def _table(path: Path, content: bytes, head: list[str]) -> pa.Table:
    try:
        return csv.read_csv(
            pa.BufferReader(content),
            read_options=csv.ReadOptions(column_names=head, skip_rows=1, use_threads=False),
            convert_options=csv.ConvertOptions(
                column_types=dict.fromkeys(head, pa.float64()), null_values=MISSING, strings_can_be_null=True
            ),
        )
    except pa.ArrowInvalid as error:
        reason = " ".join(str(error).split("Error: ")[-1].split())[:90]
        raise InputError(path, f"cannot be read as a table of numbers ({reason})", REMEDY) from None


def _column(table: pa.Table, name: str) -> np.ndarray:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)
