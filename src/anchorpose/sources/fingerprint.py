"""Whether an input is the one that a conversion began with, without reading gigabytes."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from anchorpose.recording.regular_file import open_regular

BLOCK: Final = 65536
BLOCKS: Final = 16  # spread over a large file: another recording of the same size differs in its noise everywhere

SMALL: Final = 65536
LISTED: Final = 200
"""Of the small text files of a folder, so many are read whole: a corrected lens changes no size."""

TEXTS: Final = {".json", ".txt", ".csv", ".yaml", ".yml"}


def fingerprint(path: Path) -> tuple[int, str]:
    """Bytes in all, and a SHA-256 of names, sizes and samples of the content; it does not depend on where it lies."""
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
