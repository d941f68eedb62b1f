"""Cameras of two makers, by what their libraries can do without one."""

import sys
import time
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from anchorpose.errors import AnchorposeError
from anchorpose.live import cameras, orbbec_process
from anchorpose.live.cameras import open_orbbec
from anchorpose.live.feed import Intake

HEAD = """
import json, sys, time
sys.path.insert(0, {folder!r})
from orbbec_process import HEADER
out = sys.stdout.buffer
about = dict(name="Stand-in", serial="A1", width=4, height=3, intrinsics=[5.0, 5.0, 2.0, 1.5], distortion=[0.0] * 8)
out.write(json.dumps(about).encode() + b"\\n")
for number in range(3):
    data = bytes(range(24))
    out.write(HEADER.pack(number, 1000000 + 33000 * number, int(1e6 * time.time()), 0.001, len(data)) + data)
out.flush()
"""

UNPLUGGED = """
print("no image came for 5 s; check the camera's cable", file=sys.stderr)
sys.exit(2)
"""


INSIDE_AN_IMAGE = """
out.write(HEADER.pack(3, 2000000, int(1e6 * time.time()), 0.001, 24) + bytes(5))
out.flush()
"""

MANY_WARNINGS = """
sys.stderr.write("a warning of the maker's library\\n" * 5000)
"""

STALLED = "time.sleep(60.0)"


def orbbec(end: str) -> cameras.Orbbec:
    """A camera whose process gives three images and then runs ``end``."""
    folder = orbbec_process.__file__.rpartition("/")[0]
    return open_orbbec("", None, (sys.executable, "-c", HEAD.format(folder=folder) + end))


def test_an_orbbec_camera_is_read_from_another_process_until_it_is_unplugged():
    source = orbbec(MANY_WARNINGS + UNPLUGGED)
    found = source.cameras[0]
    assert (found.camera.width, found.camera.height, found.camera.depth_scale) == (4, 3, 0.001)
    assert (found.model, found.serial, found.camera.name) == ("Stand-in", "A1", "orbbec-A1")
    images = []
    with pytest.raises(AnchorposeError, match="check the camera's cable"):
        images.extend(source.images(Event()))
    assert ([image.number for image in images], images[1].time_s) == ([0, 1, 2], pytest.approx(1.033))
    assert abs(images[1].taken_s - time.monotonic()) < 5.0
    assert images[0].grey.tolist() == np.frombuffer(bytes(range(24)), np.uint16).reshape(3, 4).tolist()


@pytest.mark.parametrize(
    ("end", "told"),
    [(INSIDE_AN_IMAGE, "the process that reads it ended"), (INSIDE_AN_IMAGE + STALLED, "no image came for 1 s")],
    ids=["ends", "hangs"],
)
def test_an_orbbec_process_that_ends_or_hangs_inside_an_image_is_a_failure_with_its_reason(monkeypatch, end, told):
    monkeypatch.setattr(cameras, "STALL_S", 1.0)
    source = orbbec(end)
    intake = Intake([source])
    intake.start()
    until_s = time.monotonic() + 10.0
    while intake.running and time.monotonic() < until_s:
        time.sleep(0.01)
    assert not intake.running
    assert told in intake.failed[0]
    assert source.process.wait(5.0) is not None


LIBRARY = """
import os
os.write(1, b"load extensions from /somewhere\\n")

class OBError(Exception):
    pass

class OBSensorType:
    DEPTH_SENSOR = 0

class Config:
    def enable_stream(self, profile): pass

class Any:
    # a device, a list of devices, a profile, a lens or an image
    fx = fy = 5.0
    cx, cy = 2.0, 1.5
    k1 = k2 = k3 = k4 = k5 = k6 = p1 = p2 = 0.0
    given = {"get_count": 1, "get_width": 4, "get_height": 3, "get_name": "Stand-in", "get_serial_number": "A1",
             "get_index": 7, "get_timestamp_us": 1000000, "get_system_timestamp_us": 1000000, "get_depth_scale": 1.0,
             "get_data": bytes(range(24))}

    def __getattr__(self, name):
        return lambda *asked: self.given.get(name, self)

class Context(Any): pass

class Pipeline(Any):
    left = 3

    def __init__(self, device): pass

    def wait_for_frames(self, wait_ms):
        os.write(1, b"[error] an image was lost\\n")
        self.left -= 1
        return Any() if self.left >= 0 else None

    def stop(self):
        os.write(1, b"the stream was stopped\\n")
"""


def test_what_the_library_of_orbbec_prints_does_not_get_between_the_images(tmp_path):
    """As version 2.1.2 does, from its import on."""
    (tmp_path / "pyorbbecsdk.py").write_text(LIBRARY)
    script = Path(orbbec_process.__file__).read_text().replace("STALL_S = 5.0", "STALL_S = 0.2")
    (tmp_path / "process.py").write_text(script)
    source = open_orbbec("", None, (sys.executable, str(tmp_path / "process.py")))
    images = []
    with pytest.raises(AnchorposeError, match="no image came for 0 s; check the camera's cable"):
        images.extend(source.images(Event()))
    assert [image.number for image in images] == [7, 7, 7]
    assert all(image.grey.tobytes() == bytes(range(24)) for image in images)


