"""What is sent of a frame while it happens, and to whom."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from anchorpose.joints import LOST, JointState
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.tables import JointTable
from anchorpose.tracker.estimate import Estimate

_CODES: Final = {state: code for code, state in enumerate(JointState)}


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """One frame's answer. NaN where a joint is lost or an angle not determined.

    frame, time_s: of the first camera; taken_s: when its images were taken, by ``time.monotonic``. joints_m (21, 3)
    world, sigma_m (21,), state_code (21,) index into ``JointState``; degrees, sigma_deg, angle_state (a,): the angles
    of ``ANGLE_NAMES``. why_lost: why every joint is lost, empty where one is not.
    """

    frame: int
    time_s: float
    taken_s: float
    joints_m: np.ndarray
    sigma_m: np.ndarray
    state_code: np.ndarray
    degrees: np.ndarray
    sigma_deg: np.ndarray
    angle_state: np.ndarray
    why_lost: str

    @property
    def latency_s(self) -> float:
        """From the images to now."""
        return time.monotonic() - self.taken_s


class Output(Protocol):
    """Somebody who is sent every frame."""

    name: str

    def send(self, frame: LiveFrame) -> None:
        """Must not wait for whoever reads; raises OSError where nothing can be sent any more."""
        ...

    def close(self) -> None:
        """No more frames come."""
        ...


def live_frame(estimate: Estimate, taken_s: float) -> LiveFrame:
    """What is sent of an estimate."""
    frame_set = estimate.frame_set
    codes = np.array([_CODES[state] for state in estimate.states], np.int8)
    table = JointTable(
        frame=np.array([frame_set.frame], np.int32),
        time_s=np.array([frame_set.time_s]),
        position_m=estimate.joints_m[None],
        state_code=codes[None],
        sigma_m=estimate.sigma_m[None],
    )
    angles = joint_angles(table)
    return LiveFrame(
        frame_set.frame,
        frame_set.time_s,
        taken_s,
        estimate.joints_m,
        estimate.sigma_m,
        codes,
        angles.degrees[0],
        angles.sigma_deg[0],
        angles.state_code[0],
        estimate.why_lost if (codes == LOST).all() else "",
    )


class Outputs:
    """All who are sent the frames; one that fails is left out from then on, with a sentence."""

    def __init__(self, outputs: Sequence[Output]) -> None:
        self._outputs = list(outputs)
        self.failed: list[str] = []

    def send(self, frame: LiveFrame) -> None:
        """To everybody."""
        for output in list(self._outputs):
            try:
                output.send(frame)
            except OSError as error:
                self._outputs.remove(output)
                self.failed.append(f"{output.name} was left out from frame {frame.frame} on: {error}")

    def close(self) -> None:
        """No more frames come."""
        for output in self._outputs:
            output.close()
