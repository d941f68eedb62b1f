"""Where each number of a page comes from: it is computed from named rows of a table, and the page names them.

A number enters a page through ``Ledger.figure`` only. Its element names the rows (``data-rows``, an id in the list at
the end of the page), the column and the operation, so that a reader, or a test, can repeat it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from markupsafe import Markup

from anchorpose.report.frame_columns import FrameColumns
from anchorpose.report.words import MISSING, number
from anchorpose.results.parquet import opened_parquet, pieces

ON_ARC: Final = " on the arc"
"""Of angles in degrees, which may pass from 180 to -180: see ``on_shortest_arc``."""

HOW_WORDS: Final = {
    "value": "the value of {column}",
    "count": "the number of these rows",
    "distinct": "how many different values of {column}",
    "extent": "the last {column} minus the first",
    "median": "the median of {column}",
    "lowest": "the lowest {column}",
    "highest": "the highest {column}",
    **{
        how + ON_ARC: f"the {how} {{column}}, on the shortest arc of the circle that holds them all"
        for how in ("lowest", "median", "highest")
    },
    "share": "of these rows with a known {column}, the share with {column} {among}",
    "at least": "of these rows with a known {column}, the share with at least {among}",
    "frames": "of the frames, the share in which not all of these rows have {column} {among}",
}
"""The operations on rows, in the words of the list of sources. An unknown value never counts as a no."""


COLUMNS_KEPT: Final = 4
"""Columns read last that stay in memory: what the sections of a page take from one table, one after the other."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table: all of ``file``, or those in which each column of ``where`` has that value (None: empty)."""

    file: str
    where: tuple[tuple[str, str | None], ...] = ()

    @property
    def sentence(self) -> str:
        """For people."""
        conditions = [f"{name} is {value if value is not None else 'empty'}" for name, value in self.where]
        return f"{self.file}, rows where {' and '.join(conditions)}" if conditions else f"{self.file}, all rows"


