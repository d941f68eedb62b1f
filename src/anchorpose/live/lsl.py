"""Joints and angles as Lab Streaming Layer streams, by the metadata of its motion capture convention."""

from __future__ import annotations

import time
from typing import Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.errors import MissingPackage
from anchorpose.joints import JOINT_NAMES
from anchorpose.live.output import LiveFrame, angles_of
from anchorpose.results.joint_angles import ANGLE_NAMES

PARTS: Final = (
    ("X", "PositionX", "meters"),
    ("Y", "PositionY", "meters"),
    ("Z", "PositionZ", "meters"),
    ("sigma", "Sigma", "meters"),
    ("state", "State", "code"),
)
"""The channels of a joint: suffix, type and unit; state: its place in ``JointState``, 0 is observed."""

ANGLE_PARTS: Final = (("", "Angle", "degrees"), ("sigma", "Sigma", "degrees"), ("state", "State", "code"))


class LslOutput:
    """Two streams, anchorpose (type Mocap) and anchorpose-angles; every sample has the time its images were taken."""

    name = "LSL"

    def __init__(self) -> None:
        """Raises MissingPackage without pylsl."""
        try:
            import pylsl
        except (ImportError, RuntimeError):
            raise MissingPackage("Lab Streaming Layer", "pylsl", "live") from None
        self._clock = pylsl.local_clock
        self._joints = self._outlet(pylsl, "anchorpose", "Mocap", JOINT_NAMES, PARTS)
        self._angles = self._outlet(pylsl, "anchorpose-angles", "Angles", ANGLE_NAMES, ANGLE_PARTS)

    def send(self, frame: LiveFrame) -> None:
        """See ``Output``."""
        stamp = self._clock() - (time.monotonic() - frame.taken_s)
        joints = np.column_stack([frame.joints_m, frame.sigma_m, frame.state_code]).astype(np.float32)
        self._joints.push_sample(joints.ravel().tolist(), stamp)
        found = angles_of(frame)
        angles = np.concatenate([found.degrees, found.sigma_deg, found.state_code]).T.astype(np.float32)
        self._angles.push_sample(angles.ravel().tolist(), stamp)

    def close(self) -> None:
        """The streams end with their objects."""
        del self._joints, self._angles

    def _outlet(self, pylsl: Any, name: str, kind: str, things: tuple[str, ...], parts: Any) -> Any:
        channels = len(things) * len(parts)
        info = pylsl.StreamInfo(name, kind, channels, pylsl.IRREGULAR_RATE, "float32", f"{name}-{id(self):x}")
        about = info.desc().append_child("acquisition")
        about.append_child_value("model", f"anchorpose {__version__}")
        if kind == "Mocap":
            setup = info.desc().append_child("setup").append_child("bounds")
            setup.append_child_value("unit", "meters")
            system = info.desc().append_child("coordinate_system")
            for axis, meaning in (("X", "forward"), ("Y", "up"), ("Z", "right of the patient")):
                system.append_child_value(axis, meaning)
        listed = info.desc().append_child("channels")
        for thing in things:
            for suffix, meaning, unit in parts:
                channel = listed.append_child("channel")
                channel.append_child_value("label", f"{thing}_{suffix}" if suffix else thing)
                channel.append_child_value("marker" if kind == "Mocap" else "angle", thing)
                channel.append_child_value("type", meaning)
                channel.append_child_value("unit", unit)
        return pylsl.StreamOutlet(info)
