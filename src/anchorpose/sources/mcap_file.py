"""MCAP files (mcap.dev/spec), also those of a recorder that was stopped before it wrote the summary.

The file is a row of records: chunks with messages, or messages alone. The summary behind them says what each chunk
holds.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, Final

from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.bag_file import (
    Block,
    Channel,
    ChunkedBag,
    DamagedBag,
    Message,
    Wire,
    kind_of,
    read_at_most,
    unpack,
    unpack_message,
)

MAGIC: Final = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
_FOOTER_BYTES: Final = 37  # operation, length, three numbers, magic
_WIRES: Final = {"cdr": Wire.CDR, "ros1": Wire.ROS1}


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


class McapFile(ChunkedBag):
    """Raises DamagedBag where not even the beginning can be read."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._kinds: dict[int, str] = {}
        with open_regular(path) as file:
            try:
                self._read_summary(file)
            except DamagedBag:
                self._indexed = False
            if not self._indexed or not self._blocks:
                self._blocks, self._counts = [], None
                self._scan(file)

    def _messages_of(self, file: BinaryIO, wanted: Collection[int]) -> Iterator[Message]:
        record = _read_record(file)
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
            self._blocks.append(Block(position, channels or None))
        elif operation == _STATISTICS:
            fields.take(42)
            counts = fields.take(fields.number(4))
            pairs = struct.iter_unpack("<HQ", counts[: len(counts) // 10 * 10])
            self._counts = {int(c): int(n) for c, n in pairs} or None
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
                    self._blocks.append(Block(position, self._channels_of(*record)))
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