@dataclass(frozen=True, slots=True, kw_only=True)
class Aggregation:
    """An operation on a column of the rows; among: the values that ``share`` and ``frames`` count, or the one number
    that ``at least`` compares with."""

    column: str
    how: str = "value"
    among: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """For people."""
        return HOW_WORDS[self.how].format(column=self.column, among=" or ".join(self.among))


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """How a number is written: times a factor, with so many decimals, and words before and after it.

    share: of a whole; a small share is not written as 0, nor a large one as all.
    """

    decimals: int = 0
    times: float = 1.0
    before: str = ""
    after: str = ""
    share: bool = False

    def write(self, value: float) -> str:
        """The text people read."""
        text = number(self.times * value, self.decimals)
        if self.share and 0 < value < 1 and text in ("0", "100"):
            text = "under 1" if text == "0" else "over 99"
        return f"{self.before}{text}{self.after}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """An entry of the list of sources; where, aggregations: JSON for programs; uses: the same for people."""

    anchor: str
    number: str
    file: str
    rows: str
    where: str
    aggregations: str
    uses: str


class Ledger:
    """The tables of a results folder, the numbers taken from them and the list of their sources.

    name: of the session, where a page shows several.
    """

    def __init__(self, folder: Path, name: str = "") -> None:
        self._folder, self._name, self._held = folder, name, dict[str, FrameColumns]()
        self._column = lru_cache(COLUMNS_KEPT)(self._read_column)
        self._places: dict[Rows, pa.Array] = {}
        self._uses: dict[Rows, list[Aggregation]] = {}

    @property
    def name(self) -> str:
        """Of the session."""
        return self._name

    def hold(self, tables: Mapping[str, FrameColumns]) -> None:
        """Takes these tables, by file, from memory from now on; others are read from their files again."""
        self._held = dict(tables)
        self._column.cache_clear()

    def take(self, rows: Rows, aggregation: Aggregation) -> float | None:
        """The number; None where the rows hold no value."""
        column = self._values(rows, aggregation.column)
        if aggregation.how == "frames":
            return _frames_beyond(self._values(rows, "frame"), column, aggregation.among)
        if aggregation.how == "count":
            return float(len(column))
        known = column.drop_null()
        if aggregation.how == "share":
            return _count_among(known, aggregation.among) / len(known) if len(known) else None
        if aggregation.how == "at least":
            return _share_at_least(known, float(aggregation.among[0])) if len(known) else None
        if aggregation.how == "value" and len(column) != 1:
            raise ValueError(f"{len(column)} rows are not a single value: {rows.sentence}")
        return _reduced(known, aggregation.how) if len(known) else None

    def figure(self, rows: Rows, aggregation: Aggregation, form: Form) -> Markup:
        """The number as an HTML element that names its source."""
        value = self.take(rows, aggregation)
        self._note(rows, aggregation)
        title = f"{rows.sentence}: {aggregation.sentence}"
        source = Markup('data-rows="{}" data-take="{}" title="{}"').format(
            self.anchor(rows), aggregation.sentence, title
        )
        if value is None:
            return Markup('<span class="unknown" {}>{}</span>').format(source, MISSING)
        element = Markup('<data value="{!r}" data-times="{!r}" {}>{}</data>')
        return element.format(value, form.times, source, form.write(value))

    def link(self, rows: Rows) -> Markup:
        """A small number that leads to the list of sources, and names the rows when pointed at or focused."""
        self._note(rows, None)
        anchor, text = self.anchor(rows), f"Source: {rows.sentence}"
        element = Markup('<a class="source" href="#{0}" title="{1}" aria-label="{1}">{2}</a>')
        return element.format(anchor, text, anchor.rsplit("-", 1)[1])

    def anchor(self, rows: Rows) -> str:
        """The id of these rows in the list of sources."""
        position = list(self._uses).index(rows) + 1 if rows in self._uses else len(self._uses) + 1
        return f"{self._name or 'source'}-{position}"

    def sources(self) -> list[Source]:
        """All rows that numbers were taken from so far."""
        return [
            Source(
                anchor=self.anchor(rows),
                number=self.anchor(rows).rsplit("-", 1)[1],
                file=rows.file,
                rows=rows.sentence,
                where=json.dumps(dict(rows.where)),
                aggregations=json.dumps({use.sentence: [use.column, use.how, list(use.among)] for use in uses}),
                uses="; ".join(dict.fromkeys(map(_in_short, uses))),
            )
            for rows, uses in self._uses.items()
        ]

    def _note(self, rows: Rows, aggregation: Aggregation | None) -> None:
        uses = self._uses.setdefault(rows, [])
        if aggregation is not None and aggregation not in uses:
            uses.append(aggregation)

    def _values(self, rows: Rows, name: str) -> pa.Array:
        """A column of the rows."""
        found = self._held[rows.file].values(name, rows.where) if rows.file in self._held else None
        if found is not None:
            return found
        column = self._column(rows.file, name)
        if not rows.where:
            return column
        if rows not in self._places:
            chosen = np.logical_and.reduce([_equal(self._column(rows.file, each), value) for each, value in rows.where])
            self._places[rows] = pa.array(np.flatnonzero(chosen).astype(np.int32))
        return column.take(self._places[rows])

    def _read_column(self, file: str, name: str) -> pa.Array:
        """All of a column, texts as a dictionary: whole tables of an hour would not fit beside each other."""
        with opened_parquet(self._folder / file) as opened:
            kind = opened.schema_arrow.field(name).type
            parts = [piece[name].combine_chunks() for piece in pieces(opened, [name])]
        if pa.types.is_string(kind):
            kind, parts = pa.dictionary(pa.int32(), kind), [part.dictionary_encode() for part in parts]
        return pa.chunked_array(parts, kind).unify_dictionaries().combine_chunks()


def _equal(column: pa.Array, value: str | None) -> np.ndarray:
    """(rows,) bool; None: empty."""
    if value is None:
        found = column.is_null()
    elif pa.types.is_dictionary(column.type):
        found = pc.equal(column.indices, column.dictionary.index(value)).fill_null(False)
    else:
        found = pc.equal(column, pa.scalar(value).cast(column.type)).fill_null(False)
    return np.asarray(found.to_numpy(zero_copy_only=False), dtype=bool)


def _is_among(column: pa.Array, among: tuple[str, ...]) -> pa.Array:
    if pa.types.is_dictionary(column.type):
        places = [place for place, text in enumerate(column.dictionary.to_pylist()) if text in among]
        return pc.is_in(column.indices, pa.array(places, pa.int32()))
    return pc.is_in(column.cast(pa.string()), pa.array(among))


def _count_among(known: pa.Array, among: tuple[str, ...]) -> int:
    return int(pc.sum(_is_among(known, among)).as_py() or 0)


def _share_at_least(known: pa.Array, least: float) -> float:
    return float((known.to_numpy(zero_copy_only=False) >= least).mean())


def _frames_beyond(frame: pa.Array, column: pa.Array, among: tuple[str, ...]) -> float | None:
    """Share of the frames that have a row with another value."""
    others = frame.filter(pc.invert(_is_among(column, among)))
    frames, beyond = (pc.count_distinct(each).as_py() for each in (frame, others))
    return beyond / frames if frames else None


def _reduced(known: pa.Array, how: str) -> float:
    if how == "distinct":
        return float(len(known.unique()))
    values = known.to_numpy(zero_copy_only=False).astype(np.float64, copy=False)
    if how == "extent":
        return float(values.max() - values.min())
    if how.endswith(ON_ARC):
        how, values = how.removesuffix(ON_ARC), on_shortest_arc(values)
    reduce: dict[str, Any] = {"value": np.max, "median": np.median, "lowest": np.min, "highest": np.max}
    return float(reduce[how](values))


def _in_short(aggregation: Aggregation) -> str:
    return f"shares of these rows by {aggregation.column}" if aggregation.how == "share" else aggregation.sentence


TURN_DEG: Final = 360.0


def on_shortest_arc(degrees: np.ndarray) -> np.ndarray:
    """degrees (n,) from -180 to 180, NaN where not known: the same angles on the shortest arc that holds all of them.

    A patient who faces against X has a pelvis at 179 in one frame and at -179 in the next: two degrees apart, not 358.
    Some values move by a whole turn, such that the median is from -180 to 180. Angles within half a turn stay as they
    are.
    """
    known = np.sort(degrees[np.isfinite(degrees)])
    if len(known) < 2:
        return degrees
    gaps = np.diff(known)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= TURN_DEG - (known[-1] - known[0]):
        return degrees
    moved = np.where(degrees <= known[widest], degrees + TURN_DEG, degrees)
    return moved - TURN_DEG if np.nanmedian(moved) > TURN_DEG / 2 else moved
