"""Store the frames of a run while it runs, in blocks that are checked on reading, so that a killed run can continue.

Reading a file never runs code from this file: the class of an object follows from the type annotation of the attribute
that holds the object. So every stored class declares its attributes, as dataclasses and named tuples do. A value is
stored as a JSON tree. Null, booleans, numbers and texts are stored as they are, a member of an enumeration as its
value, and a container as a list. Any other value is a JSON object with one key:

- ``{"Pose": {"root_m": ...}}`` is an object of the class Pose;
- ``{"again": 3}`` refers to an object that occurs earlier in this value: the fourth object (number 3);
- ``{"shared": "run"}`` is an object that is not stored, since the reader already has it under the name ``run``;
- ``{"array": 5}`` is the sixth of the arrays that are stored after the JSON tree; the keys ``number`` and ``bytes``
  mark a numpy scalar and bytes.

An object or array that occurs twice in a value is also a single object or array after reading. A container that occurs
twice becomes two containers.

Each file has a digest (checksum) of its content and its name, so that a renamed file is refused. Each pass stores its
frames in blocks and, with each block, the state that the next frame needs. Even in an uninterrupted run, each block of
frames continues from the stored state, read back from its file, so that a resumed run has exactly the same results.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache
from io import BytesIO
from itertools import repeat
from pathlib import Path
from types import UnionType
from typing import Any, Final, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import parse_json
from anchorpose.recording.regular_file import LARGEST_ARRAYS, is_there, read_whole
from anchorpose.results.folder import naming_place

NUMBERS: Final = "biuf"  # allowed kinds of a stored array's dtype: boolean, integers, floats
ALSO: Final = {float: (int, np.floating, np.integer), int: (np.integer,), bool: (np.bool_,)}
"""Types that a stored value may have besides the declared type of its field. Type checkers accept values of these types
for such a field, too.
"""


def write_value(stream: BytesIO, value: object, shared: Mapping[str, object]) -> None:
    """Write a value at the end of ``stream``. shared: objects by name; only their names are stored."""
    writer = _Writer(shared)
    tree = np.frombuffer(json.dumps(writer.node(value), separators=(",", ":")).encode(), np.uint8)
    for array in (tree, *writer.arrays):
        np.lib.format.write_array(stream, array, allow_pickle=False)


def read_value(stream: BytesIO, kind: Any, shared: Mapping[str, object]) -> Any:
    """Read a value of the type ``kind`` that ``write_value`` wrote, from the present position to the end of ``stream``.

    Raises ValueError if the content is not a value of this type.
    """
    try:
        tree, *arrays = _read_arrays(stream)
        return _Reader(arrays, shared).value(parse_json(tree.tobytes()), kind)
    except Exception as error:  # json, numpy and malformed trees raise errors of many kinds
        raise ValueError(f"holds no value of the type {kind} ({error!r})") from error


def _read_arrays(stream: BytesIO) -> list[np.ndarray]:
    arrays, end = list[np.ndarray](), stream.getbuffer().nbytes
    while stream.tell() < end:
        array = np.lib.format.read_array(stream, allow_pickle=False)
        if array.dtype.kind not in NUMBERS:
            raise ValueError(f"has an array of {array.dtype}")
        arrays.append(array)
    return arrays


class _Writer:
    def __init__(self, shared: Mapping[str, object]) -> None:
        self.arrays: list[np.ndarray] = []
        self._known: dict[int, dict[str, Any]] = {id(value): {"shared": name} for name, value in shared.items()}
        self._objects = 0

    def node(self, value: Any) -> Any:
        """Return the node of the JSON tree that stands for a value."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, Enum):
            return value.value  # a field that is declared as a number or text may hold a member of an enumeration
        if isinstance(value, dict):
            return [[self.node(key), self.node(item)] for key, item in value.items()]
        if isinstance(value, deque):
            return [value.maxlen, *map(self.node, value)]
        if isinstance(value, tuple | list | set | frozenset):
            return [self.node(item) for item in value]
        if isinstance(value, bytes):
            return self._array("bytes", np.frombuffer(value, np.uint8))
        if isinstance(value, np.generic):
            return self._array("number", np.asarray(value))
        if id(value) not in self._known:
            return self._array("array", value) if isinstance(value, np.ndarray) else self._object(value)
        return self._known[id(value)]  # the value was stored before, or it is one of the shared objects

    def _array(self, word: str, array: np.ndarray) -> dict[str, Any]:
        self._known[id(array)] = node = {word: len(self.arrays)}
        self.arrays.append(array)
        return node

    def _object(self, value: Any) -> dict[str, Any]:
        self._known[id(value)] = {"again": self._objects}
        self._objects += 1
        if is_dataclass(value):
            state = {field.name: getattr(value, field.name) for field in fields(value)}
        else:
            state = value.__getstate__()
        return {type(value).__name__: {name: self.node(item) for name, item in state.items()}}


