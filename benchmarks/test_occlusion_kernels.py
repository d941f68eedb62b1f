"""How long it takes to say which anchors a node can trust, with a hole where a hand or a bar may be.

pytest benchmarks/test_occlusion_kernels.py --benchmark-only; the figure is that of ``test_kernels``.
"""

from __future__ import annotations

import numpy as np
import pytest
from test_kernels import Frame, make_frame

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.trusted_anchors import trusted_anchors
from anchorpose.surface.mesh import keep_nodes


@pytest.fixture(scope="module")
def frame() -> Frame:
    return make_frame(0)


@pytest.mark.parametrize(
    ("radius_m", "height_m", "side_m"),
    [(0.05, 0.5, 0.12), (0.10, 1.15, 0.0), (0.10, 0.95, 0.0)],
    ids=["knee", "trunk", "belly"],
)
def test_trusted_anchors(benchmark, frame, radius_m, height_m, side_m):
    whole = frame.surface
    hidden = np.hypot(whole.points_m[:, 1] - height_m, whole.points_m[:, 2] - side_m) < radius_m
    seen, node = keep_nodes(whole, ~hidden), np.flatnonzero(~hidden)
    rim = np.append(hidden, False)[whole.ring].any(axis=1)[node]
    anchors = frame.anchors.node[frame.anchors.found & ~hidden[frame.anchors.node]]
    descriptor = geodesic_distance(seen, np.searchsorted(node, anchors)).T
    trusted = benchmark(trusted_anchors, seen, descriptor, rim)
    benchmark.extra_info.update(nodes=len(seen), anchors=len(anchors), trusted=float(trusted.mean()))
