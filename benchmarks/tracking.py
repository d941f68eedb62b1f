"""Track one recording with one version of the code, in a process of its own, and measure what it costs.

    python benchmarks/tracking.py RECORDING RESULTS CONFIG_JSON      (what ``track`` below starts)

The results folder also gets ``cost.json``: processor seconds until the body is learnt and in total, both without those
that numba spent on compiling; the peak memory; the number of frames; and, for a refused recording, the reason.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

COST_FILE: Final = "cost.json"
ONE_THREAD: Final = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
MB: Final = 1024.0  # kilobytes, the unit in which Linux gives the peak memory


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost of a run. start_s, total_s: processor seconds until the first tracked frame, and in total; refused: why
    the recording was refused, empty where it was tracked.
    """

    start_s: float
    total_s: float
    compile_s: float
    peak_mb: float
    frames: int
    refused: str = ""

    @property
    def frame_ms(self) -> float:
        """Return processor milliseconds per frame, without those of the start; NaN without a frame."""
        return 1e3 * (self.total_s - self.start_s) / self.frames if self.frames else float("nan")


def track(source: Path, recording: Path, results: Path, config: Mapping[str, Any]) -> Cost:
    """Track with the package in ``source`` into a new folder; config: what differs from the defaults of TrackConfig."""
    results.mkdir(parents=True)
    command = [sys.executable, __file__, str(recording), str(results), json.dumps(config)]
    done = subprocess.run(command, env=os.environ | ONE_THREAD | {"PYTHONPATH": str(source)}, capture_output=True)
    if done.returncode:
        raise RuntimeError(f"{recording}: {done.stderr.decode(errors='replace')[-2000:]}")
    return read_cost(results)


def read_cost(results: Path) -> Cost:
    """Return the cost of an earlier run."""
    return Cost(**json.loads((results / COST_FILE).read_text(encoding="utf-8")))


def compile_clock(clock: Callable[[], float]) -> Callable[[], float]:
    """Return a function that returns the seconds spent compiling from now on, by the given clock. Numba's own listener
    measures elapsed time, which on a busy machine is longer than the processor time from which it is subtracted.
    """
    from numba.core import event

    class Compiling(event.Listener):
        depth, began_s, spent_s = 0, 0.0, 0.0

        def on_start(self, event: object) -> None:
            self.began_s = clock() if self.depth == 0 else self.began_s
            self.depth += 1

        def on_end(self, event: object) -> None:
            self.depth -= 1
            self.spent_s += clock() - self.began_s if self.depth == 0 else 0.0

    compiling = Compiling()
    event.register("numba:compile", compiling)
    return lambda: compiling.spent_s


def main() -> None:
    """Track and write the cost; this function runs with the version of the code that is measured."""
    import resource
    import time

    from anchorpose.errors import AnchorposeError
    from anchorpose.pipeline import track_recording
    from anchorpose.tracker.config import TrackConfig

    recording, results, config = Path(sys.argv[1]), Path(sys.argv[2]), json.loads(sys.argv[3])
    compile_s, start_s = compile_clock(time.process_time), float("nan")

    def spent_s() -> float:
        return time.process_time() - compile_s()

    def progress(done: int, total: int) -> None:
        nonlocal start_s
        if start_s != start_s and any((results / "journal").glob("learnt*")):  # NaN until the body is learnt
            start_s = spent_s()

    refused, frames = "", 0
    try:
        track_recording(recording, results, TrackConfig(**config), progress)
        frames = json.loads((results / "run.json").read_text(encoding="utf-8"))["frame_count"]
    except AnchorposeError as error:
        refused = str(error)
    cost = Cost(
        start_s=spent_s() if start_s != start_s else start_s,
        total_s=spent_s(),
        compile_s=compile_s(),
        peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MB,
        frames=frames,
        refused=refused,
    )
    (results / COST_FILE).write_text(json.dumps(asdict(cost)), encoding="utf-8")


if __name__ == "__main__":
    main()