class _Reader:
    def __init__(self, arrays: list[np.ndarray], shared: Mapping[str, object]) -> None:
        self._arrays, self._shared = arrays, shared
        self._objects: list[object] = []

    def value(self, node: Any, kind: Any) -> Any:
        """Return the value for which a node of the JSON tree stands; the value's type is ``kind`` or, if ``kind`` is a
        union, one of the union's types.
        """
        kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
        if isinstance(node, dict):
            found = self._named(node, kinds)
        elif isinstance(node, list):
            found = self._container(node, kinds)
        else:
            found = next((each(node) for each in kinds if node is not None and _is(each, Enum)), node)
        classes = tuple(get_origin(each) or each for each in kinds)
        if not isinstance(found, classes + sum((ALSO.get(each, ()) for each in classes), ())):
            raise ValueError(f"has a {type(found).__name__} in place of {kind}")
        if isinstance(found, bool) and bool not in classes:
            raise ValueError(f"has a truth value in place of {kind}")
        return found

    def _named(self, node: dict[str, Any], kinds: tuple[Any, ...]) -> Any:
        ((word, item),) = node.items()
        if word == "shared":
            return self._shared[item]
        if word == "again":
            return self._objects[item]
        if word == "array":
            return self._arrays[item]
        if word == "number":
            return self._arrays[item][()]
        if word == "bytes":
            return self._arrays[item].tobytes()
        return self._object(item, next(each for each in kinds if _is(each, object) and each.__name__ == word))

    def _object(self, node: dict[str, Any], kind: type) -> object:
        declared = _declared(kind)
        if not declared or declared.keys() != node.keys():
            raise ValueError(f"has a {kind.__name__} with the attributes {list(node)}")
        made: object = object.__new__(kind)
        self._objects.append(made)
        for name, item in node.items():
            object.__setattr__(made, name, self.value(item, declared[name]))
        return made

    def _container(self, node: list[Any], kinds: tuple[Any, ...]) -> Any:
        kind = next(each for each in kinds if _is(get_origin(each) or each, (tuple, list, dict, set, frozenset, deque)))
        make, of = get_origin(kind) or kind, get_args(kind)
        if make is deque:
            return deque(self._items(node[1:], repeat(of[0])), self.value(node[0], int | None))
        if make is dict:
            return {self.value(key, of[0]): self.value(item, of[1]) for key, item in node}
        if make is tuple and of[-1] is not ...:
            return tuple(self._items(node, of))
        if _declared(make):  # the class is a named tuple
            return make(*self._items(node, _declared(make).values()))
        return make(self._items(node, repeat(of[0])))

    def _items(self, node: list[Any], kinds: Iterable[Any]) -> list[Any]:
        """Return the values of the nodes in a list. kinds: the types of these values, one per node, or one type
        repeated without end.
        """
        return [self.value(item, kind) for item, kind in zip(node, kinds, strict=not isinstance(kinds, repeat))]


def _is(kind: Any, base: type | tuple[type, ...]) -> bool:
    return isinstance(kind, type) and issubclass(kind, base)


@cache
def _declared(kind: type) -> dict[str, Any]:
    """Return the types of a class's attributes by name."""
    return get_type_hints(kind)


Item = TypeVar("Item")

DIGEST: Final = hashlib.blake2b
DIGEST_BYTES: Final = 64
COUNT: Final = "count"


