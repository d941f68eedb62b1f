"""What the files that hold ROS messages have in common: channels, and the messages on them in the order of the file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import BinaryIO, Final, NoReturn, Protocol

from anchorpose.errors import MissingPackage

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_LARGEST_BYTES: Final = 1 << 30  # of what is unpacked at once: a hundred times a usual chunk; damage can ask for more


class Wire(StrEnum):
    """How a message became bytes."""

    ROS1 = "ros1"
    CDR = "cdr"  # of ROS 2


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic of the file; kind: the type of its messages as ROS 1 writes it, for example ``sensor_msgs/Image``."""

    topic: str
    kind: str
    wire: Wire


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """The bytes of one message; received_ns: when the recorder got it, by the recorder's clock."""

    channel: Channel
    received_ns: int
    data: bytes


class DamagedBag(Exception):
    """Bytes that cannot be what the format says; the message completes "the file is damaged: ..."."""


class BagFile(Protocol):
    """An opened file of messages."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All that the file has, as far as it can be read."""
        ...

    def count(self, topic: str) -> int | None:
        """How many messages a topic has; None where only reading all of the file tells."""
        ...

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Those of the topics, in the order of the file; what is damaged is left out and becomes a note."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what could not be read, complete once all was read."""
        ...


def read_at_most(file: BinaryIO, size: int) -> bytes:
    """The next bytes, fewer at the end of the file; a damaged size does not ask for more memory than the file has."""
    place = file.tell()
    end = file.seek(0, 2)
    file.seek(place)
    return file.read(min(size, end - place))


def reading_notes(name: str, indexed: bool, unreadable: int, chunks: int) -> tuple[str, ...]:
    """Sentences on a file of chunks without a usable index, or with chunks that could not be read."""
    notes = []
    if not indexed:
        notes.append(
            f"{name} has no usable index, as where recording was cut off; it was read from its beginning as far as "
            "that goes."
        )
    if unreadable:
        notes.append(f"{unreadable} of {chunks} chunks of {name} are damaged: left out.")
    return tuple(notes)


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
