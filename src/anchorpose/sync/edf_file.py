"""Read signals of a file in EDF, EDF+ or BDF, in seconds since its start."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError, MissingPackage
from anchorpose.recording.regular_file import require_regular
from anchorpose.sync.streams import LARGEST_BYTES, Markers, OtherFile, Stream, distinct, usable

REMEDY: Final = "export it again as continuous EDF or EDF+"


def read_edf(path: Path) -> OtherFile:
    """Read the signals with their labels, as one stream per sampling rate, and annotations as markers named by their
    texts. Raises InputError if the file is not EDF, MissingPackage if pyedflib is missing.
    """
    try:
        import pyedflib
    except ImportError:
        raise MissingPackage("sync with an EDF file", "pyedflib", "sync") from None
    try:
        require_regular(path, LARGEST_BYTES)
        with pyedflib.EdfReader(str(path)) as file:
            return usable(path, _streams(file), _annotations(file), ())
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None
    except (OSError, ValueError, UnicodeDecodeError, MemoryError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0].removeprefix(f"{path}: ")[:80]
        raise InputError(path, f"cannot be read as EDF ({reason})", REMEDY) from None


def _streams(file: Any) -> list[Stream]:
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
