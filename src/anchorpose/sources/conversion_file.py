"""conversion.json: which inputs and options a recording was made from, to go on with it or to make it again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from anchorpose import __version__
from anchorpose.options import ConvertOptions
from anchorpose.recording.document import LARGEST_BYTES, parse_json
from anchorpose.recording.regular_file import Unreadable, open_regular, read_bounded
from anchorpose.results.run_record import hash_files

RECORDING_FILE: Final = "recording.json"
CONVERSION_FILE: Final = "conversion.json"
LOCK_FILE: Final = ".conversion.lock"

BLOCK: Final = 65536
BLOCKS: Final = 16  # spread over a large file: another recording of the same size differs in its noise everywhere

SMALL: Final = 65536
LISTED: Final = 200
"""Of the small text files of a folder, so many are read whole: a corrected lens changes no size."""

TEXTS: Final = {".json", ".txt", ".csv", ".yaml", ".yml"}


def conversion_document(inputs: Sequence[Path], options: ConvertOptions) -> dict[str, Any]:
    """Return what makes two conversions the same: the program's version, the inputs' content and the options."""
    prints = [(path, fingerprint(path)) for path in inputs]
    return {
        "format": "conversion",
        "version": 1,
        "anchorpose": __version__,
        "inputs": [{"name": path.resolve().name, "bytes": size, "sha256": sha256} for path, (size, sha256) in prints],
        "options": json.loads(json.dumps(asdict(options))),
    }


def read_conversion(folder: Path) -> dict[str, Any] | None:
    """Return the conversion.json of a folder; None where it has none that can be read."""
    try:
        values = parse_json(read_bounded(folder / CONVERSION_FILE, LARGEST_BYTES))
    except (Unreadable, ValueError):
        return None
    return values if isinstance(values, dict) and values.get("format") == "conversion" else None


def is_same(found: dict[str, Any], begun: dict[str, Any]) -> bool:
    """Return whether a folder's conversion is of the same inputs, whatever their names now, with the same options."""
    return _identity(found) == _identity(begun)


def _identity(document: dict[str, Any]) -> tuple[Any, ...]:
    inputs = document.get("inputs")
    prints = [(one.get("bytes"), one.get("sha256")) for one in inputs] if isinstance(inputs, list) else None
    return prints, document.get("options"), document.get("anchorpose")


def is_untouched(folder: Path) -> bool:
    """Return whether a folder with a conversion.json holds what was written into it and nothing else, as far as names
    and recording.json tell: then it can be made again without losing anybody's work."""
    for file in folder.iterdir():
        of_camera = file.is_dir() and {inner.name for inner in file.iterdir()} <= {"depth", "timestamps.csv"}
        if not of_camera and file.name not in (RECORDING_FILE, CONVERSION_FILE, LOCK_FILE):
            return False
    document = folder / RECORDING_FILE
    if not document.exists():
        return True
    found, digest = read_conversion(folder), dict(hash_files([document], folder))
    return found is not None and found.get(RECORDING_FILE) == digest[RECORDING_FILE]


def fingerprint(path: Path) -> tuple[int, str]:
    """Return bytes in all, and a SHA-256 of names, sizes and samples of the content; it does not depend on where it
    lies."""
    digest = hashlib.sha256()
    if path.is_file():
        _sample(path, digest)
        return path.stat().st_size, digest.hexdigest()
    files = [file for file in sorted(path.rglob("*")) if file.is_file() and not _hidden(file, path)]
    total = 0
    for file in files:
        size = file.stat().st_size
        digest.update(f"{file.relative_to(path).as_posix()} {size}\n".encode())
        total += size
    texts = [file for file in files if file.suffix.lower() in TEXTS and file.stat().st_size <= SMALL]
    for file in [*texts[:LISTED], *files[:1], *files[-1:]]:
        _sample(file, digest)
    return total, digest.hexdigest()


def _sample(path: Path, digest: hashlib._Hash) -> None:
    size = path.stat().st_size
    digest.update(f"{size}\n".encode())
    starts = (
        range(0, size, BLOCK) if size <= BLOCK * BLOCKS else [k * (size - BLOCK) // (BLOCKS - 1) for k in range(BLOCKS)]
    )
    with open_regular(path) as file:
        for start in starts:
            file.seek(start)
            digest.update(file.read(BLOCK))


def _hidden(file: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in file.relative_to(folder).parts)
