"""Arrays in one piece of bytes, for the page: a short JSON head that says where each array lies, then the arrays."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

MAGIC: Final = b"APV1"
ALIGNED: Final = 8  # bytes: typed arrays of a browser begin at a multiple of their item's size

TYPES: Final = ("uint8", "uint16", "int16", "int32", "uint32", "float32", "float64")


def pack(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """MAGIC, length of the head (uint32), head, arrays; little-endian, each array at a multiple of ``ALIGNED``.

    The head is {"meta": meta, "arrays": [{"name", "type", "shape", "start"}]}; start is counted from the first multiple
    of ``ALIGNED`` after the head. Raises ValueError for types that a browser has no array of.
    """
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    entries, start = [], 0
    for name, array in plain.items():
        if array.dtype.name not in TYPES:
            raise ValueError(f"{name} is {array.dtype.name}, not one of {', '.join(TYPES)}")
        entries.append({"name": name, "type": array.dtype.name, "shape": list(array.shape), "start": start})
        start += _up(array.nbytes)
    head = json.dumps({"meta": meta, "arrays": entries}, allow_nan=False).encode()
    before = len(MAGIC) + 4 + len(head)
    parts = [MAGIC, struct.pack("<I", len(head)), head, bytes(_up(before) - before)]
    for array in plain.values():
        parts += [array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes(), bytes(-array.nbytes % ALIGNED)]
    return b"".join(parts)


def unpack(data: bytes) -> tuple[Any, dict[str, np.ndarray]]:
    """The meta and the arrays of ``pack``; what the page does in JavaScript, here for tests and programs."""
    if data[:4] != MAGIC:
        raise ValueError("these bytes were not packed here")
    (length,) = struct.unpack_from("<I", data, 4)
    head, first = json.loads(data[8 : 8 + length]), _up(8 + length)
    arrays = {}
    for entry in head["arrays"]:
        kind = np.dtype(entry["type"]).newbyteorder("<")
        count = int(np.prod(entry["shape"], dtype=np.int64))
        arrays[entry["name"]] = np.frombuffer(data, kind, count, first + entry["start"]).reshape(entry["shape"])
    return head["meta"], arrays


def _up(place: int) -> int:
    return place + -place % ALIGNED