@pytest.mark.parametrize("first", ["load extensions", "7", ""])
def test_a_process_that_does_not_begin_with_the_lens_is_one_sentence_and_is_ended(first):
    with pytest.raises(AnchorposeError, match=f"began with {first!r} instead.*; name a Python"):
        open_orbbec("", None, (sys.executable, "-c", f"print({first!r}, flush=True); import time; time.sleep(60.0)"))


def test_an_orbbec_process_that_hangs_is_ended_at_once_when_reading_stops():
    source, began_s = orbbec(STALLED), time.monotonic()
    intake = Intake([source])
    intake.start()
    intake.stop()
    assert time.monotonic() - began_s < 3.0
    assert source.process.poll() is not None
    assert intake.failed == ()


def test_a_realsense_is_read_through_its_own_library(tmp_path):
    rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)
    from anchorpose.live.cameras import start

    path = tmp_path / "camera.db3"
    record_stand_in(rs, path)
    config = rs.config()
    config.enable_device_from_file(str(path), repeat_playback=False)
    source = start(rs, config, None)
    found = source.cameras[0]
    assert (found.model, found.serial) == ("Stand-in D435", "1234")
    assert (found.camera.width, found.camera.height) == (128, 96)
    assert found.camera.depth_scale == pytest.approx(0.001)
    stop, images = Event(), []
    for image in source.images(stop):
        images.append(image)
        if len(images) == 5:
            stop.set()
    assert [int(image.grey.mean()) for image in images] == [999 + image.number for image in images]
    assert np.all(np.diff([image.time_s for image in images]) > 0.03)


class Unplugged:
    """The pipeline of librealsense when a camera is pulled out and does not come back."""

    started = True

    def try_wait_for_frames(self, wait_ms):
        if not self.started:
            raise RuntimeError("try_wait_for_frames cannot be called before start()")
        self.started = False
        return False, None

    def stop(self):
        if not self.started:
            raise RuntimeError("stop() cannot be called before start()")


class Broken:
    """A pipeline that fails in a way that no camera's library documents."""

    def try_wait_for_frames(self, wait_ms):
        raise TypeError("no such stream")

    def stop(self):
        pass


@pytest.mark.parametrize(
    ("pipeline", "reason"), [(Unplugged(), "check its cable"), (Broken(), "TypeError: no such stream")]
)
def test_a_realsense_that_fails_is_a_failure_with_its_reason(pipeline, reason):
    intake = Intake([cameras.RealSense("realsense-1", (), None, pipeline)])
    intake.start()
    until_s = time.monotonic() + 10.0
    while intake.running and time.monotonic() < until_s:
        time.sleep(0.01)
    assert not intake.running
    (sentence,) = intake.failed
    assert sentence.startswith("realsense-1: ")
    assert reason in sentence


def test_no_camera_and_no_package_of_its_maker_are_one_sentence():
    pytest.importorskip("pyrealsense2", exc_type=ImportError)
    from anchorpose.live.cameras import open_realsense

    with pytest.raises(AnchorposeError, match="No RealSense camera 77 can be started"):
        open_realsense("77", None)
    with pytest.raises(AnchorposeError, match="pyorbbecsdk2 in a separate Python"):
        open_orbbec("", None, (sys.executable, "-c", "import pyorbbecsdk"))


def record_stand_in(rs, path):
    """A file that librealsense records from its software device."""
    device = rs.software_device()
    device.register_info(rs.camera_info.serial_number, "1234")
    device.register_info(rs.camera_info.name, "Stand-in D435")
    sensor = device.add_sensor("Stereo Module")
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = 128, 96, 100.0, 100.0, 64.0, 48.0
    lens.model, lens.coeffs = rs.distortion.brown_conrady, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.depth, 0, 1, rs.format.z16
    stream.width, stream.height, stream.fps, stream.bpp, stream.intrinsics = 128, 96, 30, 2, lens
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, 0.001)
    recorder = rs.recorder(str(path), device)
    recorded, queue = recorder.query_sensors()[0], rs.frame_queue(50)
    recorded.open(profile)
    recorded.start(queue)
    for number in range(20):
        frame = rs.software_video_frame()
        frame.stride, frame.bpp, frame.timestamp, frame.frame_number = 256, 2, 1000.0 + 33.4 * number, number + 1
        frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile()
        frame.pixels = np.full((96, 128), 1000 + number, np.uint16)
        sensor.on_video_frame(frame)
        time.sleep(0.01)
    recorded.stop()
    recorded.close()
