"""How far joints are apart in space, by joint and state: distances have no sign, so neither bias nor limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.agreement.matching import Match
from anchorpose.agreement.rows import (
    ALL,
    AS_MEASURED,
    INFERRED,
    LEAST_SAMPLES,
    MM,
    OFFSET_REMOVED,
    Agreement,
    in_state,
)
from anchorpose.joints import JOINT_NAMES, JointState


def distance_rows(matches: Sequence[Match], subjects: Sequence[str]) -> list[Agreement]:
    """Of each joint, and of all; mean, root mean square and largest in millimetres."""
    rows = list[Agreement]()
    for offset in (AS_MEASURED, OFFSET_REMOVED):
        for column, name in (*enumerate(JOINT_NAMES), (None, "all joints")):
            for state in (ALL, INFERRED, *(each for each in JointState if each is not JointState.LOST)):
                found = [_distance(match, column, state, offset) for match in matches]
                distance = np.concatenate(found)
                if len(distance) >= LEAST_SAMPLES:
                    rows.append(_distance_row(name, str(state), offset, distance, len(set(subjects))))
    return rows


def _distance(match: Match, column: int | None, state: str, offset: str) -> np.ndarray:
    if match.placement is None:
        return np.empty(0)
    away = match.joints.position_m - match.theirs_m
    if offset == OFFSET_REMOVED:
        away = away - np.einsum("njik,jk->nji", match.axes, match.placement.offset_m)
    length = MM * np.linalg.norm(away, axis=2)
    chosen = np.isfinite(length) & in_state(match.joints.state_code.ravel(), state).reshape(length.shape)
    picked = slice(None) if column is None else slice(column, column + 1)
    return np.asarray(length[:, picked][chosen[:, picked]])


def _distance_row(name: str, state: str, offset: str, distance: np.ndarray, subjects: int) -> Agreement:
    return Agreement(
        kind="joint", name=name, axis="distance", state=state, offset=offset, unit="mm", samples=len(distance),
        repeated="subject", units=subjects, rmse=float(np.sqrt(np.mean(distance**2))),
        mean_abs=float(distance.mean()), largest=float(distance.max()),
    )  # fmt: skip
