"""The cameras' clocks as a run found them, so that the viewer shows the pictures that were tracked together."""

from __future__ import annotations

import re
from typing import Any, Final

from anchorpose.recording.clock import Clock

_AHEAD: Final = re.compile(r"clock, ahead of the first camera's at (-?[0-9.]+) s")
_DRIFT: Final = "clock, drift against the first camera's"


def clocks_of_run(run: dict[str, Any], cameras: tuple[str, ...]) -> tuple[Clock, ...]:
    """One a camera, from the residuals of a run.json; a clock of which it tells nothing was used as it stands."""
    clocks = []
    for camera in cameras:
        ahead_s = drift = at_s = 0.0
        for residual in run.get("residuals", []):
            if residual["camera"] != camera:
                continue
            told = _AHEAD.fullmatch(residual["what"])
            if told:
                at_s, ahead_s = float(told[1]), float(residual["value"])
            elif residual["what"] == _DRIFT:
                drift = float(residual["value"])
        clocks.append(Clock(ahead_s=ahead_s, drift=drift, at_s=at_s))
    return tuple(clocks)
