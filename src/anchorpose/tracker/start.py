"""The beginning of a track: the first frame in which the patient is found, with the body that explains what is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.explained import explain
from anchorpose.body.initial import FirstShape, find_first_pose, likely_headings
from anchorpose.body.learning import MOST_DEVIATIONS, ShapeBelief, adult_belief, shape_of_height
from anchorpose.body.pose import LIMB_OF_BONES, Pose
from anchorpose.body.registration import posterior
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body, pose_points
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.surface.surface import Surface
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.isolating import observe_first
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.room import Room
from anchorpose.tracker.run import Run

HEADINGS = 2  # that are tried: rough bodies mistake a back for a front in one of ten
LEAST_TRUNK = 0.05  # of the skin of trunk and head: a face, or what is seen of a chest between others
LEAST_EXPLAINED = 0.55  # share of the surface that a first pose must account for
ADULT_HEIGHTS_M = (1.45, 2.0)
CUT_OFF = 1.08  # feet cut off by the image border or lost on the floor are a twelfth of the height
SEATED_BELOW_M = 1.35  # a person seen no taller sits or is half hidden: then the extent says nothing about the height
ORDINARY_HEIGHT_M = 1.70  # of an adult whose height is not given
ORDINARY_HEIGHTS_M = (1.60, 1.75)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first frame of a track: what was seen, the body, the belief in its pose."""

    observation: Observation
    shape: FittedShape
    belief: PoseBelief
    explained: float


class NoStart(StrEnum):
    """Why a track does not begin in a frame."""

    NOBODY_THERE = "nobody is seen where the patient may be"
    NOBODY_NEW = "everybody in view was there beside the patient"
    WHO_IS_IT = "who came in may be another person"
    TOO_LITTLE_SEEN = "too little of anybody is seen where the patient should be"
    NO_BODY_FITS = "no body explains what is seen there"
    NOT_HUMAN = "only a body outside of the range of human shapes would explain what is seen there"
    LIMBS_ALONE = "neither trunk nor head is in view, only limbs"


def find_start(frame_set: FrameSet, run: Run, choice: PatientChoice, known: FittedShape | None) -> Start | NoStart:
    """The patient in this frame, or why there is none. known: the learnt shape, if there is one already."""
    points, room, config = body_points(), run.room, run.config
    height_m = room.recording.subject_height_m or ORDINARY_HEIGHT_M
    observation = observe_first(frame_set, choice, height_m, run)
    if len(observation.surface) < config.registration.least_nodes:
        return NoStart.TOO_LITTLE_SEEN
    shapes = [known] if known else [shape_of_height(points.asset, h) for h in first_heights(observation.surface, room)]
    shape = FirstShape(shapes, known_shape(room.recording, config), known is None and config.learning.own_shape)
    with run.stage("first pose"):
        headings = _headings(observation, shape, run)
        first = find_first_pose(
            observation.evidence, observation.anchors, shape, config.registration, headings, observation.geodesics
        )
    body = build_body(points, first.shape)
    found = posterior(body, first.pose, vague_belief(first.pose), observation.evidence, config.registration)
    if not found.found or found.explained < LEAST_EXPLAINED:
        return NoStart.NO_BODY_FITS
    if known is None and np.abs(first.shape.coefficients).max() >= MOST_DEVIATIONS:
        return NoStart.NOT_HUMAN
    if _shown_of_trunk(body, found.belief.pose, observation) < LEAST_TRUNK:
        return NoStart.LIMBS_ALONE
    return Start(observation, first.shape, found.belief, found.explained)


def _shown_of_trunk(body: Body, pose: Pose, seen: Observation) -> float:
    """The share of the skin of trunk and head that covers what is seen; half of it faces a camera."""
    covering = explain(body.points, pose_points(body, pose), seen.evidence).covering
    return float(covering[np.isin(body.points.part, body.points.moving[LIMB_OF_BONES == 0])].mean())


def _headings(seen: Observation, shape: FirstShape, run: Run) -> tuple[float, ...]:
    """Which way the patient may face: along X in the equipment, elsewhere as rough bodies find it."""
    if run.room.recording.equipment is not None:
        return (0.0,)
    body = build_body(body_points(), shape.tried[0])
    return likely_headings(body, seen.evidence, run.config.registration, HEADINGS)


def turn_round(estimate: Estimate, config: TrackConfig) -> Start | None:
    """The start of a pass the other way from the frame in which one ended; None where the patient is lost there.

    Only what this frame shows makes the pose sure: the other way is to see for itself.
    """
    seen, belief, shape = estimate.observation, estimate.belief, estimate.shape
    if seen is None or belief is None or shape is None:
        return None
    points = body_points()
    body = build_body(points, shape)
    found = posterior(body, belief.pose, vague_belief(belief.pose), seen.evidence, config.registration)
    return Start(seen, shape, found.belief, found.explained)


def known_shape(recording: Recording, config: TrackConfig) -> ShapeBelief:
    """What is known of the patient's shape beforehand: an adult, perhaps of a measured height."""
    asset, height_m = body_points().asset, recording.subject_height_m
    adult = adult_belief(asset)
    return adult if height_m is None else adult.standing(asset, height_m, config.learning.height_sigma_m)


def first_heights(surface: Surface, room: Room) -> Sequence[float]:
    """Standing heights to try: the given one, else what is seen and a little more."""
    if room.recording.subject_height_m is not None:
        return (room.recording.subject_height_m,)
    top, bottom = np.percentile(surface.points_m[:, 1], [99.9, 0.1])
    floor = room.calibration.floor_height_m
    extent = float(top - (bottom if floor is None else min(floor, bottom)))
    if extent < SEATED_BELOW_M:
        return ORDINARY_HEIGHTS_M
    return tuple(float(np.clip(extent * factor, *ADULT_HEIGHTS_M)) for factor in (1.0, CUT_OFF))
