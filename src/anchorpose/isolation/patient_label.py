"""Correct the patient's pixels: add parts with another person's label, remove other people and pieces of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.camera import Camera
from anchorpose.descriptor.people import LEAST_AREA_M2
from anchorpose.isolation.bystander_memory import SAMPLE_PX
from anchorpose.isolation.components import label_components
from anchorpose.isolation.ownership import NOBODY, OwnershipLikelihood
from anchorpose.isolation.people import PERSON_AREA_M2, see_people
from anchorpose.isolation.region_growing import grow_regions, smooth_contact_m
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel

LEAST_CONTACT_M: Final = 0.05  # m, least length of the border between a stray piece and its person: a wrist's width
# least length of that border, times the piece's width; half a head continues along its longest side, a forearm does not
LEAST_CONTACT: Final = 1.0
# m2, largest stray piece: a head; a leg below a bar is larger, but may border on people who kneel in front of it
LARGEST_M2: Final = 0.03


def without_strays(shown: Sequence[Pieces], owners: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the owners (n,) uint8 of each camera after assigning stray pieces among the patient's pixels to the person
    whose surface they continue.

    A stray piece is no larger than a head, is not connected to other pixels of the patient in this camera, and
    continues another person's surface without a crease: for example, half a therapist's head where the patient's hand
    was expected. A forearm beyond a bar has no such border and remains the patient's.
    """
    return [_without_strays(pixels, owner) for pixels, owner in zip(shown, owners, strict=True)]


def _without_strays(pixels: Pieces, owner: np.ndarray) -> np.ndarray:
    others = owner >= PixelLabel.OTHER_PERSON
    mask = np.zeros(pixels.depth_m.shape, dtype=bool)
    mine = owner == PixelLabel.PATIENT
    mask[pixels.row[mine], pixels.column[mine]] = True
    if not others.any() or not mine.any():
        return owner
    piece_of, count = label_components(pixels.depth_m, mask, pixels.sensor.jump_limit)
    if count < 2:
        return owner
    piece = piece_of[pixels.row, pixels.column]
    area = np.bincount(piece[mine], pixels.area_m2[mine], minlength=count + 1)
    which = np.where(mine, piece, np.where(others, 0, -1))  # 0: another person
    contact_m = smooth_contact_m(pixels, which, count + 1)[0]
    stray = contact_m > np.maximum(LEAST_CONTACT_M, LEAST_CONTACT * np.sqrt(area))
    stray &= area < LARGEST_M2
    stray[[0, int(area.argmax())]] = False
    if not stray.any():
        return owner
    return grow_regions(pixels, np.where(mine & stray[piece], np.uint8(NOBODY), owner))


# a person with more than this share of pixels on the patient's expected skin is the patient
OWN_SHARE: Final = 0.5
OFF_SKIN_M: Final = 0.2  # m; pixels farther from the expected skin are off it: an arm moves this far between two frames
PART_CONTACT_M: Final = 0.05  # m, least border between a part of the patient and the rest: a wrist's width
ON_SKIN_M: Final = 0.05  # m; pixels nearer to the patient's expected skin are on it: its spacing, clothes, movement
LAST_LABEL: Final = 254  # the largest person label


def without_parts(shown: Sequence[Pieces], owners: list[np.ndarray], expected: OwnershipLikelihood) -> list[np.ndarray]:
    """Return the owners after parts of the patient with another person's label were given back to the patient.

    A label stands for another person if a body is fitted to it, or if enough of its pixels for a person lie off the
    patient's expected skin. Otherwise its pixels are a part of the patient, if they are connected to the patient.
    """
    bodies = np.unique(expected.owner)
    labels = {int(label) for owner in owners for label in np.flatnonzero(np.bincount(owner))}
    doubtful = [k for k in sorted(labels) if k >= PixelLabel.OTHER_PERSON and k not in bodies]
    skin = expected.points_m[expected.owner == PixelLabel.PATIENT]
    if not doubtful or not len(skin):
        return owners
    tree = cKDTree(skin)
    parts = [label for label in doubtful if _is_part(shown, owners, label, tree)]
    return [np.where(np.isin(owner, parts), np.uint8(PixelLabel.PATIENT), owner) for owner in owners]


def _is_part(shown: Sequence[Pieces], owners: Sequence[np.ndarray], label: int, skin: cKDTree) -> bool:
    """Return whether a label's pixels are a part of the patient: most lie on the patient's expected skin (a KD-tree),
    they are connected to the patient's pixels, and too few pixels for a person lie off this skin.
    """
    on_skin, elsewhere, contact_m = 0.0, 0.0, 0.0
    for pixels, owner in zip(shown, owners, strict=True):
        points, _, area = sampled(pixels, owner, owner == label)
        if not len(points):
            continue
        distance, _ = skin.query(points, distance_upper_bound=ON_SKIN_M)
        near = np.isfinite(distance)
        on_skin, elsewhere = on_skin + float(area[near].sum()), max(elsewhere, float(area[~near].sum()))
        which = np.where(owner == label, 1, np.where(owner == PixelLabel.PATIENT, 0, -1))
        contact_m = max(contact_m, float(smooth_contact_m(pixels, which, 2)[0, 1]))
    return on_skin > elsewhere and elsewhere < PERSON_AREA_M2 and contact_m >= PART_CONTACT_M


