"""What is kept of a frame besides its joints: the body's pose, the anchors, and whose each pixel is."""

from __future__ import annotations

import numpy as np

from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.body.rotations import vectors_of
from anchorpose.body.skin_points import Body
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.recording.recording import FrameSet
from anchorpose.results.anchors_table import AnchorFrame
from anchorpose.results.people_labels import LabelPicture, label_picture
from anchorpose.results.poses import BodyPose
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.observation import Observation


def body_pose(
    body: Body | None, frame: int, time_s: float, pose: Pose | None,
    axial_sigma_rad: np.ndarray | None,
) -> BodyPose:  # fmt: skip
    """The bones of a pose in the world; all NaN without one. axial_sigma_rad (21,), None where it is not known."""
    count = len(MOVING_BONES)
    head_m, quaternion, sigma = np.full((count, 3), np.nan), np.full((count, 4), np.nan), np.full(count, np.nan)
    if body is not None and pose is not None:
        T_world_rest = body.transforms(pose)[body.points.moving]
        heads = body.mesh.bone_heads[body.points.moving]
        head_m = np.einsum("mij,mj->mi", T_world_rest[:, :3, :3], heads) + T_world_rest[:, :3, 3]
        quaternion = _quaternions(T_world_rest[:, :3, :3])
        sigma = sigma if axial_sigma_rad is None else axial_sigma_rad
    return BodyPose(frame, time_s, head_m, quaternion, sigma)


def axial_sigma(body: Body, pose: Pose, covariance: np.ndarray, inflation: float) -> np.ndarray:
    """(21,) radians: how sure each bone's turn about its own long axis against its parent is, one standard deviation.

    covariance (POSE_SIZE, POSE_SIZE): of the pose; inflation: as for the joints (``UncertaintyConfig``).
    """
    mesh, moving = body.mesh, body.points.moving
    along = mesh.bone_tails[moving] - mesh.bone_heads[moving]
    axis = np.einsum("mij,mj->mi", pose.rotations[moving], along / np.linalg.norm(along, axis=1, keepdims=True))
    blocks = np.stack([covariance[k : k + 3, k : k + 3] for k in range(0, 3 * len(moving), 3)])
    return inflation * np.sqrt(np.einsum("mi,mij,mj->m", axis, blocks, axis))


def anchor_frame(estimate: Estimate) -> AnchorFrame:
    """The anchors of the surface; all missed where nothing was looked for."""
    anchors = no_anchors() if estimate.observation is None else estimate.observation.anchors
    return AnchorFrame(estimate.frame_set.frame, estimate.frame_set.time_s, anchors.position_m, anchors.sigma_m)


def label_pictures(frame_set: FrameSet, observation: Observation | None) -> tuple[LabelPicture, ...]:
    """Whose each pixel is, of the cameras that have a picture of the frame."""
    if observation is None:
        return ()
    evidence = observation.evidence
    return tuple(
        label_picture(frame_set.frame, camera.name, view)
        for camera, view in zip(evidence.cameras, evidence.views, strict=True)
        if view is not None
    )


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """(m, 4) w, x, y, z with w not negative."""
    vectors = vectors_of(rotations)
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.hstack([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors])
