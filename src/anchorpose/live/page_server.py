"""Serve the live page to browsers, and the stream of events from which the page reads the newest frames.

Each client is served by a thread, which takes the newest frame when the previous frame has been sent: a slow client
misses frames, and a client that never reads is dropped after some seconds. The tracker never waits for clients.
"""

from __future__ import annotations

import json
import math
import socket
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from http import HTTPStatus
from threading import Condition, Thread
from typing import Any, Final

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_NAMES, LIMBS, STATE_NAMES
from anchorpose.live.markers import TakeMarker, plain_text
from anchorpose.live.output import LiveFrame, angles_of
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import LONGEST_GAP_S
from anchorpose.results.joint_angles import ANGLE_NAMES
from anchorpose.results.stand_training.centre_of_mass import centre_of_mass
from anchorpose.results.stand_training.extension import feet_load
from anchorpose.results.stand_training.stance import UprightConfig, stance, upright_limits
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT, JointTable
from anchorpose.viewer.guarded_server import LIVE_PAGE, GuardedHandler, GuardedServer, Response, json_response


@dataclass(frozen=True, slots=True)
class Standing:
    """The patient's posture and the load on the feet in one frame. upright: ``UPRIGHT``, ``NOT_UPRIGHT`` or
    ``UNKNOWN``; upright_s: total time upright so far. load_left: the left foot's share of the load, 0 to 1; load_sigma:
    its standard deviation; both are None if the patient is not upright or ``feet_load`` is unknown. inferred: whether
    any joint that determines ``upright`` was not seen; load_inferred: whether any joint that determines the load was
    not seen.
    """

    upright: int
    upright_s: float
    inferred: bool
    load_left: float | None
    load_sigma: float | None
    load_inferred: bool


class UprightClock:
    """A clock that sums the time for which the patient stands upright. It takes frames in the order of time, and
    defines upright as ``anchorpose measure`` does, but without using later frames.

    The leg length that the definition of upright needs is taken from the joints of each frame. The time between two
    upright frames counts if they are at most half a second apart; in a longer gap, the patient might have sat down and
    stood up.
    """

    def __init__(self, config: UprightConfig) -> None:
        self._config = config
        self._upright, self._upright_s, self._last_s = UNKNOWN, 0.0, float("-inf")

    def push(self, joints: JointTable) -> Standing:
        """Add the joints of one frame; return posture, upright time and load on the feet after this frame."""
        body, time_s, before = centre_of_mass(joints), float(joints.time_s[0]), self._upright
        shown = stance(joints, body.position_m)
        limits = upright_limits(shown, self._config)
        if not limits.known[0]:
            self._upright = UNKNOWN
        elif limits.begins[0]:
            self._upright = UPRIGHT
        elif limits.ends[0]:
            self._upright = NOT_UPRIGHT
        step_s, self._last_s = time_s - self._last_s, time_s
        if before == self._upright == UPRIGHT and step_s <= LONGEST_GAP_S:
            self._upright_s += step_s
        load = feet_load(joints, body)
        off, sigma = float(load.rightwards[0]), float(load.sigma[0])
        known = self._upright == UPRIGHT and math.isfinite(off) and math.isfinite(sigma)
        return Standing(
            upright=int(self._upright),
            upright_s=self._upright_s,
            inferred=bool(shown.state_code[0] > 0),
            load_left=0.5 - off if known else None,
            load_sigma=sigma if known else None,
            load_inferred=bool(load.state_code[0] > 0),
        )


EVENTS: Final = "events"
STREAM: Final = "text/event-stream"
# s, maximum time between two messages to a page; the messages show that the program still runs
SIGN_OF_LIFE_S: Final = 1.0
CLIENT_PATIENCE_S: Final = 5.0  # s, maximum time for which a client reads nothing before it is dropped
# Size of the socket's buffer in bytes, enough for some frames. With a larger buffer of the socket, a slow client would
# get frames with a delay of seconds.
BUFFER_BYTES: Final = 32 * 1024
EXACT: Final = 4  # number of decimal places of positions in metres (0.1 mm)


