"""What start-up and a frame cost: python benchmarks/speed.py --cameras 1 3 --seconds 6 --before OLD/src

A recording is simulated (or given: --recording FOLDER, as ``simulate`` writes it) and tracked in a process of its own,
on one thread, with the true body, so that learning is left out: the room (clocks, empty room, everybody in the sampled
frames, where to begin), then all frames, stored as ``track`` stores them. --before: the same with the package of
another ``src`` folder, for example of the commit before, just after; the ratios are to it. Seconds are the processor's:
they grow with what else the machine does, the ratios hardly; time passed is what a clock on the wall shows. --threads:
cameras and people shared among so many threads, as ``live`` does; the ratios are to one. Errors are those of all frames
but the first second's.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from anchorpose.body.skin_points import FittedShape, body_points, even_clothes
from anchorpose.calibration.clocks import ClockConfig
from anchorpose.motion.database_file import load_motions
from anchorpose.pipeline import TrackConfig
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread, worker_threads
from anchorpose.track_inputs import UserInputs, read_inputs
from anchorpose.tracker.journal import Journal
from anchorpose.tracker.passes import plan_route, track_on
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run
from anchorpose.tracker.stopwatch import Stopwatch

ONE_THREAD: Final = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
SCENES: Final = {1: presets.single, 3: presets.clinic}
SOURCE: Final = Path(__file__).resolve().parents[1] / "src"
CLOTHING_M: Final = 0.007  # of a simulated person
SKIP_S: Final = 1.0


def measure(simulated: Path, warm: bool) -> dict[str, Any]:
    """Seconds of the room, then of each stage from the second frame on; errors of the joints; warm: of two frames."""
    began, watch = time.process_time(), Stopwatch(time.process_time)
    config = TrackConfig(stop=2, clocks=ClockConfig(estimate=False)) if warm else TrackConfig()
    inputs = read_inputs(simulated / "recording", config, UserInputs(None, None))
    room = prepare_room(inputs.recording, config)
    room_s = time.process_time() - began
    motions = load_motions(config.motion_file, inputs.recording.rate_hz, config.motion)
    ticks, passed_s = list[float](), list[float]()

    def tick() -> None:
        if not ticks:
            watch.seconds.clear()  # the first pose is found
        ticks.append(time.process_time())
        passed_s.append(time.perf_counter())

    run, route = Run(room, config, motions, watch), plan_route(room, config, tick)
    with np.load(simulated / "truth/truth.npz") as truth, TemporaryDirectory() as folder:
        own = np.zeros(body_points().asset.shape_count - len(truth["shape_coefficients"]))
        shape = FittedShape(np.append(truth["shape_coefficients"], own), even_clothes(CLOTHING_M))
        shared = {"run": run, "room": room, "points": body_points(), "asset": body_points().asset}
        records = [tracked.record.joints for tracked in track_on(route, run, shape, Journal(Path(folder), shared))]
        seconds = time.process_time() - ticks[0]
        late = [joints for joints in records if joints.time_s >= SKIP_S]
        off = np.array([joints.position_m - truth["joints"][joints.frame] for joints in late]).reshape(-1, 21, 3)
    sigma = np.array([joints.sigma_m for joints in late]).reshape(-1, 21)
    stages = {**watch.seconds, "reading, storing, the rest": seconds - sum(watch.seconds.values())}
    return {
        "room_s": room_s,
        "clock_frames": room.clocks.frames_read,
        "frames": len(ticks) - 1,
        "stages": stages,
        "passed_ms": 1e3 * (passed_s[-1] - passed_s[0]) / max(len(passed_s) - 1, 1),
        "mean_mm": 1e3 * float(np.nanmean(np.linalg.norm(off, axis=2))) if late else None,
        "in_band": 100.0 * float((np.abs(off) < 1.96 * sigma[:, :, None]).mean()) if late else None,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def run_with(source: Path, simulated: Path, threads: int = 1) -> dict[str, Any]:
    """``measure`` in a process of its own with the package in ``source``, once its kernels are compiled."""
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(source)}
    command = [sys.executable, __file__, "--child", str(simulated), "--threads", str(threads)]
    subprocess.run([*command, "--warm"], env=environment, check=True, stdout=subprocess.DEVNULL)
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return dict(json.loads(done.stdout))


def report(now: dict[str, Any], before: dict[str, Any] | None) -> str:
    """The price of a frame by stage, then start-up, as Markdown; the ratios to another version where there is one."""

    def row(title: str, *values: float) -> str:
        ratio = "" if before is None or not values[1] else f"{values[0] / values[1]:.2f}"
        return f"| {title} | {' | '.join([*(f'{value:.1f}' for value in values), ratio])} |"

    runs = [now] if before is None else [now, before]
    lines = [f"| ms a frame | now | {'before | ' * (len(runs) - 1)}ratio |", "|---|" + "--:|" * (len(runs) + 1)]
    for stage in now["stages"]:
        lines.append(row(stage, *(1e3 * one["stages"].get(stage, 0.0) / one["frames"] for one in runs)))
    lines.append(row("**a frame**", *(1e3 * sum(one["stages"].values()) / one["frames"] for one in runs)))
    lines.append(row("time passed a frame, ms", *(one["passed_ms"] for one in runs)))
    lines.append(row("room, s", *(one["room_s"] for one in runs)))
    lines.append(row("depth images read for the clocks", *(one["clock_frames"] for one in runs)))
    lines.append(row("mean error, mm", *(one["mean_mm"] for one in runs)))
    lines.append(row("in 95 % band, %", *(one["in_band"] for one in runs)))
    lines.append(row("peak memory, MB", *(one["peak_mb"] for one in runs)))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--seconds", type=float, default=6.0, help="length of the recording, at 15 pictures a second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--recording", type=Path, nargs="*", help="simulated recordings instead: recording and truth")
    parser.add_argument("--before", type=Path, help="src folder of another version")
    parser.add_argument("--threads", type=int, default=1, help="compared with one thread")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--warm", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child is not None:
        with one_thread(), worker_threads(chosen.threads):
            print(json.dumps(measure(chosen.child, chosen.warm)))
        return
    with TemporaryDirectory() as folder:
        simulated = chosen.recording or [Path(folder) / str(cameras) for cameras in chosen.cameras]
        for cameras, out in zip(chosen.cameras, simulated, strict=False):
            if chosen.recording is None:
                simulate_recording(out, SCENES[cameras](chosen.seed, chosen.seconds))
        for out in simulated:
            now = run_with(SOURCE, out, chosen.threads)
            compared = chosen.before or (SOURCE if chosen.threads > 1 else None)
            before = None if compared is None else run_with(compared, out)
            print(f"\n{out.name}\n\n{report(now, before)}", flush=True)


if __name__ == "__main__":
    main()
