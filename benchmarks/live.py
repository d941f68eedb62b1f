"""Latency of live tracking, from image to client: python benchmarks/live.py RECORDING --minutes 10.

The recording is played at its own pace, forward and backward, for as long as asked, by ``anchorpose live`` as a process
of its own. With --lsl, a Lab Streaming Layer client receives the joints, and its latencies are what is printed: from
the time at which an image was taken to the joints' arrival, median and 99 % of every minute. Without it, they are those
that the process measures when it sends. Memory: the largest resident set of every minute.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from anchorpose.recording.reader import open_recording


def main() -> None:
    """Prints one line a minute."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--lsl", action="store_true")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "played"
        play_longer(chosen.recording, folder, 60.0 * chosen.minutes + 120.0)
        command = [sys.executable, "-c", "import sys; from anchorpose.cli import main; sys.exit(main())", "live"]
        command += [str(folder), "-o", str(Path(work) / "results"), "--seconds", f"{60.0 * chosen.minutes:g}"]
        with subprocess.Popen([*command, *(["--lsl"] if chosen.lsl else [])]) as process:
            if chosen.lsl:
                _receive(process)
            else:
                for minute, kilobytes in _memory(process):
                    print(f"minute {minute}: at most {kilobytes / 1000:.0f} MB", flush=True)


def play_longer(recording: Path, out: Path, seconds: float) -> None:
    """A recording that goes forward and backward through another one; its images are links."""
    opened = open_recording(recording)
    period_s = 1.0 / opened.rate_hz
    out.mkdir()
    for path in recording.iterdir():
        if path.is_file():
            shutil.copyfile(path, out / path.name)
    length = min(len(stream.files) for stream in opened.streams)
    there = [*range(length), *range(length - 2, 0, -1)]
    for camera, stream in zip(opened.cameras, opened.streams, strict=True):
        folder = out / camera.name
        (folder / "depth").mkdir(parents=True)
        if (recording / camera.name / "background.png").exists():
            shutil.copyfile(recording / camera.name / "background.png", folder / "background.png")
        rows = ["frame,time_s"]
        for number in range(int(seconds / period_s)):
            os.link(stream.files[there[number % len(there)]], folder / "depth" / f"{number:06d}.png")
            rows.append(f"{number},{float(stream.time_s[0]) + number * period_s:.6f}")
        (folder / "timestamps.csv").write_text("\n".join(rows) + "\n")


def _memory(process: subprocess.Popen[bytes]) -> Iterator[tuple[int, int]]:
    """The largest resident set of each minute, in kB."""
    began, largest, minute = time.monotonic(), 0, 0
    while process.poll() is None:
        largest = max(largest, _resident_kb(process.pid))
        if time.monotonic() - began >= 60.0 * (minute + 1):
            minute += 1
            yield minute, largest
            largest = 0
        time.sleep(0.5)


def _resident_kb(pid: int) -> int:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0)


def _receive(process: subprocess.Popen[bytes]) -> None:
    """Latencies at a client, minute by minute."""
    import pylsl

    inlet, latencies, began, minute = None, list[float](), time.monotonic(), 0
    while process.poll() is None:
        if inlet is None:
            found = pylsl.resolve_byprop("name", "anchorpose", timeout=1.0)
            inlet = pylsl.StreamInlet(found[0]) if found else None
            began = time.monotonic()
            continue
        sample, stamp = inlet.pull_sample(timeout=0.5)
        if sample is not None:
            latencies.append(pylsl.local_clock() - stamp)
        if time.monotonic() - began >= 60.0 * (minute + 1) and latencies:
            minute += 1
            median_s, p99_s = np.quantile(latencies, [0.5, 0.99])
            delay = f"median {1000 * median_s:.0f} ms, 99 % {1000 * p99_s:.0f} ms"
            memory_mb = _resident_kb(process.pid) / 1000
            print(f"minute {minute}: {len(latencies)} frames, {delay}, {memory_mb:.0f} MB", flush=True)
            latencies = []


if __name__ == "__main__":
    main()
