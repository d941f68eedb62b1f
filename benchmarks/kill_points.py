"""Kill a run at random and let it go on: python benchmarks/kill_points.py RECORDING --kills 100 [--smooth].

The recording is tracked once without a break. Then it is tracked by processes that are killed (SIGKILL) after a random
time, until --kills processes were killed; one more process goes on to the end. All tables, pictures and run.json
(except its timings) must be the same as without a break, byte by byte. The log and the report are not compared, since
they state when they were made. If a run ends before it is killed, the next process begins another run.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from anchorpose.pipeline import track_recording
from anchorpose.results.unfinished import unfinished_results
from anchorpose.results.verify import LOG_FILE
from anchorpose.tracker import passes
from anchorpose.tracker.config import TrackConfig

WITH_TIMES: Final = {"report.html", LOG_FILE, f".{LOG_FILE}.lock"}


def main() -> None:
    """Kill, go on, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--smooth", action="store_true")
    parser.add_argument("--stop", type=int, help="track the frames before this one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--block", type=int, default=passes.BLOCK, help="frames stored at once: few of a short one")
    options = parser.parse_args()
    passes.BLOCK = options.block  # type: ignore[misc]  # forked processes also have this value
    config = replace(TrackConfig(), smooth=options.smooth, stop=options.stop)
    with TemporaryDirectory() as work:
        whole, killed = Path(work) / "whole", Path(work) / "killed"
        _track(options.recording, whole, config)  # compiles
        began = time.perf_counter()
        _track(options.recording, killed, config)
        longest_s, runs, wrong = time.perf_counter() - began, 1, _differences(whole, killed)
        shutil.rmtree(killed)
        done, rng = 0, random.Random(options.seed)
        while done < options.kills:
            done += _killed_after(rng.uniform(0.0, longest_s), options.recording, killed, config)
            if done == options.kills and not killed.exists():
                _track(options.recording, killed, config)
            if killed.exists():
                runs += 1
                wrong += _differences(whole, killed)
                shutil.rmtree(killed)
            print(f"{done} kills, {runs} runs ended, {len(wrong)} files differ", file=sys.stderr, flush=True)
    print(f"killed {done} times in {runs} runs of {longest_s:.0f} s; files that differ: {', '.join(wrong) or 'none'}")
    sys.exit(1 if wrong else 0)


def _track(recording: Path, results: Path, config: TrackConfig) -> None:
    with unfinished_results(results, recording, resume=True) as folder:
        track_recording(recording, folder, config, lambda done, total: None)


def _killed_after(seconds: float, recording: Path, results: Path, config: TrackConfig) -> bool:
    """Track in a process, and kill it after some seconds; return False if it ended before it was killed."""
    child = os.fork()
    if child == 0:
        _track(recording, results, config)
        os._exit(0)
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            if status:
                sys.exit(f"a run that went on failed: status {status}")
            return False
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def _differences(one: Path, other: Path) -> list[str]:
    names = {path.relative_to(root).as_posix() for root in (one, other) for path in root.rglob("*") if path.is_file()}
    return sorted(name for name in names - WITH_TIMES if _content(one / name) != _content(other / name))


def _content(path: Path) -> bytes:
    if not path.is_file():
        return b"absent"
    if path.name != "run.json":
        return path.read_bytes()
    run = json.loads(path.read_text(encoding="utf-8"))
    del run["timings"]
    return json.dumps(run).encode()


if __name__ == "__main__":
    main()
