"""Strict reading of a JSON file: every value checked, every refusal naming the file, the place in it and the remedy."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anchorpose.errors import InputError


def nearest_key(unknown: str, known: Iterable[str]) -> str | None:
    """The known key that ``unknown`` most likely was meant to be; None where nothing is alike."""
    alike = difflib.get_close_matches(unknown.lower(), list(known), n=1, cutoff=0.5)
    return alike[0] if alike else None


def unknown_key_remedy(unknown: str, known: Iterable[str]) -> str:
    """What to do about a key that nobody reads: the nearest known one, or all of them."""
    names = sorted(known)
    nearest = nearest_key(unknown, names)
    return f"did you mean '{nearest}'" if nearest else f"remove it, known keys are {', '.join(names)}"


@dataclass(frozen=True, slots=True)
class JsonObject:
    """One object of a JSON file and where it stands in it, such as ``cameras[0].intrinsics``."""

    path: Path
    place: str
    values: dict[str, Any]

    def refuse(self, key: str, problem: str, remedy: str) -> InputError:
        """The error that says what is wrong with the value of ``key``."""
        return InputError(self.path, f"{self._name(key)} {problem}", remedy)

    def only(self, *known: str) -> None:
        """Raises InputError on the first key that is not among ``known``."""
        for key in self.values:
            if key not in known:
                raise InputError(self.path, f"unknown key '{self._name(key)}'", unknown_key_remedy(key, known))

    def has(self, key: str) -> bool:
        """Whether ``key`` is there and not null."""
        return self.values.get(key) is not None

    def text(self, key: str) -> str:
        value = self._require(key)
        if not isinstance(value, str) or not value.strip():
            raise self.refuse(key, f"is not a text ({_shown(value)})", "write it in quotation marks")
        return value

    def number(self, key: str, *, above: float = -math.inf, at_most: float = math.inf, meaning: str) -> float:
        """A finite number in (above, at_most]; ``meaning`` tells people what the number is."""
        value = _as_number(self._require(key))
        if value is None:
            problem = f"is not a number ({_shown(self.values[key])})"
            raise self.refuse(key, problem, f"write {meaning} as a finite number")
        if not above < value <= at_most:
            raise self.refuse(key, f"is {value:g}", f"it must be {meaning}, {_range(above, at_most)}")
        return value

    def whole_number(self, key: str, *, above: int, at_most: int, meaning: str) -> int:
        value = self.number(key, above=above, at_most=at_most, meaning=meaning)
        if value != int(value):
            raise self.refuse(key, f"is {value:g}", f"it must be {meaning}, a whole number")
        return int(value)

    def numbers(self, key: str, shape: tuple[int, ...], meaning: str) -> np.ndarray:
        """Nested lists of finite numbers as a float64 array of exactly ``shape``."""
        flat: list[float] = []
        if not _collect(self._require(key), shape, flat):
            size = " x ".join(str(count) for count in shape)
            raise self.refuse(key, f"is not a list of {size} finite numbers", f"write {meaning}")
        return np.array(flat).reshape(shape)

    def object(self, key: str) -> JsonObject:
        value = self._require(key)
        if not isinstance(value, dict):
            raise self.refuse(key, f"is not an object ({_shown(value)})", "write it in curly brackets")
        return JsonObject(self.path, self._name(key), value)

    def objects(self, key: str) -> tuple[JsonObject, ...]:
        value = self._require(key)
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.refuse(key, "is not a list of objects", "write it as [{...}, {...}]")
        return tuple(JsonObject(self.path, f"{self._name(key)}[{i}]", item) for i, item in enumerate(value))

    def _name(self, key: str) -> str:
        return f"{self.place}.{key}" if self.place else key

    def _require(self, key: str) -> Any:
        if key not in self.values:
            nearest = nearest_key(key, self.values)
            remedy = f"add it (or is '{nearest}' meant to be it?)" if nearest else "add it"
            raise InputError(self.path, f"the key '{self._name(key)}' is missing", remedy)
        return self.values[key]


def read_json_object(path: Path) -> JsonObject:
    """The top of a JSON file; raises InputError unless it is one object of finite values with unique keys."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the file and its permissions") from None
    except UnicodeDecodeError:
        raise InputError(path, "is not text in UTF-8", "save it again as UTF-8") from None
    try:
        values = json.loads(text, object_pairs_hook=_unique_pairs)
    except json.JSONDecodeError as error:
        raise InputError(path, f"is not JSON (line {error.lineno}: {error.msg})", "correct that line") from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"cannot be used ({error})", "correct the file") from None
    if not isinstance(values, dict):
        raise InputError(path, "is not a JSON object", "it must start with a curly bracket")
    return JsonObject(path, "", values)


def check_format(top: JsonObject, name: str) -> None:
    """Raises InputError unless the file says that it is version 1 of the format ``name``."""
    found = top.text("format")
    if found != name:
        raise top.refuse("format", f"is '{found}'", f"this place needs a file of the format '{name}'")
    version = top.number("version", meaning="the version of the format")
    if version != 1:
        raise top.refuse("version", f"is {version:g}", "this release reads version 1: write that or update anchorpose")


def _collect(value: Any, shape: tuple[int, ...], flat: list[float]) -> bool:
    if not shape:
        number = _as_number(value)
        if number is None:
            return False
        flat.append(number)
        return True
    return isinstance(value, list) and len(value) == shape[0] and all(_collect(v, shape[1:], flat) for v in value)


def _as_number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _range(above: float, at_most: float) -> str:
    low = "" if above == -math.inf else f"more than {above:g}"
    high = "" if at_most == math.inf else f"at most {at_most:g}"
    return " and ".join(part for part in (low, high) if part)


def _unique_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        names = [key for key, _ in pairs]
        twice = next(key for key in names if names.count(key) > 1)
        raise ValueError(f"the key '{twice}' is given twice")
    return values
