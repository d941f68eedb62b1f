"""Send every frame as it is tracked: to the live page, to the Lab Streaming Layer, and as OSC messages."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from anchorpose import __version__
from anchorpose.errors import MissingPackage
from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_NAMES, STATE_NAMES
from anchorpose.results.joint_angles import ANGLE_NAMES, joint_angles
from anchorpose.results.tables import AngleTable, JointTable

if TYPE_CHECKING:
    from pythonosc.osc_bundle_builder import OscBundleBuilder


# quantile of the heights of a person's points that counts as the top of the head; higher points may be outliers
TOP: Final = 0.98


@dataclass(frozen=True, slots=True)
class PersonInView:
    """A person in view who is not the patient. number: number of the person, counted from 1; it stays the same while
    the person is followed; place_xz_m: x and z of the person's place on the floor, in the world frame; top_m: height
    (y) of the top of the head.
    """

    number: int
    place_xz_m: tuple[float, float]
    top_m: float


def people_in(memory: BystanderMemory) -> tuple[PersonInView, ...]:
    """Return the people whom ``memory`` has seen in the newest frame, without the patient."""
    return tuple(
        PersonInView(label - PixelLabel.PATIENT, (float(x), float(z)), float(np.quantile(points_m[:, 1], TOP)))
        for label, points_m in memory.seen_last.items()
        if label >= PixelLabel.OTHER_PERSON
        for x, z in [np.median(points_m[:, [0, 2]], axis=0)]
    )


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """The result for one frame.

    frame: number of the frame; time_s: its time on the first camera's clock; taken_s: when its images were taken, by
    ``time.monotonic``. joints_m (21, 3) world, sigma_m (21,), NaN where a joint is lost; state_code (21,): index into
    ``JointState``. why_lost: the reason if all joints are lost, else empty. touched: parts of the patient (``REGIONS``)
    that other people touched in the previous frame; the value of each part states whether a camera saw the contact;
    ``touched`` is None if contacts are unknown. dropped: number of images that were not tracked since live tracking
    began. people: all other people in view; patient: number of the patient, which begins with 1 and increases by 1
    whenever another person becomes the patient. holding: parts of the patient that touch the equipment, in the form of
    ``touched``.
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
    holding: Mapping[str, bool] | None = None

    @property
    def latency_s(self) -> float:
        """Return the time that has passed since the images were taken."""
        return time.monotonic() - self.taken_s

    @property
    def joint_table(self) -> JointTable:
        """Return the joints of this frame as a table with this frame only."""
        return JointTable(
            frame=np.array([self.frame], np.int32),
            time_s=np.array([self.time_s]),
            position_m=self.joints_m[None],
            state_code=self.state_code[None],
            sigma_m=self.sigma_m[None],
        )


@lru_cache(maxsize=2)  # several outputs need the angles of the same frame
def angles_of(frame: LiveFrame) -> AngleTable:
    """Return the angles of a frame as a table of one row. Angles are computed on demand, once for all outputs."""
    return joint_angles(frame.joint_table)


class Output(Protocol):
    """A receiver of every frame."""

    name: str

    def send(self, frame: LiveFrame) -> None:
        """Send a frame without waiting for the receiver; raises OSError if sending is not possible any more."""
        ...

    def close(self) -> None:
        """Close the output: no more frames follow."""
        ...


class Outputs:
    """All receivers of frames. A receiver that fails gets no more frames, and ``failed`` gets a sentence on the
    failure.
    """

    def __init__(self, outputs: Sequence[Output]) -> None:
        self._outputs = list(outputs)
        self.failed: list[str] = []

    def send(self, frame: LiveFrame) -> None:
        """Send a frame to all receivers."""
        for output in list(self._outputs):
            try:
                output.send(frame)
            except OSError as error:
                self._outputs.remove(output)
                self.failed.append(f"{output.name} was left out from frame {frame.frame} on: {error}")

    def close(self) -> None:
        """Close all outputs: no more frames follow."""
        for output in self._outputs:
            output.close()


