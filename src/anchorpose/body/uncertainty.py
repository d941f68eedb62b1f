"""Compute the sigma (standard deviation) of the joints' places from the pose's covariance, the cameras' noise and the
ambiguity of the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.special import expit

from anchorpose.body.asset import joint_bones
from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig, UncertaintyConfig
from anchorpose.body.constraints import Constraints, rows_of_nodes, surface_constraints
from anchorpose.body.evidence import Evidence, node_noise
from anchorpose.body.explanation import Explanation, limb_of_points, node_area_m2, segment_of_points
from anchorpose.body.fit import hidden_bones, limited, pose_equations, prior_equations
from anchorpose.body.likelihood import likelihood, most_nats
from anchorpose.body.limb_proposals import CHAINS, uncovered_paths
from anchorpose.body.pose import LIMB_OF_JOINTS, POSE_SIZE, SEGMENT_OF_JOINTS, TRUNK, Pose
from anchorpose.body.pose_accumulation import accumulate_pose
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.shape_rows import FreeShape
from anchorpose.body.skin_points import (
    Body,
    PosedPoints,
    joint_jacobian,
    joints_by_shape,
    place_variance,
    pose_jacobian,
    pose_points,
)
from anchorpose.body.standing_off import standing_off_sigma_m
from anchorpose.body.visibility import distance_of
from anchorpose.joints import JOINT_INDEX, JointState

# maximum number of nodes (points of the seen surface) used for sigma; the 2,500 nodes of the fit would double the
# computing time and change sigma by under a tenth
NODES: Final = 1200
# maximum number of nodes (points of the seen surface) used for ``frame_errors``; with 1,200 nodes, the sigmas differ by
# up to a tenth
FRAME_NODES: Final = 600


def noise_covariance(body: Body, belief: PoseBelief, evidence: Evidence, config: RegistrationConfig) -> np.ndarray:
    """Return the covariance (POSE_SIZE, POSE_SIZE) of the pose from the noise of this frame's readings alone.

    A change n of the readings changes the pose by ``C J^T W n``, where C is the belief's covariance, J the rows'
    Jacobian, and W the diagonal matrix of the fit's weights. So noise with the covariance N gives the pose the
    covariance ``C J^T W N W J C``. In N, nodes of one patch of pixels share one error (``node_noise``); nodes of
    different patches have independent errors.
    """
    posed = pose_points(body, belief.pose)
    few = replace(config, node_count=min(config.node_count, NODES))
    rows, node = rows_of_nodes(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], few)
    if not len(rows):
        return np.zeros_like(belief.covariance)
    used, count = min(few.node_count, len(evidence.surface)), min(config.node_count, len(evidence.surface))
    noise_m, patch = node_noise(evidence, used / len(evidence.surface))
    weight = count / used * rows.weights(rows.residuals(posed)) / config.rows_per_observation
    felt = _felt(body, posed, rows.point, rows.direction, weight * noise_m[node], patch[node] - len(evidence.surface))
    return np.asarray(belief.covariance @ felt @ belief.covariance)


def _felt(
    body: Body, posed: PosedPoints, point: np.ndarray, direction: np.ndarray, strength: np.ndarray, patch: np.ndarray
) -> np.ndarray:
    """Return ``J^T S N S J`` (POSE_SIZE, POSE_SIZE): the covariance that the noise of the readings gives to the
    gradient of the fit. J is the rows' Jacobian, S the diagonal matrix of ``strength`` (each row's weight times the
    sigma of its noise). The entry of N for two rows is 1 if both rows belong to the same patch, else 0. Rows with a
    negative patch number share their error with no other row.
    """
    alone, shared = patch < 0, patch >= 0
    none = np.zeros(int(alone.sum()))
    felt, _ = accumulate_pose(body, posed, point[alone], direction[alone], none, strength[alone] ** 2)
    if not shared.any():
        return felt
    rows = pose_jacobian(body, posed, point[shared], direction[shared]) * strength[shared, None]
    number = np.unique(patch[shared], return_inverse=True)[1]
    together = csr_array((np.ones(len(rows)), (number, np.arange(len(rows))))) @ rows
    return np.asarray(felt + together.T @ together)


def finest_patch_m(evidence: Evidence) -> float:
    """Return the side, in metres at the patient, of a patch of pixels that share one error. If several cameras with
    known noise show the patient, the side of the smallest patch of all these cameras is returned. The result is 0 if no
    camera with known noise shows the patient.

    Sensors match windows of pixels or smooth their images, which displaces the edges of a limb by a fraction of the
    patch's side.
    """
    found = [
        np.sqrt(noise.shared_px) * distance_m / camera.intrinsics.fx
        for view, camera, noise in zip(evidence.views, evidence.cameras, evidence.noises, strict=False)
        if view is not None and noise is not None and (distance_m := distance_of(view)) is not None
    ]
    return float(min(found, default=0.0))


# m2; limbs become less certain if the body leaves at least this area of seen skin uncovered; clothes and gripping hands
# alone leave about as much uncovered
WORTH_M2: Final = 0.004
# m, the length of a shank, or of a forearm with its hand. A joint may lie at the tip of an uncovered piece of skin only
# if the tip is nearer than this to the joint's estimated place
IN_REACH_M: Final = 0.45
BROADER_M: Final = 0.13  # m, breadth of a chest (0.35 m) minus its depth (0.22 m)

# m, root mean square error of a learnt body's joints per axis that is the same in every frame, beyond the error that
# follows from the uncertain shape. With this value, at least 93 % of the errors of most joints lie within 1.96 sigma on
# the hard scenes for tuning (suite ``hard`` of ``benchmarks/run.py``)
CONSTANT_ERROR_M: Final = 0.003


class FrameErrors(NamedTuple):
    """The variance of the joints' places that follows from one frame."""

    # (21,) m2, variance that follows from the rows of this frame alone, along the direction in which the variance is
    # largest
    pose: np.ndarray
    # (21,) m2, variance per axis that follows from the uncertainty of the body's shape; 0 if this uncertainty is
    # unknown
    shape: np.ndarray


