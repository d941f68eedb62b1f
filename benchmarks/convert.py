"""What `anchorpose convert` costs: a minute of 640 x 576 at 30 per second, simulated Azure Kinect depth.

    .venv/bin/python benchmarks/convert.py [INPUT [CONVERT'S OPTIONS...]]

Prints seconds of one core and the most memory held; without INPUT for two simulated seconds again and again (the noise
of each image is its own) as an array, as PNG files, as Azure Kinect's .mkv and as bags of ROS 1 and 2, which need 2 GB
of disk one after the other. Another INPUT is converted as it is.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
from azure_builder import calibration
from bags_builder import Info, Sent, image_of, write_bag

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


def simulated(folder: Path) -> np.ndarray:
    """(SIMULATED, 576, 640) uint16 millimetres."""
    config = SimulationConfig(seconds=SIMULATED / 30, fps=30.0, cameras=1, seed=5, sensor="azure-kinect")
    simulate_recording(folder / "simulated", config)
    files = sorted((folder / "simulated" / "recording").glob("*/depth/*.png"))
    return np.stack([cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files])


def minute(seen: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Time in microseconds, and depth image."""
    return ((k * 1_000_000 // 30, seen[k % len(seen)]) for k in range(FRAMES))


def array(folder: Path, seen: np.ndarray) -> Path:
    values = np.lib.format.open_memmap(folder / "minute.npy", "w+", np.uint16, (FRAMES, *seen.shape[1:]))
    for k, (_, image) in enumerate(minute(seen)):
        values[k] = image
    values.flush()
    return folder / "minute.npy"


def images(folder: Path, seen: np.ndarray) -> Path:
    (folder / "images").mkdir()
    for k, (_, image) in enumerate(minute(seen)):
        cv2.imwrite(str(folder / "images" / f"{k:06d}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return folder / "images"


def azure_kinect(folder: Path, seen: np.ndarray) -> Path:
    """Depth as the recorder writes it, without colour and infrared."""
    path, (_, height, width) = folder / "minute.mkv", seen.shape
    with av.open(str(path), "w", format="matroska", container_options={"allow_raw_vfw": "1"}) as container:
        stream = container.add_stream("rawvideo", rate=30, width=width, height=height, pix_fmt="gray16be")
        stream.metadata["title"] = "DEPTH"
        container.add_attachment("calibration.json", "application/octet-stream", calibration())
        for time_us, image in minute(seen):
            packet = av.Packet(image.astype(">u2").tobytes())
            packet.stream, packet.time_base = stream, Fraction(1, 1000)
            packet.pts = packet.dts = time_us // 1000
            container.mux(packet)
    with path.open("r+b") as file:  # PyAV leaves out the four letters of the recorder's format
        described = struct.pack("<IiiHH", 40, width, -height, 1, 16)
        file.seek(file.read(65536).index(described) + len(described))
        file.write(b"b16g")
    return path


def bag(form: str) -> Callable[[Path, np.ndarray], Path]:
    """form: one of ``bags_builder.FORMATS``."""

    def write(folder: Path, seen: np.ndarray) -> Path:
        return write_bag(folder, form, messages(seen))

    return write


def messages(seen: np.ndarray) -> Iterator[Sent]:
    """A driver's depth topic with its lens."""
    lens = Info(width=seen.shape[2], height=seen.shape[1], K=(504.0, 0, 320, 0, 504, 288, 0, 0, 1))
    yield Sent("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", 1, lens)
    for time_us, image in minute(seen):
        stamp_ns = 1_700_000_000_000_000_000 + time_us * 1000
        yield Sent("/camera/depth/image_raw", "sensor_msgs/msg/Image", stamp_ns, image_of(image, "16UC1", stamp_ns))


MADE: dict[str, tuple[Callable[[Path, np.ndarray], Path], list[str]]] = {
    "array": (array, GIVEN),
    "PNG files": (images, GIVEN),
    "Azure Kinect": (azure_kinect, []),
    **{form: (bag(form), []) for form in ("ros1", "ros1-lz4", "db3", "mcap", "mcap-zstd")},
}


def measure(name: str, source: Path, out: Path, options: list[str]) -> None:
    """Converts in a process of its own, whose time and memory are then known."""
    arguments = ["convert", str(source), str(out), *options]
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", SCRIPT, *arguments], check=True, stdout=subprocess.PIPE, text=True)
    seconds, memory_kb = done.stdout.splitlines()[-1].split()
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    print(
        f"{name}: {float(seconds):.1f} s of one core, {time.perf_counter() - start:.1f} s by the clock, at most "
        f"{int(memory_kb) / 1024:.0f} MB of memory, {size / 1e6:.0f} MB written"
    )


def main() -> None:
    """Measures the given input, or a simulated minute in each format."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if len(sys.argv) > 1:
            measure(Path(sys.argv[1]).name, Path(sys.argv[1]), folder / "out", sys.argv[2:])
            return
        seen = simulated(folder)
        for form, (write, options) in MADE.items():
            with tempfile.TemporaryDirectory(dir=folder) as inside:
                measure(form, write(Path(inside), seen), Path(inside) / "out", options)


if __name__ == "__main__":
    main()