class PageOutput:
    """An ``Output`` that serves the live page from separate threads. address: the address that a browser must open; it
    includes the secret token.

    has_markers: whether the page has keys and buttons that set markers (conditions and ratings); only a recording can
    store markers. Raises AnchorposeError if the server cannot listen on ``host`` and ``port``.
    """

    name = "the page"

    def __init__(self, host: str, port: int, has_markers: bool = False) -> None:
        self._newest = _Newest()
        self._clock, self._patient = UprightClock(UprightConfig()), 1
        self._server = _LiveServer(self._newest, host, port, has_markers)
        self._thread = Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Return the address with the secret token that every request must have."""
        return self._server.address

    def send(self, frame: LiveFrame) -> None:
        """Make this frame the newest frame of the page (see ``Output.send``)."""
        if frame.patient != self._patient:  # the upright time of a new patient begins at 0
            self._clock, self._patient = UprightClock(UprightConfig()), frame.patient
        standing, people = self._clock.push(frame.joint_table), frozenset(one.number for one in frame.people)
        self._newest.put("frame", lambda: frame_message(frame, standing), people)

    def say(self, sentence: str) -> None:
        """Show a sentence about the session until the next sentence comes."""
        self._newest.put("sentence", lambda: sentence)

    def asked(self) -> int | None:
        """Return the number (``PersonInView``) of the person whom the user chose as the new patient; later calls return
        None, until the user chooses again.
        """
        return self._newest.take_asked()

    def keep_markers(self, take: TakeMarker) -> None:
        """Pass the text and time of each marker that a user sets on the page to ``take`` from now on."""
        self._server.take_marker = take

    def close(self) -> None:
        """Show on the page that the session has ended, and end the server. May be called twice."""
        self._newest.end()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def describe_live(has_markers: bool) -> dict[str, Any]:
    """Return the values that the page needs before the first frame, for JSON. has_markers: whether the page has keys
    and buttons that set markers (conditions and ratings).
    """
    return {
        "markers": has_markers,
        "joints": list(JOINT_NAMES),
        "limbs": [list(limb) for limb in LIMBS],
        "states": list(STATE_NAMES),
        "angles": list(ANGLE_NAMES),
    }


def frame_message(frame: LiveFrame, standing: Standing) -> dict[str, Any]:
    """Return a frame as values for JSON: metres, degrees, seconds; states as indices in ``JointState``; None for
    an unknown value.
    """
    angles = angles_of(frame)
    return {
        "frame": frame.frame,
        "time_s": frame.time_s,
        "latency_ms": round(1000.0 * frame.latency_s, 1),
        "dropped": frame.dropped,
        "joints_m": [_numbers(place) for place in frame.joints_m],
        "sigma_m": _numbers(frame.sigma_m),
        "state": frame.state_code.tolist(),
        "degrees": _numbers(angles.degrees[0]),
        "sigma_deg": _numbers(angles.sigma_deg[0]),
        "angle_state": angles.state_code[0].tolist(),
        "why_lost": frame.why_lost,
        "upright": None if standing.upright == UNKNOWN else standing.upright == UPRIGHT,
        "upright_s": round(standing.upright_s, 2),
        "upright_inferred": standing.inferred,
        "load_left": standing.load_left,
        "load_sigma": standing.load_sigma,
        "load_inferred": standing.load_inferred,
        "touched": None if frame.touched is None else dict(frame.touched),
        "holding": None if frame.holding is None else dict(frame.holding),
        "people": [
            {"number": one.number, "x": round(one.place_xz_m[0], EXACT), "z": round(one.place_xz_m[1], EXACT)}
            | {"top": round(one.top_m, EXACT)}
            for one in frame.people
        ],
    }


def _numbers(values: Iterable[float]) -> list[float | None]:
    return [round(float(value), EXACT) if math.isfinite(value) else None for value in values]


class _Newest:
    """The newest frame and sentence for all clients, and the person whom a client chose as the patient. Older frames
    and sentences are not kept.
    """

    def __init__(self) -> None:
        self._changed, self.ended = Condition(), False
        # by name of an event: its number, and a function that returns its value for JSON
        self._events: dict[str, tuple[int, Callable[[], Any]]] = {"sentence": (0, str)}
        self._count = 0
        self._people = frozenset[int]()  # numbers of the people who may be chosen
        self._asked: int | None = None

    def put(self, name: str, value: Callable[[], Any], people: frozenset[int] | None = None) -> None:
        """Replace the event called ``name`` by a newer event. value: function that returns the event's value for JSON;
        people: numbers of the people who may be chosen, None if they are the same as before.
        """
        with self._changed:
            self._count += 1
            self._events[name] = (self._count, value)
            self._people = self._people if people is None else people
            self._changed.notify_all()

    def ask(self, number: int) -> None:
        """Choose a person to become the patient; raises AnchorposeError if the newest frame does not show a person
        with this number.
        """
        with self._changed:
            if number not in self._people:
                raise AnchorposeError(f"Person {number} is not in view now; the patient is as before.")
            self._asked = number

    def take_asked(self) -> int | None:
        """Return the number of the person whom a client chose; None if no person was chosen since the last call. After
        a choice was returned, no person can be chosen before the next frame.
        """
        with self._changed:
            asked, self._asked = self._asked, None
            if asked is not None:
                self._people = frozenset()
        return asked

    def end(self) -> None:
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def begin(self) -> tuple[int, bytes]:
        """Return, for a new client, the number of the newest event (the client gets all later events), and the present
        sentence as an event.
        """
        with self._changed:
            return self._count, _event("sentence", self._events["sentence"][1]())

    def take(self, after: int, patience_s: float) -> tuple[int, bytes]:
        """Wait for events newer than the number ``after``; return the newest number and the events, empty if no event
        came.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.ended or self._count > after, patience_s)
            count, events = self._count, list(self._events.items())
        return count, b"".join(_event(name, value()) for name, (number, value) in events if number > after)


