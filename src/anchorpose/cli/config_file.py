"""Loading TOML or JSON into nested frozen dataclasses; whatever does not fit is an error that names the place."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from anchorpose.errors import InputError
from anchorpose.recording.document import read_json_object, unknown_key_remedy

Config = TypeVar("Config")


def load_config(path: Path, kind: type[Config]) -> Config:
    """The dataclass ``kind`` with the values that the file gives and its own defaults for the rest.

    Raises InputError for a file that is neither TOML nor JSON, an unknown key (naming the nearest known one), a value
    of the wrong type, and a value that the dataclass itself refuses.
    """
    values = read_json_object(path).values if path.suffix == ".json" else _read_toml(path)
    return _build(path, "", kind, values)


def _read_toml(path: Path) -> dict[str, Any]:
    if path.suffix != ".toml":
        raise InputError(path, "is neither .toml nor .json", "give a configuration file of one of the two")
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, f"is not TOML ({error})", "correct the file") from None


def _build(path: Path, place: str, kind: Any, values: Any) -> Any:
    if not isinstance(values, dict):
        raise InputError(path, f"{place} is not a table of settings", "write one setting a line below its heading")
    hints = get_type_hints(kind)
    names = [field.name for field in dataclasses.fields(kind) if field.init]
    given = {}
    for key, value in values.items():
        if key not in names:
            raise InputError(path, f"unknown key '{_join(place, key)}'", unknown_key_remedy(key, names))
        given[key] = _convert(path, _join(place, key), hints[key], value)
    try:
        return kind(**given)
    except TypeError:
        required = next(name for name in names if name not in given and _has_no_default(kind, name))
        raise InputError(path, f"the key '{_join(place, required)}' is missing", "add it") from None
    except ValueError as error:
        raise InputError(path, f"{place or 'the configuration'} is refused: {error}", "correct that value") from None


def _convert(path: Path, place: str, hint: Any, value: Any) -> Any:
    if dataclasses.is_dataclass(hint):
        return _build(path, place, hint, value)
    converted = _fit(hint, value)
    if converted is _NO_FIT:
        raise InputError(path, f"{place} is {value!r}", f"write {_wanted(hint)}")
    return converted


_NO_FIT = object()


def _fit(hint: Any, value: Any) -> Any:
    """``value`` as the type ``hint`` asks for, or ``_NO_FIT``; nothing is rounded, cut or guessed."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        fits = (_fit(argument, value) for argument in arguments)
        return next((fit for fit in fits if fit is not _NO_FIT), _NO_FIT)
    if origin is Literal:
        return value if value in arguments else _NO_FIT
    if origin is tuple:
        return _fit_tuple(arguments, value)
    if hint in (NoneType, None):
        return None if value is None else _NO_FIT
    if hint is float:
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        return float(value) if number else _NO_FIT
    if isinstance(hint, type) and issubclass(hint, Enum):
        return next((member for member in hint if member.value == value), _NO_FIT)
    return value if type(value) is hint else _NO_FIT


def _fit_tuple(arguments: tuple[Any, ...], value: Any) -> Any:
    if not isinstance(value, list):
        return _NO_FIT
    hints = arguments[:1] * len(value) if arguments[1:] == (...,) else arguments
    if len(hints) != len(value):
        return _NO_FIT
    fits = tuple(_fit(hint, item) for hint, item in zip(hints, value, strict=True))
    return _NO_FIT if any(fit is _NO_FIT for fit in fits) else fits


def _wanted(hint: Any) -> str:
    if get_origin(hint) is Literal:
        return "one of " + ", ".join(str(argument) for argument in get_args(hint))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return "one of " + ", ".join(str(member.value) for member in hint)
    names = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text in quotation marks"}
    return names.get(hint, f"a value of the type {hint}")


def _has_no_default(kind: Any, name: str) -> bool:
    field = next(field for field in dataclasses.fields(kind) if field.name == name)
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
