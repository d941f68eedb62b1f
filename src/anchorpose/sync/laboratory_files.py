"""Read signals and markers of files that laboratory programs write: XDF, EDF, EDF+ and BDF."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError, MissingPackage
from anchorpose.recording.regular_file import open_regular, require_regular
from anchorpose.sync.streams import LARGEST_BYTES, Markers, OtherFile, Stream, distinct, usable

MAGIC: Final = b"XDF:"

XDF_REMEDY: Final = "give a file that LabRecorder or another program has written as XDF"

EDF_REMEDY: Final = "export it again as continuous EDF or EDF+"


def read_xdf(path: Path) -> OtherFile:
    """Read the streams of an XDF file, as LabRecorder writes them, on the clock of the recording computer.

    A stream of numbers is read as signals, a stream of texts as markers. A stream of numbers without a regular rate is
    read both as signals and as markers, since its samples may be events. Times are corrected by the clock offsets
    that the file has. Raises InputError if the file is not XDF or is empty, MissingPackage if pyxdf is missing.
    """
    try:
        import pyxdf
    except ImportError:
        raise MissingPackage("sync with an XDF file", "pyxdf", "sync") from None
    _require_xdf(path)
    with _complaints() as damaged:
        try:
            found = pyxdf.load_xdf(str(path))[0]
            streams = [each for each in found if len(each["time_stamps"])]
            names = distinct([str(each["info"]["name"][0]) for each in streams])
            signals = [_signals(name, each) for name, each in zip(names, streams, strict=True) if _has_numbers(each)]
            markers = [
                Markers(name, np.unique(np.asarray(each["time_stamps"], dtype=np.float64)))
                for name, each in zip(names, streams, strict=True)
                if _has_events(each)
            ]
        except Exception as error:  # the library raises arbitrary errors for damaged bytes
            raise _unreadable(path, "XDF", error, XDF_REMEDY) from None
    notes = [f"{path.name} is damaged; its undamaged parts were read ({damaged[0][:80]})"] if damaged else []
    return usable(path, signals, markers, notes)


def read_edf(path: Path) -> OtherFile:
    """Read a file in EDF, EDF+ or BDF, with times in seconds since its start. Signals keep their labels; all signals
    with the same sampling rate and number of samples become one stream; annotations become markers that are named by
    their texts. Raises InputError if the file is not EDF, MissingPackage if pyedflib is missing.
    """
    try:
        import pyedflib
    except ImportError:
        raise MissingPackage("sync with an EDF file", "pyedflib", "sync") from None
    try:
        _require_file(path)
        with pyedflib.EdfReader(str(path)) as file:
            return usable(path, _signals_of_edf(file), _annotations(file), ())
    except (OSError, ValueError, MemoryError) as error:
        raise _unreadable(path, "EDF", error, EDF_REMEDY) from None


def _require_file(path: Path) -> None:
    try:
        require_regular(path, LARGEST_BYTES)
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None


def _unreadable(path: Path, kind: str, error: Exception, remedy: str) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0].removeprefix(f"{path}: ")[:80]
    return InputError(path, f"cannot be read as {kind} ({reason})", remedy)


def _require_xdf(path: Path) -> None:
    _require_file(path)
    with open_regular(path) as file:
        begins = file.read(len(MAGIC))
    if begins != MAGIC:
        raise InputError(path, "is not an XDF file", XDF_REMEDY)


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """Yield a list that collects pyxdf's log messages about damage, which would otherwise go to the terminal."""
    found = list[str]()

    class Keeper(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno >= logging.ERROR:
                found.append(" ".join(record.getMessage().split()))

    logger, keeper = logging.getLogger("pyxdf"), Keeper()
    before = logger.propagate
    logger.addHandler(keeper)
    logger.propagate = False
    try:
        yield found
    finally:
        logger.removeHandler(keeper)
        logger.propagate = before


def _has_numbers(stream: Any) -> bool:
    return isinstance(stream["time_series"], np.ndarray)


def _has_events(stream: Any) -> bool:
    """Return whether each sample of a stream marks an event; nominal_srate is 0 for streams without a regular rate."""
    return not _has_numbers(stream) or float(stream["info"]["nominal_srate"][0]) == 0.0


def _signals(name: str, stream: Any) -> Stream:
    values = np.asarray(stream["time_series"], dtype=np.float64)
    labels = _labels(stream, values.shape[1])
    return Stream(name, np.asarray(stream["time_stamps"], dtype=np.float64), labels, values)


def _labels(stream: Any, count: int) -> tuple[str, ...]:
    """Return the channels' labels in the stream's header if each channel has one, otherwise ch1, ch2 and so on."""
    try:
        channels = stream["info"]["desc"][0]["channels"][0]["channel"]
        found = [str(each["label"][0]) for each in channels]
    except (KeyError, IndexError, TypeError):
        found = []
    return distinct(found if len(found) == count else [f"ch{number + 1}" for number in range(count)])


def _signals_of_edf(file: Any) -> list[Stream]:
    labels = distinct([str(label).strip() for label in file.getSignalLabels()])
    rates, counts = file.getSampleFrequencies().tolist(), file.getNSamples().tolist()
    groups = dict[tuple[float, int], list[int]]()
    for row, kind in enumerate(zip(rates, counts, strict=True)):
        groups.setdefault(kind, []).append(row)
    return [
        Stream(
            f"{rate_hz:g} Hz",
            np.arange(count) / rate_hz,
            tuple(labels[row] for row in rows),
            np.stack([file.readSignal(row) for row in rows], axis=1),
        )
        for (rate_hz, count), rows in groups.items()
    ]


def _annotations(file: Any) -> list[Markers]:
    onsets_s, _, texts = file.readAnnotations()
    names = [str(text) for text in texts]
    onsets_s = np.asarray(onsets_s, dtype=np.float64)
    return [Markers(name, np.unique(onsets_s[[each == name for each in names]])) for name in dict.fromkeys(names)]
