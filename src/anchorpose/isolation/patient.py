"""The patient's pixels in every camera's frame: by place at the start, by the predicted skin afterwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.near_skin import DistanceField, distance_field, same_grid, thinned
from anchorpose.isolation.people import PatientChoice, People
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View

OTHERS_SPACING_M = 0.03  # as finely as the patient's own vertices, so that neither side wins by density
MAX_LABEL = 255


def isolate_at_start(pieces: Sequence[Pieces | None], people: People, choice: PatientChoice) -> tuple[View | None, ...]:
    """Label each camera's pixels by person; the patient is the person nearest to the chosen place."""
    axes = np.array([person.ground_xz_m for person in people.people]).reshape(-1, 2)
    patient = int(np.argmin(np.linalg.norm(axes - choice.ground_xz_m, axis=1))) if len(axes) else -1
    label_of = np.full(len(axes) + 1, PixelLabel.CLUTTER, dtype=np.int64)  # the last one: nobody
    others = [index for index in range(len(axes)) if index != patient]
    label_of[others] = np.minimum(PixelLabel.OTHER_PERSON + np.arange(len(others)), MAX_LABEL)
    if patient >= 0:
        label_of[patient] = PixelLabel.PATIENT
    return tuple(
        None if view is None or owner is None else _labelled(view, label_of[owner])
        for view, owner in zip(pieces, people.of, strict=True)
    )


def isolate(
    pieces: Sequence[Pieces | None],
    predicted_skin_m: np.ndarray,
    others_m: np.ndarray,
    config: IsolationConfig,
    frames_without_fit: int = 0,
) -> tuple[View | None, ...]:
    """Label each camera's pixels by the patient's predicted skin.

    predicted_skin_m (k, 3) world: vertices of the patient's body where it is expected now. others_m (m, 3) world:
    where the other people were one frame ago (``other_people``); may be empty. A pixel is the patient's if it lies
    on his skin (``contact_m``), or within the margin and not nearer to somebody else. What was somebody else's and now
    lies on his skin is no evidence: were it used, one mistake would spread over the body from frame to frame. A piece
    that is mostly his and touches nobody is his whole, so that an arm that outruns its prediction is kept. The rest is
    OTHER_PERSON, or CLUTTER where a piece is smaller than a hand.
    """
    skin = distance_field(predicted_skin_m, config.skin_margin_m + config.prediction_growth_m * frames_without_fit)
    others = same_grid(others_m[skin.at(others_m) > config.contact_m], skin)
    return tuple(None if view is None else _labelled(view, _by_skin(view, skin, others, config)) for view in pieces)


def other_people(pieces: Sequence[Pieces | None], views: Sequence[View | None]) -> np.ndarray:
    """(m, 3) float32 world: a thinned sample of the skin of everyone but the patient."""
    samples = [np.empty((0, 3), dtype=np.float32)]
    for piece, view in zip(pieces, views, strict=True):
        if piece is not None and view is not None:
            points = piece.points_m[view.labels[piece.row, piece.column] >= PixelLabel.OTHER_PERSON]
            samples.append(points)
    return thinned(np.concatenate(samples), OTHERS_SPACING_M)


def _by_skin(view: Pieces, skin: DistanceField, others: DistanceField, config: IsolationConfig) -> np.ndarray:
    """(n,) int64 label of each foreground pixel."""
    to_patient, to_others = skin.at(view.points_m), others.at(view.points_m)
    patient = np.isfinite(to_patient) & ((to_patient <= config.contact_m) | (to_patient <= to_others))
    size, his, touched, area = (
        np.bincount(view.piece, weights, view.piece_count + 1)
        for weights in (None, patient, np.isfinite(to_others), view.area_m2)
    )
    whole = (his > size / 2) & (touched == 0)
    somebody = np.where(area >= config.hand_area_m2, PixelLabel.OTHER_PERSON, PixelLabel.CLUTTER)
    return np.where(patient | whole[view.piece], PixelLabel.PATIENT, somebody[view.piece])


def _labelled(view: Pieces, label: np.ndarray) -> View:
    labels = view.labels.copy()
    labels[view.row, view.column] = label.astype(np.uint8)
    return View(view.depth_m, labels)
