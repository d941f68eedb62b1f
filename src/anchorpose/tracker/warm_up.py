"""Compile the kernels (functions that numba compiles) of prediction and registration in a second process, before they
are needed.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Final

import numpy as np

from anchorpose.body.belief import vague_belief
from anchorpose.body.config import RegistrationConfig, UncertaintyConfig, VisibilityConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence, gather_evidence
from anchorpose.body.explanation import explain
from anchorpose.body.learning import learn_body
from anchorpose.body.likelihood import render_skin
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration, register
from anchorpose.body.shape_prior import adult_belief, shape_of_height
from anchorpose.body.skin_points import PosedPoints, SkinPoints, body_points, build_body, pose_points
from anchorpose.body.uncertainty import joint_sigma, skin_sigma
from anchorpose.body.visibility import joint_states
from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.lens import Intrinsics
from anchorpose.motion.database import SHIPPED
from anchorpose.motion.prediction import MotionConfig, load_motions, predict_joints
from anchorpose.surface.surface import Nodes

RATE_HZ: Final = 15.0
WALL_M: Final = 4.0
CAMERA: Final = Camera(
    name="front",
    width=512,
    height=424,
    depth_scale=0.001,
    intrinsics=Intrinsics(fx=365.0, fy=365.0, cx=256.0, cy=212.0),
    T_world_camera=np.array([[0.0, 0.0, -1.0, 2.4], [0.0, -1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0, 0, 0, 1.0]]),
)


def start_warm_up() -> subprocess.Popen[bytes]:
    """Start the second process, which compiles the kernels. It ends by itself; its result is the cache of compiled
    kernels.

    If the second process fails, the first process compiles the kernels itself, which only takes longer.
    """
    run = f"from {__name__} import warm_up; warm_up()"
    return subprocess.Popen([sys.executable, "-c", run], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def warm_up() -> Registration:
    """Run the kernels to compile them: predict the pose of a body that stands still, and fit this body to its own skin
    as a simulated camera sees it.
    """
    points = body_points()
    body = build_body(points, shape_of_height(points.asset, 1.70))
    pose = Pose(np.tile(np.eye(3), (len(points.asset.bone_names), 1, 1)), np.zeros(3))
    posed = pose_points(body, pose)
    evidence = _own_skin(points, posed)
    found = register(body, vague_belief(pose), evidence, no_constraints(), RegistrationConfig())
    covariance = found.belief.covariance
    joint_sigma(body, posed, covariance, UncertaintyConfig())
    skin_sigma(body, posed, covariance, UncertaintyConfig())
    covering = explain(points, posed, evidence).covering
    joint_states(points, posed, covering, evidence.views, evidence.cameras, VisibilityConfig())
    motions = load_motions(SHIPPED, RATE_HZ, MotionConfig())
    still = np.repeat(body.joints(pose)[None], MotionConfig().history, axis=0)
    predict_joints(still, 3, motions, MotionConfig())
    learn_body(points, body.shape, [pose], [evidence], adult_belief(points.asset), RegistrationConfig())
    return found


def _own_skin(points: SkinPoints, posed: PosedPoints) -> Evidence:
    """Return the data of a simulated frame: the skin points that face the camera, as surface nodes, and the depth image
    of skin and wall.
    """
    facing = ((CAMERA.position_m - posed.points_m) * posed.normals).sum(axis=1) > 0.0
    seen = posed.points_m[facing]
    T_camera_world = np.linalg.inv(CAMERA.require_pose())
    in_camera = seen @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    pixel = np.rint(CAMERA.project(in_camera)).astype(np.int16)
    skin = render_skin(points, posed.points_m, CAMERA, 0.0)
    assert skin is not None
    depth = np.minimum(skin.depth_m, WALL_M).astype(np.float32)
    labels = np.where(depth < WALL_M, PixelLabel.PATIENT, PixelLabel.BACKGROUND).astype(np.uint8)
    nodes = Nodes(
        seen.astype(np.float32), posed.normals[facing].astype(np.float32), np.zeros(len(seen), np.uint8), pixel
    )
    return gather_evidence(nodes, (View(depth, labels),), (CAMERA,))
