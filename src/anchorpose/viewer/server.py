"""The server of the viewer: a table of all requests about one review, and the results and files behind it.

The hypotheses of a frame are computed on demand, some seconds to a minute of work, in a separate process.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX
from anchorpose.recording.recording import Recording
from anchorpose.recording.writable import check_place
from anchorpose.results.corrections import corrections_beside, corrections_of_run
from anchorpose.results.run_record import RUN_FILE, as_json
from anchorpose.threads import one_thread
from anchorpose.viewer import payloads
from anchorpose.viewer.depth_frames import DepthFrames
from anchorpose.viewer.guarded_server import (
    BYTES,
    VIEWER_PAGE,
    GuardedHandler,
    GuardedServer,
    Response,
    describe_error,
    json_response,
)
from anchorpose.viewer.review import CorrectionFile, Review, describe, open_review, valid_corrections


class Progress(StrEnum):
    """The progress of the work."""

    IDLE = "idle"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class WorkStatus:
    """For the page: the row of the results that is worked on, how many frames were read, and messages."""

    progress: Progress
    position: int | None = None
    frames_read: int = 0
    messages: tuple[str, ...] = ()


class HypothesisWorker:
    """Works on one frame at a time; starting another cancels the one under way."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._work: tuple[BaseProcess, Connection] | None = None
        self._status, self._data = WorkStatus(Progress.IDLE), b""

    @property
    def status(self) -> WorkStatus:
        """As of now: what the process has sent since it was last asked for is read."""
        with self._lock:
            while self._work is not None and self._work[1].poll():
                self._receive(self._work[1])
            return self._status

    @property
    def data(self) -> bytes:
        """The result of ``hypotheses_of``, packed; empty unless the work is done."""
        with self._lock:
            return self._data

    def start(self, position: int, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
        """Starts on the frame of this number; patient_xz_m: the patient's place in the results, None where lost."""
        self.cancel()
        context = multiprocessing.get_context("spawn")  # the server has threads, whose locks must not be copied
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(theirs, recording, frame, patient_xz_m), daemon=True)
        with self._lock:  # cancel finds the process started, or none
            process.start()
            self._work, self._data = (process, ours), b""
            self._status = WorkStatus(Progress.WORKING, position)
        theirs.close()

    def cancel(self) -> None:
        """Ends the work, if there is any."""
        with self._lock:
            work, self._work = self._work, None
            if work is None:
                return
            self._status = replace(self._status, progress=Progress.CANCELLED)
        work[0].terminate()
        work[0].join()

    def _receive(self, pipe: Connection) -> None:
        try:
            received: int | tuple[bytes, tuple[str, ...]] = pipe.recv()
        except EOFError:
            received = b"", ("The work ended without a result.",)
        if isinstance(received, int):
            self._status = replace(self._status, frames_read=received)
            return
        self._work, (self._data, messages) = None, received
        progress = Progress.DONE if self._data else Progress.FAILED
        self._status = replace(self._status, progress=progress, messages=messages)


def hypotheses_of(
    recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None, tick: Any
) -> tuple[bytes, tuple[str, ...]]:
    """The nodes of a frame and where each subset of anchors finds them in the next, packed; and messages.

    Arrays: nodes (m, 3) and reached (m, s, 3) float32 world metres, NaN where a subset finds no match; best (m,) int32:
    the subset on the best branch, -1 where none; asked (m,) uint8: whether the track tree follows the node.
    meta: subsets [[anchor names]]; frames [this, next].
    """
    # the tracker is a second of imports: in the process that needs it
    from anchorpose.tracker.config import TrackConfig
    from anchorpose.tracker.inspection import inspect_frame

    found = inspect_frame(recording, frame, replace(TrackConfig(), patient_xz_m=patient_xz_m), False, tick)
    if found.next is None or found.observation is None:
        return b"", (*found.account, "There are no hypotheses: the patient was not found here, or no frame follows.")
    nodes = found.observation.surface.points_m
    after = found.next.observation.surface.points_m
    match, tree = found.next.links.match, found.next.hypothesis
    reached = np.where(match[..., None] >= 0, after[np.maximum(match, 0)], np.float32(np.nan))
    best, asked = np.full(len(nodes), -1, np.int32), np.zeros(len(nodes), np.uint8)
    best[tree.node], asked[tree.node] = tree.tree.subset, 1
    meta = {
        "subsets": [[ANCHOR_NAMES[anchor] for anchor in subset] for subset in found.next.links.subsets.tolist()],
        "frames": [found.frame_set.frame, found.next.observation.frame_set.frame],
    }
    arrays = {"nodes": nodes, "reached": reached.astype(np.float32), "best": best, "asked": asked}
    how = "With a first estimate of the body, from this frame on; 'anchorpose inspect --as-tracked' repeats tracking."
    return payloads.pack(meta, arrays), (how,)


