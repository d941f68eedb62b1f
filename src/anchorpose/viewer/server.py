"""Define the servers of pages that show a review (the tables of a results folder and its recording). Each server has a
table of all requests, with the function that answers each request.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.writable import check_place
from anchorpose.results.corrections import corrections_beside, corrections_of_run
from anchorpose.results.run_record import RUN_FILE, as_json
from anchorpose.viewer import payloads
from anchorpose.viewer.depth_frames import DepthFrames
from anchorpose.viewer.guarded_server import BYTES, VIEWER_PAGE, GuardedHandler, GuardedServer, Response, json_response
from anchorpose.viewer.hypotheses import HypothesisWorker
from anchorpose.viewer.review import (
    CorrectedMeanwhile,
    CorrectionFile,
    Review,
    describe,
    open_review,
    valid_corrections,
)


class ReviewApi:
    """The answers to the requests that every page about a review makes: requests for the review's frames, and for the
    data with which the page draws them.

    Raises KeyError for an unknown request, ValueError or AnchorposeError for a request that cannot be answered.
    """

    def __init__(self, review: Review) -> None:
        self.review = review
        self._compiling = threading.Lock()
        self._get: dict[str, Callable[[Mapping[str, str]], Response]] = {
            "overview": lambda query: Response(payloads.overview_payload(self.review), BYTES),
            "motion": lambda query: self._rows(payloads.motion_payload, query),
            "rays": lambda query: Response(payloads.rays_payload(self._depth_frames()), BYTES),
            "body": lambda query: self._body(),
            "points": self._points,
            "surface": self._surface,
        }
        self._post: dict[str, Callable[[dict[str, Any]], Response]] = {}

    def get(self, name: str, query: Mapping[str, str]) -> Response:
        """Return the answer to a request that changes nothing. name: the request's name; query: its parameters."""
        return self._get[name](query)

    def post(self, name: str, body: dict[str, Any]) -> Response:
        """Return the answer to a request that changes data. name: the request's name; body: its JSON object."""
        return self._post[name](body)

    def close(self) -> None:
        """End any computation that is still running for the page."""

    def _depth_frames(self) -> DepthFrames:
        if self.review.depth_frames is None:
            raise ValueError("there is no recording; start the viewer with it")
        return self.review.depth_frames

    def _rows(self, payload: Callable[[Review, int, int], bytes], query: Mapping[str, str]) -> Response:
        return Response(payload(self.review, int(query["first"]), int(query["count"])), BYTES)

    def _points(self, query: Mapping[str, str]) -> Response:
        first, count = int(query["first"]), int(query["count"])
        return Response(payloads.points_payload(self._depth_frames(), first, count, query.get("room") == "1"), BYTES)

    def _surface(self, query: Mapping[str, str]) -> Response:
        with self._compiling:  # the first call compiles functions; if two calls ran at once, both would compile them
            return Response(
                payloads.surface_payload(self._depth_frames(), int(query["first"]), int(query["count"])), BYTES
            )

    def _body(self) -> Response:
        arrays = payloads.body_skin(self.review.run)
        if arrays is None:
            raise ValueError("no body was learnt in this run")
        return Response(payloads.pack({}, arrays), BYTES)


class ViewerApi(ReviewApi):
    """The answers to the viewer's requests: in addition to the answers of ``ReviewApi``, curves of joint angles,
    corrections, and hypotheses (possible places of surface points in the next frame).
    """

    def __init__(self, review: Review, corrections: CorrectionFile, who: str) -> None:
        super().__init__(review)
        self.corrections, self.who = corrections, who
        self.worker = HypothesisWorker()
        self._get |= {
            "description": lambda query: json_response(
                {**describe(self.review), "who": self.who, "corrections_file": self.corrections.path.name}
            ),
            "curves": lambda query: self._rows(payloads.curves_payload, query),
            "place": self._place,
            "corrections": lambda query: json_response(valid_corrections(self.corrections.current())),
            "hypotheses": lambda query: self._progress(),
            "hypotheses/found": lambda query: self._hypotheses(),
        }
        self._post |= {
            "corrections/add": self._add,
            "corrections/take-back": lambda body: json_response(valid_corrections(self.corrections.take_back(body))),
            "hypotheses/start": self._start,
            "hypotheses/cancel": lambda body: self._cancel(),
        }

    def close(self) -> None:
        """Stop computing hypotheses."""
        self.worker.cancel()

    def _add(self, body: dict[str, Any]) -> Response:
        """Add a correction. The field ``replaces`` of the body is the correction of the same joint, or of the patient,
        that the page showed as valid (``CorrectionFile.add``). If another reviewer has changed the same correction
        meanwhile, nothing is added, and the answer contains the present corrections and, as ``refused``, a sentence for
        the user.
        """
        given = {name: value for name, value in body.items() if name != "replaces"}
        try:
            return json_response(valid_corrections(self.corrections.add(given, body.get("replaces"))))
        except CorrectedMeanwhile as refusal:
            return json_response({**valid_corrections(refusal.current), "refused": str(refusal)})

    def _progress(self) -> Response:
        return json_response(as_json(self.worker.status))

    def _position(self, given: Any) -> int:
        position = int(given)
        if not 0 <= position < len(self._depth_frames().frame):
            raise ValueError(f"there is no frame {position}")
        return position

    def _place(self, query: Mapping[str, str]) -> Response:
        frames, position = self._depth_frames(), self._position(query["position"])
        place_m, why = frames.place_of_person(position, query["camera"], int(query["column"]), int(query["row"]))
        return json_response({"position_m": None if place_m is None else place_m.round(4).tolist(), "why": why})

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


class ReviewServer(GuardedServer):
    """A server of a page about a review; see ``GuardedServer``."""

    program = "anchorpose view"

    def __init__(self, api: ReviewApi, host: str, port: int) -> None:
        # set before the base class is initialised: if listening fails, ``server_close`` is called, which uses this
        # field
        self.api = api
        super().__init__(host, port, _Handler)

    def server_close(self) -> None:
        """Close the server, and end any computation that is still running for its page."""
        self.api.close()
        super().server_close()


class ViewerServer(ReviewServer):
    """The server of the viewer's page."""

    page = VIEWER_PAGE
    api: ViewerApi


class _Handler(GuardedHandler):
    server: ReviewServer

    def answer_get(self, name: str) -> None:
        query = dict(parse_qsl(urlsplit(self.path).query))
        self.answer(lambda: self.server.api.get(name, query))

    def answer_post(self, name: str, body: dict[str, Any]) -> Response:
        return self.server.api.post(name, body)


def open_viewer(
    results: Path, recording: Path | None, corrections: Path | None, who: str, host: str, port: int
) -> ViewerServer:
    """Return the server of the viewer, already listening. corrections: the file to which corrections are added, by
    default the file that ``corrections_beside`` names, beside the results.

    A new file of corrections begins with the corrections with which the results were tracked. Raises InputError if
    results, recording or corrections cannot be used, AnchorposeError if the server cannot listen on ``host`` and
    ``port``.
    """
    review = open_review(results, recording)
    if corrections is not None and not corrections.exists():
        check_place(corrections, results, recording)
    path = corrections if corrections is not None else corrections_beside(results)
    initial = corrections_of_run(results / RUN_FILE, review.run)
    api = ViewerApi(review, CorrectionFile(path, initial, review.joints), who)
    return ViewerServer(api, host, port)
