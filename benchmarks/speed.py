"""What a frame costs: python benchmarks/speed.py --cameras 1 3 --seconds 20

Whether memory grows: python benchmarks/speed.py --recording FOLDER --minutes 10 [--smooth], which goes forward and
backward through a short recording for so long, and compares the first minute with all of it.

A recording is simulated (or given: --recording FOLDER) and tracked three times as a whole process held to one core:
once to compile and to warm the disk, then its first third, then all of it. What the longer run takes more, divided by
the frames it has more, is the price of a frame; what is left of the shorter one is start-up, which the room, the clocks
and learning the body take. Times are the processor's, so that what else the machine does counts little; on an idle
machine they are those of the clock. Peak memory of both runs tells whether it grows with the recording.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from live import play_longer

from anchorpose.body.config import LearningConfig
from anchorpose.recording.reader import open_recording
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording

ONE_THREAD: Final = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
SCENES: Final = {1: presets.single, 3: presets.clinic}
STARTING: Final = ("calibration and background", "first pose", "body shape", "results")
"""Stages that a recording pays once, however long it is."""


@dataclass(frozen=True, slots=True)
class Run:
    """One tracked recording: processor seconds in all and by stage, frames, peak memory in MB."""

    seconds: float
    stages: dict[str, float]
    frames: int
    peak_mb: float


def track(recording: Path, results: Path, stop: int, smooth: bool) -> Run:
    """``anchorpose track`` as a process of its own on one core; raises RuntimeError where it fails."""
    command = "from anchorpose.cli import main; main()"
    arguments = [sys.executable, "-c", command, "track", str(recording), "-o", str(results), "--stop", str(stop)]
    arguments += ["--smooth"] if smooth else []
    began = time.perf_counter()
    child = os.fork()
    if child == 0:
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.execve(sys.executable, arguments, os.environ | ONE_THREAD)
    _, status, used = os.wait4(child, 0)
    if status != 0:
        raise RuntimeError(f"tracking {recording} failed")
    seconds = used.ru_utime + used.ru_stime
    share = seconds / (time.perf_counter() - began)  # of the clock's seconds, in which run.json has the stages
    timings = json.loads((results / "run.json").read_text())["timings"]
    stages = {entry["stage"]: share * entry["seconds"] for entry in timings}
    return Run(seconds, stages, stop, used.ru_maxrss / 1024)


def measure(recording: Path, results: Path, short_s: float | None = None, smooth: bool = False) -> tuple[Run, Run]:
    """The first third, or the first ``short_s``, and the whole, after a run that compiles what is not compiled yet."""
    time_s = open_recording(recording).streams[0].time_s
    frames = len(time_s)
    part = frames // 3 if short_s is None else int(np.searchsorted(time_s, time_s[0] + short_s))
    if part == frames or time_s[part] - time_s[0] < LearningConfig().window_s:
        raise SystemExit(f"{recording} is too short: its first part must hold the seconds that the body is learnt from")
    track(recording, results / "warm", min(frames, 20), smooth)
    return track(recording, results / "part", part, smooth), track(recording, results / "whole", frames, smooth)


def report(part: Run, whole: Run) -> str:
    """The price of a frame, by stage, as Markdown."""
    more = whole.frames - part.frames
    price = (whole.seconds - part.seconds) / more
    rows = {
        stage: 1000.0 * (seconds - part.stages.get(stage, 0.0)) / more
        for stage, seconds in whole.stages.items()
        if stage not in STARTING
    }
    rest = 1000.0 * price - sum(rows.values())
    lines = ["| stage | ms a frame |", "|---|--:|"]
    lines += [f"| {stage} | {ms:.1f} |" for stage, ms in rows.items()]
    lines += [f"| reading, writing, the rest | {rest:.1f} |", f"| **a frame** | **{1000.0 * price:.1f}** |"]
    lines.append(f"\nstart-up {part.seconds - price * part.frames:.1f} s; whole run {whole.seconds:.1f} s")
    lines.append(
        f"peak memory {part.peak_mb:.0f} MB for {part.frames} frames, {whole.peak_mb:.0f} MB for {whole.frames}"
    )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the recording, at 15 pictures a second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--recording", type=Path, help="a recording folder instead of simulated ones")
    parser.add_argument("--minutes", type=float, help="so long, forward and backward through that recording")
    parser.add_argument("--smooth", action="store_true", help="track with --smooth")
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder:
        if chosen.recording is not None:
            recording, short_s = chosen.recording, None
            if chosen.minutes is not None:
                recording, short_s = Path(folder) / "longer", 60.0
                play_longer(chosen.recording, recording, 60.0 * chosen.minutes)
            print(report(*measure(recording, Path(folder), short_s, chosen.smooth)))
            return
        for cameras in chosen.cameras:
            out = Path(folder) / str(cameras)
            simulate_recording(out, SCENES[cameras](chosen.seed, chosen.seconds))
            print(
                f"\n{cameras} camera{'s' if cameras > 1 else ''}\n\n{report(*measure(out / 'recording', out))}",
                flush=True,
            )


if __name__ == "__main__":
    main()
