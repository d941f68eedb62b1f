"""Where each number of a page comes from: it is computed from named rows of a table, and the page says which.

A number enters a page through ``Ledger.figure`` only. Its element names the rows (``data-rows``, a number of the list
at the end of the page), the column and what was done with it, so that a reader, or a test, can do it again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from anchorpose.report.words import MISSING, escape, number, on_shortest_arc, table

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
    "frames": "of the frames, the share in which not all of these rows have {column} {among}",
}
"""What can be done with the rows; the words are those of the list of sources. What is not known is never a no."""


_TITLES: Final = ("number", "rows", "taken from them")


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
class Taking:
    """What is done with a column of the rows; among: the values that ``share`` and ``frames`` ask for."""

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

    share: of a whole, so that little is not written as nothing, nor nearly all as all.
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


class Ledger:
    """The tables of a results folder, the numbers taken from them and the list of their sources.

    name: of the session, where a page shows several.
    """

    def __init__(self, folder: Path, name: str = "") -> None:
        self._folder, self._name = folder, name
        self._tables: dict[Rows, pa.Table] = {}
        self._uses: dict[Rows, list[Taking]] = {}

    @property
    def name(self) -> str:
        """Of the session."""
        return self._name

    def take(self, rows: Rows, taking: Taking) -> float | None:
        """The number; None where the rows hold no value."""
        if taking.how == "frames":
            return _frames_beyond(self._table(rows), taking)
        column = self._table(rows)[taking.column]
        if taking.how == "count":
            return float(len(column))
        known = column.drop_null()
        if taking.how == "share":
            return _count_among(known, taking.among) / len(known) if len(known) else None
        if taking.how == "value" and len(column) != 1:
            raise ValueError(f"{len(column)} rows are no single value: {rows.sentence}")
        return _reduced(known, taking.how) if len(known) else None

    def figure(self, rows: Rows, taking: Taking, form: Form) -> str:
        """The number as HTML, with where it comes from."""
        value = self.take(rows, taking)
        self._note(rows, taking)
        source = f"data-rows='{self.anchor(rows)}' data-take='{escape(taking.sentence)}'"
        title = f"title='{escape(f'{rows.sentence}: {taking.sentence}')}'"
        if value is None:
            return f"<span class='unknown' {source} {title}>{MISSING}</span>"
        machine = f"value='{value!r}' data-times='{form.times!r}'"
        return f"<data {machine} {source} {title}>{escape(form.write(value))}</data>"

    def link(self, rows: Rows) -> str:
        """A small number that leads to the list of sources, and tells them when pointed at or reached by Tab."""
        self._note(rows, None)
        anchor, text = self.anchor(rows), escape(f"Source: {rows.sentence}")
        return f"<a class='source' href='#{anchor}' title='{text}' aria-label='{text}'>{anchor.rsplit('-', 1)[1]}</a>"

    def anchor(self, rows: Rows) -> str:
        """The id of these rows in the list of sources."""
        position = list(self._uses).index(rows) + 1 if rows in self._uses else len(self._uses) + 1
        return f"{self._name or 'source'}-{position}"

    def sources(self) -> str:
        """The list of all rows that numbers were taken from, as HTML."""
        body = "".join(
            f"<tr id='{self.anchor(rows)}' data-file='{escape(rows.file)}' "
            f"data-where='{escape(json.dumps(dict(rows.where)))}' data-takings='{escape(_machine(uses))}'>"
            f"<th scope='row'>{self.anchor(rows).rsplit('-', 1)[1]}</th><td>{escape(rows.sentence)}</td>"
            f"<td>{escape('; '.join(dict.fromkeys(map(_in_short, uses))))}</td></tr>"
            for rows, uses in self._uses.items()
        )
        return table(f"Sources {self._name}".strip(), _TITLES, f"<tbody>{body}</tbody>", "facts")

    def _note(self, rows: Rows, taking: Taking | None) -> None:
        uses = self._uses.setdefault(rows, [])
        if taking is not None and taking not in uses:
            uses.append(taking)

    def _table(self, rows: Rows) -> pa.Table:
        if rows not in self._tables:
            table = self._table(Rows(rows.file)) if rows.where else pq.read_table(self._folder / rows.file)
            for name, value in rows.where:
                column = table[name]
                table = table.filter(pc.is_null(column) if value is None else pc.equal(column, value))
            self._tables[rows] = table
        return self._tables[rows]


def _count_among(known: pa.ChunkedArray, among: tuple[str, ...]) -> int:
    return int(pc.sum(pc.is_in(known.cast(pa.string()), pa.array(among))).as_py() or 0)


def _frames_beyond(table: pa.Table, taking: Taking) -> float | None:
    """Share of the frames that have a row with another value."""
    others = table.filter(pc.invert(pc.is_in(table[taking.column], pa.array(taking.among))))
    frames, beyond = (pc.count_distinct(each["frame"]).as_py() for each in (table, others))
    return beyond / frames if frames else None


def _reduced(known: pa.ChunkedArray, how: str) -> float:
    if how == "distinct":
        return float(pc.count_distinct(known).as_py())
    values = known.to_numpy().astype(np.float64)
    if how == "extent":
        return float(values.max() - values.min())
    if how.endswith(ON_ARC):
        how, values = how.removesuffix(ON_ARC), on_shortest_arc(values)
    reduce: dict[str, Any] = {"value": np.max, "median": np.median, "lowest": np.min, "highest": np.max}
    return float(reduce[how](values))


def _in_short(taking: Taking) -> str:
    return f"shares of these rows by {taking.column}" if taking.how == "share" else taking.sentence


def _machine(uses: list[Taking]) -> str:
    return json.dumps({use.sentence: [use.column, use.how, list(use.among)] for use in uses})