def joint_sigma(
    body: Body,
    posed: PosedPoints,
    covariance: np.ndarray,
    config: UncertaintyConfig,
    noise: np.ndarray | None = None,
    patch_m: float = 0.0,
    frame: FrameErrors | None = None,
) -> np.ndarray:
    """Return the standard deviation (21,) of the joints' position errors per axis, metres.

    covariance (POSE_SIZE, POSE_SIZE): covariance of the pose, the inverse of the normal equations' hessian. noise:
    array of the same shape from ``noise_covariance``; None if the cameras' noise is unknown. patch_m: from
    ``finest_patch_m``; a limb is placed midway between its two edges in the image, and each edge has a uniform error
    within such a patch. frame: from ``frame_errors``; None: these errors are left out.

    The argument ``covariance`` was computed as if the errors of all frames were independent. But clothes, person labels
    and hidden limbs cause the same error in many frames. For example, a few wrongly labelled pixels may pull a forearm
    in every frame. So if a joint's variance that follows from ``covariance`` is smaller than the variance that follows
    from this frame alone, the larger variance is used.
    """
    places, bones = body.mesh.joints(posed.transforms), joint_bones(body.points.asset)
    variance = config.inflation**2 * _variance(body, posed, covariance, bones, places)
    if frame is not None:
        variance = np.maximum(variance, frame.pose) + frame.shape
    if noise is not None:
        variance = variance + _variance(body, posed, noise, bones, places)
    unlike_m = standing_off_sigma_m(body.points, body.shape)
    return np.sqrt(config.floor_m**2 + CONSTANT_ERROR_M**2 + unlike_m**2 + patch_m**2 / 24.0 + variance)


def skin_sigma(body: Body, posed: PosedPoints, covariance: np.ndarray, config: UncertaintyConfig) -> np.ndarray:
    """Return the sigma (p,) of each skin point, which is the sigma of the middle of the body part to which the point
    belongs.
    """
    count = np.bincount(body.points.part)
    parts = np.flatnonzero(count)
    middles = np.stack([np.bincount(body.points.part, posed.points_m[:, axis]) for axis in range(3)], axis=1)
    variance = np.zeros(len(count))
    variance[parts] = _variance(body, posed, covariance, parts, middles[parts] / count[parts, None])
    return np.sqrt(config.floor_m**2 + config.inflation**2 * variance[body.points.part])


def _variance(
    body: Body, posed: PosedPoints, covariance: np.ndarray, bones: np.ndarray, places_m: np.ndarray
) -> np.ndarray:
    """Return the variance (n,), m2, mean over the three axes, of places_m (n, 3); each place is fixed to a bone of
    bones (n,).
    """
    jacobian = joint_jacobian(body, posed.transforms, bones, places_m)
    return place_variance(jacobian, covariance)


