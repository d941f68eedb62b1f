"""The one place where JSON text becomes values: size, depth and numbers have limits, so no file can stall a run."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Final

from anchorpose.settings import Unfit

LARGEST_BYTES: Final = 16 * 2**20
"""A description of a recording has some thousand bytes; the values of a text need up to twenty times its size."""

DEEPEST: Final = 64
"""Objects and lists within each other; no format of ours or of a recorder has more than ten."""

LARGEST_INTEGER: Final = 2**64
"""Beyond every counter and time stamp of a recorder; arrays and floats cannot hold arbitrarily large integers."""


def parse_json(text: str | bytes, largest_bytes: int = LARGEST_BYTES) -> Any:
    """The values of a JSON text, every key of an object once; NaN and infinities are left to the caller to refuse.

    Bytes are text in UTF-8, UTF-16 or UTF-32. Raises Unfit, a ValueError, in time that grows with the size of the text:
    where it is no JSON, larger than ``largest_bytes`` or not plain (``require_plain``).
    """
    if len(text) > largest_bytes:
        raise Unfit(f"is larger than {largest_bytes / 2**20:g} MB", "give the right file: this one describes no more")
    try:
        decoded = text if isinstance(text, str) else text.decode(json.detect_encoding(text))
        values = json.loads(decoded, object_pairs_hook=_unique_pairs, parse_int=_integer)
    except UnicodeDecodeError:
        raise Unfit("is not text in UTF-8", "save it again as UTF-8") from None
    except json.JSONDecodeError as error:
        raise Unfit(f"is not JSON (line {error.lineno}: {error.msg})", "correct that line") from None
    except RecursionError:
        raise _too_deep() from None
    require_plain(values)
    return values


def require_plain(values: Any) -> None:
    """Raises Unfit where values are nested too deeply, an integer is too large or a text cannot be a file's name or be
    printed (it holds a null character or half a surrogate pair)."""
    level = [values]
    for _ in range(DEEPEST + 1):
        inner, texts = list[Any](), list[str]()
        for value in level:
            if isinstance(value, str):
                texts.append(value)
            elif isinstance(value, dict):
                inner += value
                inner += value.values()
            elif isinstance(value, list):
                inner += value
            elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
                raise _too_large()
        _require_writable(texts)
        if not inner:
            return
        level = inner
    raise _too_deep()


def _unique_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        raise Unfit(f"cannot be used: the key '{_first_twice(key for key, _ in pairs)}' is given twice", "remove one")
    return values


def _first_twice(keys: Iterable[str]) -> str:
    seen = set[str]()
    return next(key for key in keys if key in seen or seen.add(key))  # type: ignore[func-returns-value]


def _integer(digits: str) -> int:
    if len(digits) > len(str(LARGEST_INTEGER)) + 1:  # and its sign
        raise _too_large()
    return int(digits)


def _require_writable(texts: list[str]) -> None:
    """All at once: the run.json of an hour names 324,000 files."""
    together = "".join(texts)
    if together.isascii() and "\0" not in together:
        return
    for text in texts:
        if "\0" in text or any("\ud800" <= letter <= "\udfff" for letter in text if not text.isascii()):
            raise Unfit(f"holds a text with a character that has no meaning, {text[:40]!a}", "remove that character")


def _too_deep() -> Unfit:
    return Unfit(f"is nested more than {DEEPEST} levels deep", "correct the file")


def _too_large() -> Unfit:
    return Unfit("holds an integer of more than 64 bits", "correct that number")
