"""Numbers as text that reads back as the same number, in the shortest form; nothing where there is none."""

from __future__ import annotations

import math
from collections.abc import Iterable


def number_text(value: float, missing: str) -> str:
    """The shortest decimal that is the same double again; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(float(value))


def rounded_text(value: float, digits: int, missing: str) -> str:
    """With so many digits after the point, without needless zeros; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def rows_text(rows: Iterable[Iterable[str]], separator: str) -> str:
    """Lines of cells, each ended by a line feed."""
    return "".join(separator.join(row) + "\n" for row in rows)