def smeared_sigma(
    body: Body,
    pose: Pose,
    evidence: Evidence,
    edge_m: float,
    sigma_m: np.ndarray,
    registration: RegistrationConfig,
    config: UncertaintyConfig,
) -> np.ndarray:
    """Return sigma_m (21,), increased if filters blur depth edges over a width of edge_m at the patient.

    If edges are blurred, a node (point of the seen surface) gives the skin's place only to within the width of a
    blurred edge. So all nodes in a square of this width count as one observation. The filters blur every frame in the
    same way, so earlier frames add no knowledge. The direction that the trunk faces is recognised by the difference
    between the trunk's breadth and depth, and both breadth and depth have an error of edge_m. So joints off the trunk's
    axis have an additional error that is proportional to their distance from the axis.
    """
    posed = pose_points(body, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, registration.reaches_m[-1], registration)
    count = np.bincount(evidence.surface.camera, minlength=len(evidence.cameras))
    area_m2 = float(count @ node_area_m2(evidence))
    if not len(rows) or area_m2 <= 0.0:
        return sigma_m
    wide = replace(rows, sigma_m=np.hypot(rows.sigma_m, edge_m))
    alike = max(registration.rows_per_observation, len(rows) * edge_m**2 / area_m2)
    joints = body.mesh.joints(posed.transforms)
    spread = _by_frame(body, pose, wide, vague_belief(pose).information, alike).spread
    variance = np.trace(spread, axis1=1, axis2=2) / 3.0
    off_axis_m = np.linalg.norm((joints - joints[JOINT_INDEX["SpineMid"]])[:, [0, 2]], axis=1)
    # the error due to the trunk's uncertain facing moves a joint along a single axis, so its mean square over the three
    # axes is a third of its square
    turned = (edge_m / BROADER_M * off_axis_m) ** 2 / 3.0
    return np.maximum(sigma_m, np.sqrt(config.floor_m**2 + CONSTANT_ERROR_M**2 + variance + turned))


def frame_errors(
    body: Body,
    pose: Pose,
    evidence: Evidence,
    config: RegistrationConfig,
    *,
    unseen_s: np.ndarray | None = None,
    shape: ShapeBelief | None = None,
) -> FrameErrors:
    """Return the errors of the joints that follow from the constraint rows of one frame and from the ranges of the
    joints.

    unseen_s: as in ``vague_belief``, which gives the uncertainty of hidden parts; None if this frame shows all parts. A
    body with another shape would have been registered in another pose. The errors include this effect, since pose and
    shape are parameters of the same normal equations. Where skin is seen, the joints of bodies with different shapes
    lie at almost the same places after registration, even if the lengths of their bones differ.
    """
    posed, fewer_nodes = pose_points(body, pose), replace(config, node_count=min(config.node_count, FRAME_NODES))
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], fewer_nodes)
    used = min(config.node_count, max(len(evidence.surface), 1))
    alike = config.rows_per_observation * min(fewer_nodes.node_count / used, 1.0)
    if unseen_s is not None:  # nodes near a hidden part of a limb do not show this part
        rows = rows.where(~(unseen_s > 0.0).ravel()[segment_of_points(body.points)[rows.point]])
    free = None if shape is None else shape.free
    found = _by_frame(body, pose, rows, vague_belief(pose, unseen_s).information, alike, free)
    # the largest variance along any direction: a hidden knee errs forward, an arm that points at a camera errs in depth
    worst = np.linalg.eigvalsh(found.spread)[:, -1]
    if shape is None:
        return FrameErrors(worst, np.zeros(len(worst)))
    by_shape = found.by_shape.copy()
    by_shape[..., : shape.free.coefficients] += joints_by_shape(body, posed, shape.free.coefficients)
    return FrameErrors(worst, place_variance(by_shape, shape.covariance))


class _FromFrame(NamedTuple):
    """The joints' errors that follow from one frame."""

    spread: np.ndarray  # (21, 3, 3) m2, mean of the outer products of the joints' errors
    # (21, 3, s) derivative of the joints' places by the shape, as far as the registered pose changes with the shape;
    # the change that the shape causes in an unchanged pose is not included
    by_shape: np.ndarray


def _by_frame(
    body: Body, pose: Pose, rows: Constraints, known: np.ndarray, alike: float, free: FreeShape | None = None
) -> _FromFrame:
    """Return the joints' errors that follow from one frame's rows, the joint ranges and the knowledge of the pose from
    earlier frames (``known``).

    Rows, joint ranges and ``known`` may pull a joint away from its place in the pose; this distance is part of the
    error. known (POSE_SIZE, POSE_SIZE): inverse covariance of the pose given earlier frames; alike: rows per
    observation; free: the free parameters of the shape.
    """
    posed = pose_points(body, pose)
    prior = prior_equations(body.points, pose, (pose, known), hidden_bones(body.points, rows, alike))
    equations = pose_equations(body, pose, posed, rows, prior, alike, free)
    covariance, joints = np.linalg.inv(equations.hessian[:POSE_SIZE, :POSE_SIZE]), body.mesh.joints(posed.transforms)
    jacobian = joint_jacobian(body, posed.transforms, joint_bones(body.points.asset), joints)
    pulled = pose.moved(limited(-covariance @ equations.gradient[:POSE_SIZE]), body.points.moving)
    away = body.joints(pulled) - joints
    spread = jacobian @ covariance @ jacobian.transpose(0, 2, 1) + away[:, :, None] * away[:, None, :]
    return _FromFrame(spread, -jacobian @ covariance @ equations.hessian[:POSE_SIZE, POSE_SIZE:])


