"""What a run has done so far, on disk: a run that was killed goes on from there and ends with the same bytes.

Each pass stores its frames in blocks and, with each block, what the next frame needs. A run always goes on with what it
has just stored and read back, so that one that was killed has the same numbers as one that was not.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, is_there, read_whole
from anchorpose.results.folder import naming_place
from anchorpose.tracker.stored_value import read_value, write_value

Item = TypeVar("Item")

DIGEST: Final = hashlib.blake2b
DIGEST_BYTES: Final = 64


@dataclass(frozen=True, slots=True, eq=False)
class Journal:
    """Values by name in a folder; each file is whole or absent, and checked when it is read.

    Reading runs no code but the program's: see ``stored_value``. shared: objects of the run by name, which a run that
    goes on has made again; they are stored as these names.
    """

    folder: Path
    shared: Mapping[str, object] = field(default_factory=dict)

    def inside(self, name: str) -> Journal:
        """The journal in a folder of this one."""
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        return Journal(folder, self.shared)

    def write(self, name: str, value: object) -> None:
        """Stores a value; it is in memory once more, not several times."""
        stored = io.BytesIO()
        stored.write(bytes(DIGEST_BYTES))
        write_value(stored, value, self.shared)
        with stored.getbuffer() as data:
            data[:DIGEST_BYTES] = DIGEST(data[DIGEST_BYTES:]).digest()
            write_whole(self.folder / name, data)

    def read(self, name: str, kind: Any) -> Any:
        """Reads the value of this name, which is of the type ``kind``.

        Raises KeyError where none is stored, InputError where the file is damaged or holds no such value.
        """
        path = self.folder / name
        if not is_there(path):
            raise KeyError(name)
        data = read_whole(path, LARGEST_ARRAYS, f"remove {path.parent} and give the same command again")
        stored = io.BytesIO(data)
        stored.seek(DIGEST_BYTES)
        try:
            if DIGEST(memoryview(data)[DIGEST_BYTES:]).digest() != data[:DIGEST_BYTES]:
                raise ValueError("has another digest")
            return read_value(stored, kind, self.shared)
        except ValueError as error:
            raise self.damaged(name) from error

    def damaged(self, name: str) -> InputError:
        """The refusal of a value that cannot be used: what is stored with it is made again."""
        return InputError(self.folder / name, "is damaged", f"remove {self.folder} and give the same command again")

    def once(self, name: str, kind: Any, make: Callable[[], Item]) -> Item:
        """Returns the value of this name and of the type ``kind``; makes, stores and reads it where none is stored."""
        try:
            found: Item = self.read(name, kind)
        except KeyError:
            self.write(name, make())
            found = self.read(name, kind)
        return found


class Blocks(Generic[Item]):
    """The frames of one pass in the order of the pass, some of them in each file; those of one file are in memory."""

    def __init__(self, journal: Journal, kind: Any) -> None:
        """kind: the type of what is stored of a frame."""
        self._journal, self._kind = journal, kind

    def has(self, number: int) -> bool:
        """Whether a block is stored."""
        return (self._journal.folder / _block_name(number)).is_file()

    def require(self, count: int) -> None:
        """Raises InputError unless the first ``count`` blocks are stored."""
        for number in range(count):
            if not self.has(number):
                raise self._journal.damaged(_block_name(number))

    def write(self, number: int, items: list[Item]) -> None:
        """Stores a block; what was stored under its number is replaced."""
        self._journal.write(_block_name(number), items)

    def read(self, backward: bool = False) -> Iterator[Item]:
        """All frames, in the order of the pass or against it."""
        for path in sorted(self._journal.folder.glob("*.frames"), reverse=backward):
            items: list[Item] = self._journal.read(path.name, list[self._kind])  # type: ignore[name-defined]
            yield from reversed(items) if backward else items


def _block_name(number: int) -> str:
    return f"{number:06d}.frames"


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Writes a file so that it holds all of ``data`` or what it held before, also after a power cut.

    Raises InputError where the folder is gone, OSError with the folder's name where the disk is full.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        with naming_place(path.parent), partial.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except FileNotFoundError:
        raise InputError(path.parent, "was removed while the run went on", "give the same command again") from None
