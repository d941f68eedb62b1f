"""Which frames are worth a picture: some spread over the recording, the surest and the least sure, and transitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.results.episodes import SIT_TO_STAND, STAND_TO_SIT, Episode
from anchorpose.results.joint_frame import LOST
from anchorpose.results.tables import JointTable

SPREAD: Final = 4
TRANSITIONS: Final = 4  # at most, of all: the first of them

_WORDS: Final = {SIT_TO_STAND: "standing up", STAND_TO_SIT: "sitting down"}


@dataclass(frozen=True, slots=True)
class ChosenFrame:
    """row: of the joints' table; why: what it shows, for people; empty for those that are only spread."""

    row: int
    why: str


def choose_frames(joints: JointTable, episodes: Sequence[Episode], told_apart: np.ndarray) -> list[ChosenFrame]:
    """In the order of time, each frame once.

    told_apart (n,) bool: frames of which there is a picture with the people told apart; the surest and the least sure
    are chosen among those of them in which the patient is found.
    """
    why = dict.fromkeys(np.unique(np.linspace(0, len(joints.frame) - 1, SPREAD).astype(int)).tolist(), "")
    transitions = [episode for episode in episodes if episode.kind in _WORDS][:TRANSITIONS]
    for episode in transitions:
        why[_row_at(joints, 0.5 * (episode.start_s + episode.end_s))] = _WORDS[episode.kind]
    found = np.flatnonzero(told_apart & ~joints.lost.all(axis=1))
    if len(found):
        doubt = [_doubt(joints, row) for row in found.tolist()]
        why[int(found[min(range(len(found)), key=doubt.__getitem__)])] = "surest of all frames"
        why[int(found[max(range(len(found)), key=doubt.__getitem__)])] = "least sure of all frames"
    return [ChosenFrame(row, text) for row, text in sorted(why.items())]


def _doubt(joints: JointTable, row: int) -> tuple[int, int, float]:
    """Joints lost, then joints not seen, then sigma."""
    severity, sigma = joints.severity[row], joints.sigma_m[row]
    return int((severity == LOST).sum()), int((severity > 0).sum()), float(np.nanmedian(sigma))


def _row_at(joints: JointTable, time_s: float) -> int:
    return int(np.abs(joints.time_s - time_s).argmin())