def unexplained_sigma(
    body: Body, pose: Pose, evidence: Evidence, explanation: Explanation, sigma_m: np.ndarray
) -> np.ndarray:
    """Return sigma_m (21,), increased because limbs may lie on seen skin that the body does not cover.

    Each uncovered piece of surface is assigned to the limb whose skin is nearest to the piece's root, where the piece
    meets the covered skin. The limb's end may lie at the piece's tip instead of its present place. The log odds for
    this place are the log likelihood that the limb would gain on the piece, minus the log likelihood that the limb
    would lose at its present place. An elbow or knee may lie at the piece's tip, too; then the log likelihood of the
    whole limb would be lost.
    """
    posed = pose_points(body, pose)
    joints, variance = body.mesh.joints(posed.transforms), sigma_m**2
    if explanation.uncovered_m2 < WORTH_M2:
        return sigma_m.copy()
    log = likelihood(body, pose, evidence).log
    lost = np.where(SEGMENT_OF_JOINTS % 2, log.ravel()[SEGMENT_OF_JOINTS], log.sum(axis=1)[LIMB_OF_JOINTS])
    for path in uncovered_paths(evidence, explanation):
        nearest = int(np.argmin(((posed.points_m - path.places_m[-1]) ** 2).sum(axis=1)))
        limb = limb_of_points(body.points)[nearest]
        off_m = np.linalg.norm(joints - path.places_m[0], axis=1)
        mine = (limb_ends() == limb) & (limb != TRUNK) & (off_m < IN_REACH_M)
        share = expit(most_nats(path.area_m2) - lost[mine])
        variance[mine] += share * off_m[mine] ** 2 / 3.0
    return np.asarray(np.sqrt(variance))


def lost_ends(states: Sequence[JointState], before: frozenset[int] = frozenset()) -> frozenset[int]:
    """Return the lost hands and feet (joint indices). A hand or foot is lost if a camera sees past its place in this
    frame, that is, sees something farther away there. A hand or foot is also lost if a camera saw past its place in an
    earlier frame and no camera has seen the hand or foot since then. before: the lost hands and feet of the frame
    before.
    """
    return frozenset(
        end
        for end in (JOINT_INDEX[chain.joints[0]] for chain in CHAINS)
        if states[end] is JointState.LOST or (end in before and states[end] is not JointState.OBSERVED)
    )


def before_lost_ends(
    joints_m: np.ndarray, states: Sequence[JointState], sigma_m: np.ndarray, lost: frozenset[int]
) -> tuple[tuple[JointState, ...], np.ndarray]:
    """Return the states and sigma_m (21,) of joints_m (21, 3) after this change: if a hand or foot is lost (``lost``,
    from ``lost_ends``), its wrist or ankle does not count as observed, and the sigmas of both joints are larger.

    If cameras see past the place of a hand, the forearm of this hand may have been fitted to another person's arm. So
    the wrist of a lost hand does not count as observed, and half of the wrist's distance from the elbow is assumed as
    an additional error. The lost hand gets this error, too, since the hand's place follows from the wrist's place. The
    same holds for ankle and foot.
    """
    told, sigma = list(states), sigma_m.copy()
    for chain in CHAINS:
        end, before, middle = (JOINT_INDEX[name] for name in chain.joints)
        if end in lost:
            told[before] = JointState.HIDDEN if told[before] is JointState.OBSERVED else told[before]
            away_m = np.linalg.norm(joints_m[before] - joints_m[middle]) / 2.0
            sigma[[before, end]] = np.hypot(sigma[[before, end]], away_m)
    return tuple(told), sigma


@cache
def limb_ends() -> np.ndarray:
    """Return (21,): for each joint beyond shoulder or hip, the number of its limb; for all other joints, ``TRUNK``."""
    limb = LIMB_OF_JOINTS.copy()
    limb[[JOINT_INDEX[f"Shoulder{side}"] for side in ("Left", "Right")]] = TRUNK
    return limb
