"""A source without an end, frames as a live session sends them, and a page that serves them."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from threading import Event

import numpy as np
from results_builder import make_frame, standing_joints

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.live.cameras import Playback
from anchorpose.live.feed import LiveImage
from anchorpose.live.output import LiveFrame
from anchorpose.live.page_server import PageOutput
from anchorpose.recording.recording import Recording

LATENCY_S = 0.05


def standing_frame(
    frame: int,
    time_s: float,
    lost: tuple[str, ...] = (),
    states: Mapping[str, JointState] | None = None,
    knee_deg: float = 0.0,
    lean_m: float = 0.0,
    touched: Mapping[str, bool] | None = None,
    dropped: int = 0,
) -> LiveFrame:
    """A patient who stands upright, the left knee bent by knee_deg, all above the ankles moved by lean_m to the
    right."""
    place = standing_joints()
    for name in JOINT_NAMES:
        if not name.startswith(("Ankle", "Foot")):
            place[JOINT_INDEX[name], 2] += lean_m
    sine, cosine = np.sin(np.radians(knee_deg)), np.cos(np.radians(knee_deg))
    back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    knee = place[JOINT_INDEX["KneeLeft"]]
    for name in ("AnkleLeft", "FootLeft"):
        place[JOINT_INDEX[name]] = knee + back @ (place[JOINT_INDEX[name]] - knee)
    made = make_frame(frame, time_s, place, lost, 0.01, states)
    return live_frame_of(frame, time_s, made.position_m, made.state, touched=touched, dropped=dropped)


def live_frame_of(
    frame: int,
    time_s: float,
    joints_m: np.ndarray,
    states: tuple[JointState, ...] = (JointState.LOST,) * len(JOINT_NAMES),
    why_lost: str = "",
    touched: Mapping[str, bool] | None = None,
    dropped: int = 0,
) -> LiveFrame:
    """A frame with these joints (21, 3), sigma 1 cm."""
    sigma_m = np.where(np.isnan(joints_m[:, 0]), np.nan, 0.01)
    codes = np.array([STATE_CODE[state] for state in states], np.int8)
    return LiveFrame(frame, time_s, time.monotonic() - LATENCY_S, joints_m, sigma_m, codes, why_lost, touched, dropped)


class Again(Playback):
    """Plays a recording forward and backward without an end; loses its camera after some images if asked."""

    def __init__(self, recording: Recording, fps: float, lose_after: int | None = None) -> None:
        super().__init__(recording)
        self._period_s, self.lose_after = 1.0 / fps, lose_after

    def images(self, stop: Event) -> Iterator[LiveImage]:
        """See ``LiveSource``."""
        first_s = time.monotonic()
        there = [*range(len(self._order)), *range(len(self._order) - 2, 0, -1)]
        for given in count():
            taken_s = first_s + given * self._period_s
            if stop.wait(max(taken_s - time.monotonic(), 0.0)):
                return
            if given == self.lose_after:
                raise AnchorposeError("no image came for 5 s; check its cable")
            grey = self._read(0, there[given % len(there)])
            yield LiveImage(0, given, given * self._period_s, taken_s, grey)


@contextmanager
def page_running(has_markers: bool = False) -> Iterator[PageOutput]:
    """On a free port of this machine."""
    output = PageOutput("127.0.0.1", 0, has_markers)
    try:
        yield output
    finally:
        output.close()
