"""Print a table of limits: per scene class, operations per frame, time of the kernels alone, time of the program.

    python benchmarks/limits.py [NAME ...]        (NAME: the beginning of a class of suite ``speed``; by default all)

Run it on an idle machine. The ratio of both times holds on any machine, since kernels and program are timed in one
process, on one thread. The table goes to the output, the longest kernels of each class to the error output.
"""

from __future__ import annotations

import sys

from run import CACHE
from suites import speed
from work import Kernel, Work, work_of

from anchorpose.errors import AnchorposeError
from anchorpose.tracker.config import TrackConfig

SHOWN = 8  # number of kernels listed per class, the longest


def main() -> None:
    """Measure the classes whose names were given."""
    headed = False
    for case in speed("tuning", False):
        if not sys.argv[1:] or case.row.startswith(tuple(sys.argv[1:])):
            try:
                work = work_of(case.recording.ready(CACHE).recording, TrackConfig())
            except AnchorposeError as error:
                print(f"{case.row}: not tracked: {error}", file=sys.stderr)
                continue
            if not headed:
                titles = ["per frame", "frames", *work.per_frame(), "kernels alone, ms", "the program, ms", "ratio"]
                print(f"| {' | '.join(titles)} |\n|---|{'--:|' * (len(titles) - 1)}")
                headed = True
            _print(case.row, work)


def _print(scene: str, work: Work) -> None:
    best_ms = {name: kernel.calls / work.frames * kernel.best_ms() for name, kernel in work.kernels.items()}
    total_ms, spent_ms = sum(best_ms.values()), work.spent_ms / work.frames
    counts = [f"{count:,.1f}" if count < 100 else f"{count:,.0f}" for count in work.per_frame().values()]
    cells = [scene, str(work.frames), *counts, f"{total_ms:.1f}", f"{spent_ms:.1f}", f"**{spent_ms / total_ms:.1f}**"]
    print(f"| {' | '.join(cells)} |", flush=True)
    print(f"\n{scene}: calls a frame, one alone in ms, all in ms", file=sys.stderr)
    for name in sorted(best_ms, key=lambda own: -best_ms[own])[:SHOWN]:
        print(_row(name, work.kernels[name], work.frames, best_ms[name]), file=sys.stderr)


def _row(name: str, kernel: Kernel, frames: int, all_ms: float) -> str:
    calls = kernel.calls / frames
    return f"{name}: {calls:.1f}, {all_ms / calls if calls else 0.0:.3f}, {all_ms:.2f}"


if __name__ == "__main__":
    main()
