"""Every pixel to its person (transient occlusion; paper, Section III): by claims, creases and reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.isolation.bystander_memory import SAMPLE_PX, BystanderMemory
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.ownership import (
    NOBODY,
    LikelihoodGrid,
    OwnershipLikelihood,
    decide_ownership,
    grow_regions,
    join_likelihoods,
    sort_likelihood,
)
from anchorpose.isolation.people import PatientChoice, People, find_columns, find_people, ground_distance
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View

DECISION_PX = 2  # of what two people claim every second row and column is contested; the pixels between grow from them
LAST_LABEL = 254
FIRST_EARLIER_LABEL = 128  # of people met on the way back in time


def separate_initial(
    pieces: Sequence[Pieces | None], people: People, choice: PatientChoice, config: IsolationConfig
) -> tuple[View | None, ...]:
    """Label each camera's pixels where nothing is known of an earlier frame.

    The patient is the person nearest to the chosen place. Trunks are told apart by their place on the ground; arms and
    legs grow from them over the surface, up to the creases between people who touch.
    """
    label = np.full(len(people.people) + 1, NOBODY, np.uint8)  # the last one: nobody
    axes = np.array([person.ground_xz_m for person in people.people]).reshape(-1, 2)
    if len(axes):
        order = np.argsort(np.linalg.norm(axes - choice.ground_xz_m, axis=1), kind="stable")
        label[order] = np.minimum(PixelLabel.PATIENT + np.arange(len(order)), LAST_LABEL)
    owners: list[np.ndarray | None] = []
    for view, of in zip(pieces, people.of, strict=True):
        trunks = None if view is None or of is None else _trunks(view, of, axes, label, config)
        owners.append(None if view is None or trunks is None else grow_regions(view, trunks, config.crease_cost))
    return _views(pieces, _with_detached(pieces, owners, config))


def separate(
    pieces: Sequence[Pieces | None],
    memory: BystanderMemory,
    expected: OwnershipLikelihood | None,
    elapsed_s: float,
    config: IsolationConfig,
) -> tuple[View | None, ...]:
    """Label each camera's pixels by who was where ``elapsed_s`` ago and, if given, by predicted skin.

    expected: what those claim whose skin is predicted; the others claim where they were seen last. A pixel goes to the
    strongest claim if that is clearly stronger than all others' (``least_lead``). What is left, between two people or
    outrunning every claim, goes to whom it hangs together with (``grow_regions``); a piece by itself to whom it nearly
    touches (a bar cuts a forearm off); what is far from everybody and as large as a person is a new person.
    elapsed_s: negative where time is followed backwards; who is met there first has labels of another range, so that
    nobody met later bears the same.
    """
    remembered = memory if expected is None else memory.without(np.flatnonzero(np.bincount(expected.owner)))
    likelihood = join_likelihoods([remembered.likelihood(elapsed_s, config), *([] if expected is None else [expected])])
    grid = sort_likelihood(likelihood) if len(likelihood) else None
    claimed = [None if view is None else _owners_by_likelihood(view, grid, config) for view in pieces]
    owners = [
        None if view is None or owner is None else grow_regions(view, owner, config.crease_cost)
        for view, owner in zip(pieces, claimed, strict=True)
    ]
    owners = _with_detached(pieces, owners, config)
    free = memory.next_label if elapsed_s >= 0 else max(memory.next_label, FIRST_EARLIER_LABEL)
    owners = _with_newcomers(pieces, owners, free, config)
    # what he was taken for before proves nothing
    predicted: Sequence[np.ndarray | None] = [None] * len(pieces) if expected is None else claimed
    return _views(pieces, _one_patient(pieces, owners, predicted, free, config))


def _trunks(view: Pieces, of: np.ndarray, axes: np.ndarray, label: np.ndarray, config: IsolationConfig) -> np.ndarray:
    """(n,) uint8: labels of the pixels in the middle of a person's column, and of pieces that one person has alone."""
    if not len(axes):
        return np.zeros(len(of), np.uint8)
    near = ground_distance(view.points_m, axes[of]) < config.trunk_radius_m
    owners = np.zeros((view.piece_count + 1, len(axes)), dtype=bool)
    owners[view.piece[of >= 0], of[of >= 0]] = True
    alone = owners.sum(axis=1) == 1
    return np.where((of >= 0) & (near | alone[view.piece]), label[of], NOBODY).astype(np.uint8)


