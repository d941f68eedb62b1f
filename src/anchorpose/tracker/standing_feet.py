"""A foot that was seen standing stays where it stands while nobody sees it.

A leg that a therapist hides is constrained by the hip alone, and rows from the outline push it to and fro. Patients in
stand training stand: the foot's place on the floor is the best evidence of the leg.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.constraints import Constraints, join, no_constraints, place_constraints
from anchorpose.body.contact_regions import region_of_points
from anchorpose.body.regions import REGIONS
from anchorpose.body.skin_points import SkinPoints
from anchorpose.joints import JOINT_INDEX, JointState

SIDES = ("Left", "Right")
PLACES: Final = 6  # skin points that hold a foot: its place and its rotation
STILL_S: Final = 0.4  # seen standing for this long: longer than the sole is flat on the floor during a step
STILL_M: Final = 0.03  # distance within which it stays meanwhile: the noise of a visible ankle
SIGMA_M: Final = 0.02  # of its place when it goes out of sight
DRIFT_M_S: Final = 0.05  # growth of that while unseen: a small step in two seconds
DOUBT_M: Final = 0.10  # a knee that is seen to move farther takes the foot with it


@dataclass(frozen=True, slots=True, eq=False)
class _Stand:
    """places_m (k, 3): of the foot's skin points, ankle_m (3,), world; seen_s: when it was seen there last."""

    places_m: np.ndarray
    ankle_m: np.ndarray
    seen_s: float


class StandingFeet:
    """Where each foot was last seen standing; time may run backwards."""

    _skin: dict[str, np.ndarray]
    _recent: dict[str, deque[tuple[float, np.ndarray]]]
    _stand: dict[str, _Stand]

    def __init__(self, points: SkinPoints) -> None:
        region = region_of_points(points)
        self._skin = {side: _spread(np.flatnonzero(region == REGIONS.index(f"foot_{side.lower()}"))) for side in SIDES}
        self._recent = {side: deque() for side in SIDES}
        self._stand = {}

    def note(self, skin_m: np.ndarray, joints_m: np.ndarray, states: tuple[JointState, ...], time_s: float) -> None:
        """One more frame: posed skin points (p, 3), joints (21, 3) and their states.

        A foot that is seen stands or does not; one that is hidden stays where it stood; one that the cameras look past
        has gone.
        """
        for side in SIDES:
            ankle = JOINT_INDEX[f"Ankle{side}"]
            state, recent = states[ankle], self._recent[side]
            if state is JointState.LOST:
                self._stand.pop(side, None)
            if state is not JointState.OBSERVED:
                recent.clear()
                continue
            recent.append((time_s, joints_m[ankle]))
            while abs(time_s - recent[0][0]) > STILL_S + 1e-6 and len(recent) > 2:
                recent.popleft()
            before = self._stand.get(side)
            stayed = before is not None and np.linalg.norm(joints_m[ankle] - before.ankle_m) < STILL_M
            if stayed or self._is_still(recent):
                self._stand[side] = _Stand(skin_m[self._skin[side]], joints_m[ankle], time_s)
            else:
                self._stand.pop(side, None)

    def forget(self, joints: Sequence[int]) -> None:
        """Forget where the feet stood whose joints (indices) a reviewer corrected."""
        for side in SIDES:
            if {JOINT_INDEX[f"Ankle{side}"], JOINT_INDEX[f"Foot{side}"]} & set(joints):
                self._stand.pop(side, None)
                self._recent[side].clear()

    def rows(self, time_s: float) -> Constraints:
        """What holds the feet in a frame; none of feet that do not stand."""
        held = []
        for side, stand in self._stand.items():
            sigma_m = SIGMA_M + DRIFT_M_S * abs(time_s - stand.seen_s)
            held.append(place_constraints(self._skin[side], stand.places_m, sigma_m, DOUBT_M))
        return join(held) if held else no_constraints()

    def _is_still(self, recent: deque[tuple[float, np.ndarray]]) -> bool:
        places = np.array([place for _, place in recent])
        long = abs(recent[-1][0] - recent[0][0]) >= 0.75 * STILL_S
        return bool(long and np.linalg.norm(places - places[-1], axis=1).max() < STILL_M)


def _spread(index: np.ndarray) -> np.ndarray:
    return index[np.linspace(0, len(index) - 1, PLACES).astype(np.int64)]
