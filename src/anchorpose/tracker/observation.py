"""What one frame shows of the patient: isolation, surface and geodesics, one function per stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.body.evidence import Evidence, gather_evidence
from anchorpose.body.skin_points import body_points
from anchorpose.geodesics.anchors import Anchors, anchor_descriptor, find_anchors
from anchorpose.geodesics.seen import SeenGeodesics
from anchorpose.geodesics.trusted_anchors import trusted_anchors
from anchorpose.isolation.bystander_memory import BystanderMemory, empty_memory, update_memory
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.ownership import OwnershipLikelihood, join_likelihoods
from anchorpose.isolation.people import PatientChoice, find_people
from anchorpose.isolation.scene import Pieces, find_all_pieces
from anchorpose.isolation.separation import separate, separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.border import Border, border
from anchorpose.surface.patient_surface import blank_view, patient_surface
from anchorpose.surface.surface import ExpectedSkin, Surface, seen_part
from anchorpose.tracker.bystanders import (
    Bystanders,
    bystander_likelihood,
    bystanders_placed,
    follow_bystanders,
    label_by_bodies,
)
from anchorpose.tracker.room import FACING, UP
from anchorpose.tracker.run import Run
from anchorpose.tracker.steps import facing_points, find_steps, step_onto

LOOSEST_SKIN_M = 0.05  # half of a limb's width: skin predicted less precisely is left out of the likelihood
UNFITTED_M = 0.04  # that skin may stray in each frame without a fit: 1.2 m/s at 30 Hz, a fast leg
LEAST_TRUSTED = 4  # three tell nodes apart (paper, Section IV-D), four make two subsets; with fewer a node keeps all


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """Where the patient should be: the skin, how uncertain each point of it is (p,), anchors_m (5, 3), heading (3,)
    unit; frames since the last fit."""

    skin: ExpectedSkin
    sigma_m: np.ndarray
    anchors_m: np.ndarray
    facing: np.ndarray
    frames_without_fit: int


@dataclass(frozen=True, slots=True, eq=False)
class Isolated:
    """Who is who in one frame: per camera the people's pixels and everybody's labels (None without a depth image),
    the memory of everybody's skin, and the bystanders' bodies."""

    pieces: tuple[Pieces | None, ...]
    views: tuple[View | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders


@dataclass(frozen=True, slots=True, eq=False)
class SeenSurface:
    """The patient's surface in one frame.

    whole: with the hidden skin, which is inferred. border (n,) uint8 of ``Border``: what each of its nodes ends at.
    evidence: what the body is registered to, the seen part of the surface among it.
    """

    whole: Surface
    border: np.ndarray
    evidence: Evidence


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One frame after the stages up to geodesics.

    whole: the patient's surface with the hidden skin, which is inferred. expected: where the patient was expected, None
    in a frame without expectation. border (n,) uint8 of ``Border``: what each seen node ends at.
    """

    frame_set: FrameSet
    expected: Expectation | None
    evidence: Evidence
    whole: Surface
    anchors: Anchors
    distances: AnchorDistances
    border: np.ndarray
    pieces: tuple[Pieces | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders

    @property
    def surface(self) -> Surface:
        """What is seen of the patient's surface."""
        return self.evidence.surface

    @property
    def descriptor(self) -> np.ndarray:
        """(n, 5) metres: the distance of each seen node to each anchor, inf where not reached, NaN where missed.

        NaN also where a hole lengthens it and enough others are left.
        """
        return self.distances.of_seen_nodes()

    @property
    def geodesics(self) -> SeenGeodesics:
        """Surface, anchors and distances together, for proposals of poses."""
        return SeenGeodesics(self.whole, self.anchors, self.descriptor)


def observe_first(frame_set: FrameSet, choice: PatientChoice, height_m: float, run: Run) -> Observation:
    """A frame in which nothing is expected except where the patient stands."""
    isolated = isolate_first(frame_set, choice, run)
    return observe(frame_set, isolated, None, height_m, run)


def observe(
    frame_set: FrameSet, isolated: Isolated, expected: Expectation | None, height_m: float, run: Run
) -> Observation:
    """Surface and anchors of a frame whose people are isolated. height_m: what the anchors' distances are scaled by."""
    surface = see_surface(isolated, expected, run)
    anchors = see_anchors(surface, expected, height_m, run)
    return gather(frame_set, expected, isolated, surface, anchors, run)


def isolate_first(frame_set: FrameSet, choice: PatientChoice, run: Run) -> Isolated:
    """Who is who where nothing is known but where the patient stands."""
    with run.stage("isolation"):
        pieces = find_all_pieces(frame_set.depths_m, run.room.scenes)
        group = choice.group if choice.frame == frame_set.frame else None
        views = separate_initial(
            pieces, find_people(pieces, run.config.isolation, group, faint=group is not None), choice
        )
    bystanders = see_bystanders(Bystanders(), views, 0.0, run)
    if bystanders.followed:
        with run.stage("bystanders"):
            views = label_by_bodies(pieces, views, bystanders, run.room.cameras, run.config.isolation)
    return _isolated(pieces, views, empty_memory(), bystanders, 0.0, run)


def isolate(frame_set: FrameSet, expected: Expectation, before: Observation, run: Run) -> Isolated:
    """Who is who where the patient is expected at a place, and the bystanders where they were in the frame before."""
    with run.stage("isolation"):
        pieces = find_all_pieces(frame_set.depths_m, run.room.scenes)
        memory = walked(before, pieces, run)
    elapsed_s = frame_set.time_s - before.frame_set.time_s  # negative in a backward pass
    expected = placed(expected, memory, pieces, run)
    others = bystanders_placed(before.bystanders, memory, pieces, run.room.cameras, elapsed_s)
    views = _separated(pieces, expected, memory, others, elapsed_s, elapsed_s, run)
    bystanders = see_bystanders(others, views, elapsed_s, run)
    return _isolated(pieces, views, memory, bystanders, elapsed_s, run)


def walked(before: Observation, pieces: Sequence[Pieces | None], run: Run) -> BystanderMemory:
    """The memory of a frame with everybody where the next one's pixels (``pieces``) show them to have walked."""
    return before.memory.moved(find_steps(before.memory.seen_last, pieces, run.room.cameras))


def placed(expected: Expectation, memory: BystanderMemory, pieces: Sequence[Pieces | None], run: Run) -> Expectation:
    """What was expected, moved over the ground to where the patient is seen, if that is elsewhere."""
    step = step_of(expected, memory, pieces, run)
    if not step.any():
        return expected
    skin = replace(expected.skin, points_m=expected.skin.points_m + step.astype(np.float32))
    return replace(expected, skin=skin, anchors_m=expected.anchors_m + step)


def step_of(expected: Expectation, memory: BystanderMemory, pieces: Sequence[Pieces | None], run: Run) -> np.ndarray:
    """(3,) from where the patient is expected to where the frame shows the patient; 0 where they agree."""
    seen_m = memory.seen_last.get(PixelLabel.PATIENT)
    if seen_m is None:
        return np.zeros(3)
    cameras = run.room.cameras
    front = facing_points(expected.skin.points_m, expected.skin.normals, cameras)
    return step_onto(front, seen_m, pieces, cameras)


def isolate_again(seen: Observation, expected: Expectation, before: Observation, run: Run) -> Isolated:
    """Who is who in a frame that was isolated before, by a better expectation than there was when it came in."""
    elapsed_s = seen.frame_set.time_s - before.frame_set.time_s
    memory = walked(before, seen.pieces, run)
    views = _separated(seen.pieces, expected, memory, seen.bystanders, elapsed_s, 0.0, run)
    return _isolated(seen.pieces, views, memory, seen.bystanders, elapsed_s, run)


def relabelled(seen: Observation, views: Sequence[View | None], before: Observation, run: Run) -> Isolated:
    """Who is who in a frame of which some pixels have got another label."""
    elapsed_s = seen.frame_set.time_s - before.frame_set.time_s
    return _isolated(seen.pieces, views, before.memory, seen.bystanders, elapsed_s, run)


def patient_likelihood(expected: Expectation, config: IsolationConfig) -> OwnershipLikelihood:
    """The likelihood that a place is the patient's, by the predicted skin.

    A limb that has been hidden for long has none: whatever it met would be taken for it. What is seen of it again
    is connected to the patient.
    """
    spread = config.skin_sigma_m + UNFITTED_M * expected.frames_without_fit
    sure = expected.sigma_m < LOOSEST_SKIN_M
    sigma = np.hypot(spread, expected.sigma_m[sure]).astype(np.float32)
    return OwnershipLikelihood(expected.skin.points_m[sure], np.full(len(sigma), PixelLabel.PATIENT, np.uint8), sigma)


def _separated(
    pieces: Sequence[Pieces | None],
    expected: Expectation,
    memory: BystanderMemory,
    bystanders: Bystanders,
    elapsed_s: float,
    ahead_s: float,
    run: Run,
) -> tuple[View | None, ...]:
    """Everybody's pixels; ahead_s: from the frame that the bystanders' bodies were fitted to until this one."""
    with run.stage("isolation"):
        others = bystander_likelihood(bystanders, body_points(), ahead_s)
        likelihood = join_likelihoods([others, patient_likelihood(expected, run.config.isolation)])
        return separate(pieces, memory, likelihood, elapsed_s, run.config.isolation)


def see_bystanders(before: Bystanders, views: Sequence[View | None], elapsed_s: float, run: Run) -> Bystanders:
    if not run.config.follow.bystanders:
        return before
    with run.stage("bystanders"):
        return follow_bystanders(before, views, run.room.cameras, body_points(), elapsed_s)


def _isolated(
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    before: BystanderMemory,
    bystanders: Bystanders,
    elapsed_s: float,
    run: Run,
) -> Isolated:
    with run.stage("isolation"):
        memory = update_memory(before, pieces, views, run.room.cameras, elapsed_s)
    return Isolated(tuple(pieces), tuple(views), memory, bystanders)


def see_surface(isolated: Isolated, expected: Expectation | None, run: Run) -> SeenSurface:
    """The patient's surface from the patient's pixels; the expected skin says where it is cut and closed."""
    cameras = run.room.cameras
    shown = [blank_view(camera) if view is None else view for view, camera in zip(isolated.views, cameras, strict=True)]
    with run.stage("surface"):
        whole = patient_surface(shown, cameras, None if expected is None else expected.skin, run.config.surface)
        kind = border(whole, shown)
        seen = seen_part(whole)
    with run.stage("registration"):
        evidence = gather_evidence(seen, isolated.views, cameras, run.room.calibration.floor_height_m)
    return SeenSurface(whole, kind, evidence)


def see_anchors(surface: SeenSurface, expected: Expectation | None, height_m: float, run: Run) -> Anchors:
    """Head, hands and feet, as the picture shows them."""
    with run.stage("geodesics"):
        facing, places = (FACING, None) if expected is None else (expected.facing, expected.anchors_m)
        cut = surface.border == Border.CUT
        return find_anchors(surface.whole, UP, facing, height_m, cut, places, run.config.anchors)


class AnchorDistances:
    """The distances of the seen nodes to the anchors, computed when they are first asked for: most frames need none."""

    def __init__(self, surface: SeenSurface, anchors: Anchors, run: Run) -> None:
        self._surface, self._anchors, self._run = surface, anchors, run
        self._found: np.ndarray | None = None

    def of_seen_nodes(self) -> np.ndarray:
        """(n, 5) as ``Observation.descriptor``."""
        if self._found is None:
            with self._run.stage("geodesics"):
                self._found = self._compute()
        return self._found

    def _compute(self) -> np.ndarray:
        whole, cut = self._surface.whole, self._surface.border == Border.CUT
        descriptor = anchor_descriptor(whole, self._anchors)
        if self._run.config.hypotheses.trusted_only:
            trusted = trusted_anchors(whole, descriptor, cut)
            trusted |= trusted.sum(axis=1, keepdims=True) < LEAST_TRUSTED
            descriptor = np.where(trusted, descriptor, np.nan).astype(np.float32)
        return descriptor[: len(self._surface.evidence.surface)]


def gather(
    frame_set: FrameSet,
    expected: Expectation | None,
    isolated: Isolated,
    surface: SeenSurface,
    anchors: Anchors,
    run: Run,
) -> Observation:
    """The stages' results of one frame in one value."""
    return Observation(
        frame_set,
        expected,
        surface.evidence,
        surface.whole,
        anchors,
        AnchorDistances(surface, anchors, run),
        surface.border[: len(surface.evidence.surface)],
        isolated.pieces,
        isolated.memory,
        isolated.bystanders,
    )
