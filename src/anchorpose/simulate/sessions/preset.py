"""Define the preset ``stimulation``: trials of a patient between parallel bars, with a therapist on each side."""

from __future__ import annotations

from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.sessions.plan import SessionConfig


def stimulation(seed: int, session: SessionConfig, fps: float = 15.0) -> SimulationConfig:
    """Return the preset's settings: three cameras, and a recording that is as long as the session."""
    return SimulationConfig(
        seed=seed,
        seconds=session.seconds,
        fps=fps,
        equipment="parallel-bars",
        therapist_tasks=("left knee and hip", "right knee and hip"),
        session=session,
    )
