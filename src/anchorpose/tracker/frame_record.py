"""Make the record of a frame for the results: joints, pose, anchors, person labels, nearness of people and more."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import Nearness, find_nearness
from anchorpose.body.equipment_gaps import EquipmentGaps, ShownSkin, find_equipment_gaps
from anchorpose.body.explanation import Explanation
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.body.visibility import PoorDepth, facing_skin
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.joints import JointState
from anchorpose.recording.recording import FrameSet
from anchorpose.results.explained import ExplainedFrame, explained_frame
from anchorpose.results.records import LabelImage, encode_labels
from anchorpose.results.tables import AnchorFrame, BodyPose, JointFrame
from anchorpose.rotations import quaternions
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.room import Run
from anchorpose.tracker.smoothing import PassResult

# m, minimum length by which a bone's vector is divided to get the bone's direction. The minimum prevents a division by
# almost zero; only the bones of missing limbs are shorter
LEAST_BONE_M: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """The stored values of one frame."""

    joints: JointFrame
    body: BodyPose
    explained: ExplainedFrame  # how well the pose fits the depth images
    anchors: AnchorFrame
    matched_share: float | None  # share of the track tree's nodes that have a match; None if no tree was used
    near: Nearness | None  # how near other people are to the body; None if the patient is lost
    problems: tuple[str, ...]  # problems of the depth images, and the reason if a reviewer marked the frame as unusable
    why_lost: str = ""  # the reason why the patient is lost; empty if the patient is not lost
    poor: tuple[PoorDepth, ...] = ()  # the defects that make depth images too poor for joints
    gaps: EquipmentGaps | None = None  # gaps between body and equipment; None if one of them is unknown


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """A stored frame: its record, and the person label of each pixel."""

    record: FrameRecord
    labels: tuple[LabelImage, ...]


Kept = TrackedFrame | tuple[TrackedFrame, PassResult]
"""The values that a pass stores for a frame: a ``TrackedFrame``, and a ``PassResult`` if two passes are combined."""


def record_of(estimate: Estimate, body: Body | None, run: Run) -> FrameRecord:
    """Return the record of an estimate. body: the learnt body, None if no body was learnt.

    If a reviewer marked the frame as unusable, the record has no joints and no pose; ``problems`` states why.
    """
    frame_set = estimate.frame_set
    joints = JointFrame(
        frame=frame_set.frame,
        time_s=frame_set.time_s,
        position_m=estimate.joints_m,
        state=estimate.states,
        sigma_m=estimate.sigma_m,
    )
    bones, near = _bones(estimate, body, run), _near(estimate, body, run)
    gaps = _gaps(estimate, body, near, run)
    anchors, share = anchor_frame(estimate), estimate.matched_share
    explained = explained_frame(frame_set.frame, frame_set.time_s, estimate.explanation)
    record = FrameRecord(
        joints, bones, explained, anchors, share, near, frame_set.problems, estimate.why_lost, estimate.poor, gaps
    )
    why = run.room.review.why_unusable(frame_set.frame)
    return record if why is None else _without_patient(record, why)


def smoothed_record(
    record: FrameRecord, answer: PassResult, body: Body, explanation: Explanation | None
) -> FrameRecord:
    """Return ``record`` with the joints and the pose of ``answer``, the combined result of both passes. record: the
    frame's record from the pass (forward or backward) with more weight for the trunk (``trunk_of_back``); explanation:
    how well the smoothed pose fits the frame.
    """
    lost = np.array([state is JointState.LOST for state in answer.states])
    position = np.where(lost[:, None], np.nan, answer.joints_m)
    joints = replace(record.joints, position_m=position, sigma_m=answer.sigma_m, state=answer.states)
    frame, time_s = record.joints.frame, record.joints.time_s
    bones = body_pose(body, frame, time_s, answer.pose, None)
    why_lost = record.why_lost if lost.all() else ""
    return replace(
        record, joints=joints, body=bones, explained=explained_frame(frame, time_s, explanation), why_lost=why_lost
    )


def _without_patient(record: FrameRecord, why: str) -> FrameRecord:
    joints, body = record.joints, record.body
    return replace(
        record,
        joints=replace(
            joints,
            position_m=np.full_like(joints.position_m, np.nan),
            state=(JointState.LOST,) * len(joints.state),
            sigma_m=np.full_like(joints.sigma_m, np.nan),
        ),
        body=body_pose(None, body.frame, body.time_s, None, None),
        explained=explained_frame(body.frame, body.time_s, None),
        near=None,
        gaps=None,
        problems=(*record.problems, why),
    )


def _bones(estimate: Estimate, body: Body | None, run: Run) -> BodyPose:
    belief = estimate.belief
    frame, time_s = estimate.frame_set.frame, estimate.frame_set.time_s
    if body is None or belief is None:
        return body_pose(None, frame, time_s, None, None)
    sigma = axial_sigma(body, belief.pose, belief.covariance, run.config.uncertainty.inflation)
    return body_pose(body, frame, time_s, belief.pose, sigma)


def _near(estimate: Estimate, body: Body | None, run: Run) -> Nearness | None:
    """Measure how near other people are to the patient's body; None if the patient is lost."""
    seen, belief = estimate.observation, estimate.belief
    if body is None or seen is None or belief is None:
        return None
    with run.stage("contacts"):
        posed, evidence = pose_points(body, belief.pose), seen.evidence
        return find_nearness(body, posed, seen.memory, evidence.views, evidence.cameras, run.config.visibility)


