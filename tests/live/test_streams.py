"""What is sent arrives at a program that reads Lab Streaming Layer or OSC."""

import socket
import time

import numpy as np
import pytest

from anchorpose.cli.live_verbs import make_outputs
from anchorpose.errors import AnchorposeError, MissingPackage
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES, LOST
from anchorpose.live.output import LiveFrame, Outputs
from anchorpose.results.joint_angles import ANGLE_NAMES


def frame_sent() -> LiveFrame:
    joints = np.arange(3.0 * JOINT_COUNT).reshape(-1, 3)
    sigma, state = np.full(JOINT_COUNT, 0.01), np.zeros(JOINT_COUNT, np.int8)
    joints[2], sigma[2], state[2] = np.nan, np.nan, LOST
    degrees = np.linspace(0.0, 90.0, len(ANGLE_NAMES))
    codes = np.zeros(len(ANGLE_NAMES), np.int8)
    return LiveFrame(12, 0.8, time.monotonic() - 0.05, joints, sigma, state, degrees, degrees / 30.0, codes, "")


def test_a_lab_streaming_layer_client_reads_joints_with_capture_time_and_metadata():
    pylsl = pytest.importorskip("pylsl")
    from anchorpose.live.output import LslOutput

    output = LslOutput()
    try:
        (found,) = pylsl.resolve_bypred("name='anchorpose' and type='Mocap'", timeout=5.0)
        inlet = pylsl.StreamInlet(found)
        inlet.open_stream(timeout=5.0)
        sent, frame = None, frame_sent()
        for _ in range(50):
            sent = pylsl.local_clock() - (time.monotonic() - frame.taken_s)
            output.send(frame)
            sample, stamp = inlet.pull_sample(timeout=0.2)
            if sample is not None:
                break
        values = np.array(sample).reshape(JOINT_COUNT, 5)
        assert values[5].tolist() == pytest.approx([15.0, 16.0, 17.0, 0.01, 0.0])
        assert np.isnan(values[2, :4]).all()
        assert values[2, 4] == LOST
        assert stamp + inlet.time_correction(timeout=5.0) == pytest.approx(sent, abs=0.02)
        channel = inlet.info(timeout=5.0).desc().child("channels").child("channel")
        assert channel.child_value("label") == f"{JOINT_NAMES[0]}_X"
        assert (channel.child_value("type"), channel.child_value("unit")) == ("PositionX", "meters")
    finally:
        output.close()


def test_an_osc_receiver_gets_one_bundle_per_frame():
    pytest.importorskip("pythonosc")
    from pythonosc.osc_bundle import OscBundle

    from anchorpose.live.output import OscOutput

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        OscOutput("127.0.0.1", receiver.getsockname()[1]).send(frame_sent())
        messages = list(OscBundle(receiver.recv(65536)))
    assert (messages[0].address, messages[0].params[0]) == ("/anchorpose/frame", 12)
    assert messages[6].params[1:5] == pytest.approx([15.0, 16.0, 17.0, 0.01])
    assert (messages[6].params[0], messages[6].params[5]) == (JOINT_NAMES[5], "observed")
    assert messages[3].params == [JOINT_NAMES[2], "lost"]
    assert len(messages) == 2 + JOINT_COUNT + len(ANGLE_NAMES)
    assert (messages[-1].address, messages[-1].params) == ("/anchorpose/patient", [1])


@pytest.mark.parametrize(
    "address", ["nowhere.invalid:9000", "a" * 300 + ":9000", "127.0.0.1:99999", "9000", "[nowhere.invalid]:9000"]
)
def test_an_osc_host_that_does_not_exist_is_refused_by_its_option(address):
    pytest.importorskip("pythonosc")
    with pytest.raises(AnchorposeError, match=r"^--osc is '.*\.$"):
        make_outputs(False, address)


def test_an_osc_target_that_is_not_there_delays_nothing():
    pytest.importorskip("pythonosc")
    outputs = Outputs(make_outputs(False, "[::1]:9" if socket.has_ipv6 else "127.0.0.1:9"))
    began_s = time.monotonic()
    for _ in range(50):
        outputs.send(frame_sent())
    assert outputs.failed == []
    assert time.monotonic() - began_s < 5.0


@pytest.mark.thorough
def test_a_lab_streaming_layer_client_that_never_reads_delays_nothing():
    pylsl = pytest.importorskip("pylsl")
    from anchorpose.live.output import LslOutput

    outputs = Outputs([LslOutput()])
    (found,) = pylsl.resolve_bypred("name='anchorpose' and type='Mocap'", timeout=5.0)
    inlet = pylsl.StreamInlet(found, max_buflen=1)
    inlet.open_stream(timeout=5.0)
    longest_s = 0.0
    for _ in range(500):
        began_s = time.monotonic()
        outputs.send(frame_sent())
        longest_s = max(longest_s, time.monotonic() - began_s)
    assert outputs.failed == []
    assert longest_s < 1.0
    outputs.close()


def test_an_output_that_fails_is_left_out_and_the_others_go_on():
    class Broken:
        name = "a client"

        def send(self, frame):
            raise ConnectionResetError("reset by peer")

        def close(self):
            raise AssertionError("it was left out")

    class Counting:
        name, count = "counting", 0

        def send(self, frame):
            self.count += 1

        def close(self):
            self.count += 100

    counting = Counting()
    outputs = Outputs([Broken(), counting])
    outputs.send(frame_sent())
    outputs.send(frame_sent())
    outputs.close()
    assert counting.count == 102
    assert outputs.failed == ["a client was left out from frame 12 on: reset by peer"]


def test_without_the_package_the_sentence_names_the_extra(monkeypatch):
    from anchorpose.live.output import LslOutput

    monkeypatch.setitem(__import__("sys").modules, "pylsl", None)
    with pytest.raises(MissingPackage, match=r"anchorpose\[live\]"):
        LslOutput()
