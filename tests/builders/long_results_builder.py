"""Results of hours: the tables of a short recording repeated, frames and times going on."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from anchorpose.results.parquet import open_parquet
from anchorpose.results.records import MEASURES_FILE, PEOPLE
from anchorpose.results.run_record import RUN_FILE, hash_files, output_files

RATE_HZ: Final = 30.0
AT_ONCE_MB: Final = 64  # of a table, before it is written
INTERVAL: Final = ("first_frame", "last_frame")
SHORT_LISTS: Final = ("dropped", "lost", "poor_depth")


@dataclass(frozen=True, slots=True)
class Repetition:
    """Frame numbers of the short results, (n,), and how often they are repeated."""

    frame: np.ndarray
    times: int

    @property
    def period(self) -> int:
        """Frame numbers from one repetition to the next."""
        return int(self.frame[-1] - self.frame[0]) + 1


def repeat_results(short: Path, long: Path, frames: int) -> None:
    """Write the folder ``long`` with the tables of ``short``, as often as it takes to have ``frames`` frames."""
    long.mkdir(parents=True)
    frame = np.unique(pq.read_table(short / "joints.parquet", columns=["frame"])["frame"].to_numpy())
    repetition = Repetition(frame, max(1, round(frames / len(frame))))
    for path in sorted(short.glob("*.parquet")):
        if path.name == MEASURES_FILE:
            copyfile(path, long / path.name)
        else:
            _repeat_table(path, long / path.name, repetition)
    if (short / "pictures").is_dir():
        copytree(short / "pictures", long / "pictures")
    _repeat_run(short / RUN_FILE, long / RUN_FILE, repetition)


def _repeat_table(path: Path, to: Path, repetition: Repetition) -> None:
    table = pq.read_table(path)
    rows = max(1, pq.ParquetFile(path).metadata.row_group(0).num_rows)
    things = max(1, round(len(table) / len(repetition.frame)))
    rows = PEOPLE.rows_per_group if path.name == PEOPLE.file else max(rows, 512 * things)
    piece = max(1, round(AT_ONCE_MB * 2**20 / max(table.nbytes, 1) / 4))
    with open_parquet(to, table.schema) as writer:
        for first in range(0, repetition.times, piece):
            numbers = range(first, min(first + piece, repetition.times))
            several = pa.concat_tables([_later(table, number * repetition.period) for number in numbers])
            writer.write_table(several, row_group_size=rows)


def _later(table: pa.Table, frames: int) -> pa.Table:
    """Return the same rows so many frames later; times are those of ``RATE_HZ``."""
    for name, time_name in (("frame", "time_s"), ("first_frame", "start_s"), ("last_frame", "end_s")):
        if name not in table.column_names:
            continue
        place = table.column_names.index(name)
        moved = pc.add(table[name], pa.scalar(frames, pa.int32()))
        table = table.set_column(place, table.schema.field(name), moved)
        if time_name in table.column_names:
            seconds = pc.divide(moved.cast(pa.float64()), RATE_HZ)
            table = table.set_column(table.column_names.index(time_name), table.schema.field(time_name), seconds)
    return table


def _repeat_run(path: Path, to: Path, repetition: Repetition) -> None:
    run: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    shares = run["association"]["matched_share"]
    run["association"]["matched_share"] = shares * repetition.times
    for name in SHORT_LISTS:
        run[name] = [
            entry | {key: entry[key] + number * repetition.period for key in ("frame", *INTERVAL) if key in entry}
            for number in range(repetition.times)
            for entry in run.get(name) or []
        ]
    digest = next(iter(run["inputs_sha256"].values()))
    images = range(repetition.times * repetition.period)
    run["inputs_sha256"] |= {f"{c['name']}/depth/{k:06d}.png": digest for c in run["cameras"] for k in images}
    run["frame_count"] = len(shares) * repetition.times
    run["outputs_sha256"] = dict(hash_files(output_files(to.parent), to.parent))
    to.write_text(json.dumps(run, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def repeat_truth(short: Path, long: Path, results: Path) -> None:
    """Write a truth.npz with the times of ``results`` and the truth of the short recording again and again."""
    times = np.unique(pq.read_table(results / "joints.parquet", columns=["time_s"])["time_s"].to_numpy())
    with np.load(short) as file:
        arrays = {name: file[name] for name in file.files}
    count = len(arrays["time"])
    row = np.arange(len(times)) % count
    same = {name: array[row] for name, array in arrays.items() if array.shape[:1] == (count,) and name != "names"}
    np.savez_compressed(long, **(arrays | same | {"time": times}))


def pretend_later(results: Path, to: Path) -> Path:
    """Copy results as of another recording: tables are links, and run.json has another hash of every input."""
    copytree(results, to, copy_function=os.link)
    run: dict[str, Any] = json.loads((to / RUN_FILE).read_text(encoding="utf-8"))
    run["inputs_sha256"] = {name: digest[::-1] for name, digest in run["inputs_sha256"].items()}
    (to / RUN_FILE).unlink()
    (to / RUN_FILE).write_text(json.dumps(run, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return to
