"""The reference movements that ship with the package, built by ``tools/build_motion_database.py``."""

from __future__ import annotations

from importlib import resources

import numpy as np

from anchorpose.tracking.joint_motion import joint_database
from anchorpose.tracking.motion import MotionConfig, MotionDatabase


def default_motions(at_hz: float, config: MotionConfig) -> MotionDatabase:
    """D_s: movements of stand training at every speed of the configuration, for a recording of ``at_hz``."""
    path = resources.files("anchorpose.tracking").joinpath("data/motions.npz")
    with path.open("rb") as stream, np.load(stream) as stored:
        joints_m = stored["joints_mm"].astype(np.float64) / 1000.0
        clips = np.split(joints_m, stored["start"][1:-1])
        return joint_database(clips, float(stored["rate_hz"]), at_hz, config)
