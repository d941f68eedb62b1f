"""Time of the local descriptors, ours and PCL's, in one run on one core: python benchmarks/features.py.

A standing figure as a Kinect v2 sees it, near enough for the wanted number of nodes (about 4,000 and 15,000), every
second pixel; radii of 5 and 10 cm, all nodes; of the shape context every tenth, because PCL searches the neighbours of
every neighbour. PCL is built here from tests/pcl_reference with Debian's libpcl-dev (apt install libpcl-dev
libboost-dev libeigen3-dev cmake g++), as the distribution compiled it, and with --native its templates for this
processor. Both alternate on the same float32 mesh; each time includes the search of the neighbours, and local
frames where a descriptor has them. Prints medians in ms per frame, and the speed ratio.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

os.environ.update(OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1")  # before threads start

import numpy as np
from test_kernels import camera_at, render

from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics
from anchorpose.research.features.fpfh import FpfhConfig, fpfh
from anchorpose.research.features.rops import RopsConfig, rops
from anchorpose.research.features.shape_context import ShapeContextConfig, shape_context
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.surface.mesh import build_surface, faces
from anchorpose.surface.surface import Surface, SurfaceConfig

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "pcl_reference"))
from pcl import ask, build

RADII_M = (0.05, 0.10)
EVERY = {"context": 10}


def figure(zoom: float) -> Surface:
    """The standing figure, seen with ``zoom`` times a Kinect's pixels along each side."""
    plain = camera_at(0.0)
    lens = Intrinsics(fx=365.0 * zoom, fy=365.0 * zoom, cx=256.0 * zoom, cy=212.0 * zoom)
    size = {"width": int(512 * zoom), "height": int(424 * zoom)}
    camera = Camera(name="front", **size, depth_scale=0.001, intrinsics=lens, T_world_camera=plain.require_pose())
    depth = render(camera, 0)
    return build_surface(depth, depth > 0, camera, SurfaceConfig(step=2))


def ours(name: str, surface: Surface, triangles: np.ndarray, chosen: np.ndarray, radius_m: float) -> Callable:
    """One frame's work, to be timed."""
    points, normals = surface.points_m, surface.normals
    calls: dict[str, Callable[[], np.ndarray]] = {
        "fpfh": lambda: fpfh(points, normals, FpfhConfig(radius_m=radius_m), chosen),
        "shot": lambda: shot(points, normals, ShotConfig(radius_m=radius_m), chosen),
        "context": lambda: shape_context(points, normals, ShapeContextConfig(radius_m=radius_m), chosen),
        "rops": lambda: rops(points, triangles, RopsConfig(radius_m=radius_m), chosen),
    }
    return calls[name]


def timed_ms(work: Callable) -> float:
    begin = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - begin)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--native", action="store_true", help="compile PCL's templates for this processor")
    parser.add_argument(
        "--zoom", type=float, nargs="+", default=[1.15, 2.25], help="pixels along a side, of a Kinect's"
    )
    parser.add_argument("--build", type=Path, default=Path("build") / "pcl_features", help="where to compile")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    try:
        program = build(arguments.build, arguments.native)
    except RuntimeError as error:
        sys.exit(f"features.py: {error}")
    print("| descriptor | nodes | radius, cm | described | ours, ms | PCL, ms | times as fast |")
    print("|---|---|---|---|---|---|---|")
    for zoom in arguments.zoom:
        surface = figure(zoom)
        triangles = faces(surface)
        for radius in RADII_M:
            for name in ("fpfh", "shot", "context", "rops"):
                chosen = np.arange(0, len(surface), EVERY.get(name, 1), dtype=np.int32)
                work = ours(name, surface, triangles, chosen, radius)
                work()  # compiles
                mesh = (surface.points_m, surface.normals, triangles, chosen, radius)
                pairs = [(timed_ms(work), ask(program, name, *mesh)[1][0]) for _ in range(arguments.runs)]
                own, other = (median(times) for times in zip(*pairs, strict=True))
                print(
                    f"| {name} | {len(surface)} | {100 * radius:.0f} | {len(chosen)} "
                    f"| {own:.1f} | {other:.1f} | {other / own:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
