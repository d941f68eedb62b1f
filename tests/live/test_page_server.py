"""The page's server: who is let in, what arrives, and clients that do not behave."""

import http.client
import json
import socket
import time
from dataclasses import replace
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest
from live_builder import live_frame_of, page_running, standing_frame

from anchorpose.cli import main
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, LOST
from anchorpose.live.output import PersonInView, angles_of
from anchorpose.live.page_server import BUFFER_BYTES, PageOutput
from anchorpose.results.joint_angles import ANGLE_NAMES


@pytest.fixture
def output():
    with page_running() as running:
        yield running


class Client:
    """Reads the events of a page's server."""

    def __init__(self, output: PageOutput, name: str = "events") -> None:
        place = urlsplit(output.address)
        self._connection = http.client.HTTPConnection(place.hostname, place.port, timeout=10)
        self._connection.request("GET", f"{place.path}{name}")
        self.answer = self._connection.getresponse()

    def event(self) -> tuple[str, object]:
        """The next event; comments are skipped."""
        while True:
            line = self.answer.readline().decode()
            assert line, "the stream has ended"
            if line.startswith("event: "):
                return line[7:].strip(), json.loads(self.answer.readline().decode()[6:])

    def until(self, frame: int) -> None:
        while self.next("frame")["frame"] < frame:
            pass

    def next(self, name: str) -> object:
        while (event := self.event())[0] != name:
            pass
        return event[1]

    def close(self) -> None:
        self._connection.close()
        self.answer.close()


