"""A small writer of XDF 1.0, for files that the tests read: https://github.com/sccn/xdf/wiki/Specifications."""

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np


def _chunk(tag: int, content: bytes) -> bytes:
    size = len(content) + 2
    return b"\x04" + struct.pack("<I", size) + struct.pack("<H", tag) + content


def _length(count: int) -> bytes:
    return b"\x04" + struct.pack("<I", count)


def _header(number: int, name: str, kind: str, form: str, rate_hz: float, labels: Sequence[str]) -> bytes:
    channels = "".join(f"<channel><label>{label}</label></channel>" for label in labels)
    text = (
        f"<?xml version='1.0'?><info><name>{name}</name><type>{kind}</type><channel_count>{len(labels)}</channel_count>"
        f"<nominal_srate>{rate_hz:g}</nominal_srate><channel_format>{form}</channel_format><source_id>{name}</source_id>"
        f"<desc><channels>{channels}</channels></desc></info>"
    )
    return _chunk(2, struct.pack("<I", number) + text.encode())


def _samples(number: int, rows: Iterable[tuple[float, bytes]]) -> bytes:
    rows = list(rows)
    body = b"".join(b"\x08" + struct.pack("<d", time_s) + content for time_s, content in rows)
    return _chunk(3, struct.pack("<I", number) + _length(len(rows)) + body)


def write_xdf(
    path: Path,
    signals: dict[str, tuple[np.ndarray, Sequence[str], np.ndarray, float]],
    markers: dict[str, Sequence[tuple[float, str]]],
    clock_offset_s: float = 0.0,
) -> Path:
    """signals: name to times (n,), labels (k,), values (n, k), rate; markers: name to times and texts.

    clock_offset_s: what is added to the stamps of all streams to get the recorder's clock.
    """
    parts = [b"XDF:", _chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")]
    number, streams = 0, list[tuple[int, float, float]]()
    for name, (time_s, labels, values, rate_hz) in signals.items():
        number += 1
        parts.append(_header(number, name, "EMG", "double64", rate_hz, labels))
        parts.append(
            _samples(number, ((float(t), row.astype("<f8").tobytes()) for t, row in zip(time_s, values, strict=True)))
        )
        streams.append((number, float(time_s[0]), float(time_s[-1])))
    for name, events in markers.items():
        number += 1
        parts.append(_header(number, name, "Markers", "string", 0.0, ("marker",)))
        parts.append(_samples(number, ((t, _length(len(text.encode())) + text.encode()) for t, text in events)))
        streams.append((number, events[0][0], events[-1][0]))
    for stream, first_s, last_s in streams:
        for at_s in np.linspace(first_s, last_s, 6):
            parts.append(_chunk(4, struct.pack("<Idd", stream, float(at_s), clock_offset_s)))
    for stream, first_s, last_s in streams:
        text = f"<info><first_timestamp>{first_s}</first_timestamp><last_timestamp>{last_s}</last_timestamp></info>"
        parts.append(_chunk(6, struct.pack("<I", stream) + text.encode()))
    path.write_bytes(b"".join(parts))
    return path
