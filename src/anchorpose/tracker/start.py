"""Find the first pose in a frame: the body that fits the patient in this frame, or the reason why no body fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.explanation import explain
from anchorpose.body.initial import FirstPose, FirstShape, find_first_pose
from anchorpose.body.kinematics import missing_points
from anchorpose.body.limb_search import search_limbs
from anchorpose.body.matched_places import LEAST_MATCHES, MatchedPerson, match_person, matches_of
from anchorpose.body.pose import LIMB_OF_BONES, TRUNK, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.proposals import rarity
from anchorpose.body.registration import Registration, descend, posterior
from anchorpose.body.rivals import Rival, rivals_of
from anchorpose.body.skin_points import Body, FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import FrameSet, Subject
from anchorpose.rotations import unit
from anchorpose.tracker.bystanders import MOST_TRUNK_PAST
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.observation import Observation, Start
from anchorpose.tracker.observing import observe_first, people_of
from anchorpose.tracker.prior_shape import is_human, known_beliefs, likeliest, ordinary_height_m, shapes_to_try
from anchorpose.tracker.room import Run
from anchorpose.tracker.sighting import Crowd

# a forearm or shank counts as fully seen if this share of its skin is seen; a camera sees at most half of the skin
SEEN = 0.3
# maximum rarity (sum of the squared deviations of all joints from their usual range) of a pose that counts as usual;
# correct first poses have 15 to 60, wrong poses over 100
USUAL = 60.0
# minimum quality of a start (first pose) in a recording without equipment; correct first poses have 0.35, wrong first
# poses in a crowd less than 0.25
LEAST_QUALITY = 0.25
# minimum seen share of the skin of trunk and head: as much as a face, or as a part of a chest between other people
LEAST_TRUNK = 0.05
# maximum squared Mahalanobis distance (3 angles) of a person's pelvis rotation from the rotation expected for a lost
# patient; 1 patient in 10,000 exceeds it
TURN_GATE = 21.1
# maximum deviation, in standard deviations, of any of 16 shape components; one adult in a thousand exceeds it
MOST_DEVIATIONS = 4.0
LEAST_EXPLAINED = 0.55  # minimum share of the patient's surface that lies near the body in a first pose
# m, maximum height of a body's lowest skin above the floor if no shank is seen; feet on a low bed or a treadmill are
# lower than this
HANGS_M = 0.35
# minimum cosine between trunk and vertical for HANGS_M to be tested; it excludes people who lie, since their feet may
# be high
UPRIGHT = 0.7
_SHANKS = ("LeftLeg", "RightLeg")
_ENDS = ("LeftForeArm", "RightForeArm", *_SHANKS)


class NoStart(StrEnum):
    """The reason why tracking does not begin in a frame."""

    NOBODY_THERE = "nobody is seen where the patient should be"
    NOBODY_NEW = "everybody in view was seen together with the patient before"
    WHO_IS_IT = "the person who came in may not be the patient"
    TOO_LITTLE_SEEN = "too little of a person is seen where the patient should be"
    NO_BODY_FITS = "no body explains what is seen there"
    NOT_HUMAN = "only a body outside of the range of human shapes would explain what is seen there"
    HANGS = "only a body above the floor would explain what is seen there"
    LIMBS_ALONE = "neither trunk nor head is in view, only limbs"


class Facing(NamedTuple):
    """The patient's pose in a frame. Not this frame alone, but a longer stretch of the recording has decided which way
    the patient faces in this pose.
    """

    pose: Pose
    other: Rival | None  # the opposite facing, with the body learnt for it; None if the longer stretch excludes it


def find_start(
    frame_set: FrameSet,
    run: Run,
    choice: PatientChoice,
    known: FittedShape | None,
    crowd: Crowd | None = None,
    expected: PoseBelief | None = None,
) -> Start | NoStart:
    """Find the patient in a frame, or return why the patient is not found.

    known: the learnt shape, None before learning; crowd: the people in this frame, None if not found yet; expected: the
    pose expected after a loss. The expected pose is used by the search for misplaced limbs, and to reject a person who
    faces the other way.
    """
    room, config = run.room, run.config
    crowd = crowd or people_of(frame_set, run)
    observation = observe_first(frame_set, choice, ordinary_height_m(room.recording), run, crowd)
    matches = matches_of(observation.evidence.views, room.cameras, PixelLabel.PATIENT)
    if len(observation.surface) < config.registration.least_nodes or len(matches) < LEAST_MATCHES:
        return NoStart.TOO_LITTLE_SEEN
    first = _first_body(observation, match_person(matches), run, known)
    if known is None and not _is_likely(first, room.recording.subject):
        return NoStart.NOT_HUMAN
    body, turned = build_body(body_points(), first.shape), _turned(first)
    poses = [first.pose, *_as_rough(body, crowd, choice, observation, first.pose, config)]
    found = _likeliest(body, poses, observation, config)
    start = _start_with(body, found, observation, config, expected, turned=turned)
    if start is None or start.explained < LEAST_EXPLAINED:
        return NoStart.NO_BODY_FITS
    if expected is not None and _turned_round(expected, start.belief.pose):
        return NoStart.WHO_IS_IT
    return _why_not(start, run) or (start if known is None else replace(start, turned=None))


def start_as_learnt(
    frame_set: FrameSet, run: Run, choice: PatientChoice, shape: FittedShape, facing: Facing
) -> Start | NoStart:
    """Return the start (the patient's first pose) in a frame from which the body was learnt, or why tracking does not
    begin in this frame.

    Poses with the learnt facing are registered: the learnt pose, the first pose in this frame and the pose of the rough
    body. The most probable pose is kept.
    """
    config, crowd = run.config, people_of(frame_set, run)
    seen = observe_first(frame_set, choice, ordinary_height_m(run.room.recording), run, crowd)
    if len(seen.surface) < config.registration.least_nodes:
        return NoStart.TOO_LITTLE_SEEN
    body, before = build_body(body_points(), shape), vague_belief(facing.pose)
    tried = [descend(body, facing.pose, before, seen.evidence, config.registration)]
    tried += _as_rough(body, crowd, choice, seen, facing.pose, config)
    matches = matches_of(seen.evidence.views, run.room.cameras, PixelLabel.PATIENT)
    if len(matches) >= LEAST_MATCHES:
        first = _first_body(seen, match_person(matches), run, shape)
        alike = (one.pose for one in (first, *first.others) if one.shape is first.shape)
        tried += [pose for pose in alike if not facing.pose.faces_away(pose)]
    start = _start_with(body, _likeliest(body, tried, seen, config), seen, config, facing=facing)
    if start is None or start.explained < LEAST_EXPLAINED:
        return NoStart.NO_BODY_FITS
    return _why_not(start, run) or start


def _as_rough(
    body: Body, crowd: Crowd, choice: PatientChoice, seen: Observation, facing: Pose, config: TrackConfig
) -> list[Pose]:
    """Return the pose of the patient's rough body (average shape), registered to the frame; empty if this body is
    turned by more than a right angle relative to the pose ``facing``.

    The rough body was fitted to the pixels that the learnt descriptor assigns to the patient, before the fitted bodies
    of all people decided to whom each pixel belongs.
    """
    rough = crowd.body_at(choice.ground_xz_m)
    if rough is None or facing.faces_away(rough.found.belief.pose):
        return []
    pose = rough.found.belief.pose
    return [descend(body, pose, vague_belief(pose), seen.evidence, config.registration)]


def _likeliest(body: Body, poses: Sequence[Pose], seen: Observation, config: TrackConfig) -> Registration:
    """Return the most probable of some registered poses, with the uncertainty of this pose."""
    found = [posterior(body, pose, vague_belief(pose), seen.evidence, config.registration) for pose in poses]
    return max(found, key=lambda one: log_probability(body, one.belief.pose, seen.evidence) if one.found else -np.inf)


def _start_with(
    body: Body,
    found: Registration,
    seen: Observation,
    config: TrackConfig,
    expected: PoseBelief | None = None,
    facing: Facing | None = None,
    turned: Rival | None = None,
) -> Start | None:
    """Return the start of tracking from a registered first pose, after a search for misplaced limbs; None if the pose
    does not fit.

    expected: the pose expected after a loss. facing: the facing that learning from a longer stretch of the recording
    has decided; if it is given, the search does not turn the body round. turned: a pose with the opposite facing, which
    becomes a rival of the first pose.
    """
    if not found.found:
        return None
    # the search corrects exchanged left and right limbs, and limbs on which the learnt descriptor found no matches
    search = search_limbs(body, found, expected or vague_belief(found.belief.pose), seen.evidence, config.registration)
    others = [*search.rivals, turned]
    if facing is None or not facing.pose.faces_away(search.registration.belief.pose):
        found = search.registration
    if facing is not None:
        others = [*(one for one in search.rivals if not facing.pose.faces_away(one.belief.pose)), facing.other]
    rivals = rivals_of(body, found.belief, [one for one in others if one is not None])
    return Start(seen, body.shape, found.belief, found.explained, rivals, turned) if found.found else None


def _turned_round(before: PoseBelief, now: Pose) -> bool:
    """Return whether the pelvis has turned farther than is likely since the pose ``before``.

    A person whose pelvis has turned farther than is likely may not be the patient. For example, a helper who was hidden
    together with the patient often faces the patient. If the patient showed a camera the front, this helper shows the
    camera the back.
    """
    turn = before.pose.change_to(now, body_points().moving)[:3]
    return float(turn @ np.linalg.solve(before.covariance[:3, :3], turn)) > TURN_GATE


def _turned(first: FirstPose) -> Rival:
    """Return the rival of a first pose: a pose with the opposite facing. It has the body of the first pose or a body
    that was fitted for the opposite facing, whichever is likelier.
    """
    other = min(first.others, key=first.ahead_of)
    own = None if other.shape is first.shape else build_body(body_points(), other.shape)
    return Rival(vague_belief(other.pose), first.ahead_of(other), body=own)


def start_turned(seen: Observation | None, turned: Rival | None, config: TrackConfig) -> Start | None:
    """Return the start of tracking in a frame with the opposite facing of the patient (``turned``); None if that facing
    has no body of its own or does not fit.
    """
    if seen is None or turned is None or turned.body is None:
        return None
    found = posterior(turned.body, turned.belief.pose, turned.belief, seen.evidence, config.registration)
    return Start(seen, turned.body.shape, found.belief, found.explained) if found.found else None


def _first_body(seen: Observation, person: MatchedPerson, run: Run, known: FittedShape | None) -> FirstPose:
    """Find the first pose with the learnt body. Before a body is learnt, find it with a body whose shape may be fitted,
    too.

    If no likely body agrees with the user's statements about the patient, the statements are ignored and the images
    alone decide.
    """
    subject, config = run.room.recording.subject, run.config
    if known is not None:
        belief = likeliest(known_beliefs(subject, config), known)
        return _first_pose(seen, person, FirstShape((replace(belief, shape=known),), may_change=False), run)
    first = _first_pose(seen, person, shapes_to_try(person.stature_m, subject, config), run)
    if _is_likely(first, subject) or subject == subject.unmeasured:
        return first
    return _first_pose(seen, person, shapes_to_try(person.stature_m, subject.unmeasured, config), run)


def _is_likely(first: FirstPose, subject: Subject) -> bool:
    """Return whether the fitted height and build occur in people. A height that the user has measured is always
    accepted.
    """
    deviations = first.belief.deviations(first.shape)[: body_points().asset.common_count]
    return (subject.height_m is not None or is_human(first.shape)) and bool(deviations.max() < MOST_DEVIATIONS)


def _first_pose(seen: Observation, person: MatchedPerson, shape: FirstShape, run: Run) -> FirstPose:
    with run.stage("first pose"):
        return find_first_pose(seen.evidence, person, shape, run.config.registration)


def _why_not(start: Start, run: Run) -> NoStart | None:
    """Return why a first pose is rejected although it fits the images; None if it is accepted."""
    body = build_body(body_points(), start.shape)
    posed, evidence = pose_points(body, start.belief.pose), start.observation.evidence
    explanation = explain(body.points, posed, evidence)
    trunk = np.isin(body.points.part, body.points.moving[LIMB_OF_BONES == TRUNK])
    if explanation.covering[trunk].mean() < LEAST_TRUNK:
        return NoStart.LIMBS_ALONE
    shanks = [explanation.covering[body.points.part == bone].mean() for bone in _there(body, _SHANKS)]
    legs_unseen = bool(shanks) and max(shanks) < SEEN
    if evidence.floor_m is not None and legs_unseen and hangs(posed, body.joints(start.belief.pose), evidence.floor_m):
        return NoStart.HANGS
    unplaced = run.room.recording.equipment is None
    if np.nan_to_num(explanation.seen_past[TRUNK]) > MOST_TRUNK_PAST or (unplaced and quality(start) < LEAST_QUALITY):
        return NoStart.NO_BODY_FITS
    return None


def hangs(posed: PosedPoints, joints_m: np.ndarray, floor_m: float) -> bool:
    """Return whether the lowest skin of an upright body is far above the floor, which happens if only a part of the
    person is seen. The result is also True for people who sit on a high couch, but their shanks are seen.

    joints_m (21, 3): joints of the body.
    """
    trunk = unit(joints_m[JOINT_INDEX["SpineShoulder"]] - joints_m[JOINT_INDEX["SpineBase"]])
    return bool(trunk[1] > UPRIGHT and posed.points_m[:, 1].min() > floor_m + HANGS_M)


def quality(start: Start) -> float:
    """Return the quality of a start (first pose), 0 to 1: the share of the patient's surface that lies near the body.
    The quality is reduced for each forearm or shank that is hardly seen, and for a rare pose.

    The pose of a hidden limb is arbitrary, and a limb that is confused with another person's limb in the first frame
    remains confused for long. Rare poses are often wrong: for example, if legs were fitted to the head of a kneeling
    person, these legs are bent in a rare way.
    """
    body = build_body(body_points(), start.shape)
    points, pose = body.points, start.belief.pose
    covering = explain(points, pose_points(body, pose), start.observation.evidence).covering
    shares = [covering[points.part == bone].mean() for bone in _there(body, _ENDS)]
    usual = min(1.0, USUAL / max(rarity(body, pose), 1e-9))
    shown = float(np.mean(np.minimum(np.array(shares) / SEEN, 1.0))) if shares else 1.0
    return start.explained * usual * shown


def _there(body: Body, names: Sequence[str]) -> list[int]:
    """Return the bones with these names, without the bones of missing limbs."""
    asset = body.points.asset
    bones = [asset.bone(name) for name in names]
    gone = missing_points(asset, np.array(bones), body.shape.missing)
    return [bone for bone, missing in zip(bones, gone.tolist(), strict=True) if not missing]


def turn_round(estimate: Estimate, config: TrackConfig) -> Start | None:
    """Return the start of a pass in the other direction, from the last frame of a pass; None if the patient is lost in
    this frame.

    The uncertainty of the start's pose follows from the data of this frame alone, so that both passes are independent.
    """
    seen, belief, shape = estimate.observation, estimate.belief, estimate.shape
    if seen is None or belief is None or shape is None:
        return None
    points = body_points()
    body = build_body(points, shape)
    found = posterior(body, belief.pose, vague_belief(belief.pose), seen.evidence, config.registration)
    return Start(seen, shape, found.belief, found.explained, estimate.rivals)
