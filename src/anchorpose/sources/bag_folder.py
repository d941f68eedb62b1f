"""A folder of ROS 2: its bag in one file, or in several one after the other."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Final

from anchorpose.sources.bag_file import BagFile, Channel, Message

_ENDINGS: Final = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")


def files_of(folder: Path) -> tuple[Path, ...]:
    """The bags of a folder in the order of their numbers, which rosbag2 writes without leading zeros."""
    files = (path for path in folder.iterdir() if path.name.endswith(_ENDINGS) and path.is_file())

    def order(path: Path) -> tuple[tuple[int, str], ...]:
        return tuple((int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", path.name))

    return tuple(sorted(files, key=order))


class BagFolder:
    """Several files as one; see ``BagFile``."""

    def __init__(self, files: Sequence[BagFile]) -> None:
        self._files = files

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Those of all files."""
        return tuple(dict.fromkeys(channel for file in self._files for channel in file.channels))

    @property
    def notes(self) -> tuple[str, ...]:
        """Those of all files."""
        return tuple(note for file in self._files for note in file.notes)

    def count(self, topic: str) -> int | None:
        """Of all files."""
        total = 0
        for file in self._files:
            count = file.count(topic)
            if count is None:
                return None
            total += count
        return total

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """File by file."""
        for file in self._files:
            yield from file.messages(topics)