def _gaps(estimate: Estimate, body: Body | None, near: Nearness | None, run: Run) -> EquipmentGaps | None:
    """Measure the gaps between the patient's body and the equipment; None if the body or the equipment is unknown."""
    equipment, belief, seen = run.room.recording.equipment, estimate.belief, estimate.observation
    if body is None or belief is None or seen is None or near is None or equipment is None:
        return None
    with run.stage("contacts"):
        posed, reach_m = pose_points(body, belief.pose), run.config.contacts.reach_m
        shown = ShownSkin(facing_skin(posed, seen.evidence.views, seen.evidence.cameras), near.shown)
        return find_equipment_gaps(body, posed.points_m, shown, estimate.sigma_m, equipment, reach_m)


def body_pose(
    body: Body | None, frame: int, time_s: float, pose: Pose | None, axial_sigma_rad: np.ndarray | None
) -> BodyPose:
    """Return place and orientation of the bones of a pose in the world; all values are NaN without a pose.
    axial_sigma_rad (21,): as from ``axial_sigma``; None if unknown.
    """
    count = len(MOVING_BONES)
    head_m, quaternion, sigma = np.full((count, 3), np.nan), np.full((count, 4), np.nan), np.full(count, np.nan)
    if body is not None and pose is not None:
        T_world_rest = body.transforms(pose)[body.points.moving]
        heads = body.mesh.bone_heads[body.points.moving]
        head_m = np.einsum("mij,mj->mi", T_world_rest[:, :3, :3], heads) + T_world_rest[:, :3, 3]
        quaternion = quaternions(T_world_rest[:, :3, :3])
        sigma = sigma if axial_sigma_rad is None else axial_sigma_rad
    return BodyPose(frame, time_s, head_m, quaternion, sigma)


def axial_sigma(body: Body, pose: Pose, covariance: np.ndarray, inflation: float) -> np.ndarray:
    """Return (21,) radians: standard deviation of each bone's turn about its long axis, relative to its parent bone.

    covariance (POSE_SIZE, POSE_SIZE): covariance of the pose; inflation: factor that converts the sigma of this
    covariance to the reported sigma (``UncertaintyConfig``).
    """
    mesh, moving = body.mesh, body.points.moving
    along = mesh.bone_tails[moving] - mesh.bone_heads[moving]
    axis = np.einsum(
        "mij,mj->mi",
        pose.rotations[moving],
        along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), LEAST_BONE_M),
    )
    blocks = np.stack([covariance[k : k + 3, k : k + 3] for k in range(0, 3 * len(moving), 3)])
    return inflation * np.sqrt(np.einsum("mi,mij,mj->m", axis, blocks, axis))


def anchor_frame(estimate: Estimate) -> AnchorFrame:
    """Return the anchors (head, hands and feet) found on the surface; all are missed if no patient was searched for."""
    anchors = no_anchors() if estimate.observation is None else estimate.observation.anchors
    return AnchorFrame(estimate.frame_set.frame, estimate.frame_set.time_s, anchors.position_m, anchors.sigma_m)


def label_pictures(frame_set: FrameSet, observation: Observation | None) -> tuple[LabelImage, ...]:
    """Return the person label of each pixel, for each camera that has a depth image of the frame."""
    if observation is None:
        return ()
    evidence = observation.evidence
    return tuple(
        encode_labels(frame_set.frame, camera.name, view)
        for camera, view in zip(evidence.cameras, evidence.views, strict=True)
        if view is not None
    )
