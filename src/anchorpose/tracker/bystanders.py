"""Fit a rough body (a body of average shape) to every bystander (person other than the patient), and follow this body
over time. Each pixel can then be compared with the predicted skin of every person.

A therapist's forearm may touch or cross the patient's forearm. The skin seen in earlier frames does not always reveal
to whose forearm a pixel belongs, and a wrong person label persists in later frames. Fitted bodies can reveal the owner
of the forearm, since an arm is attached to only one person (paper, Section I, transient occlusions).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.body.belief import Pace, PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import seen_past, segment_of_points
from anchorpose.body.initial import find_rough_pose
from anchorpose.body.likelihood import likelihood
from anchorpose.body.limb_search import search_limbs
from anchorpose.body.matched_places import LEAST_MATCHES, match_person, matches_of
from anchorpose.body.pose import DEGREE, POSE_SIZE, TRUNK, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import Registration, posterior, register
from anchorpose.body.shape_prior import child_belief, shape_of_height
from anchorpose.body.skin_points import Body, SkinPoints, body_points, build_body, pose_points
from anchorpose.camera import Camera
from anchorpose.isolation.bystander_memory import MEMORY_S, BystanderMemory, memory_of
from anchorpose.isolation.ownership import OwnershipLikelihood, join_likelihoods
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.separation import separate
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import Nodes, SurfaceConfig, join_nodes
from anchorpose.threads import each
from anchorpose.tracker.steps import facing_points, step_onto

COARSE: Final = SurfaceConfig(step=4)  # one node per 4 x 4 pixels; a rough body needs no denser nodes


def nodes_of_pixels(
    depths_m: Sequence[np.ndarray | None],
    masks: Sequence[np.ndarray | None],
    cameras: Sequence[Camera],
    step: int = COARSE.step,
) -> Nodes:
    """Return the pixels inside the masks of all cameras as surface nodes. Only every ``step``-th pixel of every
    ``step``-th row is used. depths_m, masks (height, width): one per camera; None for a camera without a depth image.
    """
    sheets = []
    for number, (depth, mask, camera) in enumerate(zip(depths_m, masks, cameras, strict=True)):
        if depth is not None and mask is not None and mask.any():
            sheet = build_surface(depth, mask, camera, replace(COARSE, step=step))
            sheets.append(replace(sheet, camera=np.full(len(sheet), number, np.uint8)))
    return join_nodes(sheets)


ROUGHLY: Final = RegistrationConfig(
    reaches_m=(0.20, 0.12, 0.08), held_steps=0, least_nodes=60, node_count=700, rows_per_observation=2.0
)
"""Settings to fit a rough body: three registration steps, and a third as many nodes as for the patient's body."""

# rate at which a bystander's predicted pose becomes uncertain: standard deviation of each bone's rotation and of the
# pelvis's place that is added in 1 s
WALKING: Final = Pace(turn_sigma=40.0 * DEGREE, root_sigma_m=0.3)

TALLEST_CHILD_M: Final = 1.5  # m; a person who appears taller gets an adult's proportions, else a child's
STATURE_STEP_M: Final = 0.05  # m; statures are rounded to this step, since a stature from one frame has this error
# m, assumed error of a child's height; small, so that ``ordinary_body`` builds a child's body of almost exactly the
# given height
HEIGHT_SIGMA_M: Final = 0.01
# a fitted body is used only if at least this share of the person's surface nodes lies near the body
LEAST_EXPLAINED: Final = 0.75
# maximum share of a trunk's skin that a camera may see past (read something farther away) before the body is rejected;
# not 0, since rough bodies have errors of some centimetres
MOST_TRUNK_PAST: Final = 0.25
# maximum share of a limb's skin that a camera may see past (read something farther away). A fitted body is rejected if
# at least two limbs exceed this maximum, but not for a single limb, which may be misplaced on a correct body
MOST_LIMB_PAST: Final = 0.5
# minimum number of surface nodes to fit a body; a third of a person's front gives as many at a distance of 4 m
LEAST_NODES: Final = 150
SKIN_SIGMA_M: Final = 0.03  # m, sigma of a bystander's skin around its prediction, due to clothes, hair and body shape
# m/s, growth of the sigma of a person's predicted skin with the time since the last fit; a hand may move faster than
# predicted
GROWTH_M_S: Final = 0.4
# ratio of a predicted movement's velocity to the last movement's velocity; below 1, since movements slow down
DAMPING: Final = 0.8
# first and largest number of frames to wait after a failed attempt to fit a body; each failure doubles this number
FIRST_PAUSE, LONGEST_PAUSE = 15, 240


