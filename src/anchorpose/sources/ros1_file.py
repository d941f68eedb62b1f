"""ROS 1 bags (wiki.ros.org/Bags/Format/2.0), also those of a recorder that was stopped before it wrote the index.

The file is a row of chunks with messages; the index behind them says which chunk holds which connection.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.bag_file import Block, Channel, ChunkedBag, DamagedBag, Message, Wire, read_at_most, unpack

MAGIC: Final = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7  # values of the field "op"


@dataclass(frozen=True, slots=True)
class _Record:
    fields: dict[bytes, bytes]
    data: bytes
    complete: bool

    @property
    def op(self) -> int:
        return self.fields.get(b"op", b"\0")[0]

    def number(self, name: bytes, layout: str = "<I") -> int:
        try:
            return int(struct.unpack(layout, self.fields[name])[0])
        except (KeyError, struct.error) as error:
            raise DamagedBag(f"a record has no {name.decode()}") from error


class Ros1File(ChunkedBag):
    """Raises DamagedBag where not even the beginning can be read."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with open_regular(path) as file:
            file.seek(len(MAGIC))
            head = _read_record(file)
            if head is None or head.op != _BAG:
                raise DamagedBag("its first record is not that of a bag")
            first = file.tell()
            try:
                self._read_index(file, head.number(b"index_pos", "<Q"), first)
            except DamagedBag:
                self._channels, self._counts, self._blocks, self._indexed = {}, None, [], False
                self._scan(file, first)

    def _messages_of(self, file: BinaryIO, wanted: Collection[int]) -> Iterator[Message]:
        chunk = _read_record(file)
        for record in _records_of(chunk):
            if record.op == _MESSAGE and record.number(b"conn") in wanted:
                seconds, nanoseconds = struct.unpack("<II", record.fields.get(b"time", b"").ljust(8, b"\0")[:8])
                channel = self._channels[record.number(b"conn")]
                yield Message(channel, seconds * 1_000_000_000 + nanoseconds, record.data)

    def _read_index(self, file: BinaryIO, position: int, first: int) -> None:
        size = file.seek(0, 2)
        if not first < position <= size:
            raise DamagedBag("it has no index")
        file.seek(position)
        while (record := _read_record(file)) is not None:
            if not record.complete:
                raise DamagedBag("its index is cut off")
            if record.op == _CONNECTION:
                self._add_connection(record)
            elif record.op == _CHUNK_INFO:
                pairs = record.data[: len(record.data) // 8 * 8]
                counts = {int(c): int(n) for c, n in struct.iter_unpack("<II", pairs)}
                self._add_block(record.number(b"chunk_pos", "<Q"), counts)
        self._blocks.sort(key=lambda block: block.position)
        if not self._channels or any(not first <= block.position < position for block in self._blocks):
            raise DamagedBag("its index is damaged")

    def _scan(self, file: BinaryIO, first: int) -> None:
        """Without the index: chunk by chunk until one cannot be told from anything else."""
        file.seek(first)
        while True:
            position = file.tell()
            try:
                record = _read_record(file)
            except DamagedBag:
                return
            if record is None:
                return
            if record.op == _CHUNK:
                self._add_block(position, self._counts_of(record))

    def _counts_of(self, chunk: _Record) -> dict[int, int]:
        counts: dict[int, int] = {}
        try:
            for record in _records_of(chunk):
                if record.op == _CONNECTION:
                    self._add_connection(record)
                elif record.op == _MESSAGE:
                    number = record.number(b"conn")
                    counts[number] = counts.get(number, 0) + 1
        except DamagedBag:
            pass  # counted when its messages are read
        return counts

    def _add_block(self, position: int, counts: dict[int, int]) -> None:
        self._blocks.append(Block(position, frozenset(counts)))
        self._counts = dict(Counter(self._counts) + Counter(counts))

    def _add_connection(self, record: _Record) -> None:
        about = _fields_of(record.data)
        raw = (record.fields.get(b"topic", b""), about.get(b"type", b""), about.get(b"message_definition", b""))
        topic, kind, definition = (text.decode("utf-8", "replace") for text in raw)
        self._channels[record.number(b"conn")] = Channel(topic, kind, Wire.ROS1, definition)


def _records_of(chunk: _Record | None) -> Iterator[_Record]:
    """What a chunk holds; of one that the end of the file cuts off, what is complete."""
    if chunk is None or chunk.op != _CHUNK:
        raise DamagedBag("there is no chunk where the index says so")
    compression = chunk.fields.get(b"compression", b"").decode("ascii", "replace")
    if not chunk.complete and compression != "none":
        raise DamagedBag("a chunk is cut off")
    file = io.BytesIO(unpack(chunk.data, compression, chunk.number(b"size")))
    while (record := _read_record(file)) is not None and record.complete:
        yield record


def _read_record(file: BinaryIO) -> _Record | None:
    """The record at the place of a file, None at its end; one that is cut off is not complete."""
    head = _read_sized(file)
    if head is None:
        return None
    data = _read_sized(file)
    if not head[1] or data is None:
        return _Record({}, b"", False)
    return _Record(_fields_of(head[0]), data[0], data[1])


def _read_sized(file: BinaryIO) -> tuple[bytes, bool] | None:
    """Bytes after their number, and whether all are there; None at the end of the file."""
    length = file.read(4)
    if len(length) < 4:
        return None
    (size,) = struct.unpack("<I", length)
    data = read_at_most(file, size)
    return data, len(data) == size


def _fields_of(header: bytes) -> dict[bytes, bytes]:
    fields, place = {}, 0
    while place + 4 <= len(header):
        (size,) = struct.unpack_from("<I", header, place)
        name, equals, value = header[place + 4 : place + 4 + size].partition(b"=")
        if not equals or place + 4 + size > len(header):
            raise DamagedBag("the header of a record is damaged")
        fields[name] = value
        place += 4 + size
    return fields
