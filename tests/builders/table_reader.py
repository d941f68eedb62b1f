"""Recomputes a number of the report from the rows of the table that the page names."""

from __future__ import annotations

import json
import statistics
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from page_reader import Element


def on_arc(values: list[float]) -> list[float]:
    """Every value tried as the beginning of the arc."""
    arcs = [[v if v >= first else v + 360.0 for v in values] for first in values]
    arc = min(arcs, key=lambda arc: (round(max(arc) - min(arc), 9), max(arc)))
    return [v - 360.0 for v in arc] if statistics.median(arc) > 180.0 else arc


def taken_again(folder: Path, source: Element, aggregation: str) -> float:
    """The number computed from the table as the page describes it, without numpy."""
    column, how, among = json.loads(source.attributes["data-takings"])[aggregation]
    where = json.loads(source.attributes["data-where"])
    rows = [
        row
        for row in pq.read_table(folder / source.attributes["data-file"]).to_pylist()
        if all((None if row[name] is None else str(row[name])) == value for name, value in where.items())
    ]
    values = [row[column] for row in rows if row[column] is not None]
    if how == "share":
        return sum(str(value).lower() in among for value in values) / len(values)
    if how == "at least":
        return sum(value >= float(among[0]) for value in values) / len(values)
    if how == "frames":
        frames = {row["frame"]: set() for row in rows}
        for row in rows:
            frames[row["frame"]].add(row[column] in among)
        return sum(states != {True} for states in frames.values()) / len(frames)
    if how.endswith(" on the arc"):
        how, values = how.removesuffix(" on the arc"), on_arc(values)
    reduced: dict[str, Any] = {
        "value": lambda: values[0] if len(rows) == 1 else pytest.fail(f"{len(rows)} rows are not one value"),
        "count": lambda: len(rows),
        "distinct": lambda: len(set(values)),
        "extent": lambda: max(values) - min(values),
        "median": lambda: statistics.median(values),
        "lowest": lambda: min(values),
        "highest": lambda: max(values),
    }
    return float(reduced[how]())