@dataclass(frozen=True, slots=True, eq=False)
class Bystander:
    """A bystander to whom a body is fitted."""

    label: int
    body: Body
    belief: PoseBelief
    change: np.ndarray  # (POSE_SIZE,) change of the pose between the last two fits; 0 while the person is hidden
    elapsed_s: float  # s, time between the last two fits; negative in a backward pass
    hidden_s: float = 0.0  # s, time since the body was last fitted; 0 if it was fitted in this frame


@dataclass(frozen=True, slots=True)
class Search:
    """A bystander without a fitted body; fitting a body is tried again after some frames."""

    label: int
    wait: int  # number of frames until fitting is tried again
    pause: int  # number of frames to wait after the next attempt to fit a body, if this attempt fails


@dataclass(frozen=True, slots=True, eq=False)
class Bystanders:
    """All bystanders of one frame. Bystanders in ``followed`` have a fitted body; bystanders in ``searched`` do not
    have a fitted body in this frame.
    """

    followed: tuple[Bystander, ...] = ()
    searched: tuple[Search, ...] = ()


def bystander_likelihood(bystanders: Bystanders, points: SkinPoints, elapsed_s: float) -> OwnershipLikelihood:
    """Return, for each bystander, the likelihood that a place belongs to this bystander, computed from the predicted
    skin of the bystander's body. elapsed_s: time since the frame of ``bystanders``.
    """
    found = []
    for one in bystanders.followed:
        spread = SKIN_SIGMA_M + GROWTH_M_S * (abs(elapsed_s) + one.hidden_s)
        skin = pose_points(one.body, ahead(one, points, elapsed_s)).points_m.astype(np.float32)
        owner, sigma = np.full(len(skin), one.label, np.uint8), np.full(len(skin), spread, np.float32)
        found.append(OwnershipLikelihood(skin, owner, sigma))
    return join_likelihoods(found)


