"""Find other people whose pixels have the patient's label, by the learnt descriptor; give them new labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.camera import Camera
from anchorpose.descriptor.people import APART_M, LEAST_AREA_M2
from anchorpose.isolation.ownership import NOBODY
from anchorpose.isolation.patient_label import ON_SKIN_M, sampled
from anchorpose.isolation.people import PERSON_AREA_M2, People, see_people
from anchorpose.isolation.region_growing import grow_regions
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.tracker.sighting import see_people_apart

# m; a pixel farther than this from the predicted skin counts as off the skin; an arm moves at most this far between two
# frames
OFF_SKIN_M: Final = 0.2
# minimum share of a found person's pixels that must lie on the patient's predicted skin for a person with little
# surface to count as a part of the patient, which the learnt descriptor mistook for a separate person
OWN_SHARE: Final = 0.5
# minimum share of a person's pixels that must lie on the patient's predicted skin; if all found people with much
# surface have at least this share, they count as a single person. A body that was fitted to two people by mistake
# covers only about half of each person
ONE_BODY_SHARE: Final = 0.75


def one_patient(
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    skin_m: np.ndarray,
    place_xz_m: np.ndarray,
    free: np.ndarray,
    due: bool,
) -> tuple[View | None, ...]:
    """Return the views after separating other people whose pixels have the patient's label.

    Other people are searched for if many of the patient's pixels lie off the patient's predicted skin. They are also
    searched for whenever a check is ``due``, since the predicted skin does not reveal a body that was fitted to another
    person by mistake. If the descriptor takes a single person for two people, fitted rough bodies correct this error
    (``see_people_apart``). The patient is the person with most surface near the predicted place. Every other person who
    shows enough surface gets a new label. A person of smaller surface gets a new label only if many of the patient's
    pixels, and most of this person's pixels, lie off the predicted skin. skin_m (s, 3): the patient's predicted skin
    without uncertain points; place_xz_m (2,): the patient's predicted place over the ground; free: labels for new
    people, in the order in which they are given.
    """
    theirs = [_patient_pixels(pixels, view) for pixels, view in zip(pieces, views, strict=True)]
    skin = cKDTree(skin_m) if len(skin_m) else None
    moved = _off_skin_m2(theirs, skin) >= LEAST_AREA_M2
    if not (moved or due):
        return tuple(views)
    people = see_people(theirs, cameras)
    if len(people.people) < 2 or not _may_be_others(theirs, people, skin, moved).any():
        return tuple(views)
    people = see_people_apart(theirs, cameras).people
    others = _may_be_others(theirs, people, skin, moved)
    others[_nearest(people, place_xz_m)] = False
    if not others.any():
        return tuple(views)
    used = np.concatenate([np.unique(view.labels) for view in views if view is not None])
    label = np.full(len(others) + 1, PixelLabel.PATIENT, np.int64)
    label[:-1][others] = free[~np.isin(free, used)][: others.sum()]
    label[-1] = NOBODY
    return tuple(
        view if pixels is None or view is None or of is None else _split(pixels, view, label[of])
        for pixels, view, of in zip(theirs, views, people.of, strict=True)
    )


def _patient_pixels(pixels: Pieces | None, view: View | None) -> Pieces | None:
    if pixels is None or view is None:
        return None
    return pixels.only(view.labels[pixels.row, pixels.column] == PixelLabel.PATIENT)


def _may_be_others(theirs: Sequence[Pieces | None], people: People, skin: cKDTree | None, moved: bool) -> np.ndarray:
    """Return (k,) bool: people who may not be the patient. If at least two people have enough surface for a whole
    person, all such people are included, unless one body explains them: the patient's predicted skin covers them all.
    If many pixels lie off this skin (``moved``), people whose pixels lie mostly off it are included, too.
    """
    share = _share_on_skin(theirs, people, skin)
    large = np.array([person.area_m2 >= PERSON_AREA_M2 for person in people.people])
    large &= (large.sum() > 1) and (share[large] < ONE_BODY_SHARE).any()
    return large | (share < OWN_SHARE) if moved else large


def _nearest(people: People, place_xz_m: np.ndarray) -> int:
    """Return the index of the person with most surface near a place (2,): the largest product of the person's area and
    a normal density of the distance from the place.
    """
    weight = [
        person.area_m2 * np.exp(-0.5 * np.sum((person.ground_xz_m - place_xz_m) ** 2) / APART_M**2)
        for person in people.people
    ]
    return int(np.argmax(weight))


def _off_skin_m2(theirs: Sequence[Pieces | None], skin: cKDTree | None) -> float:
    """Return the area of the patient's pixels that lie farther than ``OFF_SKIN_M`` from the predicted skin; the area of
    all these pixels if ``skin`` is None.
    """
    area_m2 = 0.0
    for pixels in theirs:
        if pixels is None:
            continue
        every = np.ones(len(pixels.row), dtype=bool)
        points, _, area = sampled(pixels, every, every)
        if len(points):
            area_m2 += float(area[~_near(skin, points, OFF_SKIN_M)].sum())
    return area_m2


def _share_on_skin(theirs: Sequence[Pieces | None], people: People, skin: cKDTree | None) -> np.ndarray:
    """Return the share (k,) of each person's pixels that lies on the patient's predicted skin."""
    own, every = np.zeros(len(people.people) + 1), np.zeros(len(people.people) + 1)
    for pixels, of in zip(theirs, people.of, strict=True):
        if pixels is None or of is None or not len(of):
            continue
        every += np.bincount(of % len(every), pixels.area_m2, len(every))
        on_skin = _near(skin, pixels.points_m, ON_SKIN_M)
        own += np.bincount(of % len(own), np.where(on_skin, pixels.area_m2, 0.0), len(own))
    return np.asarray(own / np.maximum(every, 1e-9))[:-1]


def _near(skin: cKDTree | None, points_m: np.ndarray, reach_m: float) -> np.ndarray:
    """Return (n,) bool: points at most ``reach_m`` from the skin; all False if ``skin`` is None."""
    if skin is None:
        return np.zeros(len(points_m), dtype=bool)
    return np.asarray(np.isfinite(skin.query(points_m, distance_upper_bound=reach_m)[0]))


def _split(pixels: Pieces, view: View, seeds: np.ndarray) -> View:
    """Return the view after region growing divided the patient's pixels among people. seeds: the label at pixels where
    growing starts, ``NOBODY`` at all other pixels.
    """
    grown = grow_regions(pixels, seeds.astype(np.uint8))
    labels = view.labels.copy()
    labels[pixels.row, pixels.column] = np.where(grown == NOBODY, PixelLabel.PATIENT, grown)
    return View(view.depth_m, labels)
