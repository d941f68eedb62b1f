"""Builds and runs pcl_features, the program that asks the Point Cloud Library for its descriptors."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

SIZES = {"fpfh": 33, "frame": 9, "shot": 352, "turn": 9, "context": 1980, "unique": 1960, "rops": 135}
TO_INSTALL = "PCL and a compiler are needed: apt install libpcl-dev libboost-dev libeigen3-dev cmake g++"


def build(folder: Path, native: bool = False) -> Path:
    """The compiled program; RuntimeError with one sentence where something to build it with is missing."""
    if shutil.which("cmake") is None:
        raise RuntimeError(TO_INSTALL)
    configure = ["cmake", "-S", str(Path(__file__).parent), "-B", str(folder), f"-DNATIVE={'ON' if native else 'OFF'}"]
    for command in (configure, ["cmake", "--build", str(folder)]):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{TO_INSTALL}\n{done.stdout}{done.stderr}")
    return folder / "pcl_features"


def ask(
    program: Path,
    name: str,
    points_m: np.ndarray,
    normals: np.ndarray,
    triangles: np.ndarray,
    chosen: np.ndarray,
    radius_m: float,
    runs: int = 1,
) -> tuple[np.ndarray, list[float]]:
    """PCL's rows (k, SIZES[name]) float32 of the chosen points, and the milliseconds of each run on one thread."""
    counts = np.array([len(points_m), len(triangles), len(chosen)], np.int32)
    parts = [counts, points_m.astype(np.float32), normals.astype(np.float32), triangles.astype(np.int32)]
    parts.append(chosen.astype(np.int32))
    with TemporaryDirectory() as scratch:
        cloud, out = Path(scratch) / "cloud", Path(scratch) / "rows"
        cloud.write_bytes(b"".join(part.tobytes() for part in parts))
        command = [str(program), str(cloud), repr(radius_m), name, str(runs), str(out)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        return np.fromfile(out, np.float32).reshape(len(chosen), SIZES[name]), json.loads(done.stdout)
