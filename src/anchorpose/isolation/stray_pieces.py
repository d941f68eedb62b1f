"""Pieces that the prediction gave to the patient although they belong to another person: connectedness decides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.isolation.components import label_components
from anchorpose.isolation.ownership import NOBODY
from anchorpose.isolation.region_growing import grow_regions, smooth_contact_m
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel

LEAST_CONTACT_M: Final = 0.05  # a wrist's width
LEAST_CONTACT: Final = 1.0  # of a piece's width: half a head goes on along its longest side, a held forearm does not
LARGEST_M2: Final = 0.03  # a head; a leg below a bar is larger, and those who kneel before it border on all of it


def without_strays(shown: Sequence[Pieces], owners: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Owners (n,) uint8 of each camera, with stray pieces of the patient's pixels given to the person they continue.

    A stray piece is no larger than a head, connected to nothing else of the patient's in this camera, and goes on
    without a crease as another person's surface: half a therapist's head where the patient's hand was expected. A
    forearm beyond a bar, which a hand may hold, stays the patient's.
    """
    return [_without_strays(pixels, owner) for pixels, owner in zip(shown, owners, strict=True)]


def _without_strays(pixels: Pieces, owner: np.ndarray) -> np.ndarray:
    others = owner >= PixelLabel.OTHER_PERSON
    mask = np.zeros(pixels.depth_m.shape, dtype=bool)
    mine = owner == PixelLabel.PATIENT
    mask[pixels.row[mine], pixels.column[mine]] = True
    if not others.any() or not mine.any():
        return owner
    piece_of, count = label_components(pixels.depth_m, mask, pixels.limit)
    if count < 2:
        return owner
    piece = piece_of[pixels.row, pixels.column]
    area = np.bincount(piece[mine], pixels.area_m2[mine], minlength=count + 1)
    which = np.where(mine, piece, np.where(others, 0, -1))  # 0: anybody else
    contact_m = smooth_contact_m(pixels, which, count + 1)[0]
    stray = contact_m > np.maximum(LEAST_CONTACT_M, LEAST_CONTACT * np.sqrt(area))
    stray &= area < LARGEST_M2
    stray[[0, int(area.argmax())]] = False
    if not stray.any():
        return owner
    return grow_regions(pixels, np.where(mine & stray[piece], np.uint8(NOBODY), owner))
