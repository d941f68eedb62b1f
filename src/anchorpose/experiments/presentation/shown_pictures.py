"""The pictures that stand beside the figures: PNG files of a folder, with captions."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError

PICTURES_FOLDER: Final = "pictures"
CAPTIONS_FILE: Final = "pictures.json"
SECTIONS: Final = {
    "matches": "One per cent of the matches (the paper’s “appearance” and “mesh”)",
    "tracked": "Tracked joints over the truth (“mhtjoints”)",
    "hypotheses": "Hypotheses (“hypothesis”)",
    "regions": "Bright and shadow regions",
    "other": "More pictures",
}
"""Titles, in the order of the page; "other" is what no caption names."""

FILES_ONLY: Final = "match"
"""The section of pictures that stay files: one of each method would make the page three times as large."""

REMEDY: Final = "write a list of objects with file, caption and section, or take the file away"


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """A PNG of the folder."""

    section: str
    caption: str
    png_bytes: bytes


def read_pictures(folder: Path) -> list[ShownPicture]:
    """The PNG files of ``folder / pictures`` in the order of their captions, then those without by name.

    Raises InputError where the captions cannot be read or name what is not there.
    """
    place = folder / PICTURES_FOLDER
    captions = _captions(place / CAPTIONS_FILE)
    found = {path.name: path for path in sorted(place.glob("*.png"))} if place.is_dir() else {}
    for name, _, section in captions:
        if name not in found or section not in (*SECTIONS, FILES_ONLY):
            raise InputError(
                place / CAPTIONS_FILE, f"names '{name}' of section '{section}', which is not there", REMEDY
            )
    named = {name for name, _, _ in captions}
    rest = [(name, Path(name).stem.replace("_", " "), "other") for name in found if name not in named]
    return [
        ShownPicture(section, caption, found[name].read_bytes())
        for name, caption, section in [*captions, *rest]
        if section != FILES_ONLY
    ]


def _captions(path: Path) -> list[tuple[str, str, str]]:
    if not path.is_file():
        return []
    try:
        entries: Any = json.loads(path.read_text(encoding="utf-8"))
        return [(str(entry["file"]), str(entry["caption"]), str(entry["section"])) for entry in entries]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"holds no captions ({type(error).__name__})", REMEDY) from None
