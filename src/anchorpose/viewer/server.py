"""The server of the viewer: a table of all requests about one review, and the results and files behind it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.writable import check_place
from anchorpose.results.corrections import corrections_beside, corrections_of_run
from anchorpose.results.run_record import RUN_FILE, as_json
from anchorpose.viewer.correction_file import CorrectionFile, valid_corrections
from anchorpose.viewer.depth_frames import DepthFrames
from anchorpose.viewer.guarded_server import BYTES, VIEWER_PAGE, GuardedHandler, GuardedServer, Response, json_response
from anchorpose.viewer.hypotheses import HypothesisWorker
from anchorpose.viewer.payloads import (
    body_skin,
    curves_payload,
    motion_payload,
    overview_payload,
    pack,
    points_payload,
    rays_payload,
    surface_payload,
)
from anchorpose.viewer.review import Review, describe, open_review


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
            "overview": lambda query: Response(overview_payload(self.review), BYTES),
            "motion": lambda query: self._rows(motion_payload, query),
            "curves": lambda query: self._rows(curves_payload, query),
            "rays": lambda query: Response(rays_payload(self._depth_frames()), BYTES),
            "body": lambda query: self._body(),
            "points": self._points,
            "surface": self._surface,
            "place": self._place,
            "corrections": lambda query: json_response(valid_corrections(self.corrections.current())),
            "hypotheses": lambda query: json_response(as_json(self.worker.status)),
            "hypotheses/found": lambda query: self._hypotheses(),
        }
        self._post: dict[str, Callable[[dict[str, Any]], Response]] = {
            "corrections/add": lambda body: json_response(valid_corrections(self.corrections.add(body))),
            "corrections/take-back": lambda body: json_response(valid_corrections(self.corrections.take_back(body))),
            "hypotheses/start": self._start,
            "hypotheses/cancel": lambda body: self._cancel(),
        }

    def get(self, name: str, query: Mapping[str, str]) -> Response:
        """Answers a request that changes nothing."""
        return self._get[name](query)

    def post(self, name: str, body: dict[str, Any]) -> Response:
        """Answers a request that changes something; body: its JSON object."""
        return self._post[name](body)

    def _depth_frames(self) -> DepthFrames:
        if self.review.depth_frames is None:
            raise ValueError("there is no recording; start the viewer with it")
        return self.review.depth_frames

    def _rows(self, payload: Callable[[Review, int, int], bytes], query: Mapping[str, str]) -> Response:
        return Response(payload(self.review, int(query["first"]), int(query["count"])), BYTES)

    def _points(self, query: Mapping[str, str]) -> Response:
        first, count = int(query["first"]), int(query["count"])
        return Response(points_payload(self._depth_frames(), first, count, query.get("room") == "1"), BYTES)

    def _surface(self, query: Mapping[str, str]) -> Response:
        with self._compiling:  # the first call compiles; two at once would compile twice
            return Response(surface_payload(self._depth_frames(), int(query["first"]), int(query["count"])), BYTES)

    def _place(self, query: Mapping[str, str]) -> Response:
        frames, position = self._depth_frames(), int(query["position"])
        if not 0 <= position < len(frames.frame):
            raise ValueError(f"there is no frame {position}")
        place_m, why = frames.place_of_person(position, query["camera"], int(query["column"]), int(query["row"]))
        return json_response({"position_m": None if place_m is None else place_m.round(4).tolist(), "why": why})

    def _body(self) -> Response:
        arrays = body_skin(self.review.run)
        if arrays is None:
            raise ValueError("no body was learnt in this run")
        return Response(pack({}, arrays), BYTES)

    def _start(self, body: dict[str, Any]) -> Response:
        position, frames = int(body["position"]), self._depth_frames()
        if not 0 <= position < len(frames.frame):
            raise ValueError(f"there is no frame {position}")
        place = self.review.joints.position_m[position, JOINT_INDEX["SpineBase"]]
        xz_m = (float(place[0]), float(place[2])) if np.isfinite(place).all() else None
        self.worker.start(position, frames.recording, int(frames.frame[position]), xz_m)
        return json_response(as_json(self.worker.status))

    def _cancel(self) -> Response:
        self.worker.cancel()
        return json_response(as_json(self.worker.status))

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
    """A server that listens.

    corrections: the file to extend; None = beside the results (``corrections_beside``). A new file begins with the
    corrections that the results were tracked with. Raises InputError where results, recording or corrections cannot be
    used, AnchorposeError where it cannot listen on ``host`` and ``port``.
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
