"""Print the page of limits: what each scene class needs, what its kernels take alone, what the program takes.

    python benchmarks/limits.py [NAME ...]        (NAME: the beginning of a class of suite ``speed``; by default all)

Run it on an idle machine. The ratio holds on any: kernels and program are timed in one process, on one thread.
"""

from __future__ import annotations

import sys

from run import CACHE
from suites import speed
from work import Kernel, work_of

from anchorpose.errors import AnchorposeError
from anchorpose.tracker.config import TrackConfig

SHOWN = 8  # kernels of each class, the longest


def main() -> None:
    """Measure the classes whose names were given."""
    for case in speed("tuning", False):
        if not sys.argv[1:] or case.row.startswith(tuple(sys.argv[1:])):
            try:
                work = work_of(case.recording.ready(CACHE).recording, TrackConfig())
            except AnchorposeError as error:
                print(f"\n## {case.row}\n\nNot tracked: {error}", flush=True)
                continue
            best_ms = {name: kernel.calls / work.frames * kernel.best_ms() for name, kernel in work.kernels.items()}
            total_ms, spent_ms = sum(best_ms.values()), work.spent_ms / work.frames
            print(f"\n## {case.row}\n\n{work.frames} frames of {spent_ms:.1f} ms; kernels alone {total_ms:.1f} ms;")
            print(f"**{spent_ms / total_ms:.1f} times** what they need. Per frame:\n\n| | |\n|---|--:|")
            for name, count in work.per_frame().items():
                print(f"| {name} | {count:,.1f} |")
            print("\n| kernel | calls a frame | one alone, ms | all, ms |\n|---|--:|--:|--:|")
            for name in sorted(best_ms, key=lambda own: -best_ms[own])[:SHOWN]:
                print(_row(name, work.kernels[name], work.frames, best_ms[name]), flush=True)


def _row(name: str, kernel: Kernel, frames: int, all_ms: float) -> str:
    calls = kernel.calls / frames
    return f"| `{name}` | {calls:.1f} | {all_ms / calls if calls else 0.0:.3f} | {all_ms:.2f} |"


if __name__ == "__main__":
    main()
