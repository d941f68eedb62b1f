"""What each verb costs on an hour's results: python benchmarks/long_results.py RESULTS --truth TRUTH.npz

The tables of a short recording are repeated, frames and times going on, until there are as many frames as an hour of
three cameras has at 30 Hz; run.json names as many depth images. Every verb that reads results then runs as a process of
its own on a fresh copy; the table has its peak memory (resident set) and its seconds. ``--frames`` takes several
lengths, so that one sees what grows. The viewer is started, and asked for what its page fetches before it is drawn.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile, copytree
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.request import urlopen

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from anchorpose.exports.formats import Format
from anchorpose.results.parquet import open_parquet
from anchorpose.results.people_labels import PEOPLE
from anchorpose.results.records import MEASURES_FILE
from anchorpose.results.run_record import RUN_FILE, hash_files, output_files

HOUR: Final = 108_000
RATE_HZ: Final = 30.0
AT_ONCE_MB: Final = 64  # of a table, before it is written
VERB: Final = "import sys\nfrom anchorpose.cli import main\nif __name__ == '__main__': sys.exit(main(sys.argv[1:]))"
INTERVAL: Final = ("first_frame", "last_frame")
SHORT_LISTS: Final = ("dropped", "lost", "poor_depth")


@dataclass(frozen=True, slots=True)
class Cost:
    """Peak of the resident set and time of one process."""

    megabytes: float
    seconds: float


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
    """The folder ``long`` with the tables of ``short``, as often as it takes to have ``frames`` frames."""
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
    """The same rows so many frames later; times are those of ``RATE_HZ``."""
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
    """A truth.npz with the times of ``results`` and the truth of the short recording again and again."""
    times = np.unique(pq.read_table(results / "joints.parquet", columns=["time_s"])["time_s"].to_numpy())
    with np.load(short) as file:
        arrays = {name: file[name] for name in file.files}
    count = len(arrays["time"])
    row = np.arange(len(times)) % count
    same = {name: array[row] for name, array in arrays.items() if array.shape[:1] == (count,) and name != "names"}
    np.savez_compressed(long, **(arrays | same | {"time": times}))


def pretend_later(results: Path, to: Path) -> Path:
    """The same results as of another recording: tables are links, and run.json has another hash of every input."""
    copytree(results, to, copy_function=os.link)
    run: dict[str, Any] = json.loads((to / RUN_FILE).read_text(encoding="utf-8"))
    run["inputs_sha256"] = {name: digest[::-1] for name, digest in run["inputs_sha256"].items()}
    (to / RUN_FILE).unlink()
    (to / RUN_FILE).write_text(json.dumps(run, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return to


def compare_sessions(results: Path, out: Path) -> Cost:
    """``anchorpose report`` of two sessions."""
    later = pretend_later(results, out / "later")
    return run_verb("report", str(results), str(later), "-o", str(out / "comparison.html"))


def repeat_measures(results: Path, out: Path) -> Cost:
    """``anchorpose reliability`` of three subjects with two sessions each."""
    rows = [f"{subject},{session},{results.resolve()}" for subject in "abc" for session in (1, 2)]
    (out / "sessions.csv").write_text("\n".join(["subject,session,results", *rows]) + "\n", encoding="utf-8")
    return run_verb("reliability", str(out / "sessions.csv"))


def run_verb(*arguments: str) -> Cost:
    """A verb as a process of its own; raises RuntimeError where it fails."""
    began = time.perf_counter()
    with subprocess.Popen([sys.executable, "-c", VERB, *arguments], stdout=subprocess.DEVNULL) as child:
        return _ended(child, began, " ".join(arguments[:1]))


def open_view(results: Path) -> Cost:
    """``anchorpose view`` until it has answered what its page asks for before it draws; seconds to that moment."""
    began = time.perf_counter()
    command = [sys.executable, "-c", VERB, "view", str(results), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        address = child.stdout.readline().split()[-1]
        for name in ("", "description", "overview", "motion?first=0&count=512"):
            with urlopen(address + name) as answer:
                answer.read()
        seconds = time.perf_counter() - began
        child.send_signal(signal.SIGINT)
        child.stdout.read()
        return Cost(_ended(child, began, "view").megabytes, seconds)


def _ended(child: Any, began: float, name: str) -> Cost:
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode not in (0, 128 + signal.SIGINT):
        raise RuntimeError(f"{name} failed with {child.returncode}")
    return Cost(used.ru_maxrss / 1024, time.perf_counter() - began)


def verbs(results: Path, truth: Path | None, out: Path) -> dict[str, Callable[[], Cost]]:
    """What is measured, by name; ``measure`` first, so that the others read what it wrote."""
    folder = str(results)
    return {
        "measure": lambda: run_verb("measure", folder),
        "measure --smooth": lambda: run_verb("measure", folder, "--smooth", "butterworth", "--fill", "linear"),
        "report": lambda: run_verb("report", folder),
        **({} if truth is None else {"evaluate": lambda: run_verb("evaluate", folder, "--truth", str(truth))}),
        **{
            f"export --to {kind}": lambda kind=kind: run_verb("export", folder, "--to", kind, "-o", str(out / kind))
            for kind in map(str, Format)
        },
        "view": lambda: open_view(results),
        "verify": lambda: run_verb("verify", folder),
        "report, two sessions": lambda: compare_sessions(results, out),
        "reliability": lambda: repeat_measures(results, out),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes the results, runs every verb and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="results of a short recording")
    parser.add_argument("--truth", type=Path, help="its truth.npz, for evaluate")
    parser.add_argument("--frames", type=int, nargs="+", default=[HOUR])
    parser.add_argument("--only", nargs="+", help="these verbs, as the table names them")
    parser.add_argument("--work", type=Path, help="make the results in this folder and keep them")
    options = parser.parse_args(arguments)
    print(f"{'frames':>8} {'verb':21} {'peak, MB':>9} {'seconds':>8}")
    for frames in options.frames:
        with TemporaryDirectory() as temporary:
            work = Path(temporary) if options.work is None else options.work / str(frames)
            long, truth = work / "results", None if options.truth is None else work / "truth.npz"
            if not long.exists():
                repeat_results(options.results, long, frames)
                if truth is not None:
                    repeat_truth(options.truth, truth, long)
            with TemporaryDirectory(dir=work) as out:
                for name, run in verbs(long, truth, Path(out)).items():
                    if options.only is None or name in options.only:
                        cost = run()
                        print(f"{frames:>8} {name:21} {cost.megabytes:9.0f} {cost.seconds:8.1f}", flush=True)


if __name__ == "__main__":
    main()
