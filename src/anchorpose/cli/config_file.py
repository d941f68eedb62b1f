"""Settings from a TOML or JSON file; whatever does not fit is an error that names the place."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from anchorpose.errors import InputError
from anchorpose.recording.document import read_json, read_text, require_plain, validate
from anchorpose.settings import Unfit

if TYPE_CHECKING:
    from anchorpose.tracker.config import TrackConfig

Config = TypeVar("Config")


def load_track_config(path: Path | None) -> TrackConfig:
    """Return the settings of ``anchorpose track``; see ``load_config``. None = the defaults."""
    from anchorpose.tracker.config import TrackConfig

    return TrackConfig() if path is None else load_config(path, TrackConfig)


def load_config(path: Path, kind: type[Config]) -> Config:
    """Return the class of settings ``kind`` with the file's values, and its own defaults for the rest.

    Raises InputError for a file that is neither TOML nor JSON, an unknown name (with the nearest known one), a value of
    the wrong type, and an impossible value.
    """
    if path.suffix not in (".toml", ".json"):
        raise InputError(path, "is neither .toml nor .json", "give a configuration file of one of the two")
    return validate(path, kind, read_json(path) if path.suffix == ".json" else read_toml(path))


def read_toml(path: Path) -> dict[str, Any]:
    """Return the values of a TOML file; raises InputError unless each of them could stand in a JSON file as well."""
    try:
        values = tomllib.loads(read_text(path))
        require_plain(values)
    except Unfit as error:
        raise InputError(path, error.problem, error.remedy) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"is not TOML ({error})", "correct the file") from None
    return values
