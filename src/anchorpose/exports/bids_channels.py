"""The channels of a BIDS motion recording: what each column of motion.tsv is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.exports.source import STATES, Samples
from anchorpose.joints import JOINT_NAMES

WORLD: Final = "world"
CHANNEL_COLUMNS: Final = (
    "name", "component", "type", "tracked_point", "units", "reference_frame", "description",
)  # fmt: skip
_STATE_CODES: Final = ", ".join(f"{code} {state}" for code, state in enumerate(STATES))


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A column: its row in channels.tsv and its values (n,), NaN where missing; digits after the point."""

    name: str
    component: str
    kind: str
    tracked_point: str
    units: str
    description: str
    values: np.ndarray
    digits: int

    @property
    def row(self) -> tuple[str, ...]:
        """As in channels.tsv."""
        frame = WORLD if self.kind == "POS" else "n/a"
        return self.name, self.component, self.kind, self.tracked_point, self.units, frame, self.description


def channels_of(samples: Samples) -> list[Channel]:
    """Latency, then joints, angles, and how sure and how known each is."""
    latency = Channel(
        "latency", "n/a", "LATENCY", "n/a", "s", "time since the first frame", samples.time_s - samples.time_s[0], 6
    )
    places = [
        Channel(
            f"{name}_{axis}", axis, "POS", name, "m", f"joint centre, {way}", samples.position_m[:, number, index], 6
        )
        for number, name in enumerate(JOINT_NAMES)
        for index, (axis, way) in enumerate((("x", "forward"), ("y", "up"), ("z", "to the right")))
    ]
    angles = [
        Channel(name, "n/a", "JNTANG", name, "deg", "joint angle", samples.degrees[:, number], 6)
        for number, name in enumerate(samples.angles)
    ]
    joints = _quality(JOINT_NAMES, "m", samples.joint_sigma_m, samples.joint_severity)
    return [
        latency,
        *places,
        *angles,
        *joints,
        *_quality(samples.angles, "deg", samples.sigma_deg, samples.angle_severity),
    ]


def _quality(names: tuple[str, ...], units: str, sigma: np.ndarray, severity: np.ndarray) -> list[Channel]:
    meaning = "one standard deviation of the error" + (" along each axis" if units == "m" else "")
    return [
        channel
        for number, name in enumerate(names)
        for channel in (
            Channel(f"{name}_sigma", "n/a", "MISC", name, units, meaning, sigma[:, number], 6),
            Channel(
                f"{name}_state", "n/a", "MISC", name, "n/a", f"how it is known: {_STATE_CODES}",
                severity[:, number].astype(np.float64), 0,
            ),
        )
    ]  # fmt: skip