def bystanders_placed(
    bystanders: Bystanders,
    memory: BystanderMemory,
    pieces: Sequence[Pieces | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
) -> Bystanders:
    """Return the bystanders after moving their bodies over the ground to where the next frame (``pieces``) shows them.
    memory: the skin of all people, already moved by ``find_steps``; elapsed_s: time from the old to the next frame.
    """
    seen, points, moved = memory.seen_last, body_points(), list[Bystander]()
    for one in bystanders.followed:
        if one.label in seen:
            posed = pose_points(one.body, ahead(one, points, elapsed_s))
            step = step_onto(facing_points(posed.points_m, posed.normals, cameras), seen[one.label], pieces, cameras)
            if step.any():
                pose = replace(one.belief.pose, root_m=one.belief.pose.root_m + step)
                one = replace(one, belief=replace(one.belief, pose=pose))
        moved.append(one)
    return replace(bystanders, followed=tuple(moved))


def first_bystanders(
    fitted: Mapping[int, RoughPerson | None], views: Sequence[View | None], cameras: Sequence[Camera]
) -> Bystanders:
    """Return the bystanders of an initial frame. fitted: the rough body of each person, by label; None for a person
    without a rough body.
    """
    now = each(
        lambda label: _begun(label, fitted[label], person_evidence(views, cameras, label)) or _failed(label),
        labels_of(views),
    )
    return _all_of(now)


def follow_bystanders(
    before: Bystanders, views: Sequence[View | None], cameras: Sequence[Camera], points: SkinPoints, elapsed_s: float
) -> Bystanders:
    """Return the bystanders of the next frame, from the pixels with each person's label.

    If the body of the last frame does not fit the person's pixels, a new body is fitted. If no new body fits, or if the
    person is hidden, the last body keeps its place for ``MEMORY_S``, so that a person who reappears at this place is
    recognised. The body is dropped earlier if a camera sees past the body (reads something farther away). For a visible
    person without a body, fitting is tried again after a pause.
    """
    known = {one.label: one for one in before.followed}
    searched = {search.label: search for search in before.searched}

    shown = labels_of(views)

    def next_of(label: int) -> Bystander | Search | None:
        last = searched.get(label, Search(label, 0, FIRST_PAUSE))
        if last.wait > 0:
            return replace(last, wait=last.wait - 1)
        evidence, one = person_evidence(views, cameras, label), known.get(label)
        found = None if one is None or label not in shown else _follow(one, evidence, points, elapsed_s)
        found = found or _begun(label, rough_person(views, cameras, label), evidence)
        found = found or (None if one is None else _hidden(one, evidence, elapsed_s))
        return found or (_failed(label, last.pause) if label in shown else None)

    return _all_of(each(next_of, sorted({*shown, *known})))


def _failed(label: int, pause: int = FIRST_PAUSE) -> Search:
    return Search(label, pause, min(2 * pause, LONGEST_PAUSE))


def _all_of(now: Sequence[Bystander | Search | None]) -> Bystanders:
    followed = tuple(one for one in now if isinstance(one, Bystander))
    return Bystanders(followed, tuple(one for one in now if isinstance(one, Search)))


def label_by_bodies(
    pieces: Sequence[Pieces | None],
    views: tuple[View | None, ...],
    patient: RoughPerson,
    bystanders: Bystanders,
    cameras: Sequence[Camera],
) -> tuple[View | None, ...]:
    """Label the pixels of an initial frame a second time, now by the bodies that were fitted to each person's pixels.

    Where people touch, the first labels may assign an arm or leg to the wrong person; the bodies correct this.
    """
    posed = Bystander(PixelLabel.PATIENT, patient.body, patient.found.belief, np.zeros(POSE_SIZE), 1.0)
    skin = join_likelihoods([_shown_skin(one, views, cameras) for one in (posed, *bystanders.followed)])
    return separate(pieces, memory_of(pieces, views), skin, 0.0, cameras)


def _shown_skin(one: Bystander, views: Sequence[View | None], cameras: Sequence[Camera]) -> OwnershipLikelihood:
    """Return the likelihood that a place belongs to a person of an initial frame. Limbs that the person's own pixels do
    not show are left out: the place of such a limb is a guess, so it must not decide to whom pixels at this place
    belong.
    """
    points, skin = body_points(), bystander_likelihood(Bystanders((one,)), body_points(), 0.0)
    shown = likelihood(one.body, one.belief.pose, person_evidence(views, cameras, one.label)).seen
    kept = shown.ravel()[segment_of_points(points)]
    return OwnershipLikelihood(skin.points_m[kept], skin.owner[kept], skin.sigma_m[kept])


def labels_of(views: Sequence[View | None]) -> list[int]:
    there = np.zeros(256, dtype=bool)
    for view in views:
        if view is not None:
            _note_labels(view.labels, there)
    return [label for label in np.flatnonzero(there).tolist() if label >= PixelLabel.OTHER_PERSON]


@njit(cache=True, nogil=True)
def _note_labels(labels: np.ndarray, there: np.ndarray) -> None:
    for label in labels.ravel():
        there[label] = True


def person_evidence(views: Sequence[View | None], cameras: Sequence[Camera], label: int) -> Evidence:
    """Return the data to which one person's body is fitted, mainly the surface nodes of the person's pixels. The
    person's outline is not used: a large part of the outline is often the edge of an object that hides the body, not
    the edge of the body. If few pixels show the person, a larger share of these pixels becomes nodes.
    """
    masks = [None if view is None else view.labels == label for view in views]
    depths = [None if view is None else view.depth_m for view in views]
    pixels = sum(int(np.count_nonzero(mask)) for mask in masks if mask is not None)
    step = min(COARSE.step, max(1, math.isqrt(pixels // ROUGHLY.node_count)))
    surface = nodes_of_pixels(depths, masks, cameras, step)
    return Evidence(surface, tuple(views), (None,) * len(views), tuple(cameras), label=label)


def _is_person(body: Body, pose: Pose, evidence: Evidence) -> bool:
    """Return whether a fitted body may be a real person: no camera sees past a large part of the body (reads something
    farther away there). If a camera sees past the body, it may have been fitted to pixels that show only a part of a
    person.
    """
    past = np.nan_to_num(seen_past(body.points, pose_points(body, pose), evidence.views, evidence.cameras))
    return bool(past[TRUNK] <= MOST_TRUNK_PAST and (np.delete(past, TRUNK) > MOST_LIMB_PAST).sum() <= 1)


def _follow(one: Bystander, evidence: Evidence, points: SkinPoints, elapsed_s: float) -> Bystander | None:
    predicted = one.belief.later(ahead(one, points, elapsed_s), abs(elapsed_s), WALKING)
    found = register(one.body, predicted, evidence, no_constraints(), ROUGHLY)
    if not found.found or found.explained < LEAST_EXPLAINED or not _is_person(one.body, found.belief.pose, evidence):
        return None
    change = one.belief.pose.change_to(found.belief.pose, points.moving)
    return replace(one, belief=found.belief, change=change, elapsed_s=elapsed_s, hidden_s=0.0)


def _hidden(one: Bystander, evidence: Evidence, elapsed_s: float) -> Bystander | None:
    """Return a hidden bystander with the body in its last pose; None after ``MEMORY_S`` or if a camera sees past the
    body.
    """
    hidden_s = one.hidden_s + abs(elapsed_s)
    if hidden_s > MEMORY_S or not _is_person(one.body, one.belief.pose, evidence):
        return None
    return replace(one, change=np.zeros(POSE_SIZE), hidden_s=hidden_s)


class RoughPerson(NamedTuple):
    """A body of average shape that was registered to a person."""

    body: Body
    found: Registration


def rough_person(views: Sequence[View | None], cameras: Sequence[Camera], label: int) -> RoughPerson | None:
    """Fit a body of average shape, with the stature that the pixels show, to the person with this label; return None if
    too little of the person is seen or if no pose fits. The body is fitted twice: with the facing that the learnt
    descriptor shows, and with the opposite facing. The more probable of the two poses is returned.
    """
    evidence, matches = person_evidence(views, cameras, label), matches_of(views, cameras, label)
    if len(evidence.surface) < LEAST_NODES or len(matches) < LEAST_MATCHES:
        return None
    person = match_person(matches)
    body = ordinary_body(body_points(), round(person.stature_m / STATURE_STEP_M))
    pose = find_rough_pose(body, evidence, person.matches, person.pose, ROUGHLY)
    found = posterior(body, pose, vague_belief(pose), evidence, ROUGHLY)
    # search for misplaced limbs, since the learnt descriptor may have assigned skin to a wrong limb. The search for
    # misplaced limbs may take all its rounds: after the first round alone, a person who crouches would be taken for a
    # person who faces the other way
    if found.found and not _is_person(body, found.belief.pose, evidence):
        found = search_limbs(body, found, vague_belief(found.belief.pose), evidence, ROUGHLY).registration
    pose = find_rough_pose(body, evidence, person.matches.turned, None, ROUGHLY)
    turned = posterior(body, pose, vague_belief(pose), evidence, ROUGHLY)
    both = [one for one in (found, turned) if one.found]
    best = max(both, key=lambda one: log_probability(body, one.belief.pose, evidence), default=None)
    return None if best is None else RoughPerson(body, best)


@lru_cache(maxsize=16)
def ordinary_body(points: SkinPoints, steps: int) -> Body:
    """Build the average body of an adult or child of a given height; steps: height in units of ``STATURE_STEP_M``."""
    height_m = steps * STATURE_STEP_M
    if height_m >= TALLEST_CHILD_M:
        return build_body(points, shape_of_height(points.asset, height_m))
    return build_body(points, child_belief(points.asset).standing(points.asset, height_m, HEIGHT_SIGMA_M).shape)


def _begun(label: int, person: RoughPerson | None, evidence: Evidence) -> Bystander | None:
    """Return a bystander with a newly fitted body; None if no body fits the person's pixels."""
    if person is None:
        return None
    body, found = person
    if found.explained < LEAST_EXPLAINED or not _is_person(body, found.belief.pose, evidence):
        return None
    return Bystander(label, body, found.belief, np.zeros(POSE_SIZE), 1.0)


def ahead(one: Bystander, points: SkinPoints, elapsed_s: float) -> Pose:
    """Predict a bystander's pose ``elapsed_s`` after the last fit: the last movement continues, slightly slower."""
    return one.belief.pose.moved(DAMPING * elapsed_s / one.elapsed_s * one.change, points.moving)
