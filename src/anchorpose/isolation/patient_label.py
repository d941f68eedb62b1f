"""Correct the label of the patient's pixels: parts labelled as others, strays of others, and whoever stands apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.isolation.bystander_memory import SAMPLE_PX
from anchorpose.isolation.components import label_components
from anchorpose.isolation.ownership import NOBODY, OwnershipLikelihood
from anchorpose.isolation.people import PERSON_AREA_M2, IsolationConfig, find_columns, find_people, ground_distance
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
    piece_of, count = label_components(pixels.depth_m, mask, pixels.sensor.jump_limit)
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


TRUNK_RADIUS_M: Final = 0.15  # half a trunk's depth and some clothes: what stands there is this person
OWN_COLUMN: Final = 0.5  # of a column beside the patient's: with so much of it on their expected skin, it is theirs
PART_CONTACT_M: Final = 0.05  # a wrist's width, over which a part of the patient is connected to the rest
ON_SKIN_M: Final = 0.05  # from the patient's expected skin: its spacing, clothes, and what it moves
LAST_LABEL: Final = 254


def without_parts(shown: Sequence[Pieces], owners: list[np.ndarray], expected: OwnershipLikelihood) -> list[np.ndarray]:
    """Owners, with the patient's own parts given back that have the label of another person.

    Another person has a body, or is a person by size without what lies on the patient's expected skin. What has
    neither, and is connected to the patient, is a part of the patient.
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
    """Whether a label's pixels lie mostly on the patient's skin (a tree of it), are connected to the patient's, and
    leave too little elsewhere for a person."""
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
    owners: list[np.ndarray],
    expected: OwnershipLikelihood | None,
    free: int,
    config: IsolationConfig,
) -> list[np.ndarray]:
    """Owners with anybody who stands apart from the patient, and was taken for part of them, split off.

    The patient is where most of what they own is; another column that is a person by size is another person, unless
    most of it lies on the patient's predicted skin: a patient who bends down has the trunk beside the legs. expected:
    the likelihood of predicted skin, None where there is none. free: the first unused label.
    """
    if not shown:
        return owners
    parts = [sampled(pixels, o, o == PixelLabel.PATIENT) for pixels, o in zip(shown, owners, strict=True)]
    points, _, area = (np.concatenate(part) for part in zip(*parts, strict=True))
    if len(find_columns(points, area)) < 2:
        return owners
    theirs = [pixels.only(o == PixelLabel.PATIENT) for pixels, o in zip(shown, owners, strict=True)]
    people = find_people(theirs, config).people
    if len(people) < 2:
        return owners
    axes = np.array([person.ground_xz_m for person in people])
    others = np.arange(len(axes)) != np.argmax([person.area_m2 for person in people])
    if expected is not None:
        others &= (
            _share_on_skin(shown, owners, expected.points_m[expected.owner == PixelLabel.PATIENT], axes) < OWN_COLUMN
        )
    if not others.any():
        return owners
    first = max(free, *(int(owner.max(initial=0)) + 1 for owner in owners))
    label = np.full(len(axes), PixelLabel.PATIENT, np.int64)
    label[others] = np.minimum(first + np.arange(others.sum()), LAST_LABEL)
    return [_split(pixels, owner, axes, label) for pixels, owner in zip(shown, owners, strict=True)]


def _share_on_skin(
    shown: Sequence[Pieces], owners: Sequence[np.ndarray], skin_m: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """(k,) share of the patient's pixels about each axis that lie on the patient's predicted skin (p, 3)."""
    own, every = np.zeros(len(axes)), np.zeros(len(axes))
    if not len(skin_m):
        return own
    tree = cKDTree(skin_m)
    for pixels, owner in zip(shown, owners, strict=True):
        points, _, area = sampled(pixels, owner, owner == PixelLabel.PATIENT)
        if not len(points):
            continue
        of = np.argmin([ground_distance(points, axis) for axis in axes], axis=0)
        away, _ = tree.query(points, distance_upper_bound=ON_SKIN_M)
        every += np.bincount(of, area, minlength=len(axes))
        own += np.bincount(of, np.where(np.isfinite(away), area, 0.0), minlength=len(axes))
    return np.asarray(own / np.maximum(every, 1e-9))


def _split(pixels: Pieces, owner: np.ndarray, axes: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(n,) uint8 owners after the patient's pixels were divided among axes (k, 2) with labels (k,)."""
    patient = owner == PixelLabel.PATIENT
    theirs = pixels.only(patient)
    of = np.argmin([ground_distance(theirs.points_m, axis) for axis in axes], axis=0)
    seeds = np.where(ground_distance(theirs.points_m, axes[of]) < TRUNK_RADIUS_M, label[of], NOBODY)
    grown = grow_regions(theirs, seeds.astype(np.uint8))
    split = owner.copy()
    split[patient] = np.where(grown == NOBODY, PixelLabel.PATIENT, grown)
    return split


def sampled(pixels: Pieces, owner: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points_m (k, 3), owner (k,) and area_m2 (k,) of every third row's and column's ``wanted`` (n,) bool pixels."""
    chosen = pixels.index[::SAMPLE_PX, ::SAMPLE_PX]
    chosen = chosen[chosen >= 0]
    chosen = chosen[wanted[chosen]]
    return pixels.points_m[chosen], owner[chosen], pixels.area_m2[chosen] * SAMPLE_PX**2
