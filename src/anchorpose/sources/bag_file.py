"""Read the messages in bags (files of ROS messages) as bytes, by topic. The package rosbags reads ROS 1 bags, and ROS 2
bags in MCAP; Python's sqlite3 reads ROS 2 bags in SQLite.

Of the package rosbags, only the readers of files are used. The package could not decode the messages of RealSense and
Orbbec, because the definitions of these messages in the bag lack fields. A ROS 1 bag that was cut off has no index, so
its chunks are read one after the other. At any other damage, reading stops, and a note names the tool that repairs the
file.
"""

from __future__ import annotations

import errno
import os
import re
import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

from anchorpose.errors import InputError, MissingPackage
from anchorpose.recording.regular_file import open_regular, require_regular

ROS1_MAGIC: Final = b"#ROSBAG V2.0\n"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE_MAGIC: Final = b"SQLite format 3\0"
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
# Maximum size of an unpacked message in bytes, a hundred times the usual size. Messages for which the file states a
# larger size are refused, since a damaged file may state any size.
_LARGEST_BYTES: Final = 1 << 30
_MESSAGE, _CHUNK, _CONNECTION = b"\2", b"\5", b"\7"  # value of the field "op" in each kind of record of ROS 1
_ENDINGS: Final = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")


class DamagedBag(Exception):
    """The error for bytes that contradict the format. Its message completes a sentence that begins with "the bag is
    damaged: ".
    """


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic of a bag: a named series of messages of the same type.

    kind: the type of the topic's messages as ROS 1 writes it, for example ``sensor_msgs/Image``; cdr: whether the
    messages are in the encoding of ROS 2; definition: the text that defines the type, if the file embeds this text.
    """

    topic: str
    kind: str
    cdr: bool
    definition: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """One message as bytes; received_ns: time of receipt in nanoseconds, by the recorder's clock."""

    channel: Channel
    received_ns: int
    data: bytes


class BagFile(ABC):
    """An opened file of messages. repair: advice on how to repair a damaged file of this format. Raises InputError if
    the file cannot be opened, MissingPackage if rosbags is missing.
    """

    repair: str

    def __init__(self, path: Path) -> None:
        require_regular(path)
        self._path = path
        self._damage = ""
        try:
            self._connections = {number: (channel, count) for number, channel, count in self._open()}
        except Exception as error:
            raise InputError(path, f"the bag is damaged: {_damaged(error)}", self.repair) from error

    @property
    def counted_channels(self) -> list[tuple[Channel, int | None]]:
        """Return, for each publisher on a topic, the channel and the number of messages, which is None if the messages
        can be counted only by reading the whole file.
        """
        return list(self._connections.values())

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences on the parts that could not be read; they are complete after everything was read."""
        return (self._damage,) if self._damage else ()

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of the topics in the order of their receipt, up to the first damage in the file."""
        channels, self._damage = {number: channel for number, (channel, _) in self._connections.items()}, ""
        numbers = [number for number, channel in channels.items() if channel.topic in topics]
        try:
            for number, received_ns, data in self._read(numbers) if numbers else ():
                if channels[number].topic in topics:  # topics of a damaged file may share a connection number
                    yield Message(channels[number], received_ns, _unpack(data))
        except Exception as error:
            self._damage = (
                f"{self._path.name} is damaged ({_damaged(error)}), so that what follows is missing: {self.repair}."
            )

    @abstractmethod
    def _open(self) -> list[tuple[int, Channel, int | None]]:
        """Return, for each connection (a publisher on a topic), its number, its channel, and its number of messages,
        None if unknown.
        """

    @abstractmethod
    def _read(self, numbers: Collection[int]) -> Iterable[tuple[int, int, bytes]]:
        """Yield connection number, time of receipt (ns) and bytes of each message of the connections ``numbers``."""


class _RosbagsFile(BagFile):
    """A bag that the package rosbags reads and keeps open."""

    cdr = True

    @abstractmethod
    def _reader(self) -> Any:
        """Return a reader of the package rosbags for this file; the reader is not opened yet."""

    def _open(self) -> list[tuple[int, Channel, int | None]]:
        try:
            self._bag = self._reader()
        except ImportError:
            raise MissingPackage("a bag of ROS messages", "rosbags", "ros") from None
        self._bag.open()
        return [
            (each.id, Channel(each.topic, _kind(each.msgtype), self.cdr, each.msgdef.data), each.msgcount)
            for each in self._bag.connections
        ]

    def _read(self, numbers: Collection[int]) -> Iterable[tuple[int, int, bytes]]:
        wanted = [each for each in self._bag.connections if each.id in numbers]
        return ((each.id, received_ns, data) for each, received_ns, data in self._bag.messages(wanted))


