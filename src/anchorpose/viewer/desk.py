"""What the server does with each request, without a word of HTTP: the table of what can be asked."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.run_record import plain
from anchorpose.viewer.body_skin import body_skin
from anchorpose.viewer.container import pack
from anchorpose.viewer.correcting import Correcting, shown
from anchorpose.viewer.description import describe
from anchorpose.viewer.footage import Footage
from anchorpose.viewer.hypotheses import HypothesisWorker
from anchorpose.viewer.payloads import motion_payload, points_payload, rays_payload, surface_payload
from anchorpose.viewer.review import Review

BYTES, JSON = "application/octet-stream", "application/json"


@dataclass(frozen=True, slots=True)
class Answer:
    """What is sent back."""

    content: bytes
    kind: str


class Desk:
    """Answers for one review; KeyError for what there is not, ValueError or AnchorposeError for what is wrong."""

    def __init__(self, review: Review, correcting: Correcting, who: str) -> None:
        self.review, self.correcting, self.who = review, correcting, who
        self.worker = HypothesisWorker()
        self._compiling = threading.Lock()
        self._asked: dict[str, Callable[[Mapping[str, str]], Answer]] = {
            "description": lambda query: _json(
                {**describe(self.review), "who": self.who, "corrections_file": self.correcting.path.name}
            ),
            "motion": lambda query: Answer(motion_payload(self.review), BYTES),
            "rays": lambda query: Answer(rays_payload(self._footage()), BYTES),
            "body": lambda query: self._body(),
            "points": self._points,
            "surface": self._surface,
            "corrections": lambda query: _json(shown(self.correcting.current())),
            "hypotheses": lambda query: _json(plain(self.worker.standing)),
            "hypotheses/found": lambda query: self._hypotheses(),
        }
        self._told: dict[str, Callable[[dict[str, Any]], Answer]] = {
            "corrections/add": lambda body: _json(shown(self.correcting.add(body))),
            "corrections/take-back": lambda body: _json(shown(self.correcting.take_back(body))),
            "hypotheses/start": self._start,
            "hypotheses/cancel": lambda body: self._cancel(),
        }

    def ask(self, name: str, query: Mapping[str, str]) -> Answer:
        """GET."""
        return self._asked[name](query)

    def tell(self, name: str, body: dict[str, Any]) -> Answer:
        """POST."""
        return self._told[name](body)

    def _footage(self) -> Footage:
        if self.review.footage is None:
            raise ValueError("there is no recording; start the viewer with it")
        return self.review.footage

    def _points(self, query: Mapping[str, str]) -> Answer:
        first, count = int(query["first"]), int(query["count"])
        return Answer(points_payload(self._footage(), first, count, query.get("room") == "1"), BYTES)

    def _surface(self, query: Mapping[str, str]) -> Answer:
        with self._compiling:  # the first call compiles: two at once would do it twice
            return Answer(surface_payload(self._footage(), int(query["first"]), int(query["count"])), BYTES)

    def _body(self) -> Answer:
        arrays = body_skin(self.review.run)
        if arrays is None:
            raise ValueError("no body was learnt in this run")
        return Answer(pack({}, arrays), BYTES)

    def _start(self, body: dict[str, Any]) -> Answer:
        position, footage = int(body["position"]), self._footage()
        if not 0 <= position < len(footage.frame):
            raise ValueError(f"there is no frame {position}")
        place = self.review.joints.position_m[position, JOINT_INDEX["SpineBase"]]
        xz_m = (float(place[0]), float(place[2])) if np.isfinite(place).all() else None
        self.worker.start(position, footage.recording, int(footage.frame[position]), xz_m)
        return _json(plain(self.worker.standing))

    def _cancel(self) -> Answer:
        self.worker.cancel()
        return _json(plain(self.worker.standing))

    def _hypotheses(self) -> Answer:
        if not self.worker.data:
            raise ValueError("there are no hypotheses yet")
        return Answer(self.worker.data, BYTES)


def _json(value: Any) -> Answer:
    return Answer(json.dumps(value, allow_nan=False).encode(), JSON)
