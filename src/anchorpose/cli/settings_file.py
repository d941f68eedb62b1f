"""Read the settings file that ``--config`` names: settings of tracking, and defaults for options of commands."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cyclopts import Parameter

from anchorpose.errors import InputError

if TYPE_CHECKING:
    from cyclopts import App, ArgumentCollection

    from anchorpose.tracker.config import TrackConfig

TABLES: Final = (
    "batch",
    "calibrate",
    "convert",
    "evaluate",
    "export",
    "inspect",
    "live",
    "measure",
    "record",
    "report",
    "simulate",
    "track",
    "view",
)
"""The commands that accept a settings file; the file may have a table with the name of each command."""

COMMAND_ONLY: Final = frozenset({"config", "output", "overwrite"})
"""Options that a settings file may not contain: the file must not decide where results go or which results are
replaced.
"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SettingsFile:
    """The option ``--config`` of commands that use no settings of tracking. Such a command uses only the table with its
    own name in the file. ``fill_from_file`` reads the file before the command begins.
    """

    config: Path | None = None
    """A TOML or JSON settings file; its table with the name of this command has defaults for these options."""


def tracking_settings(path: Path | None) -> TrackConfig:
    """Return the settings of tracking in a settings file, or the defaults if ``path`` is None.

    Raises InputError if the file cannot be read, or if it has an unknown name or a setting of tracking with an
    unsuitable value. The tables of commands are ignored.
    """
    from anchorpose.recording.document import read_config, validate
    from anchorpose.tracker.config import TrackConfig

    if path is None:
        return TrackConfig()
    values = read_config(path)
    known = {*TABLES, *(field.name for field in fields(TrackConfig))}
    for name in values.keys() - known:
        raise unknown_key(path, name, name, known, "remove it: it is neither a setting nor a verb")
    return validate(path, TrackConfig, {name: value for name, value in values.items() if name not in TABLES})


def fill_from_file(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Take the value of each option that the command line leaves out from the settings file (called by cyclopts).

    Raises InputError if the command's table in the file has an unknown option, or if ``tracking_settings`` refuses any
    setting of tracking in the file.
    """
    verb = " ".join(commands)
    given = next((each for each in arguments if "--config" in each.names and each.tokens), None)
    if given is None or verb not in TABLES:
        return
    from cyclopts.config import Dict

    from anchorpose.recording.document import read_config

    path = Path(given.tokens[0].value)
    tracking_settings(path)
    table = read_config(path).get(verb, {})
    options = {name.removeprefix("--") for each in arguments for name in each.names if name.startswith("--")}
    require_options(path, verb, table, options)
    Dict({verb: table}, source=str(path))(app, commands, arguments)


def require_options(path: Path, verb: str, table: object, options: set[str]) -> None:
    """Raise InputError unless ``table`` is a table whose names are all options of the command ``verb``."""
    if not isinstance(table, dict):
        raise InputError(
            path, f"'{verb}' is not a table", f"write [{verb}], and options of 'anchorpose {verb}' below it"
        )
    for name in table:
        option = name.replace("_", "-")
        if option in COMMAND_ONLY:
            raise InputError(path, f"'{verb}.{name}' cannot stand in a file", f"give --{option} in the command")
        if option not in options:
            remedy = f"'anchorpose {verb} --help' lists the options"
            raise unknown_key(path, f"{verb}.{name}", option, options - COMMAND_ONLY, remedy)


def unknown_key(path: Path, place: str, name: str, known: set[str], otherwise: str) -> InputError:
    """Return the error for an unknown name; its remedy is the nearest known name, or ``otherwise`` if none is similar.

    place: the unknown name together with its table, such as track.threads.
    """
    from anchorpose.settings import LONGEST_KEY, nearest_key

    near = nearest_key(name, known)
    return InputError(path, f"unknown key '{place[:LONGEST_KEY]}'", f"did you mean '{near}'" if near else otherwise)