def one_patient(
    shown: Sequence[Pieces],
    cameras: Sequence[Camera],
    owners: list[np.ndarray],
    expected: OwnershipLikelihood | None,
    free: int,
) -> list[np.ndarray]:
    """Return the owners after separating other people who had been taken for a part of the patient.

    This is tested only if many of the patient's pixels lie off the expected skin; the learnt descriptor then shows
    whether several people share the pixels. The patient is the person with most of these pixels, together with all
    people whose pixels lie mostly on the expected skin: a patient who bends down may be found as two people. expected:
    the likelihood of predicted skin, None without a prediction. free: the first unused label.
    """
    skin = None if expected is None else expected.points_m[expected.owner == PixelLabel.PATIENT]
    tree = None if skin is None or not len(skin) else cKDTree(skin)
    if _off_skin_m2(shown, owners, tree) < LEAST_AREA_M2:
        return owners
    theirs = [pixels.only(o == PixelLabel.PATIENT) for pixels, o in zip(shown, owners, strict=True)]
    people = see_people(theirs, cameras)
    if len(people.people) < 2:
        return owners
    others = np.arange(len(people.people)) != np.argmax([person.area_m2 for person in people.people])
    others &= _share_on_skin(theirs, people.of, tree, len(others)) < OWN_SHARE
    if not others.any():
        return owners
    first = max(free, *(int(owner.max(initial=0)) + 1 for owner in owners))
    label = np.full(len(others) + 1, PixelLabel.PATIENT, np.int64)
    label[:-1][others] = np.minimum(first + np.arange(others.sum()), LAST_LABEL)
    label[-1] = NOBODY
    return [_split(pixels, owner, label[of]) for pixels, owner, of in zip(shown, owners, people.of, strict=True)]


def _off_skin_m2(shown: Sequence[Pieces], owners: Sequence[np.ndarray], skin: cKDTree | None) -> float:
    """Return the area of the patient's pixels farther than ``OFF_SKIN_M`` from the expected skin; without a prediction,
    of all these pixels.
    """
    area_m2 = 0.0
    for pixels, owner in zip(shown, owners, strict=True):
        points, _, area = sampled(pixels, owner, owner == PixelLabel.PATIENT)
        if len(points):
            off = np.ones(len(points), bool) if skin is None else ~np.isfinite(_away_m(skin, points, OFF_SKIN_M))
            area_m2 += float(area[off].sum())
    return area_m2


def _away_m(skin: cKDTree, points_m: np.ndarray, reach_m: float) -> np.ndarray:
    """Return the distance (n,) of points from the skin, inf beyond the reach."""
    return np.asarray(skin.query(points_m, distance_upper_bound=reach_m)[0])


def _share_on_skin(
    theirs: Sequence[Pieces], people: Sequence[np.ndarray | None], skin: cKDTree | None, count: int
) -> np.ndarray:
    """Return the share (k,) of each person's pixels that lies on the patient's expected skin. The people are found
    among the patient's pixels.
    """
    own, every = np.zeros(count + 1), np.zeros(count + 1)
    for pixels, of in zip(theirs, people, strict=True):
        if of is None or skin is None or not len(of):
            continue
        on_skin = np.isfinite(_away_m(skin, pixels.points_m, ON_SKIN_M))
        every += np.bincount(of % (count + 1), pixels.area_m2, count + 1)
        own += np.bincount(of % (count + 1), np.where(on_skin, pixels.area_m2, 0.0), count + 1)
    return np.asarray(own / np.maximum(every, 1e-9))[:-1]


def _split(pixels: Pieces, owner: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Return (n,) uint8 owners after region growing divided the patient's pixels. seeds: labels of the pixels where it
    starts; ``NOBODY`` at all other pixels.
    """
    patient = owner == PixelLabel.PATIENT
    grown = grow_regions(pixels.only(patient), seeds.astype(np.uint8))
    split = owner.copy()
    split[patient] = np.where(grown == NOBODY, PixelLabel.PATIENT, grown)
    return split


def sampled(pixels: Pieces, owner: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points_m (k, 3), owner (k,) and area_m2 (k,) of the ``wanted`` (n,) bool pixels in every third row and
    column.
    """
    chosen = pixels.index[::SAMPLE_PX, ::SAMPLE_PX]
    chosen = chosen[chosen >= 0]
    chosen = chosen[wanted[chosen]]
    return pixels.points_m[chosen], owner[chosen], pixels.area_m2[chosen] * SAMPLE_PX**2
