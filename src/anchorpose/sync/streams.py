"""Hold the signals of another device and their times as in the device's file, and find signals by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.options import DAY_S

LARGEST_BYTES: Final = 2 * 2**30
"""Maximum size in bytes of an XDF or EDF file; 16 channels of EMG at 2 kHz take half a gigabyte per hour as floats."""


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Several signals that were sampled at the same times.

    time_s (n,) float64, seconds on the device's clock, rising; channels: names of the k signals; values (n, k) float64
    in the file's units, NaN where missing.
    """

    name: str
    time_s: np.ndarray
    channels: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """The onsets of one stream of markers. time_s (n,) float64, seconds on the device's clock, rising."""

    name: str
    time_s: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class OtherFile:
    """The content of another device's file: streams of signals, and markers; notes: sentences on unused content."""

    path: Path
    streams: tuple[Stream, ...]
    markers: tuple[Markers, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return each channel's name; as ``STREAM/CHANNEL`` if channels of two streams have the same name."""
        plain = [channel for stream in self.streams for channel in stream.channels]
        return tuple(
            channel if plain.count(channel) == 1 else f"{stream.name}/{channel}"
            for stream in self.streams
            for channel in stream.channels
        )

    def take(self, wanted: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the times (n,) of the wanted channels and their values (n, wanted); raises InputError unless one
        stream has all wanted channels.
        """
        found = [self._place(name) for name in wanted]
        if len({place for place, _ in found}) > 1:
            problem = f"has {', '.join(wanted)} in streams of different times"
            raise InputError(self.path, problem, "name signals of one sensor")
        stream = self.streams[found[0][0]]
        return stream.time_s, stream.values[:, [column for _, column in found]]

    def _place(self, name: str) -> tuple[int, int]:
        """Return the index of the stream with the channel ``name``, and of the channel in it."""
        places = [
            (place, column)
            for place, stream in enumerate(self.streams)
            for column, channel in enumerate(stream.channels)
            if name in (channel, f"{stream.name}/{channel}")
        ]
        if len(places) == 1:
            return places[0]
        listed = ", ".join(self.names[:12]) + (" and more" if len(self.names) > 12 else "")
        problem = f"has no signal '{name}'" if not places else f"has {len(places)} signals '{name}'"
        raise InputError(self.path, problem, f"name one of {listed}")


def checked(path: Path, stream: Stream) -> Stream:
    """Return the stream; raises InputError if its times are impossible for a recording, or if it has no values."""
    where = f" of {stream.name}" if stream.name else ""
    if len(stream.time_s) < 2:
        raise InputError(path, f"has {len(stream.time_s)} samples{where}", "give the file of a movement")
    if not np.isfinite(stream.time_s).all():
        raise InputError(path, f"has samples{where} without a time", "export it again with a time for each sample")
    late = np.flatnonzero(np.diff(stream.time_s) <= 0)
    if len(late):
        row = int(late[0]) + 1
        problem = f"its time does not rise at sample {row + 1}{where} ({stream.time_s[row]:.6f} s)"
        raise InputError(path, problem, "export it again with a rising time for each sample")
    lasts_s = float(stream.time_s[-1] - stream.time_s[0])
    if lasts_s > DAY_S:
        raise InputError(path, f"lasts {lasts_s:.3g} s by its times", "give its times in seconds")
    if len(set(stream.channels)) < len(stream.channels):
        twice = next(name for name in stream.channels if stream.channels.count(name) > 1)
        raise InputError(path, f"has two signals '{twice[:40]}'{where}", "rename one of them")
    if not np.isfinite(stream.values).any():
        raise InputError(path, f"has no values{where}", "export it again with its signals")
    return stream


def distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, all different: a number is added to each name that has occurred before."""
    found = list[str]()
    for name in names:
        others = (f"{name} {number}" for number in count(2))
        found.append(name if name not in found else next(other for other in others if other not in found))
    return tuple(found)


def usable(path: Path, streams: Iterable[Stream], markers: Sequence[Markers], notes: Sequence[str]) -> OtherFile:
    """Return the file with the streams that ``checked`` accepts, and a note on each other stream; raises InputError if
    the file has neither a usable stream nor markers.
    """
    kept, left_out = list[Stream](), list[InputError]()
    for stream in streams:
        try:
            kept.append(checked(path, stream))
        except InputError as error:
            left_out.append(error)
    if not kept and not markers:
        raise left_out[0] if left_out else InputError(path, "holds no signals", "give the file of a movement")
    why = (f"{path.name} {error.problem}; these are left out" for error in left_out)
    return OtherFile(path, tuple(kept), tuple(markers), (*notes, *why))