def _work(pipe: Connection, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
    read = count(1)
    try:
        with one_thread():
            found = hypotheses_of(recording, frame, patient_xz_m, lambda: pipe.send(next(read)))
    except AnchorposeError as error:
        found = b"", (describe_error(error),)
    pipe.send(found)


class ViewerApi:
    """Answers requests about one review.

    Raises KeyError for an unknown request, ValueError or AnchorposeError for a wrong one.
    """

    def __init__(self, review: Review, corrections: CorrectionFile, who: str) -> None:
        self.review, self.corrections, self.who = review, corrections, who
        self.worker = HypothesisWorker()
        self._compiling = threading.Lock()
        self._get: dict[str, Callable[[Mapping[str, str]], Response]] = {
            "description": lambda query: json_response(
                {**describe(self.review), "who": self.who, "corrections_file": self.corrections.path.name}
            ),
            "overview": lambda query: Response(payloads.overview_payload(self.review), BYTES),
            "motion": lambda query: self._rows(payloads.motion_payload, query),
            "curves": lambda query: self._rows(payloads.curves_payload, query),
            "rays": lambda query: Response(payloads.rays_payload(self._depth_frames()), BYTES),
            "body": lambda query: self._body(),
            "points": self._points,
            "surface": self._surface,
            "place": self._place,
            "corrections": lambda query: json_response(valid_corrections(self.corrections.current())),
            "hypotheses": lambda query: self._progress(),
            "hypotheses/found": lambda query: self._hypotheses(),
        }
        self._post: dict[str, Callable[[dict[str, Any]], Response]] = {
            "corrections/add": lambda body: json_response(valid_corrections(self.corrections.add(body))),
            "corrections/take-back": lambda body: json_response(valid_corrections(self.corrections.take_back(body))),
            "hypotheses/start": self._start,
            "hypotheses/cancel": lambda body: self._cancel(),
        }

    def _progress(self) -> Response:
        return json_response(as_json(self.worker.status))

    def get(self, name: str, query: Mapping[str, str]) -> Response:
        """Answer a request that changes nothing."""
        return self._get[name](query)

    def post(self, name: str, body: dict[str, Any]) -> Response:
        """Answer a request that changes something; body: its JSON object."""
        return self._post[name](body)

    def _depth_frames(self) -> DepthFrames:
        if self.review.depth_frames is None:
            raise ValueError("there is no recording; start the viewer with it")
        return self.review.depth_frames

    def _position(self, given: Any) -> int:
        position = int(given)
        if not 0 <= position < len(self._depth_frames().frame):
            raise ValueError(f"there is no frame {position}")
        return position

    def _rows(self, payload: Callable[[Review, int, int], bytes], query: Mapping[str, str]) -> Response:
        return Response(payload(self.review, int(query["first"]), int(query["count"])), BYTES)

    def _points(self, query: Mapping[str, str]) -> Response:
        first, count = int(query["first"]), int(query["count"])
        return Response(payloads.points_payload(self._depth_frames(), first, count, query.get("room") == "1"), BYTES)

    def _surface(self, query: Mapping[str, str]) -> Response:
        with self._compiling:  # the first call compiles; two at once would compile twice
            return Response(
                payloads.surface_payload(self._depth_frames(), int(query["first"]), int(query["count"])), BYTES
            )

    def _place(self, query: Mapping[str, str]) -> Response:
        frames, position = self._depth_frames(), self._position(query["position"])
        place_m, why = frames.place_of_person(position, query["camera"], int(query["column"]), int(query["row"]))
        return json_response({"position_m": None if place_m is None else place_m.round(4).tolist(), "why": why})

    def _body(self) -> Response:
        arrays = payloads.body_skin(self.review.run)
        if arrays is None:
            raise ValueError("no body was learnt in this run")
        return Response(payloads.pack({}, arrays), BYTES)

    def _start(self, body: dict[str, Any]) -> Response:
        position, frames = self._position(body["position"]), self._depth_frames()
        place = self.review.joints.position_m[position, JOINT_INDEX["SpineBase"]]
        xz_m = (float(place[0]), float(place[2])) if np.isfinite(place).all() else None
        self.worker.start(position, frames.recording, int(frames.frame[position]), xz_m)
        return self._progress()

    def _cancel(self) -> Response:
        self.worker.cancel()
        return self._progress()

    def _hypotheses(self) -> Response:
        if not self.worker.data:
            raise ValueError("there are no hypotheses yet")
        return Response(self.worker.data, BYTES)


class ViewerServer(GuardedServer):
    """See ``GuardedServer``."""

    page, program = VIEWER_PAGE, "anchorpose view"

    def __init__(self, api: ViewerApi, host: str, port: int) -> None:
        self.api = api  # first: where nothing can listen, the server is closed at once
        super().__init__(host, port, _Handler)

    def server_close(self) -> None:
        """Cancels the work under way as well."""
        self.api.worker.cancel()
        super().server_close()


class _Handler(GuardedHandler):
    server: ViewerServer

    def answer_get(self, name: str) -> None:
        query = dict(parse_qsl(urlsplit(self.path).query))
        self.answer(lambda: self.server.api.get(name, query))

    def answer_post(self, name: str, body: dict[str, Any]) -> Response:
        return self.server.api.post(name, body)


def open_viewer(
    results: Path, recording: Path | None, corrections: Path | None, who: str, host: str, port: int
) -> ViewerServer:
    """Return a server that listens; corrections: the file to extend, by default ``corrections_beside`` the results.

    A new file begins with the corrections that the results were tracked with. Raises InputError where results,
    recording or corrections cannot be used, AnchorposeError where it cannot listen on ``host`` and ``port``.
    """
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    review = open_review(results, recording)
    if corrections is not None and not corrections.exists():
        check_place(corrections, results, recording)
    path = corrections if corrections is not None else corrections_beside(results)
    initial = corrections_of_run(results / RUN_FILE, review.run)
    api = ViewerApi(review, CorrectionFile(path, initial, review.joints), who)
    return ViewerServer(api, host, port)