def _event(name: str, value: Any) -> bytes:
    return f"event: {name}\ndata: {json.dumps(value, allow_nan=False)}\n\n".encode()


class _LiveServer(GuardedServer):
    page, program = LIVE_PAGE, "anchorpose live"

    def __init__(self, newest: _Newest, host: str, port: int, has_markers: bool) -> None:
        self.newest, self.has_markers = newest, has_markers
        self.take_marker: TakeMarker | None = None
        super().__init__(host, port, _Handler)


class _Handler(GuardedHandler):
    server: _LiveServer

    def answer_get(self, name: str) -> None:
        if name == EVENTS:
            self._send_events()
        elif name == "description":
            self.answer(lambda: json_response(describe_live(self.server.has_markers)))
        else:
            self.refuse(HTTPStatus.NOT_FOUND, "There is nothing of this name here.")

    def answer_post(self, name: str, body: dict[str, Any]) -> Response:
        """Answer a POST. If ``name`` is ``patient``, the person with the number in ``body`` becomes the patient. If
        ``name`` is ``marker``, the text in ``body`` is stored as a marker in the recording.
        """
        if name == "marker":
            return self._keep_marker(body.get("text"))
        if name != "patient":
            raise KeyError(name)
        number = body.get("person")
        if type(number) is not int:  # isinstance would accept True
            raise ValueError("Give the number of a person who is in view; the patient is as before.")
        self.server.newest.ask(number)
        return json_response({"person": number})

    def _keep_marker(self, text: object) -> Response:
        if self.server.take_marker is None:
            raise ValueError("Nothing is recorded, so that no marker is kept.")
        if not isinstance(text, str) or not plain_text(text):
            raise ValueError("Give the marker a text.")
        self.server.take_marker(text, time.monotonic())
        return json_response({"marker": plain_text(text)})

    def _send_events(self) -> None:
        """Send events until the session ends, or the client goes away or reads nothing."""
        self.connection.settimeout(CLIENT_PATIENCE_S)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.close_connection = True  # when the stream ends, the connection ends, too
        newest = self.server.newest
        seen, events = newest.begin()  # taken before the answer begins, so that the client gets all later events
        self.send_head(HTTPStatus.OK, STREAM, {})
        try:
            self.wfile.write(events)
            while not newest.ended:
                seen, events = newest.take(seen, SIGN_OF_LIFE_S)
                self.wfile.write(events or b": still here\n\n")
            self.wfile.write(_event("end", ""))
        except (ConnectionError, TimeoutError):
            pass
