"""Estimate a frame's joints, their states and their standard deviations (sigma) from the registered body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.belief import PoseBelief
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import Explanation, explain
from anchorpose.body.inverse_kinematics import CorrectedJoints
from anchorpose.body.kinematics import missing_joints
from anchorpose.body.pose import LIMB_OF_JOINTS, SEGMENT_OF_JOINTS, Pose
from anchorpose.body.registration import Registration
from anchorpose.body.rivals import Rival, with_rivals
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import Body, FittedShape, PosedPoints, pose_points
from anchorpose.body.uncertainty import (
    FrameErrors,
    before_lost_ends,
    finest_patch_m,
    frame_errors,
    joint_sigma,
    lost_ends,
    noise_covariance,
    smeared_sigma,
    unexplained_sigma,
)
from anchorpose.body.visibility import PoorDepth, distance_of, joint_states, poor_depth
from anchorpose.isolation.depth_noise import DepthDetail
from anchorpose.isolation.view import View
from anchorpose.joints import JOINT_COUNT, JointState
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation

TOO_UNCERTAIN: Final = "every joint is more uncertain than a forearm's length"


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The patient's pose and joints in one frame, as estimated, with their uncertainty."""

    frame_set: FrameSet
    observation: Observation | None  # results of earlier stages; None if no patient was found or searched for
    belief: PoseBelief | None  # pose and its uncertainty; None if the patient is lost
    shape: FittedShape | None  # shape of the body; None if no patient was found or searched for
    explained: float  # 0 to 1, share of the patient's visible surface that lies near the fitted body
    joints_m: np.ndarray  # (21, 3) m, world; NaN for lost joints
    sigma_m: np.ndarray  # (21,) m, standard deviation of each joint's position per axis; NaN for lost joints
    states: tuple[JointState, ...]
    # share of the track tree's nodes that have a match in this frame; None if the tree was not used
    matched_share: float | None = None
    explanation: Explanation | None = None  # how well the pose fits the depth images; None if the patient is lost
    why_lost: str = ""  # the reason why all joints are lost; empty if they are not lost
    poor: tuple[PoorDepth, ...] = ()  # the defects that make depth images of this frame too poor for joints
    moved: bool = False  # whether limbs were found in another place than expected from earlier frames
    ends: frozenset[int] = frozenset()  # joint numbers of lost hands and feet (``lost_ends``)
    rivals: tuple[Rival, ...] = ()  # other poses that fit the images almost as well as the pose in ``belief``
    # joint states as in ``states``, but without the rule that a joint with a large sigma is lost
    shown: tuple[JointState, ...] = ()


class Earlier(NamedTuple):
    """The values that the estimate of a frame needs from earlier frames, and from learning the body's shape."""

    rivals: Sequence[Rival] = ()  # other poses that fit the images almost as well as the registered pose
    ends: frozenset[int] = frozenset()  # joint numbers of lost hands and feet (``lost_ends``)
    # (PARTS, 2) s, time since each half of the trunk and of each limb was last seen; a limb is divided at elbow or knee
    unseen_s: np.ndarray | None = None
    seen_sigma_m: np.ndarray | None = None  # (21,) m, sigma of each joint when its part was last seen; NaN = never
    shape: ShapeBelief | None = None  # belief in the patient's shape, as in ``Run.shape``


_NOTHING_OPEN: Final = Earlier()


def nobody_found(frame_set: FrameSet, why: str, poor: tuple[PoorDepth, ...] = ()) -> Estimate:
    """Return the estimate of a frame in which all joints are lost; ``why`` states the reason, without a full stop."""
    return Estimate(
        frame_set,
        None,
        None,
        None,
        0.0,
        np.full((JOINT_COUNT, 3), np.nan),
        np.full(JOINT_COUNT, np.nan),
        (JointState.LOST,) * JOINT_COUNT,
        why_lost=why,
        poor=poor,
    )


def estimate_of(
    body: Body,
    registration: Registration,
    observation: Observation,
    matched_share: float | None,
    config: TrackConfig,
    corrected: CorrectedJoints | None = None,
    earlier: Earlier = _NOTHING_OPEN,
) -> Estimate:
    """Estimate the joints of the registered body (each joint moves with its bone: rule J of the paper), the joints'
    states from the depth images, and their sigma.

    corrected: joints whose places a reviewer corrected. If cameras see past such a joint, the joint counts as hidden
    instead of lost. The joint's sigma covers the distance between the estimated place and the reviewer's place; if
    sigma then exceeds ``lost_sigma_m``, the joint is lost all the same.
    """
    belief, evidence = registration.belief, observation.evidence
    posed = pose_points(body, belief.pose)
    joints = body.mesh.joints(posed.transforms)
    explanation = explain(body.points, posed, evidence)
    frame = _frame_errors(body, belief.pose, evidence, config, earlier, corrected)
    sigma = _sigma(body, belief, posed, observation, explanation, config, frame, earlier.rivals)
    poor = poor_depth(posed, evidence.views, evidence.cameras, _details(observation), config.visibility.reach_m)
    shown = _states(body, posed, explanation, evidence, poor, config)
    ends = lost_ends(shown, earlier.ends)
    states, sigma = before_lost_ends(joints, shown, sigma, ends)
    if corrected is not None:
        states, sigma = _as_placed(joints, states, sigma, corrected)
    lost = (sigma > config.follow.lost_sigma_m) | np.array([state is JointState.LOST for state in states])
    lost |= missing_joints(body.points.asset, body.shape.missing)
    return Estimate(
        observation.frame_set,
        observation,
        belief,
        body.shape,
        registration.explained,
        np.where(lost[:, None], np.nan, joints),
        np.where(lost, np.nan, sigma),
        tuple(JointState.LOST if gone else state for gone, state in zip(lost, states, strict=True)),
        matched_share,
        explanation,
        TOO_UNCERTAIN if lost.all() else "",
        tuple(one for one in poor if one is not None),
        ends=ends,
        rivals=tuple(earlier.rivals),
        shown=states,
    )