def _owners_by_likelihood(view: Pieces, grid: LikelihoodGrid | None, config: IsolationConfig) -> np.ndarray:
    """(n,) uint8 owner of each foreground pixel by claims alone."""
    if grid is None:
        return np.zeros(len(view.row), np.uint8)
    return decide_ownership(grid, view.points_m, _asked(view), config.claim_gate, config.least_lead)


def _asked(view: Pieces) -> np.ndarray:
    """(n,) bool: the pixels at which rivals' claims are weighed."""
    return np.asarray((view.row % DECISION_PX == 0) & (view.column % DECISION_PX == 0))


def _with_detached(
    pieces: Sequence[Pieces | None], owners: Sequence[np.ndarray | None], config: IsolationConfig
) -> list[np.ndarray | None]:
    """Owners with pieces that nobody owns given to whom they nearly touch, in any camera."""
    if not any(_has_open_piece(view, owner, config) for view, owner in zip(pieces, owners, strict=True)):
        return list(owners)
    low, high = _around_open(pieces, owners, config.detached_m)
    own = [
        _sampled(view, owner)
        for view, owner in zip(pieces, owners, strict=True)
        if view is not None and owner is not None
    ]
    points = np.concatenate([place for place, _, _ in own]) if own else np.zeros((0, 3))
    if not len(points):
        return list(owners)
    near = ((points >= low) & (points <= high)).all(axis=1)  # a tree of everybody's skin takes longer than its answers
    label, tree = np.concatenate([whose for _, whose, _ in own])[near], cKDTree(points[near])
    return [
        None if view is None or owner is None else _given_to_neighbour(view, owner, tree, label, config)
        for view, owner in zip(pieces, owners, strict=True)
    ]


