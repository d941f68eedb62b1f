"""What the files that hold ROS messages have in common: channels, and the messages on them in the order of the file."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

from anchorpose.errors import MissingPackage
from anchorpose.recording.regular_file import open_regular

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_LARGEST_BYTES: Final = 1 << 30  # of what is unpacked at once: a hundred times a usual chunk; damage can ask for more
_ENDINGS: Final = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")


class Wire(StrEnum):
    """How a message became bytes."""

    ROS1 = "ros1"
    CDR = "cdr"  # of ROS 2


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic of the file.

    kind: the type of its messages as ROS 1 writes it, for example ``sensor_msgs/Image``; definition: its text,
    where a bag of ROS 1 embeds it.
    """

    topic: str
    kind: str
    wire: Wire
    definition: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """The bytes of one message; received_ns: when the recorder got it, by the recorder's clock."""

    channel: Channel
    received_ns: int
    data: bytes


class DamagedBag(Exception):
    """Bytes that cannot be what the format says; the message completes "the file is damaged: ..."."""


class BagFile(ABC):
    """An opened file of messages, with its channels by their number in the file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] | None = None  # messages of each channel, None where only reading all tells

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All that the file has, as far as it can be read; two publishers on a topic are one channel."""
        return tuple(dict.fromkeys(self._channels.values()))

    def count(self, topic: str) -> int | None:
        """How many messages a topic has; None where only reading all of the file tells."""
        return None if self._counts is None else sum(self._counts.get(number, 0) for number in self._on((topic,)))

    @abstractmethod
    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Those of the topics, in the order of the file; what is damaged is left out and becomes a note."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Sentences on what could not be read, complete once all was read."""

    def _on(self, topics: Collection[str]) -> set[int]:
        return {number for number, channel in self._channels.items() if channel.topic in topics}


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a file: where it begins, and which channels it has messages of; None where not known."""

    position: int
    channels: frozenset[int] | None


class ChunkedBag(BagFile):
    """A file of chunks, with or without an index that says where they are and what they hold."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._blocks: list[Block] = []
        self._indexed = True
        self._unreadable = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """See ``BagFile``."""
        notes, name = [], self._path.name
        if not self._indexed:
            notes.append(
                f"{name} has no usable index, as where recording was cut off; it was read from its beginning as far as "
                "that goes."
            )
        if self._unreadable:
            notes.append(f"{self._unreadable} of {len(self._blocks)} chunks of {name} are damaged: left out.")
        return tuple(notes)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """See ``BagFile``."""
        wanted, self._unreadable = self._on(topics), 0
        with open_regular(self._path) as file:
            for block in self._blocks:
                if block.channels is not None and wanted.isdisjoint(block.channels):
                    continue
                try:
                    file.seek(block.position)
                    yield from self._messages_of(file, wanted)
                except DamagedBag:
                    self._unreadable += 1

    @abstractmethod
    def _messages_of(self, file: BinaryIO, wanted: Collection[int]) -> Iterator[Message]:
        """Those of the block at the place of the file. Raises DamagedBag."""


class BagFolder(BagFile):
    """Several files as one, one after the other."""

    def __init__(self, path: Path, files: Sequence[BagFile]) -> None:
        super().__init__(path)
        self._files = files
        self._channels = dict(enumerate(channel for file in files for channel in file.channels))

    @property
    def notes(self) -> tuple[str, ...]:
        """Those of all files."""
        return tuple(note for file in self._files for note in file.notes)

    def count(self, topic: str) -> int | None:
        """Of all files."""
        counts = [file.count(topic) for file in self._files]
        return None if None in counts else sum(count or 0 for count in counts)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """File by file."""
        for file in self._files:
            yield from file.messages(topics)


def files_of(folder: Path) -> tuple[Path, ...]:
    """The bags of a ROS 2 folder in the order of their numbers, which rosbag2 writes without leading zeros."""
    files = (path for path in folder.iterdir() if path.name.endswith(_ENDINGS) and path.is_file())

    def order(path: Path) -> tuple[tuple[int, str], ...]:
        return tuple((int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", path.name))

    return tuple(sorted(files, key=order))


def read_at_most(file: BinaryIO, size: int) -> bytes:
    """The next bytes, fewer at the end of the file; a damaged size does not ask for more memory than the file has."""
    place = file.tell()
    end = file.seek(0, 2)
    file.seek(place)
    return file.read(min(size, end - place))


def kind_of(name: str) -> str:
    """The type's name as ROS 1 writes it: ROS 2 puts ``msg`` in between."""
    return name.replace("/msg/", "/")


def unpack(data: bytes, compression: str, size: int) -> bytes:
    """Raises DamagedBag where the data do not unpack to ``size`` bytes; MissingPackage without the library."""
    if compression in ("", "none"):
        return data
    if not 0 <= size <= _LARGEST_BYTES:
        raise DamagedBag(f"{size} bytes cannot be the size of a chunk")
    unpackers = {"bz2": _unpack_bz2, "lz4": _unpack_lz4, "zstd": _unpack_zstd}
    if compression not in unpackers:
        raise DamagedBag(f"it names a compression {compression[:20]!r} that does not exist")
    try:
        unpacked = unpackers[compression](data, size)
    except MissingPackage:
        raise
    except Exception as error:  # each library has errors of its own, all of which say that the data are damaged
        raise DamagedBag(f"data packed with {compression} do not unpack") from error
    if len(unpacked) != size:
        raise DamagedBag(f"data packed with {compression} are not complete")
    return unpacked


def unpack_message(data: bytes) -> bytes:
    """A message that is perhaps packed with zstd: RealSense and ROS 2 do so without a mark in the message.

    CDR begins with a zero byte, so that the two cannot be confused.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    try:
        unpacked = _unpack_zstd(data, _LARGEST_BYTES)
    except MissingPackage:
        raise
    except Exception as error:
        raise DamagedBag("a message packed with zstd does not unpack") from error
    return unpacked


def _unpack_bz2(data: bytes, size: int) -> bytes:
    import bz2

    return bz2.BZ2Decompressor().decompress(data, max_length=size)


def _unpack_lz4(data: bytes, size: int) -> bytes:
    try:
        import lz4.frame
    except ImportError as error:
        _missing("lz4", error)
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))


def _unpack_zstd(data: bytes, size: int) -> bytes:
    try:
        from backports import zstd
    except ImportError as error:
        _missing("backports.zstd", error)
    return bytes(zstd.ZstdDecompressor().decompress(data, max_length=size))


def _missing(package: str, error: ImportError) -> NoReturn:
    raise MissingPackage("a bag with compressed messages", package, "ros") from error
