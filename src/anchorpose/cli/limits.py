"""What a number on the command line may be; the parser refuses any other, with the option's name, before any work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from cyclopts import Parameter, Token
from cyclopts.validators import Number

DAY_S: Final = 86_400.0
TALLEST_M: Final = 3.0
FARTHEST_M: Final = 100.0
"""No room is that large; a place in millimetres is beyond."""

FASTEST_HZ: Final = 1000.0
MOST_FRAMES: Final = 10**9
MOST_PROCESSES: Final = 1024
LARGEST_SEED: Final = 2**63 - 1
LARGEST_PORT: Final = 65535


def positive(most: float) -> Parameter:
    """Above zero, up to ``most``; not a number is refused as well."""
    return Parameter(validator=Number(gt=0, lte=most), converter=_as_number)


def between(least: float, most: float) -> Parameter:
    """From ``least`` to ``most``, both allowed."""
    return Parameter(validator=Number(gte=least, lte=most), converter=_as_number)


def whole(least: int, most: int) -> Parameter:
    """A whole number from ``least`` to ``most``; the parser alone would round 1.7 to 2."""
    return Parameter(validator=Number(gte=least, lte=most), converter=_as_whole)


def _as_number(kind: Any, tokens: Sequence[Token]) -> float:
    try:
        return plain_number(tokens[0].value)
    except ValueError:
        raise ValueError(f'"{tokens[0].value[:40]}" is not a number') from None


def plain_number(text: str) -> float:
    """A number without the underscores that Python allows between digits; raises ValueError for NaN, too."""
    number = float(text)
    if "_" in text or math.isnan(number):
        raise ValueError
    return number


def _as_whole(kind: Any, tokens: Sequence[Token]) -> int:
    try:
        plain_number(tokens[0].value)
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f'"{tokens[0].value[:40]}" is not a whole number') from None
