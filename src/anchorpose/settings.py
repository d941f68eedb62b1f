"""How settings are declared: frozen, keyword-only and checked when made."""

from __future__ import annotations

from typing import Annotated, TypeVar, cast, dataclass_transform

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(gt=0, strict=True)]

Class = TypeVar("Class")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(cls: type[Class]) -> type[Class]:
    """A class of settings: a frozen dataclass whose fields are checked by their annotations.

    Raises pydantic's ValidationError, a ValueError, on an unknown name, a wrong type or an impossible value.
    ``replace``, ``asdict`` and ``fields`` of dataclasses work as usual.
    """
    return cast(type[Class], dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))(cls))
