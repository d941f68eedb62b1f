"""Connections that send nothing, and too many of them: the page goes on, and depth images are written."""

import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from urllib.parse import SplitResult, urlsplit
from urllib.request import urlopen

import pytest
from live_builder import page_running, standing_frame

from anchorpose.live.page_server import PageOutput
from anchorpose.recording.reader import open_recording
from anchorpose.viewer import guarded_server
from anchorpose.viewer.access import MOST_PER_CLIENT

LONG_LENGTH = "9" * 5000


@pytest.fixture
def output():
    with page_running() as running:
        yield running


def connect(place: SplitResult, request: str = "") -> socket.socket:
    opened = socket.create_connection((place.hostname, place.port), timeout=10.0)
    opened.sendall(request.encode())
    return opened


def get(output: PageOutput, name: str) -> str:
    return f"GET {urlsplit(output.address).path}{name} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


def is_closed(connection: socket.socket) -> bool:
    """Whether the other end closes it within its patience."""
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


def test_connections_that_send_nothing_give_way_the_oldest_first(output):
    with ExitStack() as stack:
        idle = [stack.enter_context(connect(urlsplit(output.address))) for _ in range(MOST_PER_CLIENT + 40)]
        with urlopen(f"{output.address}description", timeout=10.0) as answer:
            assert answer.status == 200
        assert all(is_closed(one) for one in idle[:40])
        idle[-1].settimeout(0.2)
        with pytest.raises(TimeoutError):
            idle[-1].recv(1)


def test_who_sent_the_token_does_not_give_way_and_one_more_is_refused(output):
    place = urlsplit(output.address)
    with ExitStack() as stack:
        readers = [stack.enter_context(connect(place, get(output, "events"))) for _ in range(MOST_PER_CLIENT)]
        for reader in readers:
            assert reader.recv(12) == b"HTTP/1.1 200"
        assert is_closed(stack.enter_context(connect(place)))
        output.send(standing_frame(7, 0.7))
        for reader in readers:
            content = b""
            while b'"frame": 7' not in content:
                content += (more := reader.recv(65536))
                assert more


def test_a_connection_without_a_request_is_closed_after_a_while(output, monkeypatch):
    monkeypatch.setattr(guarded_server, "IDLE_S", 0.3)
    place = urlsplit(output.address)
    with connect(place) as silent, connect(place, get(output, "description")) as served:
        assert is_closed(silent)
        while served.recv(65536):  # the answer, and then the end
            pass


def test_a_length_of_five_thousand_digits_is_refused(output, capsys):
    place = urlsplit(output.address)
    host = f"127.0.0.1:{place.port}"
    head = f"POST {place.path}patient HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
    with connect(place, f"{head}Content-Type: application/json\r\nContent-Length: {LONG_LENGTH}\r\n\r\n") as wrong:
        assert wrong.recv(65536).startswith(b"HTTP/1.1 413 ")
    assert capsys.readouterr().err == ""


RECORDING_UNDER_ATTACK = """
import resource, select, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (128, 128))
from pathlib import Path
import numpy as np
from anchorpose.camera import Camera
from anchorpose.lens import Intrinsics
from anchorpose.live.page_server import PageOutput
from anchorpose.live.recorder import Recorder
from anchorpose.live.feed import LiveImage
from anchorpose.sources.plan import CameraPlan
lens = Intrinsics(fx=60.0, fy=60.0, cx=32.0, cy=24.0)
camera = Camera(name="front", width=64, height=48, depth_scale=0.001, intrinsics=lens)
recorder, page = Recorder(Path(sys.argv[1]), [CameraPlan(camera=camera)]), PageOutput("127.0.0.1", 0)
print(page.address, flush=True)
given = 0
while not select.select([sys.stdin], [], [], 0.02)[0]:
    recorder.put(LiveImage(0, given, given / 30, 0.0, np.full((48, 64), 1000, np.uint16)))
    given += 1
print(given)
recorder.finish()
"""


@pytest.mark.thorough
def test_254_idle_connections_cost_the_recorder_no_image(tmp_path):
    pytest.importorskip("resource", reason="limits of a process exist on POSIX only")
    command = [sys.executable, "-c", RECORDING_UNDER_ATTACK, str(tmp_path / "kept")]
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1, text=True) as child, ExitStack() as stack:
        place = urlsplit(child.stdout.readline().strip())
        for _ in range(254):
            stack.enter_context(connect(place))
        time.sleep(0.5)
        given, errors = child.communicate("\n", timeout=60)
    assert (child.returncode, errors) == (0, "")
    assert len(open_recording(tmp_path / "kept").streams[0].files) == int(given) > 10