class McapFile(_RosbagsFile):
    """A bag of ROS 2 in MCAP (mcap.dev)."""

    repair = "repair it with 'mcap recover FILE -o NEW', or record again"

    def _reader(self) -> Any:
        from rosbags.rosbag2.storage_mcap import McapReader

        return McapReader(self._path)


class Ros1File(_RosbagsFile):
    """A bag of ROS 1 (wiki.ros.org/Bags/Format/2.0), which is also read if its index is missing."""

    cdr = False
    repair = "repair it with 'rosbag reindex FILE', or record again"

    def _reader(self) -> Any:
        from rosbags.rosbag1 import Reader

        return Reader(self._path)

    def _open(self) -> list[tuple[int, Channel, int | None]]:
        self._indexed = True
        try:
            return super()._open()
        except Exception as error:
            _damaged(error)
            self._indexed = False
            found = {number: data for number, _, data in _scan(self._path) if isinstance(data, Channel)}
            if not found:
                raise
        return [(number, channel, None) for number, channel in found.items()]

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences on the parts that could not be read; they are complete after everything was read."""
        cut = f"{self._path.name} has no usable index, as where recording was cut off; it was read as far as it goes."
        return super().notes if self._indexed else (cut,)

    def _read(self, numbers: Collection[int]) -> Iterable[tuple[int, int, bytes]]:
        if self._indexed:
            return super()._read(numbers)
        scanned = _scan(self._path)
        return ((number, time, data) for number, time, data in scanned if number in numbers and isinstance(data, bytes))


def _scan(path: Path) -> Iterator[tuple[int, int, bytes | Channel]]:
    """Read a ROS 1 bag chunk by chunk, without its index, until a chunk is cut off. Yield (connection number, time in
    ns, bytes) for each message, and (connection number, 0, channel) for each connection.
    """
    from rosbags.rosbag1.reader import Header, decompressors

    with open_regular(path) as bag:
        bag.seek(len(ROS1_MAGIC))
        for chunk, packed in _records(bag):
            if chunk.get("op") != _CHUNK:
                continue
            try:
                content = decompressors[chunk.get_string("compression")](packed)
            except Exception:  # each decompressor has its own errors, which all mean damage
                return
            for header, data in _records(BytesIO(content)):
                if header.get("op") == _CONNECTION:
                    about = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
                    kind, definition = about.get_string("type"), about.get_string("message_definition")
                    channel = Channel(header.get_string("topic"), _kind(kind), False, definition)
                    yield header.get_uint32("conn"), 0, channel
                elif header.get("op") == _MESSAGE:
                    yield header.get_uint32("conn"), header.get_time("time"), data


def _records(file: BinaryIO) -> Iterator[tuple[Any, bytes]]:
    """Yield header and data of the records of a ROS 1 bag until a record is cut off; the data of the last record may be
    incomplete.
    """
    from rosbags.rosbag1.reader import Header, ReaderError, read_uint32

    try:
        while True:
            yield Header.read(file), file.read(read_uint32(file))
    except (ReaderError, UnicodeDecodeError):
        return


class Ros2Database(BagFile):
    """A bag of ROS 2 in SQLite (rosbag2's ``.db3``), one message per row; RealSense writes the same tables."""

    repair = "repair it with 'sqlite3 FILE .recover | sqlite3 NEW', or record again"

    def _open(self) -> list[tuple[int, Channel, int | None]]:
        with open_regular(self._path) as file:
            head, size = file.read(32), file.seek(0, 2)
        page = int.from_bytes(head[16:18], "big")  # page size in bytes (sqlite.org/fileformat); 1 means 65536
        if size < int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page):
            raise DamagedBag("its end is missing")  # SQLite would read the missing bytes as zeros
        topics = "SELECT id, name, type, (SELECT COUNT(*) FROM messages WHERE topic_id = topics.id) FROM topics"
        with closing(self._connect()) as connection:
            return [
                (int(number), Channel(str(topic), _kind(str(kind)), True), int(count))
                for number, topic, kind, count in connection.execute(topics)
            ]

    def _read(self, numbers: Collection[int]) -> Iterable[tuple[int, int, bytes]]:
        marks = ",".join(str(number) for number in numbers)
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY id"
        with closing(self._connect()) as connection:
            for number, received_ns, data in connection.execute(query):
                yield number, int(received_ns), bytes(data)

    def _connect(self) -> sqlite3.Connection:
        """Open the database read only. SQLite writes no files beside the database either, unless a recorder left a
        journal there.
        """
        return sqlite3.connect(f"{self._path.resolve().as_uri()}?mode=ro", uri=True)


