"""What is sent of a frame while it happens, and to whom."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Protocol

import numpy as np

from anchorpose.joints import LOST, JointState
from anchorpose.live.people import PersonInView
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import AngleTable, JointTable
from anchorpose.tracker.estimate import Estimate

_CODES: Final = {state: code for code, state in enumerate(JointState)}


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """One frame's answer. NaN where a joint is lost.

    frame, time_s: of the first camera; taken_s: when its images were taken, by ``time.monotonic``. joints_m (21, 3)
    world, sigma_m (21,), state_code (21,) index into ``JointState``. why_lost: why every joint is lost, empty where one
    is not. touched: parts of the patient (``REGIONS``) that other people touched in the frame before, and whether that
    was seen; None where it is not known. dropped: images that were not tracked, since tracking live began. people:
    everybody else in view; patient: 1, and one more whenever another person becomes the patient.
    """

    frame: int
    time_s: float
    taken_s: float
    joints_m: np.ndarray
    sigma_m: np.ndarray
    state_code: np.ndarray
    why_lost: str
    touched: Mapping[str, bool] | None = None
    dropped: int = 0
    people: tuple[PersonInView, ...] = ()
    patient: int = 1

    @property
    def latency_s(self) -> float:
        """From the images to now."""
        return time.monotonic() - self.taken_s

    @property
    def joint_table(self) -> JointTable:
        """A table of this frame alone."""
        return JointTable(
            frame=np.array([self.frame], np.int32),
            time_s=np.array([self.time_s]),
            position_m=self.joints_m[None],
            state_code=self.state_code[None],
            sigma_m=self.sigma_m[None],
        )


@lru_cache(maxsize=2)  # several outputs ask for the same
def angles_of(frame: LiveFrame) -> AngleTable:
    """The angles of a frame, a table of one row; computed when they are asked for, so that joints are sent first."""
    return joint_angles(frame.joint_table)


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
    """What is sent of an estimate; taken_s as in ``LiveFrame``."""
    frame_set = estimate.frame_set
    codes = np.array([_CODES[state] for state in estimate.states], np.int8)
    return LiveFrame(
        frame_set.frame,
        frame_set.time_s,
        taken_s,
        estimate.joints_m,
        estimate.sigma_m,
        codes,
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
