"""Time the computation of the joint angles of some frames: pytest benchmarks/test_angles.py --benchmark-only."""

from __future__ import annotations

import numpy as np
import pytest

from anchorpose.joints import JOINT_COUNT
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import JointTable


@pytest.mark.parametrize("frames", [1, 5000])
def test_joint_angles(benchmark, frames):
    rng = np.random.default_rng(0)
    places = rng.normal(size=(JOINT_COUNT, 3)) + 0.1 * rng.normal(size=(frames, JOINT_COUNT, 3))
    state, sigma = np.zeros((frames, JOINT_COUNT), np.int8), np.full((frames, JOINT_COUNT), 0.01)
    benchmark(joint_angles, JointTable(np.arange(frames), np.arange(frames) / 15.0, places, state, sigma))
