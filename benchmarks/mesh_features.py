"""Time of MeshHOG and LD-SIFT per frame: OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/mesh_features.py

The mean adult in front of a Kinect v2 at two distances, meshed on every second pixel to about 2,300 and 4,000 nodes.
Beside each descriptor the time of its plain numpy version (tests/builders/features_plain.py), extrapolated from some
nodes of the frame. Times are medians of processor time, without compilation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
from test_kernels import camera_at, render

from anchorpose.research.features.ld_sift import Angle, LdSiftConfig, Scale, ld_sift
from anchorpose.research.features.mesh_gradient import mesh_gradient, principal_curvatures
from anchorpose.research.features.mesh_hog import FirstAxis, MeshHogConfig, mesh_hog, scalar_function
from anchorpose.research.features.nearest import Metric, nearest_descriptor
from anchorpose.research.features.rings import rings_within
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import Surface, SurfaceConfig

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))
from features_plain import plain_ld_sift, plain_mesh_hog

DISTANCES_M = (2.75, 2.1)
PLAIN_NODES = 20
REPEATS = 7


def milliseconds(step: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median processor time of a step."""
    step()
    times = []
    for _ in range(repeats):
        began = time.process_time()
        step()
        times.append(time.process_time() - began)
    return 1000.0 * median(times)


def figure(distance_m: float) -> Surface:
    """What a camera so far away sees."""
    camera = camera_at(0.0)
    pose = camera.require_pose().copy()
    pose[0, 3] = distance_m
    camera = replace(camera, T_world_camera=pose)
    depth = render(camera, 0)
    return build_surface(depth, depth > 0, camera, SurfaceConfig(step=2))


def parts(surface: Surface) -> dict[str, Callable[[], object]]:
    """What the descriptors are made of."""
    values = principal_curvatures(surface, 0.07)[:, 0]
    return {
        "neighbours within 0.1 m": lambda: rings_within(surface, 0.1),
        "neighbours within 0.2 m": lambda: rings_within(surface, 0.2),
        "curvature, 0.07 m": lambda: principal_curvatures(surface, 0.07),
        "gradient": lambda: mesh_gradient(surface, values),
    }


def matches(surface: Surface) -> dict[str, Callable[[], object]]:
    """Every node's nearest descriptor among all nodes."""
    table = ld_sift(surface)
    return {f"nearest of 128 columns, {metric}": lambda metric=metric: nearest_descriptor(table, table, metric)
            for metric in Metric}  # fmt: skip


def compare_hog(surface: Surface, config: MeshHogConfig, label: str) -> None:
    gradients = mesh_gradient(surface, scalar_function(surface, config))
    report(
        f"MeshHOG {label}", surface, lambda: mesh_hog(surface, config),
        lambda node: plain_mesh_hog(surface, config, gradients, node),
    )  # fmt: skip


def compare_sift(surface: Surface, config: LdSiftConfig, label: str) -> None:
    report(
        f"LD-SIFT {label}", surface, lambda: ld_sift(surface, config), lambda node: plain_ld_sift(surface, config, node)
    )


def report(label: str, surface: Surface, ours: Callable[[], object], plain: Callable[[int], object]) -> None:
    own = milliseconds(ours)
    some = np.linspace(0, len(surface) - 1, PLAIN_NODES).astype(int)
    slow = milliseconds(lambda: [plain(node) for node in some], 1) * len(surface) / PLAIN_NODES
    print(f"  {label:36s} {own:8.1f} ms   plain {slow / 1000.0:7.1f} s, {slow / own:5.0f} times as long")


def main() -> None:
    for distance_m in DISTANCES_M:
        surface = figure(distance_m)
        print(f"{len(surface)} nodes")
        for label, step in (parts(surface) | matches(surface)).items():
            print(f"  {label:36s} {milliseconds(step):8.1f} ms")
        for radius_m in (0.1, 0.2):
            compare_hog(surface, MeshHogConfig(radius_m=radius_m), f"{radius_m} m")
        compare_hog(surface, MeshHogConfig(first_axis=FirstAxis.GRADIENT), "0.2 m, gradient")
        for radius_m in (0.1, 0.15):
            compare_sift(surface, LdSiftConfig(radius_m=radius_m), f"{radius_m} m")
        compare_sift(surface, LdSiftConfig(angle=Angle.PEAK), "0.15 m, peak")
        compare_sift(surface, LdSiftConfig(scale=Scale.INTRINSIC), "intrinsic scale")


if __name__ == "__main__":
    main()
