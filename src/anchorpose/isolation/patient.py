"""The patient's pixels in every camera's frame: by place at the start, by the predicted skin afterwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.growth import NOBODY, OTHER, PATIENT, grow_owners
from anchorpose.isolation.near_skin import DistanceField, distance_field, thinned
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
    lies on his skin is no evidence: were it used, one mistake would spread over the body from frame to frame. What lies
    off every prediction belongs to whom it hangs together with, so that an arm that outruns its prediction is kept; a
    piece on its own is the patient's if it is nearly in touch with him (a bar cuts a forearm off), else OTHER_PERSON,
    or CLUTTER where it is smaller than a hand.
    """
    growth = config.prediction_growth_m * frames_without_fit
    skin = distance_field(predicted_skin_m, config.skin_margin_m + growth)
    apart = others_m[skin.at(others_m) > config.contact_m]
    others = distance_field(apart, config.skin_margin_m + growth) if len(apart) else None
    owners = [None if view is None else _owners(view, skin, others, config) for view in pieces]
    own = [view.points_m[owner == PATIENT] for view, owner in zip(pieces, owners, strict=True)
           if view is not None and owner is not None]  # fmt: skip
    near = cKDTree(thinned(np.concatenate(own), OTHERS_SPACING_M)) if own else None
    return tuple(
        None if view is None or owner is None else _labelled(view, _labels(view, owner, near, config))
        for view, owner in zip(pieces, owners, strict=True)
    )


def other_people(pieces: Sequence[Pieces | None], views: Sequence[View | None], config: IsolationConfig) -> np.ndarray:
    """(m, 3) float32 world: a thinned sample of the skin of everyone but the patient.

    Clusters too small to be a person are left out: an arm of the patient that was once taken for somebody else's must
    not claim itself again in the next frame.
    """
    samples = [np.empty((0, 3), dtype=np.float32)]
    for piece, view in zip(pieces, views, strict=True):
        if piece is not None and view is not None:
            points = piece.points_m[view.labels[piece.row, piece.column] >= PixelLabel.OTHER_PERSON]
            samples.append(points)
    sample = thinned(np.concatenate(samples), OTHERS_SPACING_M)
    return sample[_cluster_sizes(sample) * OTHERS_SPACING_M**2 >= config.other_surface_m2]


def _cluster_sizes(points_m: np.ndarray) -> np.ndarray:
    """(m,) how many of the points hang together with each one, over gaps of two spacings."""
    if not len(points_m):
        return np.zeros(0, dtype=np.int64)
    cube = np.floor((points_m - points_m.min(axis=0)) / (2.0 * OTHERS_SPACING_M)).astype(np.int64)
    filled = np.zeros(cube.max(axis=0) + 1, dtype=bool)
    filled[tuple(cube.T)] = True
    cluster, _ = ndimage.label(filled, structure=np.ones((3, 3, 3), dtype=int))
    own = cluster[tuple(cube.T)]
    return np.bincount(own)[own]


def _owners(view: Pieces, skin: DistanceField, others: DistanceField | None, config: IsolationConfig) -> np.ndarray:
    """(n,) uint8 of ``growth``: who owns each foreground pixel, by prediction and by what hangs together."""
    to_patient = skin.at(view.points_m)
    to_others = np.full(len(to_patient), np.inf, np.float32) if others is None else others.at(view.points_m)
    patient = np.isfinite(to_patient) & ((to_patient <= config.contact_m) | (to_patient <= to_others))
    owner = np.where(patient, PATIENT, np.where(np.isfinite(to_others), OTHER, NOBODY)).astype(np.uint8)
    return grow_owners(view, owner)


def _labels(view: Pieces, owner: np.ndarray, patient: cKDTree | None, config: IsolationConfig) -> np.ndarray:
    """(n,) int64 pixel labels; pieces that nobody owns go to the patient if they nearly touch him."""
    open_pixels = np.flatnonzero(owner == NOBODY)
    touching = np.zeros(view.piece_count + 1, dtype=bool)
    if patient is not None and len(open_pixels):
        distance, _ = patient.query(view.points_m[open_pixels], distance_upper_bound=config.detached_m)
        touching[view.piece[open_pixels[np.isfinite(distance)]]] = True
    his = (owner == PATIENT) | ((owner == NOBODY) & touching[view.piece])
    area = np.bincount(view.piece, view.area_m2, view.piece_count + 1)
    somebody = np.where(area >= config.hand_area_m2, PixelLabel.OTHER_PERSON, PixelLabel.CLUTTER)
    return np.where(his, PixelLabel.PATIENT, somebody[view.piece])


def _labelled(view: Pieces, label: np.ndarray) -> View:
    labels = view.labels.copy()
    labels[view.row, view.column] = label.astype(np.uint8)
    return View(view.depth_m, labels)
