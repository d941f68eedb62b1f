"""Joints and angles as OSC messages, one bundle per frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from anchorpose.errors import MissingPackage
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.live.output import LiveFrame, angles_of
from anchorpose.results.joint_angles import ANGLE_NAMES

if TYPE_CHECKING:
    from pythonosc.osc_bundle_builder import OscBundleBuilder

_STATES = tuple(state.value for state in JointState)


class OscOutput:
    """/anchorpose/frame number seconds; /anchorpose/joint name x y z sigma state, in metres; /anchorpose/angle name
    degrees sigma state. A lost joint, or an angle without a value, has its name and the state only."""

    def __init__(self, host: str, port: int) -> None:
        """Raises MissingPackage without python-osc, OSError where there is no such host."""
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
        """See ``Output``: UDP waits for nobody."""
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
        """Nothing is open that would have to be closed."""

    def _add_named(self, bundle: OscBundleBuilder, address: str, name: str, values: list[float], state: int) -> None:
        known = values if all(map(math.isfinite, values)) else []
        self._add(bundle, address, name, *known, _STATES[state])

    def _add(self, bundle: OscBundleBuilder, address: str, *values: str | int | float) -> None:
        message = self._message(address=address)
        for value in values:
            message.add_arg(value)
        bundle.add_content(message.build())