def status_of(output: PageOutput, path: str, **headers: str) -> int:
    place = urlsplit(output.address)
    connection = http.client.HTTPConnection("127.0.0.1", place.port, timeout=10)
    connection.request("GET", path, headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_nobody_gets_in_without_the_token_or_by_another_name(output):
    path = urlsplit(output.address).path
    for wrong in ("/", "/events", f"{path[:-2]}/events", f"/x{path}events", "/description"):
        assert status_of(output, wrong) == 403
    assert status_of(output, f"{path}events", Host="evil.example") == 403
    assert status_of(output, f"{path}description", Host="localhost:9000") == 200
    for there, status in (("", 200), ("live/main.js", 200), ("three/three.module.min.js", 200), ("points", 404)):
        assert status_of(output, f"{path}{there}") == status


def posted(output: PageOutput, body: object, name: str = "patient", token: str = "", **more: str) -> tuple[int, str]:
    """Status and sentence of a request that would change something."""
    place = urlsplit(output.address)
    connection = http.client.HTTPConnection("127.0.0.1", place.port, timeout=10)
    host = f"127.0.0.1:{place.port}"
    headers = {"Host": host, "Origin": f"http://{host}", "Content-Type": "application/json"} | more
    connection.request("POST", f"/{token}/{name}" if token else f"{place.path}{name}", json.dumps(body), headers)
    answer = connection.getresponse()
    found = answer.status, json.loads(answer.read()).get("error", "")
    connection.close()
    return found


BESIDE = (PersonInView(2, (0.5, 0.8), 1.7),)


def test_a_person_in_view_is_asked_for_once_and_nobody_until_the_next_frame(output):
    output.send(replace(standing_frame(1, 0.1), people=BESIDE))
    assert output.asked() is None
    assert posted(output, {"person": 2}) == (200, "")
    assert [output.asked(), output.asked()] == [2, None]
    assert posted(output, {"person": 2})[0] == 400  # the numbers may be others' from now on
    output.send(replace(standing_frame(2, 0.2), people=BESIDE))
    assert posted(output, {"person": 2})[0] == 200


def test_a_request_that_is_wrong_is_one_sentence_and_changes_nothing(output):
    output.send(replace(standing_frame(1, 0.1), people=BESIDE))
    assert posted(output, {"person": 3}) == (400, "Person 3 is not in view now; the patient is as before.")
    for wrong in ({}, {"person": "2"}, {"person": True}, {"person": None}, {"person": 2.0}):
        status, sentence = posted(output, wrong)
        assert (status, sentence.count(".")) == (400, 1)
    assert (posted(output, [2])[0], posted(output, {"person": 2}, "joints")[0]) == (400, 404)
    assert posted(output, {"person": 2}, token="x" * 22)[0] == 403
    assert posted(output, {"person": 2}, Origin="http://evil.example")[0] == 403
    assert posted(output, {"person": 2}, Host="evil.example")[0] == 403
    assert output.asked() is None


def test_a_marker_is_kept_where_something_is_recorded(output):
    assert posted(output, {"text": "end"}, "marker") == (400, "Nothing is recorded, so that no marker is kept.")
    kept: list[tuple[str, float]] = []
    output.keep_markers(lambda text, at_s: kept.append((text, at_s)))
    before_s = time.monotonic()
    assert posted(output, {"text": "begin stand"}, "marker") == (200, "")
    assert [text for text, _ in kept] == ["begin stand"]
    assert before_s <= kept[0][1] <= time.monotonic()
    for wrong in ({}, {"text": ""}, {"text": "\t\n"}, {"text": 3}, {"text": ["end"]}):
        assert posted(output, wrong, "marker") == (400, "Give the marker a text.")
    assert len(kept) == 1


def test_the_people_arrive_and_the_time_upright_begins_again_with_another_patient(output):
    client = Client(output)
    for number in range(3):
        output.send(replace(standing_frame(number, number / 10.0), people=BESIDE))
        found = client.next("frame")
    assert found["people"] == [{"number": 2, "x": 0.5, "z": 0.8, "top": 1.7}]
    assert found["upright_s"] == pytest.approx(0.2)
    output.send(replace(standing_frame(3, 0.3), patient=2))
    assert client.next("frame")["upright_s"] == 0.0
    client.close()


def test_two_clients_read_joints_and_angles_with_sigma_and_state(output):
    clients = [Client(output), Client(output)]
    assert [client.event() for client in clients] == [("sentence", "")] * 2
    frame = standing_frame(12, 0.8, lost=("HandLeft",))
    output.say("Tracking live.")
    output.send(frame)
    for client in clients:
        assert client.next("sentence") == "Tracking live."
        found = client.next("frame")
        assert (found["frame"], found["time_s"], found["why_lost"]) == (12, 0.8, "")
        assert 0.0 < found["latency_ms"] < 5000.0
        for name, place in zip(JOINT_NAMES, frame.joints_m, strict=True):
            expected = [None] * 3 if name == "HandLeft" else pytest.approx(place.tolist(), abs=1e-4)
            assert found["joints_m"][JOINT_INDEX[name]] == expected
        assert found["sigma_m"][JOINT_INDEX["HandLeft"]] is None
        assert found["state"][JOINT_INDEX["HandLeft"]] == LOST
        knee = ANGLE_NAMES.index("knee_flexion_left")
        assert found["degrees"][knee] == pytest.approx(angles_of(frame).degrees[0, knee], abs=1e-3)
        assert found["sigma_deg"][knee] == pytest.approx(angles_of(frame).sigma_deg[0, knee], abs=1e-3)
        client.close()


def test_a_new_client_is_given_the_sentence_but_no_frame_of_before(output):
    output.say("Looking at the room.")
    output.send(standing_frame(1, 0.1))
    client = Client(output)
    assert client.event() == ("sentence", "Looking at the room.")
    output.send(standing_frame(2, 0.2))
    assert client.next("frame")["frame"] == 2
    client.close()


def test_a_client_that_never_reads_delays_nobody_and_is_left_out(output, monkeypatch):
    monkeypatch.setattr("anchorpose.live.page_server.CLIENT_PATIENCE_S", 2.0)
    place = urlsplit(output.address)
    with socket.socket() as silent:
        silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        silent.connect((place.hostname, place.port))
        silent.sendall(f"GET {place.path}events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        reader = Client(output)
        reader.event()
        last = Thread(target=lambda: reader.until(199))
        last.start()
        longest_s = 0.0
        for number in range(200):
            began_s = time.monotonic()
            output.send(standing_frame(number, number / 30.0))
            longest_s = max(longest_s, time.monotonic() - began_s)
            time.sleep(0.003)
        assert longest_s < 1.5  # a send that waited for the silent client would take two seconds
        last.join(timeout=10.0)
        assert not last.is_alive()  # the last frame arrived
        reader.close()
        for number in range(400):  # enough for all buffers, also where a busy machine sends few of the first frames
            output.send(standing_frame(200 + number, (200 + number) / 30.0))
            time.sleep(0.01)
        silent.settimeout(5.0)
        received = 0
        while received < 100 * 3000 and (content := silent.recv(65536)):  # what was in the buffers, then the end
            received += len(content)
            if began_s + 20.0 < time.monotonic():
                break  # signs of life come for ever: it was not left out
        assert content == b""


def test_the_end_is_an_event_and_closing_twice_does_nothing(output):
    client = Client(output)
    output.close()
    output.close()
    assert client.next("end") == ""


def test_the_verb_refuses_a_port_in_use_and_leaves_nothing(output, tmp_path, capsys):
    from recording_builder import write_recording

    recording, results = write_recording(tmp_path / "recording"), tmp_path / "results"
    port = str(urlsplit(output.address).port)
    assert main(["live", str(recording), "-o", str(results), "--page", "--no-browser", "--port", port]) == 2
    assert "choose another --host or --port" in capsys.readouterr().err
    assert not results.exists()


def test_what_people_and_what_equipment_touch_is_sent_apart(output):
    client = Client(output)
    frame = standing_frame(1, 0.1, touched={"knee_left": True})
    output.send(replace(frame, holding={"hand_left": False}))
    sent = client.next("frame")
    assert (sent["touched"], sent["holding"]) == ({"knee_left": True}, {"hand_left": False})
    output.send(standing_frame(2, 0.2))
    assert client.next("frame")["holding"] is None
    client.close()


def test_time_upright_counts_between_upright_frames_and_not_over_a_gap(output):
    client = Client(output)
    seconds = []
    for number, time_s in enumerate((0.0, 0.1, 0.2, 5.0, 5.1)):
        output.send(standing_frame(number, time_s))
        seconds.append(client.next("frame")["upright_s"])
    assert seconds == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.3])
    output.send(live_frame_of(6, 5.2, np.full((21, 3), np.nan), why_lost="nobody is seen"))
    lost = client.next("frame")
    assert (lost["upright"], lost["load_left"], lost["touched"]) == (None, None, None)
    assert lost["upright_s"] == pytest.approx(0.3)
    client.close()


def test_the_load_moves_to_the_foot_that_the_body_leans_over(output):
    client = Client(output)
    shares = []
    for number, lean_m in enumerate((0.0, -0.05, 0.05)):  # the patient's right is +Z
        frame = standing_frame(number, number / 10.0, lean_m=lean_m)
        output.send(frame)
        shares.append(client.next("frame")["load_left"])
    assert shares[0] == pytest.approx(0.5, abs=0.02)
    assert shares[1] > 0.6
    assert shares[2] < 0.4
    client.close()
