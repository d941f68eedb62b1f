"""What `anchorpose convert` costs: a minute of 640 x 576 at 30 per second, simulated Azure Kinect depth.

    .venv/bin/python benchmarks/convert.py [INPUT [CONVERT'S OPTIONS...]]

Prints seconds of one core and the most memory held; without INPUT for an array of two simulated seconds again and again
(the noise of each image is its own) and for the same images as PNG files. Another INPUT is converted as it is.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.write import simulate_recording

FRAMES, SIMULATED = 1800, 60

GIVEN = ["--intrinsics", "504,504,320,288", "--depth-scale", "0.001", "--fps", "30"]

SCRIPT = """
import sys, time
from anchorpose.cli import main
code = main(sys.argv[1:])
with open("/proc/self/status") as status:  # getrusage would count what the parent held when it forked
    peak = next(line.split()[1] for line in status if line.startswith("VmHWM"))
print(time.process_time(), peak)
sys.exit(code)
"""


def minute_of_depth(folder: Path) -> tuple[Path, Path]:
    """An .npy file and a folder of PNG images."""
    config = SimulationConfig(seconds=SIMULATED / 30, fps=30.0, cameras=1, seed=5, sensor="azure-kinect")
    simulate_recording(folder / "simulated", config)
    files = sorted((folder / "simulated" / "recording").glob("*/depth/*.png"))
    seen = np.stack([cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files])
    array = np.lib.format.open_memmap(folder / "minute.npy", "w+", np.uint16, (FRAMES, *seen.shape[1:]))
    images = folder / "images"
    images.mkdir()
    for k in range(FRAMES):
        array[k] = seen[k % len(seen)]
        cv2.imwrite(str(images / f"{k:06d}.png"), array[k], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    array.flush()
    return folder / "minute.npy", images


def measure(source: Path, out: Path, options: list[str]) -> None:
    """Converts in a process of its own, whose time and memory are then known."""
    arguments = ["convert", str(source), str(out), *options]
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", SCRIPT, *arguments], check=True, stdout=subprocess.PIPE, text=True)
    seconds, memory_kb = done.stdout.splitlines()[-1].split()
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    print(
        f"{source.name}: {float(seconds):.1f} s of one core, {time.perf_counter() - start:.1f} s by the clock, at most "
        f"{int(memory_kb) / 1024:.0f} MB of memory, {size / 1e6:.0f} MB written"
    )


def main() -> None:
    """Measures the given input, or both forms of a simulated minute."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if len(sys.argv) > 1:
            measure(Path(sys.argv[1]), folder / "out", sys.argv[2:])
            return
        for k, source in enumerate(minute_of_depth(folder)):
            measure(source, folder / f"out{k}", GIVEN)


if __name__ == "__main__":
    main()
