"""ROS 2 bags in SQLite (rosbag2's ``.db3``), one message a row; RealSense writes the same tables."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

from anchorpose.recording.regular_file import open_regular
from anchorpose.sources.bag_file import BagFile, Channel, DamagedBag, Message, Wire, kind_of, unpack_message

MAGIC: Final = b"SQLite format 3\0"


class Ros2Database(BagFile):
    """Raises DamagedBag where the end is missing, or the list of topics cannot be read."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._unreadable = 0
        self._cut_off = False
        if _is_cut_off(path):
            raise DamagedBag("its end is missing")
        try:
            with closing(self._connect()) as connection:
                for number, topic, kind in connection.execute("SELECT id, name, type FROM topics"):
                    self._channels[int(number)] = Channel(str(topic), kind_of(str(kind)), Wire.CDR)
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            raise DamagedBag("its list of topics cannot be read") from error
        self._count()

    @property
    def notes(self) -> tuple[str, ...]:
        """See ``BagFile``."""
        notes = []
        if self._cut_off:
            notes.append(f"{self._path.name} is damaged; it was read from its beginning as far as that goes.")
        if self._unreadable:
            notes.append(f"{self._unreadable} messages of {self._path.name} are damaged: left out.")
        return tuple(notes)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """See ``BagFile``."""
        wanted, self._unreadable, self._cut_off = self._on(topics), 0, False
        marks = ",".join(str(number) for number in sorted(wanted))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY id"
        try:
            with closing(self._connect()) as connection:
                for number, received_ns, data in connection.execute(query):
                    message = self._message(number, received_ns, data)
                    if message is not None:
                        yield message
        except (sqlite3.Error, OverflowError):
            self._cut_off = True

    def _message(self, number: object, received_ns: object, data: object) -> Message | None:
        if isinstance(number, int) and isinstance(received_ns, int) and isinstance(data, bytes):
            try:
                return Message(self._channels[number], received_ns, unpack_message(data))
            except DamagedBag:
                pass
        self._unreadable += 1
        return None

    def _count(self) -> None:
        try:
            with closing(self._connect()) as connection:
                self._counts = dict(connection.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        except sqlite3.Error:
            self._counts = None

    def _connect(self) -> sqlite3.Connection:
        """Read only: nothing is written beside the file either, unless a recorder left its own journal there."""
        return sqlite3.connect(f"{self._path.resolve().as_uri()}?mode=ro", uri=True)


def _is_cut_off(path: Path) -> bool:
    """Whether the file is shorter than its header says (sqlite.org/fileformat); SQLite would fill up with zeros."""
    with open_regular(path) as file:
        head = file.read(100)
        size = file.seek(0, 2)
    page = int.from_bytes(head[16:18], "big")
    return size < int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page)
