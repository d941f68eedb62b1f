"""A recorder's file given to a verb as if it were a recording: converted beside it, once."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.sources.convert import (
    RECORDING_FILE,
    Progress,
    conversion_document,
    convert,
    is_same,
    is_untouched,
    read_conversion,
)
from anchorpose.sources.plan import ConvertOptions
from anchorpose.sources.readers import find_reader

ENDING: Final = ".anchorpose"


@dataclass(frozen=True, slots=True)
class DirectInput:
    """What a verb was given, and the recording that it works with; ready where nothing needs to be done."""

    given: Path
    recording: Path
    ready: bool


def look_at(path: Path) -> DirectInput:
    """What ``path`` is. A recording, and anything that no reader knows, is left to ``open_recording``.

    Raises InputError where the recording made of it is of other content and holds files that were added by hand.
    """
    if not path.exists() or (path / RECORDING_FILE).exists() or find_reader(path) is None:
        return DirectInput(path, path, True)
    recording = path.resolve().with_name(path.resolve().name + ENDING)
    if recording.is_symlink():
        raise InputError(recording, "is in the way and is a link", "rename it, or use 'anchorpose convert'")
    if not recording.is_dir() or not any(recording.iterdir()):
        return DirectInput(path, recording, False)
    found = read_conversion(recording)
    if found is None:
        raise InputError(
            recording, "is in the way and was not made by anchorpose", "rename it, or use 'anchorpose convert'"
        )
    if is_same(found, conversion_document([path], ConvertOptions())):
        return DirectInput(path, recording, (recording / RECORDING_FILE).exists())
    if not is_untouched(recording):
        problem = f"was made when {path.name} or anchorpose was another, and holds what was added or changed since"
        raise InputError(recording, problem, "rename or remove it")
    shutil.rmtree(recording)
    return DirectInput(path, recording, False)


def make_recording(direct: DirectInput, progress: Progress) -> tuple[str, ...]:
    """Converts what is not ready and returns its notes; raises InputError with the way round where it cannot."""
    if not _may_write(direct.recording.parent):
        remedy = f"make the recording elsewhere with 'anchorpose convert {direct.given.name} OUT'"
        raise InputError(direct.recording.parent, "cannot be written", remedy)
    return convert([direct.given], direct.recording, ConvertOptions(), progress).notes


def _may_write(folder: Path) -> bool:
    """A folder that is marked as read-only stays so for an administrator too, to whom the system allows everything."""
    marked = os.name == "posix" and not folder.stat().st_mode & 0o222
    return not marked and os.access(folder, os.W_OK)
