"""How long the patient has been upright, and how the feet share the load, frame by frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import LONGEST_GAP_S
from anchorpose.results.stand_training.centre_of_mass import centre_of_mass
from anchorpose.results.stand_training.extension import feet_load
from anchorpose.results.stand_training.stance import UprightConfig, stance, upright_limits
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT, JointTable


@dataclass(frozen=True, slots=True)
class Standing:
    """upright: ``UPRIGHT``, ``NOT_UPRIGHT`` or ``UNKNOWN`` in this frame; upright_s: so far. load_left: the left foot's
    share of the load, 0 to 1, with load_sigma; both None where not upright, and where ``feet_load`` is not known.
    inferred, load_inferred: a joint that it is recognised by was not seen."""

    upright: int
    upright_s: float
    inferred: bool
    load_left: float | None
    load_sigma: float | None
    load_inferred: bool


class UprightClock:
    """Takes frames in the order of time; measures as ``anchorpose measure`` does, but knows only what came before.

    The leg's length is that of the learnt body in each frame. Time counts between two upright frames that are no
    farther apart than half a second.
    """

    def __init__(self, config: UprightConfig) -> None:
        self._config = config
        self._upright, self._upright_s, self._last_s = UNKNOWN, 0.0, float("-inf")

    def push(self, joints: JointTable) -> Standing:
        """joints: of one frame."""
        body, time_s, before = centre_of_mass(joints), float(joints.time_s[0]), self._upright
        shown = stance(joints, body.position_m)
        limits = upright_limits(shown, self._config)
        if not limits.known[0]:
            self._upright = UNKNOWN
        elif limits.begins[0]:
            self._upright = UPRIGHT
        elif limits.ends[0]:
            self._upright = NOT_UPRIGHT
        step_s, self._last_s = time_s - self._last_s, time_s
        if before == self._upright == UPRIGHT and step_s <= LONGEST_GAP_S:
            self._upright_s += step_s
        load = feet_load(joints, body)
        off, sigma = float(load.rightwards[0]), float(load.sigma[0])
        known = self._upright == UPRIGHT and math.isfinite(off) and math.isfinite(sigma)
        return Standing(
            upright=int(self._upright),
            upright_s=self._upright_s,
            inferred=bool(shown.state_code[0] > 0),
            load_left=0.5 - off if known else None,
            load_sigma=sigma if known else None,
            load_inferred=bool(load.state_code[0] > 0),
        )
