"""Whether the memory of tracking grows: python benchmarks/memory.py RECORDING --minutes 10 [--smooth]

Goes forward and backward through a short recording for so long, and tracks the first minute and all of it, each as a
process of its own. Prints the peak memory of both. RECORDING: a folder as ``anchorpose simulate`` writes it.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from live import play_longer

from anchorpose.recording.reader import open_recording

SHORT_S: Final = 60.0


def peak_mb(recording: Path, results: Path, stop: int, smooth: bool) -> float:
    """Peak memory of ``anchorpose track`` on the first frames; raises RuntimeError where it fails."""
    command = "from anchorpose.cli import main; main()"
    arguments = [sys.executable, "-c", command, "track", str(recording), "-o", str(results), "--stop", str(stop)]
    arguments += ["--smooth"] if smooth else []
    child = os.posix_spawn(sys.executable, arguments, dict(os.environ))
    _, status, used = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise RuntimeError(f"tracking {recording} failed")
    return used.ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--smooth", action="store_true", help="track with --smooth")
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder:
        longer = Path(folder) / "longer"
        play_longer(chosen.recording, longer, 60.0 * chosen.minutes)
        time_s = open_recording(longer).streams[0].time_s
        for frames in (int(np.searchsorted(time_s, time_s[0] + SHORT_S)), len(time_s)):
            peak = peak_mb(longer, Path(folder) / str(frames), frames, chosen.smooth)
            print(f"{frames} frames: {peak:.0f} MB", flush=True)


if __name__ == "__main__":
    main()
