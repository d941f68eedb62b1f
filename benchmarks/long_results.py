"""Measure time and memory of each command on an hour's results.

    python benchmarks/long_results.py RESULTS --truth TRUTH.npz

The tables of a short recording are repeated, with increasing frame numbers and times, until they have as many frames as
an hour of three cameras at 30 Hz; run.json is extended to as many depth images. Every command that reads results then
runs as a process of its own on a fresh copy. The table has each command's peak memory (resident set) and its seconds;
with several lengths for ``--frames``, it shows what grows with the length. The viewer is started and answers the
requests that its page makes before it draws.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.request import urlopen

from anchorpose.exports.formats import Format

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
from long_results_builder import pretend_later, repeat_results, repeat_truth

HOUR: Final = 108_000
VERB: Final = "import sys\nfrom anchorpose.cli import main\nif __name__ == '__main__': sys.exit(main(sys.argv[1:]))"


@dataclass(frozen=True, slots=True)
class Cost:
    """Peak of the resident set and time of one process."""

    megabytes: float
    seconds: float


def repeat_measures(results: Path, out: Path) -> Cost:
    """Return the cost of ``anchorpose reliability`` for three subjects with two sessions each."""
    rows = [f"{subject},{session},{results.resolve()}" for subject in "abc" for session in (1, 2)]
    (out / "sessions.csv").write_text("\n".join(["subject,session,results", *rows]) + "\n", encoding="utf-8")
    return run_verb("reliability", str(out / "sessions.csv"))


def run_verb(*arguments: str) -> Cost:
    """Run a command of anchorpose as a process of its own; return its cost. Raises RuntimeError if it fails."""
    began = time.perf_counter()
    with subprocess.Popen([sys.executable, "-c", VERB, *arguments], stdout=subprocess.DEVNULL) as child:
        return _ended(child, began, " ".join(arguments[:1]))


def open_view(results: Path) -> Cost:
    """Start ``anchorpose view``, make the requests that its page makes before it draws; return the cost, with seconds
    until then.
    """
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
    """Return the commands to measure, by name; ``measure`` is first, since other commands read what it wrote."""
    folder, page = str(results), str(out / "comparison.html")
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
        "report, two sessions": lambda: run_verb(
            "report", folder, str(pretend_later(results, out / "later")), "-o", page
        ),
        "reliability": lambda: repeat_measures(results, out),
    }


def main() -> None:
    """Make the long results, run every command on them and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="results of a short recording")
    parser.add_argument("--truth", type=Path, help="its truth.npz, for evaluate")
    parser.add_argument("--frames", type=int, nargs="+", default=[HOUR])
    parser.add_argument("--only", nargs="+", help="these verbs, as the table names them")
    options = parser.parse_args()
    print(f"{'frames':>8} {'verb':21} {'peak, MB':>9} {'seconds':>8}")
    for frames in options.frames:
        with TemporaryDirectory() as work:
            long = Path(work) / "results"
            truth = None if options.truth is None else Path(work) / "truth.npz"
            repeat_results(options.results, long, frames)
            if truth is not None:
                repeat_truth(options.truth, truth, long)
            for name, run in verbs(long, truth, Path(work)).items():
                if options.only is None or name in options.only:
                    cost = run()
                    print(f"{frames:>8} {name:21} {cost.megabytes:9.0f} {cost.seconds:8.1f}", flush=True)


if __name__ == "__main__":
    main()