def _frame_errors(
    body: Body, pose: Pose, evidence: Evidence, config: TrackConfig, earlier: Earlier, corrected: CorrectedJoints | None
) -> FrameErrors:
    """Return the variances of the joints' places that follow from this frame and from the uncertainty of the body's
    shape.

    The variance of a hidden joint is increased by the variance that the joint had when its body part was last seen. On
    each limb (or trunk) with a corrected joint, the variance ``FrameErrors.pose`` of all joints is set to 0, since the
    covariance of the pose already includes the reviewer's corrections.
    """
    found = frame_errors(body, pose, evidence, config.registration, unseen_s=earlier.unseen_s, shape=earlier.shape)
    variance = found.pose.copy()
    if earlier.unseen_s is not None and earlier.seen_sigma_m is not None:
        hidden = (earlier.unseen_s > 0.0).ravel()[SEGMENT_OF_JOINTS]
        variance[hidden] += np.nan_to_num(earlier.seen_sigma_m[hidden]) ** 2
    if corrected is not None:
        variance[np.isin(LIMB_OF_JOINTS, LIMB_OF_JOINTS[corrected.joint])] = 0.0
    return found._replace(pose=variance)


def _sigma(
    body: Body,
    belief: PoseBelief,
    posed: PosedPoints,
    observation: Observation,
    explanation: Explanation,
    config: TrackConfig,
    frame: FrameErrors,
    rivals: Sequence[Rival],
) -> np.ndarray:
    """Return the joints' sigma_m (21,) from the covariance of the pose and the errors of the frame. Sigma is then
    increased for three errors that neither of them includes: another pose may be the true pose (``rivals``), the true
    place of a limb may be on seen skin that the estimated body leaves uncovered, and cameras may blur depth edges.
    """
    evidence = observation.evidence
    noise = noise_covariance(body, belief, evidence, config.registration)
    patch_m = finest_patch_m(evidence)
    sigma = joint_sigma(body, posed, belief.covariance, config.uncertainty, noise, patch_m, frame)
    if rivals:
        sigma = with_rivals(body, body.joints(belief.pose), sigma, rivals)
    sigma = unexplained_sigma(body, belief.pose, evidence, explanation, sigma)
    return _smeared_sigma(body, belief.pose, observation, sigma, config)


def _as_placed(
    joints_m: np.ndarray, states: Sequence[JointState], sigma_m: np.ndarray, corrected: CorrectedJoints
) -> tuple[tuple[JointState, ...], np.ndarray]:
    """Return the states and sigma_m (21,) of all joints. Joints that a reviewer placed get the state ``HIDDEN`` instead
    of ``LOST``. The sigma of these joints is large enough to cover the distance between the estimated place and the
    reviewer's place.
    """
    placed, sigma_m = set(corrected.joint.tolist()), sigma_m.copy()
    away_m = np.linalg.norm(joints_m[corrected.joint] - corrected.position_m, axis=1)
    sigma_m[corrected.joint] = np.maximum(sigma_m[corrected.joint], away_m / np.sqrt(3.0))
    seen = (
        JointState.HIDDEN if joint in placed and state is JointState.LOST else state
        for joint, state in enumerate(states)
    )
    return tuple(seen), sigma_m


def displaced(estimate: Estimate, displaced_m: float) -> Estimate:
    """Return the estimate with sigma increased by the error of the camera poses. displaced_m: distance in metres by
    which this error displaces the patient; the direction of this displacement is unknown.
    """
    if not displaced_m:
        return estimate
    return replace(estimate, sigma_m=np.hypot(estimate.sigma_m, displaced_m / np.sqrt(3.0)))


def _details(observation: Observation) -> list[DepthDetail | None]:
    return [None if pieces is None else pieces.sensor for pieces in observation.pieces]


def _smeared_sigma(
    body: Body, pose: Pose, observation: Observation, sigma_m: np.ndarray, config: TrackConfig
) -> np.ndarray:
    """Return sigma_m (21,), increased if every camera that shows the patient has filters that blur depth edges."""
    edges = []
    for view, detail in zip(observation.evidence.views, _details(observation), strict=True):
        distance_m = None if view is None else distance_of(view)
        if detail is None or distance_m is None:
            continue
        if not detail.filtered:
            return sigma_m
        edges.append(detail.edge_m(distance_m))
    if not edges:
        return sigma_m
    return smeared_sigma(body, pose, observation.evidence, min(edges), sigma_m, config.registration, config.uncertainty)


def _states(
    body: Body,
    posed: PosedPoints,
    explanation: Explanation,
    evidence: Evidence,
    poor: Sequence[PoorDepth | None],
    config: TrackConfig,
) -> tuple[JointState, ...]:
    """Return the joint states. A joint that is seen only by cameras whose depth is too coarse for limbs counts as
    hidden, not as observed.
    """

    def by(views: Sequence[View | None]) -> tuple[JointState, ...]:
        return joint_states(body.points, posed, explanation.covering, views, evidence.cameras, config.visibility)

    found = by(evidence.views)
    coarse = [one is not None and not one.resolves_limbs for one in poor]
    if not any(coarse):
        return found
    resolved = by([None if blurred else view for view, blurred in zip(evidence.views, coarse, strict=True)])
    return tuple(
        JointState.HIDDEN if state is JointState.OBSERVED and sharp is not JointState.OBSERVED else state
        for state, sharp in zip(found, resolved, strict=True)
    )
