"""Whom a limb's pixels continue: the border at which the surface goes on as the patient's, or as another person's.

Two bodies that touch meet in a crease, one body goes on without (``isolation.region_growing``). So the border tells
whether pixels that a limb of the patient lies on are the patient's, whatever their label and whatever was predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.limb_proposals import CHAINS, Chain, end_points
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.isolation.region_growing import smooth_contact_m
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.tracker.observation import Observation

ON_SKIN_M: Final = 0.06  # as ``body.explained.COVERED_M``: clothes, the spacing of skin points and half a forearm
LEAST_BORDER_M: Final = 0.10  # to other people, in all cameras: a shorter one is a hand that holds the limb
HALF: Final = 0.5  # of a limb's border: hands that hold a limb go around less of it than where it joins the patient

SLACK_M: Final = 0.05  # of the border to the patient: a hand's width, where a bar or an arm lies across it
CONTINUES: Final = 0.35  # of the border to others: hands that hold a limb go around up to three times its width

_REST, _OTHERS = len(CHAINS), len(CHAINS) + 1  # of the pixels in ``limb_borders``
_PATIENT, _LIMB, _OTHER, _LEFT = range(4)  # of the pixels in ``relabelled_limb``


@dataclass(frozen=True, slots=True)
class Borders:
    """How long pixels go on without a crease, all cameras together, metres: as the patient's, as other people's."""

    to_patient_m: float
    to_others_m: float

    @property
    def doubtful(self) -> bool:
        """Whether the pixels may as well be another person's."""
        return self.to_others_m >= LEAST_BORDER_M and self.to_others_m >= HALF * self.to_patient_m


def limb_borders(
    body: Body, pose: Pose, pieces: tuple[Pieces | None, ...], views: tuple[View | None, ...]
) -> Mapping[Chain, Borders]:
    """Whom the patient's pixels on each limb beyond its elbow or knee continue.

    Both 0 of every limb where the patient's pixels border on other people's for less than ``LEAST_BORDER_M`` in all:
    no limb can be doubtful then.
    """
    if _border_to_others_m(pieces, views) < LEAST_BORDER_M:
        return dict.fromkeys(CHAINS, Borders(0.0, 0.0))
    length = np.zeros((_OTHERS + 1, _OTHERS + 1))
    for pixels, which in _limbs_of_pixels(body, pose, pieces, views):
        length += smooth_contact_m(pixels, which, _OTHERS + 1)
    return {
        chain: Borders(float(length[number, :_OTHERS].sum()), float(length[number, _OTHERS]))
        for number, chain in enumerate(CHAINS)
    }


def _border_to_others_m(pieces: Sequence[Pieces | None], views: Sequence[View | None]) -> float:
    """How long the patient's pixels go on as other people's, all cameras together."""
    length_m = 0.0
    for pixels, view in zip(pieces, views, strict=True):
        if pixels is not None and view is not None:
            label = view.labels[pixels.row, pixels.column]
            owner = np.where(label >= PixelLabel.OTHER_PERSON, 1, np.where(label == PixelLabel.PATIENT, 0, -1))
            length_m += float(smooth_contact_m(pixels, owner, 2)[0, 1])
    return length_m


def _limbs_of_pixels(
    body: Body, pose: Pose, pieces: Sequence[Pieces | None], views: Sequence[View | None]
) -> Iterator[tuple[Pieces, np.ndarray]]:
    """Each camera's pixels with (n,) int64: which of ``CHAINS`` they lie on, ``_REST`` of the patient, ``_OTHERS``."""
    skin_m, limb = pose_points(body, pose).points_m, limb_of_ends(body)
    for pixels, view in zip(pieces, views, strict=True):
        if pixels is None or view is None:
            continue
        label = view.labels[pixels.row, pixels.column]
        which = np.where(label >= PixelLabel.OTHER_PERSON, _OTHERS, -1).astype(np.int64)
        mine = np.flatnonzero(label == PixelLabel.PATIENT)
        if len(mine):
            which[mine] = limb[nearest_point(skin_m, pixels.points_m[mine].astype(np.float64), ON_SKIN_M)]
            yield pixels, which


def limb_of_ends(body: Body) -> np.ndarray:
    """(p + 1,) int64: which of ``CHAINS`` each skin point is beyond the elbow or knee of, else, and last, the rest."""
    limb = np.full(len(body.rest_m) + 1, _REST, np.int64)
    for number, chain in enumerate(CHAINS):
        limb[end_points(body.points, chain)] = number
    return limb


def relabelled_limb(
    body: Body, pose: Pose, moved: Pose, chain: Chain, seen: Observation
) -> tuple[View | None, ...] | None:
    """The views with a limb's pixels given to the patient; None where they continue another person rather.

    pose: before the limb was found; moved: with the limb where it was found. The patient's pixels on the limb as it was
    before, which nothing of the body covers now, become nobody's: they are not evidence of anything until the next
    frame decides whose they are.
    """
    whole = cKDTree(pose_points(body, moved).points_m[end_points(body.points, chain, whole=True)])
    skin_m, number = pose_points(body, moved).points_m, CHAINS.index(chain)
    views, length = list(seen.evidence.views), np.zeros((4, 4))
    for camera, (pixels, view) in enumerate(zip(seen.pieces, views, strict=True)):
        if pixels is None or view is None:
            continue
        which = _on_limb(pixels, view, whole)
        left = np.flatnonzero(which == _PATIENT)
        was = limb_of_ends(body)[
            nearest_point(pose_points(body, pose).points_m, pixels.points_m[left].astype(np.float64), ON_SKIN_M)
        ]
        left = left[was == number]
        left = left[nearest_point(skin_m, pixels.points_m[left].astype(np.float64), ON_SKIN_M) < 0]
        which[left] = _LEFT
        length += smooth_contact_m(pixels, which, 4)
        labels = view.labels.copy()
        labels[pixels.row[which == _LIMB], pixels.column[which == _LIMB]] = PixelLabel.PATIENT
        labels[pixels.row[left], pixels.column[left]] = PixelLabel.CLUTTER
        views[camera] = View(view.depth_m, labels)
    found = Borders(float(length[_LIMB, _PATIENT]), float(length[_LIMB, _OTHER]))
    return tuple(views) if found.to_patient_m + SLACK_M >= CONTINUES * found.to_others_m else None


def _on_limb(pixels: Pieces, view: View, limb: cKDTree) -> np.ndarray:
    """(n,) int64 of each foreground pixel: the patient's, on the limb's skin, other people's; -1 nobody's."""
    label = view.labels[pixels.row, pixels.column]
    which = np.where(label == PixelLabel.PATIENT, _PATIENT, -1).astype(np.int64)
    other = np.flatnonzero(label >= PixelLabel.OTHER_PERSON)
    if len(other):
        away, _ = limb.query(pixels.points_m[other], distance_upper_bound=ON_SKIN_M)
        which[other] = np.where(np.isfinite(away), _LIMB, _OTHER)
    return which