@dataclass(frozen=True, slots=True, eq=False)
class Journal:
    """A folder with one file for each stored value; the file's name is the value's name. Each file is either complete
    or absent, and is checked when it is read.

    Reading runs no code from the file. shared: objects of the run by name; a resumed run creates them again, so only
    their names are stored.
    """

    folder: Path
    shared: Mapping[str, object] = field(default_factory=dict)

    def inside(self, name: str) -> Journal:
        """Return the journal in a subfolder of this journal's folder; the subfolder is made if it is missing."""
        folder = self.folder / name
        try:
            folder.mkdir(exist_ok=True)
        except FileExistsError:
            raise self.damaged(name) from None
        return Journal(folder, self.shared)

    def require_whole(self, other: Collection[str] = ()) -> None:
        """Check all stored values, also in subfolders. other: names of files in this folder that ``write`` did not
        store, and that are skipped.

        Raises InputError if a file is damaged or was stored under another name.
        """
        for path in sorted(self.folder.rglob("*")):
            place = path.relative_to(self.folder)
            is_pass = path.is_dir() and len(place.parts) == 1
            is_cut_off = ".partial" in path.name and path.is_file()
            if place.parts[0] not in other and not is_pass and not is_cut_off:
                Journal(path.parent)._stored(path.name)

    def write(self, name: str, value: object) -> None:
        """Store a value in the file ``name``. The file's content is not copied in memory, since it may be large."""
        stored = io.BytesIO()
        stored.write(bytes(DIGEST_BYTES))
        write_value(stored, value, self.shared)
        with stored.getbuffer() as data:
            data[:DIGEST_BYTES] = self._digest(name, data[DIGEST_BYTES:])
            write_whole(self.folder / name, data)

    def read(self, name: str, kind: Any) -> Any:
        """Read the stored value with this name; ``kind`` is the type of the value.

        Raises KeyError if no value of this name is stored, InputError if the file is damaged or the value has another
        type.
        """
        path = self.folder / name
        if not is_there(path):
            raise KeyError(name)
        stored = io.BytesIO(self._stored(name))
        stored.seek(DIGEST_BYTES)
        try:
            return read_value(stored, kind, self.shared)
        except ValueError as error:
            raise self.damaged(name) from error

    def _stored(self, name: str) -> bytes:
        """Return the content of a file; raises InputError if it is damaged or was stored under another name."""
        data = read_whole(self.folder / name, LARGEST_ARRAYS, self._remedy)
        if self._digest(name, memoryview(data)[DIGEST_BYTES:]) != data[:DIGEST_BYTES]:
            raise self.damaged(name)
        return data

    def _digest(self, name: str, data: memoryview) -> bytes:
        """Return the digest of a file's content and name, so that a file copied to another name is refused."""
        digest = DIGEST(f"{self.folder.name}/{name}\n".encode())
        digest.update(data)
        return digest.digest()

    @property
    def _remedy(self) -> str:
        return f"remove {self.folder} and give the same command again"

    def damaged(self, name: str) -> InputError:
        """Return the error for a damaged file; its remedy is to compute everything in the file's folder again."""
        return InputError(self.folder / name, "is damaged", self._remedy)

    def once(self, name: str, kind: Any, make: Callable[[], Item]) -> Item:
        """Return the stored value with the name ``name`` and the type ``kind``. If no value of this name is stored yet,
        ``make`` computes the value, which is then stored and read again.
        """
        try:
            found: Item = self.read(name, kind)
        except KeyError:
            self.write(name, make())
            found = self.read(name, kind)
        return found


class Blocks(Generic[Item]):
    """The frames of one pass, in order. A file (block) holds several frames, and only the frames of a single file are
    in memory at a time.
    """

    def __init__(self, journal: Journal, kind: Any) -> None:
        """Use ``kind`` as the type of a stored frame."""
        self._journal, self._kind = journal, kind

    def has(self, number: int) -> bool:
        """Return whether the block with this number is stored."""
        return (self._journal.folder / _block_name(number)).is_file()

    def require(self, count: int) -> None:
        """Raise InputError unless the first ``count`` blocks are stored."""
        for number in range(count):
            if not self.has(number):
                raise self._journal.damaged(_block_name(number))

    def write(self, number: int, items: list[Item]) -> None:
        """Store a block; it replaces an earlier block with this number."""
        self._journal.write(_block_name(number), items)

    def write_count(self, count: int) -> None:
        """Store the number of blocks, so that a loss of the last block is noticed. Call this method unless the number
        of blocks is stored elsewhere.
        """
        self._journal.write(COUNT, count)

    def _count(self) -> int:
        try:
            return int(self._journal.read(COUNT, int))
        except KeyError:
            return 0

    def read(self, backward: bool = False) -> Iterator[Item]:
        """Yield all frames, in the order of the pass or in reverse; raises InputError if a block is missing."""
        paths = sorted(self._journal.folder.glob("*.frames"), reverse=backward)
        self.require(max(len(paths), self._count()))
        for path in paths:
            items: list[Item] = self._journal.read(path.name, list[self._kind])  # type: ignore[name-defined]
            yield from reversed(items) if backward else items


def _block_name(number: int) -> str:
    return f"{number:06d}.frames"


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Write a file so that it holds either all of ``data`` or its earlier content, even after a power cut.

    Raises InputError if the folder was removed, OSError with the folder's name if the disk is full.
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
