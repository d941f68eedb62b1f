"""Correct the patient's pixels: add parts that have another person's label, and remove stray pieces of other people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.isolation.bystander_memory import SAMPLE_PX
from anchorpose.isolation.components import label_components
from anchorpose.isolation.ownership import NOBODY, OwnershipLikelihood
from anchorpose.isolation.people import PERSON_AREA_M2
from anchorpose.isolation.region_growing import grow_regions, smooth_contact_m
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel

# m, minimum length of the border between a stray piece and the person whose surface it continues, a wrist's width
LEAST_CONTACT_M: Final = 0.05
# minimum length of the border between a stray piece and the person whose surface it continues, divided by the square
# root of the piece's area. Half a head borders on the other half along its longest side, so it can be a stray piece; a
# forearm borders on the rest of the body along a shorter side, so it cannot
LEAST_CONTACT: Final = 1.0
# m2, maximum area of a stray piece, the area of a head. The patient's leg below a bar may border on a person who kneels
# in front, but the leg is larger than a stray piece, so it keeps the patient's label
LARGEST_M2: Final = 0.03


def without_strays(shown: Sequence[Pieces], owners: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the owners (n,) uint8 of each camera's foreground pixels (``shown``): as in ``owners``, but a stray piece
    of the patient's pixels gets the person whose surface it continues.

    A stray piece is no larger than a head, is not connected to other pixels of the patient in this camera, and
    continues another person's surface without a crease between them: for example, half a therapist's head where the
    patient's hand was expected. The patient's forearm beyond a bar continues no other person's surface, so it keeps the
    patient's label.
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
    which = np.where(mine, piece, np.where(others, 0, -1))  # the patient's piece; 0: another person, -1: nobody
    contact_m = smooth_contact_m(pixels, which, count + 1)[0]
    stray = contact_m > np.maximum(LEAST_CONTACT_M, LEAST_CONTACT * np.sqrt(area))
    stray &= area < LARGEST_M2
    stray[[0, int(area.argmax())]] = False
    if not stray.any():
        return owner
    return grow_regions(pixels, np.where(mine & stray[piece], np.uint8(NOBODY), owner))


# m, minimum length of the border between a part of the patient and the patient's other pixels, a wrist's width
PART_CONTACT_M: Final = 0.05
# m; pixels this near to a point of predicted skin count as on the skin, to allow for spacing, clothes and movement
ON_SKIN_M: Final = 0.05


def without_parts(shown: Sequence[Pieces], owners: list[np.ndarray], expected: OwnershipLikelihood) -> list[np.ndarray]:
    """Give parts of the patient that have another person's label the patient's label again; return the owners (n,) of
    each camera's foreground pixels.

    A label is believed to stand for another person in two cases: if a body model is fitted to this person (``expected``
    then has this person's skin), or if the label's pixels off the patient's predicted skin have enough area for a
    person. Otherwise the label's pixels are a part of the patient, if most lie on the patient's predicted skin and they
    are connected to the patient.
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
    """Return whether the pixels with ``label``, another person's label, are a part of the patient. Three conditions
    must hold: most of the pixels lie on the patient's predicted skin (``skin``, a KD-tree), they are connected to the
    patient's pixels, and the pixels off this skin have too little area for a person.
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


def sampled(pixels: Pieces, owner: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points_m (k, 3), owner (k,) and area_m2 (k,) of the ``wanted`` (n,) bool pixels in every third row and
    column; each area is nine times the pixel's own area, since the pixel stands for nine pixels.
    """
    chosen = pixels.index[::SAMPLE_PX, ::SAMPLE_PX]
    chosen = chosen[chosen >= 0]
    chosen = chosen[wanted[chosen]]
    return pixels.points_m[chosen], owner[chosen], pixels.area_m2[chosen] * SAMPLE_PX**2
