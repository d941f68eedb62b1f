"""How long and in how many bouts the patient was upright."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JointState
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import recorded_seconds, runs_of_known
from anchorpose.results.records import UPRIGHT_EPISODE, Episode, Measure
from anchorpose.results.stand_training.session import Session, inferred_share
from anchorpose.results.stand_training.stance import Stance, UprightConfig, upright
from anchorpose.results.tables import UPRIGHT, JointTable

NO_TIME: Final = "the recording has a single frame, which has no duration"
NEVER_KNOWN: Final = "in no frame was it known whether the patient was upright"


def upright_episodes(joints: JointTable, stance: Stance, state: np.ndarray) -> tuple[Episode, ...]:
    """The bouts; state (n,) of ``upright``."""
    return tuple(
        episode(UPRIGHT_EPISODE, joints, stance.state_code, run)
        for run in runs_of_known(state == UPRIGHT, state != UNKNOWN, joints.time_s)
    )  # fmt: skip


def episode(kind: str, joints: JointTable, state_code: np.ndarray, run: slice) -> Episode:
    """The frames of ``run`` as an episode; state_code (n,) of the joints that it was told by."""
    return Episode(
        kind=kind,
        first_frame=int(joints.frame[run.start]),
        last_frame=int(joints.frame[run.stop - 1]),
        start_s=float(joints.time_s[run.start]),
        end_s=float(joints.time_s[run.stop - 1]),
        state=tuple(JointState)[int(state_code[run].max())],
    )


def time_measures(session: Session, config: UprightConfig) -> list[Measure]:
    """Recorded, found, upright and unknown time, the share, the bouts and the longest of them."""
    seconds, state, state_code = session.seconds, session.posture.upright, session.stance.state_code
    known, standing = state != UNKNOWN, state == UPRIGHT
    frames, shared = int(known.sum()), inferred_share(state_code[known])
    total, known_s = recorded_seconds(session.joints.time_s), float(seconds[known].sum())
    runs = runs_of_known(standing, known, session.joints.time_s)
    recorded = _row("recorded_time", total, "s", len(seconds), None, None if total else NO_TIME)
    why = NO_TIME if not total else None if known_s else NEVER_KNOWN
    upright_s, sigma_s = float(seconds[standing].sum()), _sigma_s(session, config)
    longest = max((float(seconds[run][standing[run]].sum()) for run in runs), default=0.0)
    return [
        recorded,
        _row("found_time", float(seconds[session.found].sum()), "s", int(session.found.sum()), None, recorded.why),
        _row("unknown_time", max(total - known_s, 0.0), "s", len(seconds), None, recorded.why),
        _row("upright_time", upright_s, "s", frames, shared, why, sigma_s),
        _row("upright_share", upright_s / known_s if known_s else None, "1", frames, shared, why,
             sigma_s / known_s if known_s else None),
        _row("upright_bouts", float(len(runs)), "count", frames, shared, why),
        _row("longest_upright_bout", longest, "s", frames, shared, why, sigma_s),
    ]  # fmt: skip


def _sigma_s(session: Session, config: UprightConfig) -> float:
    """Half of what the time changes when all frames err by one sigma, first for and then against standing.

    And every beginning and end of a bout may be half a frame off.
    """
    state = session.posture.upright
    edges = 2 * len(runs_of_known(state == UPRIGHT, state != UNKNOWN, session.joints.time_s))
    usual = float(np.median(session.seconds))
    more, less = (
        float(session.seconds[upright(session.stance, config, shift) == UPRIGHT].sum()) for shift in (1.0, -1.0)
    )
    return float(np.hypot(0.5 * (more - less), 0.5 * np.sqrt(edges) * usual))


def _row(
    measure: str,
    value: float | None,
    unit: str,
    frames: int,
    shared: float | None,
    why: str | None,
    sigma: float | None = None,
) -> Measure:
    if why is not None:
        return Measure(measure=measure, value=None, unit=unit, frames=frames, inferred_share=shared, why=why)
    return Measure(measure=measure, value=value, unit=unit, sigma=sigma, frames=frames, inferred_share=shared)
