"""Pictures are made of the depth image of their frame, or not at all."""

from pathlib import Path

import numpy as np

from anchorpose.joints import LOST
from anchorpose.pages.overlay import _recorded
from anchorpose.recording.recording import DepthStream
from anchorpose.results.tables import JointTable


def test_a_frame_is_found_in_the_recording_by_its_number_and_its_time():
    """Frame 12 was counted on while the camera was silent; the camera later gave its own number 12."""
    number, time_s = np.array([10, 11, 12, 20, 21], np.int32), np.array([1.0, 1.1, 1.2, 4.0, 4.1])
    nan, codes = np.full((5, 21, 3), np.nan), np.full((5, 21), LOST, np.int8)
    joints = JointTable(number, time_s, nan, codes, nan[..., 0])
    stream = DepthStream([Path()] * 4, np.array([1.0, 1.1, 3.2, 4.0]), np.array([10, 11, 12, 20]))
    position, recorded = _recorded(joints, stream)
    assert recorded.tolist() == [True, True, False, True, False]
    assert position[recorded].tolist() == [0, 1, 3]
