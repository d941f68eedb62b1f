"""Declare the allowed values of settings and files, check them, and explain an invalid value to the user in one
sentence.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Annotated, Any, Final, TypeVar, cast, dataclass_transform, get_args, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

LEAST, LARGEST = 1e-6, 1e9
"""Limits of any number that is squared, inverted or used as a divisor, since floats overflow beyond these limits. As
lengths they are a micrometre and a million kilometres.
"""

Positive = Annotated[float, Field(ge=LEAST, le=LARGEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(gt=0, strict=True)]

STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)
"""Pydantic configuration that refuses unknown names and numbers that are not finite."""

LONGEST_KEY: Final = 60  # maximum number of characters of an unknown key that a message shows

Class = TypeVar("Class")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(cls: type[Class]) -> type[Class]:
    """Make a class of settings: a frozen dataclass whose fields are checked by their annotations.

    Raises pydantic's ValidationError, a ValueError, on an unknown name, a wrong type or an impossible value.
    ``replace``, ``asdict`` and ``fields`` of dataclasses work as usual.
    """
    return cast("type[Class]", dataclass(frozen=True, kw_only=True, config=STRICT)(cls))


class Unfit(ValueError):
    """The error for a setting that has the right type but a value that cannot be used. It states the problem and the
    remedy.

    key: name of the field with this value; it is needed only if the check was made on the whole object that contains
    the field, and not on the field alone.
    """

    def __init__(self, problem: str, remedy: str, key: str = "") -> None:
        self.problem, self.remedy, self.key = problem, remedy, key
        super().__init__(f"{problem}; {remedy}")


def nearest_key(unknown: str, known: Iterable[str]) -> str | None:
    """Return the known key most similar to ``unknown``, regardless of upper and lower case; None if none is similar."""
    names = {name.lower(): name for name in known}
    alike = difflib.get_close_matches(unknown.lower(), list(names), n=1, cutoff=0.5)
    return names[alike[0]] if alike else None


def explain(error: ValidationError, kind: Any = None) -> tuple[str, str]:
    """Return the first problem of a failed validation, with its place such as ``cameras[0].name``, and the remedy.

    kind: the expected type, from which the names and descriptions of the allowed fields are taken. If several problems
    were found, an unknown name is reported first, since it may be the misspelt name of a field that is reported as
    missing.
    """
    unknown = ("extra_forbidden", "unexpected_keyword_argument")
    found = min(error.errors(include_url=False), key=lambda one: one["type"] not in unknown)
    place, meaning, known = _follow(kind, found["loc"])
    problem, given, context = found["type"], found["input"], found.get("ctx", {})
    name = place.rpartition(".")[2]
    if problem in unknown:
        near = nearest_key(name, known)
        remedy = f"did you mean '{near}'" if near else f"remove it, known keys are {', '.join(sorted(known))}"
        return f"unknown key '{place}'", remedy
    if problem == "missing":
        near = nearest_key(name, given) if isinstance(given, dict) else None
        remedy = f"add it (or is '{near}' meant to be it?)" if near else "add it"
        return f"the key '{place}' is missing", remedy + (meaning and f": {meaning}")
    if problem == "value_error":
        refusal = context["error"]
        if isinstance(refusal, Unfit):
            return f"{_join(place, refusal.key)} {refusal.problem}".strip(), refusal.remedy
        return f"{place} is refused: {refusal}" if place else str(refusal), "correct that value"
    if problem == "union_tag_invalid":
        key = _join(place, context["discriminator"].strip("'"))
        return f"{key} is {shown(context['tag'])}", f"it must be one of {context['expected_tags']}"
    wanted = found["msg"].partition(" should ")[2]
    for words, plain in _PLAIN_WORDS.items():
        wanted = wanted.replace(words, plain)
    if not wanted:
        return f"cannot be used ({found['msg']})", "correct the file"
    return f"{place} is {shown(given)}", f"it must {wanted}" + (meaning and f": {meaning}")


def sentence_of(error: ValueError) -> str:
    """Return a sentence, without a full stop, that explains why a setting was refused."""
    return "; ".join(explain(error)) if isinstance(error, ValidationError) else str(error)


_PLAIN_WORDS: Final = {  # pydantic's words, and the words that replace them in messages
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "more than",
    "a valid array": "a list",
    "a valid boolean": "true or false",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid string": "a text in quotation marks",
    "an object": "an object or a table",
}


def _follow(kind: Any, location: tuple[int | str, ...]) -> tuple[str, str, list[str]]:
    """Return the place of an error in a file, such as ``cameras[0].name``, the description of the innermost field at
    this place, and the names of the fields that are allowed there.
    """
    place, meaning, owners, known = "", "", _classes_in(kind), list[str]()
    for step in location:
        if isinstance(step, int):
            place += f"[{step}]"
            continue
        declared = {name: hint for owner in owners for name, hint in _fields(owner).items()}
        tagged = [owner for owner in owners if _is_tag(step, owner)]
        # pydantic adds the tag (which type of a union it tried) to the place of an error, although the tag is not a key
        # of the file
        if step not in declared and tagged:
            owners = tagged
            continue
        place, known = _join(place, step if len(step) <= LONGEST_KEY else step[:LONGEST_KEY] + "..."), list(declared)
        if step in declared:
            meaning, owners = _stated(declared[step], "description"), _classes_in(declared[step])
    return place, meaning, known


def _is_tag(step: str, owner: type) -> bool:
    return step == owner.__name__ or any(step in get_args(hint) for hint in _fields(owner).values())


def _classes_in(hint: Any) -> list[type]:
    """Return the classes with declared fields that a type contains, for example as parts of a tuple or a union."""
    if isinstance(hint, type) and (is_dataclass(hint) or issubclass(hint, BaseModel)):
        return [hint]
    return [found for part in get_args(hint) for found in _classes_in(part)]


@cache
def _fields(owner: type) -> dict[str, Any]:
    """Return the type annotation of every field of a class, by the name that the field has in a file."""
    hints = get_type_hints(owner, include_extras=True)
    names = owner.model_fields if issubclass(owner, BaseModel) else [field.name for field in fields(cast("Any", owner))]
    return {_stated(hints[name], "alias") or name: hints[name] for name in names}


def _stated(hint: Any, what: str) -> str:
    """Return the text of the kind ``what`` ("alias" or "description") that a field's type annotation contains; empty if
    it contains no such text.
    """
    own = [text for part in getattr(hint, "__metadata__", ()) if (text := getattr(part, what, None))]
    return own[0] if own else next((text for part in get_args(hint) if (text := _stated(part, what))), "")


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place and key else place or key


def shown(value: Any) -> str:
    """Return a value as JSON writes it, cut to 40 characters, for a message."""
    text = json.dumps(value, default=repr)
    return text if len(text) <= 40 else text[:37] + "..."
