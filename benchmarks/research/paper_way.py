"""Time the paper's way and ours from a depth frame to five geodesic fields: python benchmarks/research/paper_way.py

The paper smooths and triangulates the point cloud with PCL and runs Dijkstra along the edges of the mesh. The folder
paper_way/ has this method as a C++ program, built here with CMake against Debian's libpcl-dev (apt install libpcl-dev
libboost-graph-dev cmake g++). Both methods run in turn on one core, from the same noisy pixels, each after a run to
warm up. Each method's distances are compared with the exact distances (pygeodesic) on its own mesh.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from pygeodesic.geodesic import PyGeodesicAlgorithmExact

from anchorpose.camera import Camera
from anchorpose.geodesics.anchors import find_anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.mesh import build_surface, faces
from anchorpose.surface.surface import SurfaceConfig

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from test_kernels import FACING, HEIGHT_M, UP, camera_at, largest_piece, manifold, render

PROGRAM = Path(__file__).parent / "paper_way"
TO_INSTALL = "needs PCL and a compiler: apt install libpcl-dev libboost-graph-dev cmake g++"
STEPS = ("smoothing", "triangulation", "graph", "dijkstra")


@dataclass(frozen=True, slots=True)
class Way:
    """One run of a method: mesh (metres, world), fields (s, n) from the sources (s,), and milliseconds of each step."""

    points_m: np.ndarray
    triangles: np.ndarray
    sources: np.ndarray
    fields_m: np.ndarray
    times_ms: dict[str, float]


def build(folder: Path) -> Path:
    """Compile the C++ program. If a tool or library to build it is missing, end with one sentence."""
    if shutil.which("cmake") is None:
        sys.exit(f"paper_way.py {TO_INSTALL}")
    for command in (["cmake", "-S", str(PROGRAM), "-B", str(folder)], ["cmake", "--build", str(folder)]):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            print(done.stderr, file=sys.stderr)
            sys.exit(f"paper_way.py {TO_INSTALL}")
    return folder / "paper_way"


def run_paper(program: Path, cloud_m: np.ndarray, sources: np.ndarray, radius_m: float, folder: Path) -> Way:
    """Run the C++ program on points (n, 3). sources: (s,) indices of the points to measure distances from."""
    counts = np.array([len(cloud_m), len(sources)], np.int32)
    parts = [counts, cloud_m.astype(np.float32), sources.astype(np.int32)]
    (folder / "cloud").write_bytes(b"".join(part.tobytes() for part in parts))
    command = [str(program), str(folder / "cloud"), str(folder / "mesh"), str(radius_m)]
    times = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    raw = (folder / "mesh").read_bytes()
    nodes, triangles, fields = np.frombuffer(raw, np.int32, 3)
    words = np.frombuffer(raw, np.int32, offset=12)
    ends = np.cumsum([3 * nodes, 3 * triangles, fields, fields * nodes])
    points, corners, starts, distances = np.split(words, ends)[:4]
    return Way(
        points.view(np.float32).reshape(-1, 3),
        corners.reshape(-1, 3),
        starts,
        distances.view(np.float32).reshape(fields, nodes),
        {name: times[name] for name in STEPS},
    )


def run_ours(depth_m: np.ndarray, camera: Camera, pixels: np.ndarray, step: int) -> Way:
    """Run build_surface and geodesic_distance from the nodes nearest to pixels (s, 2), after a run to warm up."""
    config = SurfaceConfig(step=step)
    geodesic_distance(build_surface(depth_m, depth_m > 0, camera, config), np.zeros(5, np.int32))
    begin = time.perf_counter()
    surface = build_surface(depth_m, depth_m > 0, camera, config)
    meshed = time.perf_counter()
    away = ((surface.pixel[None].astype(np.int64) - pixels[:, None]) ** 2).sum(axis=2)
    sources = away.argmin(axis=1).astype(np.int32)
    chosen = time.perf_counter()
    fields = geodesic_distance(surface, sources)
    times = {"meshing": 1e3 * (meshed - begin), "fields": 1e3 * (time.perf_counter() - chosen)}
    return Way(surface.points_m, faces(surface), sources, fields, times)


def errors_mm(way: Way) -> np.ndarray:
    """Return a method's errors at nodes of the largest piece of its mesh, against the exact distances on this mesh."""
    used, corners = np.unique(largest_piece(manifold(way.triangles), len(way.points_m)), return_inverse=True)
    solver = PyGeodesicAlgorithmExact(way.points_m[used].astype(np.float64), corners.reshape(-1, 3).astype(np.int32))
    off = []
    for source, found in zip(way.sources, way.fields_m[:, used], strict=True):
        if source in used:  # false on a small component that an edge connects to the rest
            exact = solver.geodesicDistances(np.array([np.searchsorted(used, source)], np.int32), None)[0]
            both = np.isfinite(found) & np.isfinite(exact)
            off.append(np.abs(found[both] - exact[both]))
    return 1e3 * np.concatenate(off)


def row(title: str, runs: list[Way]) -> str:
    """Return a row of the table: medians over the runs."""
    steps = {name: median(run.times_ms[name] for run in runs) for name in runs[0].times_ms}
    total_ms = median(sum(run.times_ms.values()) for run in runs)
    last, error = runs[-1], errors_mm(runs[-1])
    described = ", ".join(f"{name} {ms:.2f}" for name, ms in steps.items())
    reached = 100 * np.isfinite(last.fields_m).mean()
    sizes = f"{len(last.points_m)} | {len(last.triangles)} | {reached:.1f} %"
    return f"| {title} | {described} | {total_ms:.2f} | {sizes} | {error.mean():.1f} / {error.max():.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=11)
    parser.add_argument("--radius", type=float, default=0.025, help="search radius of the triangulation, metres")
    parser.add_argument("--build", type=Path, default=Path("build") / "paper_way", help="where to compile")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    os.environ["OMP_NUM_THREADS"] = "1"
    program = build(arguments.build)
    camera = camera_at(0.0)
    depth = render(camera, 0)
    surface = build_surface(depth, depth > 0, camera, SurfaceConfig(step=1))
    anchors = find_anchors(surface, UP, FACING, HEIGHT_M)
    pixels = surface.pixel[anchors.node[anchors.found]].astype(np.int64)
    seen = np.argwhere(depth > 0)
    cloud = camera.back_project(depth)[depth > 0]
    away = ((seen[None] - pixels[:, None]) ** 2).sum(axis=2)
    paper: list[Way] = []
    ours: dict[int, list[Way]] = {1: [], 2: []}
    with TemporaryDirectory() as folder:
        first = run_paper(program, cloud, away.argmin(axis=1), arguments.radius, Path(folder))
        meshed = np.unique(largest_piece(manifold(first.triangles), len(cloud)))  # greedy projection leaves tips out
        starts = meshed[away[:, meshed].argmin(axis=1)]
        for _ in range(arguments.runs):
            paper.append(run_paper(program, cloud, starts, arguments.radius, Path(folder)))
            for step, runs in ours.items():
                runs.append(run_ours(depth, camera, pixels, step))
    columns = ("way", "steps, ms", "all, ms", "nodes", "triangles", "reached", "error mean / max, mm")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    print(row("the paper's: PCL, Boost", paper))
    for step, runs in ours.items():
        print(row(f"anchorpose, {('every', 'every second')[step - 1]} pixel", runs))


if __name__ == "__main__":
    main()
