"""What one frame shows of the patient: isolation, surface, geodesics, descriptor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.body.evidence import Evidence, gather_evidence
from anchorpose.body.skin_points import body_points
from anchorpose.geodesics.anchors import Anchors, find_anchors
from anchorpose.geodesics.descriptor import anchor_descriptor
from anchorpose.geodesics.trusted_anchors import trusted_anchors
from anchorpose.isolation.bystander_memory import BystanderMemory, empty_memory, update_memory
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.ownership import OwnershipLikelihood, join_likelihoods
from anchorpose.isolation.people import PatientChoice, find_people
from anchorpose.isolation.scene import Pieces, find_pieces
from anchorpose.isolation.separation import separate, separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.border import Border, border
from anchorpose.surface.patient_surface import blank_view, patient_surface
from anchorpose.surface.surface import ExpectedSkin, Surface, seen_part
from anchorpose.tracker.bystanders import Bystanders, bystander_likelihood, follow_bystanders
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import FACING, UP, Room
from anchorpose.tracker.stopwatch import Stopwatch

LEAST_TRUSTED = 4  # three tell nodes apart (paper, Section IV-D), four make two subsets; with fewer a node keeps all


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """Where the patient should be: his skin, how sure each point of it is (p,), anchors_m (5, 3), heading (3,) unit;
    frames since the last fit."""

    skin: ExpectedSkin
    sigma_m: np.ndarray
    anchors_m: np.ndarray
    facing: np.ndarray
    frames_without_fit: int


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One frame after the stages up to geodesics.

    whole: the patient's surface with its hidden skin, which is inferred. descriptor (n, 5) metres: the distance of each
    seen node to each anchor, inf where not reached, NaN where missed, or where a hole lengthens it and enough others
    are left. expected: where the patient was expected,
    None in a frame of which nothing was. border (n,) uint8 of ``Border``: what each seen node ends at. pieces: the
    people's pixels, so that they can be told apart again; memory: where everybody's skin is.
    """

    frame_set: FrameSet
    expected: Expectation | None
    evidence: Evidence
    whole: Surface
    anchors: Anchors
    descriptor: np.ndarray
    border: np.ndarray
    pieces: tuple[Pieces | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders

    @property
    def surface(self) -> Surface:
        """What is seen of the patient's surface."""
        return self.evidence.surface


def observe_first(
    frame_set: FrameSet, room: Room, choice: PatientChoice, height_m: float, config: TrackConfig, watch: Stopwatch
) -> Observation:
    """A frame of which nothing is expected but where the patient stands."""
    with watch.stage("isolation"):
        pieces = _find_pieces(frame_set, room, config)
        views = separate_initial(pieces, find_people(pieces, config.isolation), choice, config.isolation)
    others = _follow_others(Bystanders(), views, room, 0.0, config, watch)
    return _observed(frame_set, room, pieces, views, None, empty_memory(), others, 0.0, height_m, config, watch)


def observe(
    frame_set: FrameSet, room: Room, expected: Expectation, before: Observation, height_m: float, config: TrackConfig,
    watch: Stopwatch,
) -> Observation:  # fmt: skip
    """A frame in which the patient is expected at a place, and the others where they were in the frame before."""
    with watch.stage("isolation"):
        pieces = _find_pieces(frame_set, room, config)
    elapsed_s = frame_set.time_s - before.frame_set.time_s  # negative on the way back to the start
    views = _separated(pieces, expected, before, before.bystanders, elapsed_s, elapsed_s, config, watch)
    others = _follow_others(before.bystanders, views, room, elapsed_s, config, watch)
    return _observed(
        frame_set, room, pieces, views, expected, before.memory, others, elapsed_s, height_m, config, watch
    )


def observe_again(
    seen: Observation, room: Room, expected: Expectation, before: Observation, height_m: float, config: TrackConfig,
    watch: Stopwatch,
) -> Observation:  # fmt: skip
    """The same frame, isolated by a better expectation than there was when it came in."""
    elapsed_s = seen.frame_set.time_s - before.frame_set.time_s
    views = _separated(seen.pieces, expected, before, seen.bystanders, elapsed_s, 0.0, config, watch)
    return _observed(
        seen.frame_set, room, seen.pieces, views, expected, before.memory, seen.bystanders, elapsed_s, height_m, config,
        watch,
    )  # fmt: skip


def _separated(
    pieces: Sequence[Pieces | None], expected: Expectation, before: Observation, bystanders: Bystanders,
    elapsed_s: float, ahead_s: float, config: TrackConfig, watch: Stopwatch,
) -> tuple[View | None, ...]:  # fmt: skip
    """Everybody's pixels; ahead_s: from the frame that the bystanders' bodies were fitted to to this one."""
    with watch.stage("isolation"):
        others = bystander_likelihood(bystanders, body_points(), ahead_s, config.bystanders)
        likelihood = join_likelihoods([others, patient_likelihood(expected, config.isolation)])
        return separate(pieces, before.memory, likelihood, elapsed_s, config.isolation)


def _follow_others(
    before: Bystanders, views: Sequence[View | None], room: Room, elapsed_s: float, config: TrackConfig,
    watch: Stopwatch,
) -> Bystanders:  # fmt: skip
    with watch.stage("bystanders"):
        return follow_bystanders(before, views, room.cameras, body_points(), elapsed_s, config.bystanders)


def patient_likelihood(expected: Expectation, config: IsolationConfig) -> OwnershipLikelihood:
    """What the patient claims by his predicted skin.

    A limb that has been hidden for long claims nothing: whatever it met would be taken for it. What is seen of it again
    hangs on him.
    """
    spread = config.skin_sigma_m + config.prediction_growth_m * expected.frames_without_fit
    sure = expected.sigma_m < config.loosest_claim_m
    sigma = np.hypot(spread, expected.sigma_m[sure]).astype(np.float32)
    return OwnershipLikelihood(expected.skin.points_m[sure], np.full(len(sigma), PixelLabel.PATIENT, np.uint8), sigma)


def _find_pieces(frame_set: FrameSet, room: Room, config: TrackConfig) -> list[Pieces | None]:
    return [
        None if depth is None else find_pieces(depth, scene, config.isolation)
        for depth, scene in zip(frame_set.depths_m, room.scenes, strict=True)
    ]


def _observed(
    frame_set: FrameSet, room: Room, pieces: Sequence[Pieces | None], views: Sequence[View | None],
    expected: Expectation | None, before: BystanderMemory, bystanders: Bystanders, elapsed_s: float, height_m: float,
    config: TrackConfig, watch: Stopwatch,
) -> Observation:  # fmt: skip
    shown = [blank_view(camera) if view is None else view for view, camera in zip(views, room.cameras, strict=True)]
    with watch.stage("surface"):
        whole = patient_surface(shown, room.cameras, None if expected is None else expected.skin, config.surface)
        kind = border(whole, shown)
        surface = seen_part(whole)
    with watch.stage("geodesics"):
        facing, places = (FACING, None) if expected is None else (expected.facing, expected.anchors_m)
        anchors = find_anchors(whole, UP, facing, height_m, kind == Border.CUT, places, config.anchors)
        descriptor = anchor_descriptor(whole, anchors)
        if config.hypotheses.trusted_only:
            trusted = trusted_anchors(whole, descriptor, kind == Border.CUT)
            trusted |= trusted.sum(axis=1, keepdims=True) < LEAST_TRUSTED
            descriptor = np.where(trusted, descriptor, np.nan).astype(np.float32)
        descriptor = descriptor[: len(surface)]
    with watch.stage("isolation"):
        memory = update_memory(before, pieces, views, room.cameras, elapsed_s, config.isolation)
    with watch.stage("registration"):
        evidence = gather_evidence(surface, views, room.cameras)
    return Observation(
        frame_set, expected, evidence, whole, anchors, descriptor, kind[: len(surface)], tuple(pieces), memory,
        bystanders,
    )  # fmt: skip