PARTS: Final = (
    ("X", "PositionX", "meters"),
    ("Y", "PositionY", "meters"),
    ("Z", "PositionZ", "meters"),
    ("sigma", "Sigma", "meters"),
    ("state", "State", "code"),
)
"""The channels of a joint in the stream: suffix of the channel's label, type and unit. The channel ``state`` has an
index into ``JointState``, where 0 is observed.
"""

ANGLE_PARTS: Final = (("", "Angle", "degrees"), ("sigma", "Sigma", "degrees"), ("state", "State", "code"))


class LslOutput:
    """Two streams of the Lab Streaming Layer, named anchorpose (type Mocap) and anchorpose-angles; each sample has the
    time at which its images were taken.
    """

    name = "LSL"

    def __init__(self) -> None:
        """Open both streams; raises MissingPackage if the package pylsl cannot be loaded."""
        try:
            import pylsl
        except (ImportError, RuntimeError):
            raise MissingPackage("Lab Streaming Layer", "pylsl", "live") from None
        self._clock = pylsl.local_clock
        self._joints = self._outlet(pylsl, "anchorpose", "Mocap", JOINT_NAMES, PARTS)
        self._angles = self._outlet(pylsl, "anchorpose-angles", "Angles", ANGLE_NAMES, ANGLE_PARTS)

    def send(self, frame: LiveFrame) -> None:
        """Send a frame as a sample of each stream (see ``Output.send``)."""
        stamp = self._clock() - (time.monotonic() - frame.taken_s)
        joints = np.column_stack([frame.joints_m, frame.sigma_m, frame.state_code]).astype(np.float32)
        self._joints.push_sample(joints.ravel().tolist(), stamp)
        found = angles_of(frame)
        angles = np.concatenate([found.degrees, found.sigma_deg, found.state_code]).T.astype(np.float32)
        self._angles.push_sample(angles.ravel().tolist(), stamp)

    def close(self) -> None:
        """End the streams by deleting their objects."""
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


class OscOutput:
    """An output that sends OSC messages: /anchorpose/frame number seconds; /anchorpose/joint name x y z sigma state, in
    metres; /anchorpose/angle name degrees sigma state; /anchorpose/patient number. A lost joint, or an angle without a
    value, has only its name and state.
    """

    def __init__(self, host: str, port: int) -> None:
        """Prepare to send to ``host`` and ``port``; raises MissingPackage if python-osc is missing, OSError if the host
        is unknown.
        """
        try:
            from pythonosc import osc_bundle_builder, osc_message_builder
            from pythonosc.udp_client import UDPClient
        except ImportError:
            raise MissingPackage("OSC", "python-osc", "live") from None
        self.name = f"OSC to {host}:{port}"
        self._client = UDPClient(host, port)
        self._bundle, self._message = osc_bundle_builder.OscBundleBuilder, osc_message_builder.OscMessageBuilder
        self._now = osc_bundle_builder.IMMEDIATELY

    def send(self, frame: LiveFrame) -> None:
        """Send a frame as one bundle of messages (see ``Output.send``); UDP does not wait for a receiver."""
        bundle = self._bundle(self._now)
        self._add(bundle, "/anchorpose/frame", int(frame.frame), float(frame.time_s))
        for row, name in enumerate(JOINT_NAMES):
            values = [*frame.joints_m[row].tolist(), float(frame.sigma_m[row])]
            self._add_named(bundle, "/anchorpose/joint", name, values, int(frame.state_code[row]))
        angles = angles_of(frame)
        for row, name in enumerate(ANGLE_NAMES):
            values = [float(angles.degrees[0, row]), float(angles.sigma_deg[0, row])]
            self._add_named(bundle, "/anchorpose/angle", name, values, int(angles.state_code[0, row]))
        self._add(bundle, "/anchorpose/patient", int(frame.patient))
        self._client.send(bundle.build())

    def close(self) -> None:
        """Do nothing, since UDP has no connection to close."""

    def _add_named(self, bundle: OscBundleBuilder, address: str, name: str, values: list[float], state: int) -> None:
        known = values if all(map(math.isfinite, values)) else []
        self._add(bundle, address, name, *known, STATE_NAMES[state])

    def _add(self, bundle: OscBundleBuilder, address: str, *values: str | int | float) -> None:
        message = self._message(address=address)
        for value in values:
            message.add_arg(value)
        bundle.add_content(message.build())
