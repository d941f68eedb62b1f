"""Write the result of a synchronisation: the relation between both clocks, joints and events with times on the other
clock, and the other device's signals at the times of the joints.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from anchorpose import __version__
from anchorpose.agreement.clock import OtherClock, resampled
from anchorpose.errors import InputError
from anchorpose.recording.events import EVENTS_FILE
from anchorpose.results.folder import FolderKind, check_results_path, whole_or_nothing
from anchorpose.results.frame_time import usual_step_s
from anchorpose.results.parquet import open_parquet, read_any_parquet
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE, read_contacts, read_episodes
from anchorpose.results.tables import JOINTS
from anchorpose.results.trial_table import TRIALS_FILE
from anchorpose.results.verify import require_own
from anchorpose.sync.streams import Stream
from anchorpose.sync.synchronising import Synchronised

CLOCK_FILE: Final = "clock.json"
CLOCK_FORMAT: Final = "anchorpose-clock"
JOINTS_FILE: Final = "joints_other_clock.parquet"
SIGNALS_FILE: Final = "signals.parquet"

SYNC: Final = FolderKind("a synchronisation", (CLOCK_FILE,), (CLOCK_FILE, JOINTS_FILE, SIGNALS_FILE, EVENTS_FILE))

SEVERAL: Final = 2.0
"""Minimum number of samples per frame at which a signal is averaged over the time of each frame; with fewer samples,
the signal is interpolated.
"""


def write_sync(folder: Path, found: Synchronised, overwrite: bool = False) -> None:
    """Write all files into a new folder, or replace an earlier synchronisation if ``overwrite``; raises InputError if
    the folder may not be written.
    """
    check_results_path(folder, None, overwrite, SYNC)
    signals, events = signal_table(found), list(_events(found))
    with whole_or_nothing(folder, SYNC.own if overwrite else ()) as work:
        text = json.dumps(clock_document(found), indent=1, ensure_ascii=False) + "\n"
        (work / CLOCK_FILE).write_text(text, encoding="utf-8", newline="\n")
        other_s = found.clock.reference_time_s(found.joints.time_s)
        JOINTS.write(work / JOINTS_FILE, replace(found.joints, time_s=other_s))
        with open_parquet(work / SIGNALS_FILE, signals.schema) as writer:
            writer.write_table(signals)
        if events:
            rows = [
                "\t".join(("onset", "duration", "trial_type", "table")),
                *("\t".join(row) for _, row in sorted(events)),
            ]
            (work / EVENTS_FILE).write_text("\n".join(rows) + "\n", encoding="utf-8", newline="\n")


def clock_document(found: Synchronised) -> dict[str, Any]:
    """Return the content of clock.json: at the time t of the recording, the other clock shows t + offset_s + 1e-6
    drift_ppm (t - at_s).
    """
    clock = found.clock
    correlation = getattr(clock, "correlation", None)
    return {
        "format": CLOCK_FORMAT,
        "version": 1,
        "anchorpose": __version__,
        "results": found.results.resolve().name,
        "other": found.other.path.name,
        "method": found.method,
        "compared": found.compared,
        "offset_s": round(clock.offset_s, 6),
        "offset_sigma_s": round(clock.offset_sigma_s, 6),
        "at_s": round(clock.middle_s, 6),
        "drift_ppm": round(1e6 * clock.drift, 3),
        "drift_sigma_ppm": round(1e6 * clock.drift_sigma, 3),
        "common_s": [round(each, 3) for each in clock.overlap_s],
        **({} if correlation is None else {"correlation": round(correlation, 3)}),
        "notes": list(found.notes),
    }


def signal_table(found: Synchronised) -> pa.Table:
    """Return a table with frame, time_s (recording's clock), other_time_s, and each signal's value at these times; null
    where missing.

    A signal with several samples per frame has its mean over the frame's time, and a column NAME_rms with the root mean
    square, as is usual for EMG; other signals are interpolated. Raises InputError if a signal has the name of another
    column.
    """
    time_s = found.joints.time_s
    other_s, step_s = found.clock.reference_time_s(time_s), usual_step_s(time_s)
    columns = {"frame": pa.array(found.joints.frame), "time_s": pa.array(time_s), "other_time_s": pa.array(other_s)}
    names = iter(found.other.names)
    for stream in found.other.streams:
        several = usual_step_s(stream.time_s) * SEVERAL <= step_s
        own = _averaged(stream, other_s, step_s) if several else (resampled(stream.time_s, stream.values, other_s),)
        for column in range(len(stream.channels)):
            name = next(names)
            for ending, values in zip(("", "_rms"), own, strict=False):
                if f"{name}{ending}" in columns:
                    problem = f"has a signal '{name}', and the table has a column '{name}{ending}' already"
                    raise InputError(found.other.path, problem, "rename that signal")
                columns[f"{name}{ending}"] = pa.array(values[:, column], pa.float64(), from_pandas=True)
    return pa.table(columns)


def _averaged(stream: Stream, at_s: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and root mean square (m, k) of a stream's samples within half of ``step_s`` of each time (m,); NaN
    without samples.
    """
    first, end = (np.searchsorted(stream.time_s, at_s + side * 0.5 * step_s) for side in (-1, 1))
    known = np.isfinite(stream.values)
    # each signal's mean, which is subtracted so that the sums stay small and are rounded less
    centre = np.where(known, stream.values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    values = np.where(known, stream.values - centre, 0.0)
    count, total, square = (
        np.vstack([np.zeros(each.shape[1]), np.cumsum(each, axis=0)]) for each in (known * 1.0, values, values**2)
    )
    seen, total, square = (each[end] - each[first] for each in (count, total, square))
    some = np.where(seen > 0, seen, np.nan)
    mean = total / some
    return mean + centre, np.sqrt(np.maximum(square / some + 2.0 * centre * mean + centre**2, 0.0))


def _events(found: Synchronised) -> Iterator[tuple[float, tuple[str, ...]]]:
    """Yield (onset, cells of events.tsv) of the trials, episodes and contacts in the results."""
    files = [name for name in (TRIALS_FILE, EPISODES_FILE, CONTACTS_FILE) if (found.results / name).is_file()]
    require_own(found.results, files)
    if TRIALS_FILE in files:
        columns = ["condition", "start_s", "duration_s"]
        for row in read_any_parquet(found.results / TRIALS_FILE, columns=columns).to_pylist():
            start_s = row["start_s"]
            yield _event(found.clock, row["condition"], start_s, start_s + row["duration_s"], "trials")
    if EPISODES_FILE in files:
        for episode in read_episodes(found.results / EPISODES_FILE):
            yield _event(found.clock, episode.kind, episode.start_s, episode.end_s, "episodes")
    if CONTACTS_FILE in files:
        for contact in read_contacts(found.results / CONTACTS_FILE):
            name = f"contact_{contact.part}"
            yield _event(found.clock, name, contact.start_s, contact.end_s, "contacts")


def _event(clock: OtherClock, name: str, start_s: float, end_s: float, table: str) -> tuple[float, tuple[str, ...]]:
    onset_s, ended_s = clock.reference_time_s(np.array([start_s, end_s])).tolist()
    return onset_s, (f"{onset_s:.6f}", f"{ended_s - onset_s:.6f}", " ".join(name.split()), table)