def _around_open(
    pieces: Sequence[Pieces | None], owners: Sequence[np.ndarray | None], reach_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """The corners (3,) of the box around all pixels that nobody owns, and some way on."""
    places = np.concatenate(
        [
            view.points_m[owner == NOBODY]
            for view, owner in zip(pieces, owners, strict=True)
            if view is not None and owner is not None
        ]
    )
    return places.min(axis=0) - reach_m, places.max(axis=0) + reach_m


def _has_open_piece(view: Pieces | None, owner: np.ndarray | None, config: IsolationConfig) -> bool:
    return view is not None and owner is not None and view.area_m2[owner == NOBODY].sum() >= config.crumb_area_m2


def _sampled(view: Pieces, owner: np.ndarray, whose: int | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points_m (k, 3), owner (k,) and area_m2 (k,) of every third row's and column's pixels of somebody, or of one."""
    chosen = view.index[::SAMPLE_PX, ::SAMPLE_PX]
    chosen = chosen[chosen >= 0]
    chosen = chosen[owner[chosen] != NOBODY if whose is None else owner[chosen] == whose]
    return view.points_m[chosen], owner[chosen], view.area_m2[chosen] * SAMPLE_PX**2


def _given_to_neighbour(
    view: Pieces, owner: np.ndarray, tree: cKDTree, label: np.ndarray, config: IsolationConfig
) -> np.ndarray:
    open_pixels = np.flatnonzero(owner == NOBODY)
    if not len(open_pixels):
        return owner
    distance, nearest = tree.query(view.points_m[open_pixels], distance_upper_bound=config.detached_m)
    found = np.isfinite(distance)
    piece, distance, whose = view.piece[open_pixels[found]], distance[found], label[nearest[found]]
    to = np.zeros(view.piece_count + 1, np.uint8)
    order = np.argsort(-distance, kind="stable")  # the nearest comes last and stays
    to[piece[order]] = whose[order]
    given = owner.copy()
    given[open_pixels] = to[view.piece[open_pixels]]
    return given


def _with_newcomers(
    pieces: Sequence[Pieces | None], owners: Sequence[np.ndarray | None], next_label: int, config: IsolationConfig
) -> list[np.ndarray | None]:
    """Owners with new labels for what nobody owns and is a person by size."""
    area = sum(
        float(view.area_m2[owner == NOBODY].sum())
        for view, owner in zip(pieces, owners, strict=True)
        if view is not None and owner is not None
    )
    if area < config.person_area_m2:
        return list(owners)
    open_only = [
        None if view is None or owner is None else view.only(owner == NOBODY)
        for view, owner in zip(pieces, owners, strict=True)
    ]
    people = find_people(open_only, config)
    label = np.minimum(next_label + np.arange(len(people.people) + 1), LAST_LABEL)
    label[-1] = NOBODY
    named = []
    for owner, of in zip(owners, people.of, strict=True):
        if owner is not None and of is not None:
            owner = owner.copy()
            owner[owner == NOBODY] = label[of]
        named.append(owner)
    return named


def _one_patient(
    pieces: Sequence[Pieces | None],
    owners: Sequence[np.ndarray | None],
    claimed: Sequence[np.ndarray | None],
    free: int,
    config: IsolationConfig,
) -> list[np.ndarray | None]:
    """Owners with whoever stands apart from the patient, and was taken for part of him, split off.

    The patient is where most of what he owns is; a further column of his that is a person by size is one, unless his
    predicted skin is in most of it: who bends down has his trunk beside his legs. claimed: owners by claims alone,
    before they grew; None where no skin was predicted. free: the first label that nobody had before.
    """
    sampled = [
        _sampled(view, owner, PixelLabel.PATIENT)
        for view, owner in zip(pieces, owners, strict=True)
        if view is not None and owner is not None
    ]
    if not sampled:
        return list(owners)
    points, area = (np.concatenate(parts) for parts in zip(*[(p, a) for p, _, a in sampled], strict=True))
    people = find_columns(points, area, config)
    if len(people) < 2:
        return list(owners)
    axes = np.array([person.ground_xz_m for person in people])
    others = np.arange(len(axes)) != np.argmax([person.area_m2 for person in people])
    others &= _expected_share(pieces, owners, claimed, axes) < config.own_column
    if not others.any():
        return list(owners)
    label = np.full(len(axes), PixelLabel.PATIENT, np.int64)
    label[others] = np.minimum(_next_free(owners, free) + np.arange(others.sum()), LAST_LABEL)
    split = []
    for view, owner in zip(pieces, owners, strict=True):
        if view is not None and owner is not None:
            his = view.only(owner == PixelLabel.PATIENT)
            of = np.argmin([ground_distance(his.points_m, axis) for axis in axes], axis=0)
            seeds = np.where(ground_distance(his.points_m, axes[of]) < config.trunk_radius_m, label[of], NOBODY)
            grown = grow_regions(his, seeds.astype(np.uint8), config.crease_cost)
            owner = owner.copy()
            owner[owner == PixelLabel.PATIENT] = np.where(grown == NOBODY, PixelLabel.PATIENT, grown)
        split.append(owner)
    return split


def _expected_share(
    pieces: Sequence[Pieces | None],
    owners: Sequence[np.ndarray | None],
    claimed: Sequence[np.ndarray | None],
    axes: np.ndarray,
) -> np.ndarray:
    """(k,) share of what the patient owns about each axis that he claimed himself, before it grew to him."""
    own, every = np.zeros(len(axes)), np.zeros(len(axes))
    for view, owner, claim in zip(pieces, owners, claimed, strict=True):
        if view is not None and owner is not None and claim is not None:
            his = np.flatnonzero((owner == PixelLabel.PATIENT) & _asked(view))
            of = np.argmin([ground_distance(view.points_m[his], axis) for axis in axes], axis=0)
            every += np.bincount(of, minlength=len(axes))
            own += np.bincount(of, claim[his] == PixelLabel.PATIENT, minlength=len(axes))
    return np.asarray(own / np.maximum(every, 1))


def _next_free(owners: Sequence[np.ndarray | None], free: int) -> int:
    used = max((int(owner.max(initial=0)) for owner in owners if owner is not None), default=0)
    return max(free, used + 1)


def _views(pieces: Sequence[Pieces | None], owners: Sequence[np.ndarray | None]) -> tuple[View | None, ...]:
    views: list[View | None] = []
    for view, owner in zip(pieces, owners, strict=True):
        if view is None or owner is None:
            views.append(None)
            continue
        labels = view.labels.copy()
        labels[view.row, view.column] = np.where(owner == NOBODY, np.uint8(PixelLabel.CLUTTER), owner)
        views.append(View(view.depth_m, labels))
    return tuple(views)