class Bag:
    """One file, or several files of one recording that are read in sequence as one file."""

    def __init__(self, files: Sequence[BagFile]) -> None:
        self._files = files

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Return all topics, one channel per topic, even if several publishers use the topic."""
        return tuple(dict.fromkeys(channel for file in self._files for channel, _ in file.counted_channels))

    @property
    def notes(self) -> tuple[str, ...]:
        """Return the notes of all files."""
        return tuple(note for file in self._files for note in file.notes)

    def count(self, topic: str) -> int | None:
        """Return the number of messages of a topic in all files; None if counting requires reading a whole file."""
        counts = [count for file in self._files for channel, count in file.counted_channels if channel.topic == topic]
        return None if None in counts else sum(count or 0 for count in counts)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of the topics, file by file."""
        for file in self._files:
            yield from file.messages(topics)


def open_bag(path: Path) -> Bag:
    """Open a bag, or a folder of ROS 2 with several bags; raises InputError if a bag cannot be opened, MissingPackage
    if the package that reads it is missing.
    """
    return Bag([_open_file(file) for file in (files_of(path) if path.is_dir() else (path,))])


def _open_file(path: Path) -> BagFile:
    with open_regular(path) as file:
        head = file.read(16)
    kinds: dict[bytes, Callable[[Path], BagFile]] = {
        ROS1_MAGIC: Ros1File,
        MCAP_MAGIC: McapFile,
        SQLITE_MAGIC: Ros2Database,
    }
    for magic, kind in kinds.items():
        if head.startswith(magic):
            return kind(path)
    if head.startswith(_ZSTD_MAGIC):
        raise InputError(path, "it is packed as a whole", "unpack it first: zstd -d FILE")
    raise InputError(path, "is not a bag", "copy it again from where it was recorded")


def files_of(folder: Path) -> tuple[Path, ...]:
    """Return the bags of a ROS 2 folder, sorted by the numbers in their names, which have no leading zeros."""
    files = (path for path in folder.iterdir() if path.name.endswith(_ENDINGS) and path.is_file())

    def order(path: Path) -> tuple[tuple[int, str], ...]:
        return tuple((int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", path.name))

    return tuple(sorted(files, key=order))


def _kind(name: str) -> str:
    """Return the type's name as ROS 1 writes it, without the ``msg`` that ROS 2 inserts (``sensor_msgs/msg/Image``)."""
    return name.replace("/msg/", "/")


def _damaged(error: Exception) -> DamagedBag:
    """Convert a library's error to DamagedBag; an error of the disk or a MissingPackage is raised again."""
    if isinstance(error, DamagedBag):
        return error
    # some errors of the type OSError mean damage of the bag, not of the disk: a damaged bz2 stream raises OSError
    # without errno, and a position outside the file raises OSError with EINVAL
    of_the_disk = isinstance(error, OSError) and error.errno not in (None, errno.EINVAL)
    if isinstance(error, sqlite3.Error) and getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_IOERR_READ:
        raise OSError(errno.EIO, os.strerror(errno.EIO)) from error
    if of_the_disk or isinstance(error, MissingPackage):
        raise error
    return DamagedBag((str(error).splitlines() or [""])[0][:100].rstrip(".") or type(error).__name__)


def _unpack(data: bytes) -> bytes:
    """Unpack a message if it is packed with zstd. RealSense and ROS 2 may pack messages without stating this in the
    message.

    An unpacked message in CDR begins with a zero byte, so it cannot be mistaken for a packed message.
    """
    if not data.startswith(_ZSTD_MAGIC):
        return data
    try:
        from backports import zstd
    except ImportError:
        raise MissingPackage("a bag with compressed messages", "backports.zstd", "ros") from None
    try:
        return bytes(zstd.ZstdDecompressor().decompress(data, max_length=_LARGEST_BYTES))
    except zstd.ZstdError:
        return b""  # an empty message counts as damaged when its fields are read
