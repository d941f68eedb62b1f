"""How a batch scales: the same short sessions on one worker and on several, and what a session costs.

    python benchmarks/batch.py OUT [--sessions 8] [--seconds 4] [--workers 2]

Means something on a machine that does nothing else, with as many cores as workers. A first session, which is not
counted, compiles what is not compiled yet.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from anchorpose.batch.cluster import Place
from anchorpose.batch.run import run_batch
from anchorpose.batch.sessions import Session, find_sessions
from anchorpose.cli.track import TrackOptions
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording

FIRST_SEED = 3


def main() -> None:
    """Simulates what is not there, runs both batches and prints and writes the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sessions", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    recordings = [given.out / f"clinic-{FIRST_SEED + number}" for number in range(given.sessions)]
    for number, folder in enumerate(recordings):
        if not folder.exists():
            simulate_recording(folder, clinic(FIRST_SEED + number, seconds=given.seconds))
    sessions = find_sessions([str(folder / "recording") for folder in recordings], TrackOptions())
    timed(sessions[:1], given.out / "warm", 1)
    alone_s = timed(sessions, given.out / "on-1", 1)
    shared_s = timed(sessions, given.out / f"on-{given.workers}", given.workers)
    figures = {
        "sessions": len(sessions),
        "seconds_each": given.seconds,
        "one_worker_s": round(alone_s, 1),
        "workers": given.workers,
        "workers_s": round(shared_s, 1),
        "times_as_fast": round(alone_s / shared_s, 2),
    }
    (given.out / "batch.json").write_text(json.dumps(figures, indent=1) + "\n")
    print(json.dumps(figures, indent=1))


def timed(sessions: tuple[Session, ...], out: Path, workers: int) -> float:
    """Seconds for a whole batch into a new folder."""
    if out.exists():
        raise SystemExit(f"{out} is there already; give another folder or remove it.")
    begin = time.perf_counter()
    rows = run_batch(sessions, out, Place(workers), lambda done, total: None)
    if any(row.why for row in rows):
        raise SystemExit("\n".join(str(row.why) for row in rows if row.why))
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
