"""Settings from a TOML or JSON file; whatever does not fit is an error that names the place."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Set
from dataclasses import fields, is_dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, get_type_hints

from anchorpose.errors import InputError
from anchorpose.recording.document import read_json, read_text, require_plain, validate
from anchorpose.settings import Unfit

if TYPE_CHECKING:
    from anchorpose.tracker.config import TrackConfig

Config = TypeVar("Config")

MOVED: Final = {"bystanders.followed": "follow.bystanders", "smoothing.lost_sigma_m": "follow.lost_sigma_m"}
"""Settings of version 0.1.0 that now belong to another stage."""


def load_track_config(path: Path | None) -> TrackConfig:
    """The settings of ``anchorpose track``; see ``load_config``. None = the defaults.

    Also raises InputError for settings of version 0.1.0 that are constants now.
    """
    from anchorpose.tracker.config import TrackConfig

    if path is None:
        return TrackConfig()
    of_version_0_1 = files(__package__).joinpath("settings_of_0_1.txt").read_text(encoding="utf-8")
    return load_config(path, TrackConfig, set(of_version_0_1.split()))


def load_config(path: Path, kind: type[Config], former: Set[str] = frozenset()) -> Config:
    """The class of settings ``kind`` with the values that the file gives and its own defaults for the rest.

    former: dotted names that earlier versions had. Raises InputError for a file that is neither TOML nor JSON, a former
    name, an unknown name (with the nearest known one), a value of the wrong type, and an impossible value.
    """
    values = read_json(path) if path.suffix == ".json" else _read_toml(path)
    known = set(_names_of(kind))
    gone = sorted(former & set(_names_given(values)) - known)
    for name in gone:
        if new := _new_name(name, known):
            raise InputError(path, f"{name} is called {new} since version 0.2.0", "rename it")
    if gone:
        verb, what = ("is no longer a setting", "it") if len(gone) == 1 else ("are no longer settings", "them")
        raise InputError(path, f"{', '.join(gone)} {verb} since version 0.2.0", f"remove {what} from the file")
    return validate(path, kind, values)


def _read_toml(path: Path) -> dict[str, Any]:
    if path.suffix != ".toml":
        raise InputError(path, "is neither .toml nor .json", "give a configuration file of one of the two")
    try:
        values = tomllib.loads(read_text(path))
        require_plain(values)
    except Unfit as error:
        raise InputError(path, error.problem, error.remedy) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"is not TOML ({error})", "correct the file") from None
    return values


def _names_given(values: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """The dotted names of all values in nested tables."""
    for key, value in values.items():
        yield from _names_given(value, f"{prefix}{key}.") if isinstance(value, dict) else (prefix + key,)


def _names_of(kind: Any, prefix: str = "") -> Iterator[str]:
    """The dotted names of all settings in nested classes of settings."""
    hints = get_type_hints(kind)
    for name in (field.name for field in fields(kind)):
        yield from _names_of(hints[name], f"{prefix}{name}.") if is_dataclass(hints[name]) else (prefix + name,)


def _new_name(former: str, known: Set[str]) -> str | None:
    """The setting of the same stage in which the former place went into the name: a.b_c for a.x.b.c, for instance."""
    if former in MOVED:
        return MOVED[former]
    stage, *rest = former.split(".")
    ends = (f"{stage}.{'_'.join(rest[first:])}" for first in range(len(rest)))
    return next((name for name in ends if name in known), None)
