"""Label each pixel with the person whom it shows (people who hide each other for a time are the transient occlusion of
the paper, Section III). The label is the owner of the most likely skin there, else the person to whom the pixel is
connected without a crease, else the nearest person.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.camera import Camera
from anchorpose.isolation.bystander_memory import FORWARD_LABELS, BystanderMemory
from anchorpose.isolation.ownership import (
    NOBODY,
    LikelihoodGrid,
    OwnershipLikelihood,
    decide_ownership,
    join_likelihoods,
    sort_likelihood,
)
from anchorpose.isolation.patient_label import ON_SKIN_M, sampled, without_parts, without_strays
from anchorpose.isolation.people import PERSON_AREA_M2, PatientChoice, People, see_people
from anchorpose.isolation.region_growing import grow_regions
from anchorpose.isolation.scene import SMALLEST_PIECE_M2, Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.threads import each

# pixels; where the skin of several people is near, likelihoods decide only the pixels in every second row and column;
# the other pixels are decided by region growing
DECISION_PX: Final = 2
# m, maximum distance of a detached piece from its person: a bar's width plus the distance that a hidden forearm moves
DETACHED_M: Final = 0.12
# m, added in quadrature to the standard deviation of remembered skin of people without a fitted body, so that this skin
# does not win against skin predicted from a body
UNSUPPORTED_SIGMA_M: Final = 0.04


def separate_initial(pieces: Sequence[Pieces | None], people: People, choice: PatientChoice) -> tuple[View | None, ...]:
    """Label each camera's pixels by person in a single frame, without knowledge from other frames.

    The patient is the person nearest to the place in ``choice``.
    """
    return label_people(pieces, people, by_distance(people, choice.ground_xz_m))


def by_distance(people: People, ground_xz_m: np.ndarray) -> np.ndarray:
    """Return the numbers (k,) int of the people, sorted by their distance from a place (2,), nearest first."""
    axes = np.array([person.ground_xz_m for person in people.people]).reshape(-1, 2)
    return np.argsort(np.linalg.norm(axes - ground_xz_m, axis=1), kind="stable")


def label_people(pieces: Sequence[Pieces | None], people: People, order: np.ndarray) -> tuple[View | None, ...]:
    """Label each camera's pixels by person.

    order (k,): numbers of the people; the first becomes the patient. Pixels at which the descriptor finds no person
    join the person to whom they are connected, up to the creases between touching people.
    """
    label = np.full(len(people.people) + 1, NOBODY, np.uint8)  # the last entry stands for nobody
    label[order] = np.minimum(PixelLabel.PATIENT + np.arange(len(order)), FORWARD_LABELS.stop - 1)
    shown, persons = [pixels for pixels in pieces if pixels is not None], [of for of in people.of if of is not None]
    seeds = [label[of] for of in persons]
    return _views(pieces, _with_detached(shown, _grown(shown, seeds)))


def separate(
    pieces: Sequence[Pieces | None],
    memory: BystanderMemory,
    expected: OwnershipLikelihood | None,
    elapsed_s: float,
    cameras: Sequence[Camera],
) -> tuple[View | None, ...]:
    """Label each camera's pixels by the people seen ``elapsed_s`` ago and, if given, by predicted skin.

    expected: predicted skin of some people; the skin of all other people is expected where it was seen last. (1) A
    pixel gets the most likely owner if this owner is clearly more likely than every other person
    (``decide_ownership``). (2) Other pixels get the person to whom they are connected (``grow_regions``). (3) A
    separate piece, such as a forearm that a bar cuts off, gets the person that it nearly touches. (4) A remaining piece
    that the learnt descriptor takes for a person is a new person. elapsed_s: negative in the backward pass, in which
    new people get labels from another range.
    """
    shown = [pixels for pixels in pieces if pixels is not None]
    of_shown = [camera for pixels, camera in zip(pieces, cameras, strict=True) if pixels is not None]
    bodies = np.zeros(0, np.int64) if expected is None else np.flatnonzero(np.bincount(expected.owner))
    remembered = memory.without(bodies).likelihood(elapsed_s, 0.0 if expected is None else UNSUPPORTED_SIGMA_M)
    likelihood = join_likelihoods([remembered, *([] if expected is None else [expected])])
    grid = sort_likelihood(likelihood) if len(likelihood) else None
    decided = each(lambda pixels: _decided(pixels, grid), shown)
    owners = without_strays(shown, _with_detached(shown, _grown(shown, decided)))
    owners = _with_newcomers(shown, of_shown, owners, memory.free_labels(elapsed_s), memory)
    owners = owners if expected is None else without_parts(shown, owners, expected)
    return _views(pieces, owners)


def _decided(pixels: Pieces, grid: LikelihoodGrid | None) -> np.ndarray:
    """Return the owner (n,) uint8 of each foreground pixel as decided by likelihood alone; ``NOBODY`` if undecided."""
    if grid is None:
        return np.zeros(len(pixels.row), np.uint8)
    return decide_ownership(grid, pixels.points_m, _decision_pixels(pixels))


def _decision_pixels(pixels: Pieces) -> np.ndarray:
    """Return (n,) bool: the pixels at which the likelihoods of several people are compared."""
    return np.asarray((pixels.row % DECISION_PX == 0) & (pixels.column % DECISION_PX == 0))


def _grown(shown: Sequence[Pieces], owners: Sequence[np.ndarray]) -> list[np.ndarray]:
    return each(grow_regions, shown, owners)


def _with_detached(shown: Sequence[Pieces], owners: list[np.ndarray]) -> list[np.ndarray]:
    """Give the pixels of each piece that have no owner to the person whose skin, as seen by any camera, these pixels
    nearly touch.
    """
    cameras = list(zip(shown, owners, strict=True))
    if not any(pixels.area_m2[owner == NOBODY].sum() >= SMALLEST_PIECE_M2 for pixels, owner in cameras):
        return owners
    unowned = np.concatenate([pixels.points_m[owner == NOBODY] for pixels, owner in cameras])
    low, high = unowned.min(axis=0) - DETACHED_M, unowned.max(axis=0) + DETACHED_M
    owned = [sampled(pixels, owner, owner != NOBODY) for pixels, owner in cameras]
    points = np.concatenate([place for place, _, _ in owned])
    if not len(points):
        return owners
    # only skin near unowned pixels is searched: building a KD-tree of all skin would take longer than the search
    near = ((points >= low) & (points <= high)).all(axis=1)
    label, tree = np.concatenate([whose for _, whose, _ in owned])[near], cKDTree(points[near])
    return [_to_neighbour(pixels, owner, tree, label) for pixels, owner in cameras]


def _to_neighbour(pixels: Pieces, owner: np.ndarray, tree: cKDTree, label: np.ndarray) -> np.ndarray:
    """Give each piece's unowned pixels to the person who is nearest to one of these pixels, within DETACHED_M; return
    all owners.
    """
    unowned = np.flatnonzero(owner == NOBODY)
    if not len(unowned):
        return owner
    distance, nearest = tree.query(pixels.points_m[unowned], distance_upper_bound=DETACHED_M)
    found = np.isfinite(distance)
    piece, distance, whose = pixels.piece[unowned[found]], distance[found], label[nearest[found]]
    to = np.zeros(pixels.piece_count + 1, np.uint8)
    order = np.argsort(-distance, kind="stable")  # the nearest person's label is written last, so it remains
    to[piece[order]] = whose[order]
    assigned = owner.copy()
    assigned[unowned] = to[pixels.piece[unowned]]
    return assigned


def _with_newcomers(
    shown: Sequence[Pieces],
    cameras: Sequence[Camera],
    owners: list[np.ndarray],
    free: np.ndarray,
    memory: BystanderMemory,
) -> list[np.ndarray]:
    """Give newcomers a label; return the owners (n,) of each camera's foreground pixels. A newcomer is a person that
    the descriptor finds at pixels of which most have no owner. The label is new (``free`` has labels for newcomers, in
    the order in which they are given). But if most of these pixels lie where the patient was seen last, the patient's
    predicted place was wrong, and the newcomer gets the patient's label.
    """
    bare = [owner == NOBODY for owner in owners]
    if sum(float(pixels.area_m2[own].sum()) for pixels, own in zip(shown, bare, strict=True)) < PERSON_AREA_M2:
        return owners
    people = see_people(shown, cameras)
    of_pixels = [of for of in people.of if of is not None]
    count = len(people.people) + 1  # the last entry stands for nobody
    free_m2, all_m2 = np.zeros(count), np.zeros(count)
    for pixels, own, of in zip(shown, bare, of_pixels, strict=True):
        all_m2 += np.bincount(of % count, pixels.area_m2, count)
        free_m2 += np.bincount(of[own] % count, pixels.area_m2[own], count)
    new = np.flatnonzero((free_m2[:-1] > PERSON_AREA_M2) & (free_m2[:-1] > all_m2[:-1] / 2.0))
    if not len(new):
        return owners
    label = np.full(count, NOBODY, np.uint8)
    was_patient = _where_patient_was(shown, of_pixels, bare, memory)[new]
    label[new] = np.where(was_patient, np.uint8(PixelLabel.PATIENT), free[: len(new)])
    return _grown(
        shown, [np.where(own, label[of], owner) for own, of, owner in zip(bare, of_pixels, owners, strict=True)]
    )


def _where_patient_was(
    shown: Sequence[Pieces], of_pixels: Sequence[np.ndarray], free: Sequence[np.ndarray], memory: BystanderMemory
) -> np.ndarray:
    """Return (k,) bool: for each person, whether most of that person's pixels without an owner lie on the patient's
    skin as seen last. of_pixels: for each camera (n,), the person at each pixel; free: for each camera (n,), whether
    the pixel has no owner.
    """
    skin = cKDTree(memory.points_m[memory.owner == PixelLabel.PATIENT])
    of = np.concatenate([number[own] for number, own in zip(of_pixels, free, strict=True)])
    places_m = np.concatenate([pixels.points_m[own] for pixels, own in zip(shown, free, strict=True)])
    away_m, _ = skin.query(places_m, distance_upper_bound=ON_SKIN_M)
    found = of >= 0
    on_skin = np.bincount(of[found], np.isfinite(away_m[found]))
    return np.asarray(on_skin > 0.5 * np.bincount(of[found]))


def _views(pieces: Sequence[Pieces | None], owners: Sequence[np.ndarray]) -> tuple[View | None, ...]:
    """Return one view per camera, None for a camera without a frame. owners: one per camera with a frame."""
    left = iter(owners)
    return tuple(None if pixels is None else view_of(pixels, next(left)) for pixels in pieces)


def view_of(pixels: Pieces, owner: np.ndarray) -> View:
    """Return the camera's view, given the owner (n,) uint8 of each foreground pixel, ``NOBODY`` without an owner."""
    labels = pixels.labels.copy()
    labels[pixels.row, pixels.column] = np.where(owner == NOBODY, np.uint8(PixelLabel.CLUTTER), owner)
    return View(pixels.depth_m, labels)
