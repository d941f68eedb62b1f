"""What a run has done so far, on disk: a run that was killed goes on from there and ends with the same bytes.

Each pass stores its frames in blocks and, with each block, what the next frame needs. A run always goes on with what it
has just stored and read back, so that one that was killed has the same numbers as one that was not.
"""

from __future__ import annotations

import hashlib
import io
import os
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, is_there, read_whole

Item = TypeVar("Item")

DIGEST: Final = hashlib.blake2b
DIGEST_BYTES: Final = 64

SAFE_NAMES: Final = frozenset(
    {
        "builtins.object",
        "builtins.range",
        "builtins.set",
        "builtins.frozenset",
        "builtins.slice",
        "collections.deque",
        "copyreg._reconstructor",
        "numpy.dtype",
        "numpy.ndarray",
        "numpy._core.multiarray._reconstruct",
        "numpy._core.multiarray.scalar",
        "numpy._core.numeric._frombuffer",
    }
)
"""What a stored value may consist of besides the classes of this package: reading runs no other code."""


@dataclass(frozen=True, slots=True, eq=False)
class Journal:
    """Values by name in a folder; each file is whole or absent, and checked when it is read.

    shared: objects of the run by name, which a run that goes on has made again; they are stored as these names.
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
        _Pickler(stored, self.shared).dump(value)
        with stored.getbuffer() as data:
            data[:DIGEST_BYTES] = DIGEST(data[DIGEST_BYTES:]).digest()
            write_whole(self.folder / name, data)

    def read(self, name: str) -> Any:
        """The value of this name; raises KeyError where none is stored, InputError where the file is damaged."""
        path = self.folder / name
        if not is_there(path):
            raise KeyError(name)
        data = read_whole(path, LARGEST_ARRAYS, "begin the run again, with --overwrite")
        if DIGEST(memoryview(data)[DIGEST_BYTES:]).digest() != data[:DIGEST_BYTES]:
            raise InputError(path, "is damaged", "begin the run again, with --overwrite")
        stored = io.BytesIO(data)
        stored.seek(DIGEST_BYTES)
        return _Unpickler(stored, self.shared).load()

    def once(self, name: str, make: Callable[[], Item]) -> Item:
        """What is stored under this name; made, stored and read back where nothing is."""
        try:
            found: Item = self.read(name)
        except KeyError:
            self.write(name, make())
            found = self.read(name)
        return found


class Blocks(Generic[Item]):
    """The frames of one pass in the order of the pass, some of them in each file; those of one file are in memory."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def has(self, number: int) -> bool:
        """Whether a block is stored."""
        return (self._journal.folder / _block_name(number)).is_file()

    def write(self, number: int, items: list[Item]) -> None:
        """Stores a block; what was stored under its number is replaced."""
        self._journal.write(_block_name(number), items)

    def read(self, backward: bool = False) -> Iterator[Item]:
        """All frames, in the order of the pass or against it."""
        for path in sorted(self._journal.folder.glob("*.frames"), reverse=backward):
            items: list[Item] = self._journal.read(path.name)
            yield from reversed(items) if backward else items


def _block_name(number: int) -> str:
    return f"{number:06d}.frames"


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Writes a file so that it holds all of ``data`` or what it held before, also after a power cut.

    Raises InputError where the folder is gone or the disk is full.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except FileNotFoundError:
        raise InputError(path.parent, "was removed while the run went on", "begin the run again") from None
    except OSError as error:
        remedy = "make room and give the same command with --resume"
        raise InputError(path.parent, f"cannot be written to ({error.strerror})", remedy) from None


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: Mapping[str, object]) -> None:
        super().__init__(file, protocol=5)
        self._names = {id(value): name for name, value in shared.items()}

    def persistent_id(self, obj: object) -> str | None:
        """The name of a shared object."""
        return self._names.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Mapping[str, object]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: Any) -> object:
        """The shared object of a name."""
        if pid not in self._shared:
            raise pickle.UnpicklingError(f"no object is shared as {pid}")
        return self._shared[pid]

    def find_class(self, module: str, name: str) -> Any:
        """Classes of this package and of arrays only."""
        if f"{module}.{name}" in SAFE_NAMES:
            return super().find_class(module, name)
        if module.startswith("anchorpose."):
            found = super().find_class(module, name)
            if isinstance(found, type):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} does not belong in a journal")
