"""What the server does with each request, without a word of HTTP: the table of what can be asked.

The learnt body for the page: its skin at rest, and how each point of it hangs on the bones that move.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anchorpose.body.asset import BodyAsset, load_body_asset
from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import MOVING_BONES
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.run_record import as_json
from anchorpose.viewer.correcting import Correcting, shown
from anchorpose.viewer.depth_frames import Footage
from anchorpose.viewer.description import describe
from anchorpose.viewer.hypotheses import HypothesisWorker
from anchorpose.viewer.payloads import motion_payload, pack, points_payload, rays_payload, surface_payload
from anchorpose.viewer.review import Review

INFLUENCES = 4  # bones a point, for the graphics card; the others move no point by more than 5 mm, for the eye only


def moving_ancestor(asset: BodyAsset) -> np.ndarray:
    """(b,) which of ``MOVING_BONES`` carries each bone: itself, or the next one above it."""
    row_of = {asset.bone(name): row for row, name in enumerate(MOVING_BONES)}
    carried = np.zeros(len(asset.bone_names), np.int64)
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        carried[bone] = row_of[bone] if bone in row_of else carried[parent]
    return carried


def body_skin(run: dict[str, Any]) -> dict[str, np.ndarray] | None:
    """The arrays of the page's body; None where no body was learnt.

    vertices (v, 3) and normals (v, 3) float32 at rest, faces (f, 3) uint32, bones (v, 4) uint8 rows of
    ``MOVING_BONES``, weights (v, 4) float32, heads (21, 3) float32: where the bones turn about, at rest. Posed:
    ``sum of weight * (turn (vertex - head) + head in the world)``, linear blend skinning as in ``ShapedBody.skin``.
    """
    learnt = run.get("body")
    if learnt is None:
        return None
    asset = load_body_asset()
    body = shape_body(asset, np.array(learnt["coefficients"]))
    bones, weights = _heaviest(moving_ancestor(asset)[asset.skin_bones], asset.skin_weights)
    return {
        "vertices": body.vertices.astype(np.float32),
        "normals": _normals(body.vertices, asset.faces).astype(np.float32),
        "faces": asset.faces.astype(np.uint32),
        "bones": bones,
        "weights": weights,
        "heads": body.bone_heads[[asset.bone(name) for name in MOVING_BONES]].astype(np.float32),
    }


def _heaviest(bones: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ``INFLUENCES`` heaviest bones of each point, bones that move together counted as one; weights sum to 1."""
    total = np.zeros((len(bones), len(MOVING_BONES)))
    np.add.at(total, (np.arange(len(bones))[:, None], bones), weights)
    chosen = np.argsort(-total, axis=1, kind="stable")[:, :INFLUENCES]
    kept = np.take_along_axis(total, chosen, axis=1)
    return chosen.astype(np.uint8), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    across = np.cross(b - a, c - a)
    summed = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(summed, faces[:, corner], across)
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1.0)


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
            "hypotheses": lambda query: _json(as_json(self.worker.standing)),
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
        return _json(as_json(self.worker.standing))

    def _cancel(self) -> Answer:
        self.worker.cancel()
        return _json(as_json(self.worker.standing))

    def _hypotheses(self) -> Answer:
        if not self.worker.data:
            raise ValueError("there are no hypotheses yet")
        return Answer(self.worker.data, BYTES)


def _json(value: Any) -> Answer:
    return Answer(json.dumps(value, allow_nan=False).encode(), JSON)
