"""MCAP files (mcap.dev/spec), also those of a recorder that was stopped before it wrote the summary.

The file is a row of records: chunks with messages, or messages alone. The summary behind them says what each chunk
holds.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from anchorpose.sources.bag_file import (
    Channel,
    DamagedBag,
    Message,
    Wire,
    kind_of,
    read_at_most,
    reading_notes,
    unpack,
    unpack_message,
)

MAGIC: Final = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
_FOOTER_BYTES: Final = 37  # operation, length, three numbers, magic
_WIRES: Final = {"cdr": Wire.CDR, "ros1": Wire.ROS1}


@dataclass(frozen=True, slots=True)
class _Block:
    """A chunk, or a message outside of chunks: where it begins, and which channels it has; None where not known."""

    position: int
    channels: frozenset[int] | None


class _Fields:
    """Values one after the other; raises DamagedBag at the end."""

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, 0

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def take(self, size: int) -> bytes:
        if size > len(self._data) - self._place:
            raise DamagedBag("a record is shorter than what it holds")
        self._place += size
        return self._data[self._place - size : self._place]

    def text(self) -> str:
        return self.take(self.number(4)).decode("utf-8", "replace")

    def rest(self) -> bytes:
        return self._data[self._place :]


class McapFile:
    """Raises DamagedBag where not even the beginning can be read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kinds: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._blocks: list[_Block] = []
        self._counts: dict[int, int] = {}
        self._indexed = True
        self._unreadable = 0
        with path.open("rb") as file:
            try:
                self._read_summary(file)
            except DamagedBag:
                self._indexed = False
            if not self._indexed or not self._blocks:
                self._blocks, self._counts = [], {}
                self._scan(file)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """See ``BagFile``; two publishers on a topic are one channel."""
        return tuple(dict.fromkeys(self._channels.values()))

    @property
    def notes(self) -> tuple[str, ...]:
        """See ``BagFile``."""
        return reading_notes(self._path.name, self._indexed, self._unreadable, len(self._blocks))

    def count(self, topic: str) -> int | None:
        """See ``BagFile``."""
        return sum(self._counts.get(number, 0) for number in self._on((topic,))) if self._counts else None

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """See ``BagFile``."""
        wanted, self._unreadable = self._on(topics), 0
        with self._path.open("rb") as file:
            for block in self._blocks:
                if block.channels is not None and wanted.isdisjoint(block.channels):
                    continue
                try:
                    file.seek(block.position)
                    yield from self._messages_of(_read_record(file), wanted)
                except DamagedBag:
                    self._unreadable += 1

    def _on(self, topics: Collection[str]) -> set[int]:
        return {number for number, channel in self._channels.items() if channel.topic in topics}

    def _messages_of(self, record: tuple[int, bytes] | None, wanted: set[int]) -> Iterator[Message]:
        if record is None:
            raise DamagedBag("a chunk is cut off")
        for operation, data in _records_of(*record):
            if operation != _MESSAGE:
                continue
            fields = _Fields(data)
            number = fields.number(2)
            if number in wanted:
                fields.take(4)  # the number of the message
                received_ns = fields.number(8)
                fields.take(8)  # when it was sent
                yield Message(self._channels[number], received_ns, unpack_message(fields.rest()))

    def _read_summary(self, file: BinaryIO) -> None:
        end = file.seek(0, 2) - _FOOTER_BYTES
        file.seek(max(end, 0))
        footer = file.read()
        if end < 0 or footer[0] != _FOOTER or not footer.endswith(MAGIC):
            raise DamagedBag("its end is missing")
        start = int.from_bytes(footer[9:17], "little")
        if not 0 <= start <= end:
            raise DamagedBag("its summary is damaged")
        file.seek(start or end)
        while file.tell() < end and (record := _read_record(file)) is not None:
            self._read_summary_record(*record)
        if not self._channels or any(block.position > end for block in self._blocks):
            raise DamagedBag("its summary is damaged")

    def _read_summary_record(self, operation: int, data: bytes) -> None:
        fields = _Fields(data)
        if operation == _CHUNK_INDEX:
            fields.take(16)
            position = fields.number(8)
            fields.take(8)
            offsets = _Fields(fields.take(fields.number(4))).rest()
            channels = frozenset(int(c) for c, _ in struct.iter_unpack("<HQ", offsets[: len(offsets) // 10 * 10]))
            self._blocks.append(_Block(position, channels or None))
        elif operation == _STATISTICS:
            fields.take(42)
            counts = fields.take(fields.number(4))
            self._counts = {int(c): int(n) for c, n in struct.iter_unpack("<HQ", counts[: len(counts) // 10 * 10])}
        else:
            self._add(operation, data)

    def _scan(self, file: BinaryIO) -> None:
        """Without the summary: record by record until one is cut off."""
        file.seek(len(MAGIC))
        while True:
            position = file.tell()
            try:
                record = _read_record(file)
                if record is None or record[0] == _DATA_END:
                    return
                if record[0] in (_CHUNK, _MESSAGE):
                    self._blocks.append(_Block(position, self._channels_of(*record)))
                else:
                    self._add(*record)
            except DamagedBag:
                return

    def _channels_of(self, operation: int, data: bytes) -> frozenset[int] | None:
        found = set()
        try:
            for inner, inner_data in _records_of(operation, data):
                if inner == _MESSAGE:
                    found.add(_Fields(inner_data).number(2))
                else:
                    self._add(inner, inner_data)
        except DamagedBag:
            return None  # counted when its messages are read
        return frozenset(found)

    def _add(self, operation: int, data: bytes) -> None:
        fields = _Fields(data)
        if operation == _SCHEMA:
            number = fields.number(2)
            self._kinds[number] = kind_of(fields.text())
        elif operation == _CHANNEL:
            number, kind = fields.number(2), self._kinds.get(fields.number(2), "")
            topic, wire = fields.text(), _WIRES.get(fields.text())
            if wire is not None:  # others are not of ROS
                self._channels[number] = Channel(topic, kind, wire)


def _records_of(operation: int, data: bytes) -> Iterator[tuple[int, bytes]]:
    """A record that is not a chunk itself; what a chunk holds, once its checksum is right."""
    if operation != _CHUNK:
        yield operation, data
        return
    fields = _Fields(data)
    fields.take(16)
    size, checksum, compression = fields.number(8), fields.number(4), fields.text()
    content = unpack(fields.take(fields.number(8)), compression, size)
    if checksum and zlib.crc32(content) != checksum:
        raise DamagedBag("the checksum of a chunk is wrong")
    file = io.BytesIO(content)
    while (record := _read_record(file)) is not None:
        yield record


def _read_record(file: BinaryIO) -> tuple[int, bytes] | None:
    """Operation and content of the record at the place of a file; None at its end or where it is cut off."""
    head = file.read(9)
    if len(head) < 9:
        return None
    size = int.from_bytes(head[1:], "little")
    data = read_at_most(file, size)
    return (head[0], data) if len(data) == size else None
