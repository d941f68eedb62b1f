"""The beginning of a track: the first frame in which the patient is found, with the body that explains what is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.explained import explain
from anchorpose.body.initial import FirstPose, FirstShape, find_first_pose, likely_headings
from anchorpose.body.limb_search import rarity
from anchorpose.body.pose import LIMB_OF_BONES, TRUNK
from anchorpose.body.registration import posterior
from anchorpose.body.skin_points import FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.isolation.people import PatientChoice
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import FrameSet, Subject
from anchorpose.rotations import unit
from anchorpose.tracker.bystanders import MOST_TRUNK_PAST
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.isolating import observe_first
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.prior_shape import is_human, known_beliefs, likeliest, ordinary_height_m, shapes_to_try
from anchorpose.tracker.run import Run

SEEN = 0.3  # of the skin of a forearm or shank: half of it faces a camera
USUAL = 60.0  # squared deviations of all joint ranges: right first poses have 15 to 60, wrong ones over 100
LEAST_QUALITY = 0.25  # where no equipment says that a person is there: right ones have 0.35, one in a crowd had less
HEADINGS = 2  # that are tried: rough bodies mistake a back for a front in one of ten
LEAST_TRUNK = 0.05  # of the skin of trunk and head: a face, or what is seen of a chest between others
MOST_DEVIATIONS = 3.0  # of a statistical component: one adult in a thousand
LEAST_EXPLAINED = 0.55  # share of the surface that a first pose must account for
HANGS_M = 0.35  # above the floor: who sits on a high bed, or stands on a treadmill, has the feet lower
UPRIGHT = 0.7  # cosine between trunk and the vertical: who lies has no feet near the floor
_ENDS = ("LeftForeArm", "RightForeArm", "LeftLeg", "RightLeg")


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first frame of a track: what was seen, the body, the belief in its pose."""

    observation: Observation
    shape: FittedShape
    belief: PoseBelief
    explained: float


class NoStart(StrEnum):
    """Why a track does not begin in a frame."""

    NOBODY_THERE = "nobody is seen where the patient should be"
    NOBODY_NEW = "everybody in view was there beside the patient"
    WHO_IS_IT = "who came in may be another person"
    TOO_LITTLE_SEEN = "too little of anybody is seen where the patient should be"
    NO_BODY_FITS = "no body explains what is seen there"
    NOT_HUMAN = "only a body outside of the range of human shapes would explain what is seen there"
    HANGS = "only a body that hangs above the floor would explain what is seen there"
    LIMBS_ALONE = "neither trunk nor head is in view, only limbs"


def find_start(frame_set: FrameSet, run: Run, choice: PatientChoice, known: FittedShape | None) -> Start | NoStart:
    """The patient in this frame, or why there is none. known: the learnt shape, if there is one already."""
    points, room, config = body_points(), run.room, run.config
    observation = observe_first(frame_set, choice, ordinary_height_m(room.recording), run)
    if len(observation.surface) < config.registration.least_nodes:
        return NoStart.TOO_LITTLE_SEEN
    first = _first_body(observation, run, known)
    if known is None and not _is_likely(first, room.recording.subject):
        return NoStart.NOT_HUMAN
    body = build_body(points, first.shape)
    found = posterior(body, first.pose, vague_belief(first.pose), observation.evidence, config.registration)
    start = Start(observation, first.shape, found.belief, found.explained)
    if not found.found or found.explained < LEAST_EXPLAINED:
        return NoStart.NO_BODY_FITS
    return _why_not(start, run) or start


def _first_body(seen: Observation, run: Run, known: FittedShape | None) -> FirstPose:
    """The first pose with the learnt body, else with one that may still change.

    Where what is stated about the patient allows no likely body, the images decide without it.
    """
    subject, config = run.room.recording.subject, run.config
    if known is not None:
        belief = likeliest(known_beliefs(subject, config), known)
        return _first_pose(seen, FirstShape((replace(belief, shape=known),), may_change=False), run)
    first = _first_pose(seen, shapes_to_try(seen.surface, run.room, subject, config), run)
    if _is_likely(first, subject) or subject == subject.unmeasured:
        return first
    return _first_pose(seen, shapes_to_try(seen.surface, run.room, subject.unmeasured, config), run)


def _is_likely(first: FirstPose, subject: Subject) -> bool:
    """Whether people have such a height and such a build; a height that was measured is believed."""
    deviations = first.belief.deviations(first.shape)[: body_points().asset.common_count]
    return (subject.height_m is not None or is_human(first.shape)) and bool(deviations.max() < MOST_DEVIATIONS)


def _first_pose(seen: Observation, shape: FirstShape, run: Run) -> FirstPose:
    headings, config = _headings(seen, shape, run), run.config.registration
    with run.stage("first pose"):
        return find_first_pose(seen.evidence, seen.anchors, shape, config, headings, seen.geodesics)


def _why_not(start: Start, run: Run) -> NoStart | None:
    """Why a first pose that explains what is seen is not believed all the same, None where it is."""
    body = build_body(body_points(), start.shape)
    posed, evidence = pose_points(body, start.belief.pose), start.observation.evidence
    explanation = explain(body.points, posed, evidence)
    trunk = np.isin(body.points.part, body.points.moving[LIMB_OF_BONES == TRUNK])
    if explanation.covering[trunk].mean() < LEAST_TRUNK:
        return NoStart.LIMBS_ALONE
    if evidence.floor_m is not None and hangs(posed, body.joints(start.belief.pose), evidence.floor_m):
        return NoStart.HANGS
    unplaced = run.room.recording.equipment is None
    if np.nan_to_num(explanation.seen_past[TRUNK]) > MOST_TRUNK_PAST or (unplaced and quality(start) < LEAST_QUALITY):
        return NoStart.NO_BODY_FITS
    return None


def hangs(posed: PosedPoints, joints_m: np.ndarray, floor_m: float) -> bool:
    """Whether an upright body ends far above the floor (a height): what is seen is then not all of the person.

    joints_m (21, 3).
    """
    trunk = unit(joints_m[JOINT_INDEX["SpineShoulder"]] - joints_m[JOINT_INDEX["SpineBase"]])
    return bool(trunk[1] > UPRIGHT and posed.points_m[:, 1].min() > floor_m + HANGS_M)


def _headings(seen: Observation, shape: FirstShape, run: Run) -> tuple[float, ...]:
    """Which way the patient may face: along X in the equipment, elsewhere as rough bodies find it."""
    if run.room.recording.equipment is not None:
        return (0.0,)
    body = build_body(body_points(), shape.tried[0].shape)
    return likely_headings(body, seen.evidence, run.config.registration, HEADINGS)


def quality(start: Start) -> float:
    """0 to 1: the share of the surface that the body explains, less for each forearm and shank of which little is seen,
    and for a pose that people seldom take.

    Where such a part is hidden its pose is arbitrary, and what is taken for another person's in the first frame is not
    soon given back. Legs that explain the head of another person who kneels beside are bent as legs seldom are.
    """
    body = build_body(body_points(), start.shape)
    points, pose = body.points, start.belief.pose
    covering = explain(points, pose_points(body, pose), start.observation.evidence).covering
    shares = [covering[points.part == points.asset.bone(bone)].mean() for bone in _ENDS]
    usual = min(1.0, USUAL / max(rarity(body, pose), 1e-9))
    return start.explained * usual * float(np.mean(np.minimum(np.array(shares) / SEEN, 1.0)))


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
