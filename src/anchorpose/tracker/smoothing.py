"""The forward and the backward pass combined, limb by limb, then smoothed over time.

A limb that is lost behind a person in one direction is often kept in the other. Where the two passes agree they are
averaged; where they do not, the limb is taken from the pass that sees more of it at its place. Joints are then smoothed
by a Kalman smoother (Rauch, Tung and Striebel 1965, doi:10.2514/3.3166).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.pose import LIMB_OF_BONES, LIMB_OF_JOINTS, PARTS, Pose
from anchorpose.body.skin_points import Body, SkinPoints
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState
from anchorpose.results.people_labels import LabelImage
from anchorpose.tracker.estimate import Estimate

SPINE_BASE: Final = JOINT_INDEX["SpineBase"]  # of the trunk, and not of a limb
FIRST_SPEED_M_S: Final = 1.0  # standard deviation of a joint's velocity before anything is known of it
APART_M: Final = 0.06  # a limb's joints nearer than this are averaged: the width of a wrist, so it is the same limb
TRUNK_APART_M: Final = 0.15  # half a shoulder breadth: beyond it the trunk is in two places, and limbs cannot be mixed
HIDDEN_COST: Final = 0.5  # of a joint that is not seen, per frame; of one that is seen: 0
LOST_COST: Final = 2.0  # of a joint where the cameras see past it: it is not there
SWITCH_COST: Final = 0.2  # of changing from one pass to the other: less than a hidden joint in one frame
SWITCH_COST_PER_M: Final = 10.0  # a jump of 0.2 m has to save one lost joint
ACCELERATION: Final = 2.0  # m/s per square root of a second: 1 m/s in the quarter of a second that a reach starts in


def smooth_in_time(time_s: np.ndarray, joints_m: np.ndarray, sigma_m: np.ndarray, acceleration: float) -> np.ndarray:
    """The most likely course (t, j, 3) of joints seen at joints_m (t, j, 3), (t, j) sigma_m off, whose velocity is a
    random walk: it changes by ``acceleration`` times the square root of the time, m/s.

    Every axis of every joint by itself. time_s (t,): strictly rising or falling.
    """
    steps_s = np.abs(np.diff(time_s))
    mean, spread, ahead_mean, ahead_spread = _forwards(steps_s, joints_m, sigma_m, acceleration)
    smooth = mean[-1]
    course = [smooth[:, 0]]
    for k in range(len(steps_s) - 1, -1, -1):
        gain = np.linalg.solve(ahead_spread[k], _motion(steps_s[k]) @ spread[k]).transpose(0, 2, 1)
        smooth = mean[k] + gain @ (smooth - ahead_mean[k])
        course.append(smooth[:, 0])
    return np.array(course[::-1])


def _forwards(
    steps_s: np.ndarray, joints_m: np.ndarray, sigma_m: np.ndarray, acceleration: float
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Kalman's filter: position and velocity (j, 2, 3) and their covariance (j, 2, 2) of each frame, and as predicted
    from the frame before, of each but the first."""
    count = joints_m.shape[1]
    mean = np.stack([joints_m[0], np.zeros((count, 3))], axis=1)
    spread = np.zeros((count, 2, 2))
    spread[:, 0, 0], spread[:, 1, 1] = sigma_m[0] ** 2, FIRST_SPEED_M_S**2
    means, spreads, ahead_means, ahead_spreads = [mean], [spread], [], []
    for k, step_s in enumerate(steps_s.tolist(), 1):
        motion = _motion(step_s)
        mean, spread = motion @ mean, motion @ spread @ motion.T + acceleration**2 * _random_walk(step_s)
        ahead_means.append(mean)
        ahead_spreads.append(spread)
        gain = spread[:, :, 0] / (spread[:, 0, 0] + sigma_m[k] ** 2)[:, None]
        mean = mean + gain[:, :, None] * (joints_m[k] - mean[:, 0])[:, None, :]
        spread = spread - gain[:, :, None] * spread[:, None, 0]
        means.append(mean)
        spreads.append(spread)
    return means, spreads, ahead_means, ahead_spreads


def _motion(step_s: float) -> np.ndarray:
    return np.array([[1.0, step_s], [0.0, 1.0]])


def _random_walk(step_s: float) -> np.ndarray:
    """(2, 2) covariance that position and velocity gain in a step, for an acceleration of one."""
    return np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])


@dataclass(frozen=True, slots=True, eq=False)
class PassResult:
    """What one pass, or both together, answer for a frame, and the person labels that it was seen by: some kilobytes.

    pose: None where the patient is lost; joints_m (21, 3) by that pose, also of lost joints; sigma_m (21,), NaN where
    lost; labels: of each camera with a depth image, none where the patient is lost.
    """

    pose: Pose | None
    joints_m: np.ndarray
    sigma_m: np.ndarray
    states: tuple[JointState, ...]
    labels: tuple[LabelImage, ...] = ()


def pass_result(body: Body, estimate: Estimate, labels: tuple[LabelImage, ...], usable: bool) -> PassResult:
    """What is kept of an estimate until the other pass has come to the same frame; nothing of one of no use."""
    if estimate.belief is None or not usable:
        blank = np.full((JOINT_COUNT, 3), np.nan)
        return PassResult(None, blank, blank[:, 0].copy(), (JointState.LOST,) * JOINT_COUNT)
    pose = estimate.belief.pose
    return PassResult(pose, body.joints(pose), estimate.sigma_m, estimate.states, labels)


def smooth(
    body: Body,
    time_s: np.ndarray,
    there: Sequence[PassResult],
    back: Sequence[PassResult],
    held: np.ndarray,
    lost_sigma_m: float,
) -> list[PassResult]:
    """The frames (t,) of two passes, both in the order of the first, as one.

    held (t, 21) bool: joints whose place a reviewer gave, and their limbs: they stay, and move no other frame.
    Joints are put together, smoothed over each stretch without a gap, and the body is posed to meet them: bones keep
    their lengths, joints their ranges, and frames in which both passes lost the patient stay lost.
    """
    weight = _weights_of_back(there, back, lost_sigma_m)
    mixed = [_mixed(*frame) for frame in zip(there, back, weight[:, LIMB_OF_JOINTS], strict=True)]
    joints = _smoothed_stretches(time_s, mixed, held, lost_sigma_m)
    answers = []
    for one, other, answer, wanted, share in zip(there, back, mixed, joints, weight, strict=True):
        start = _nearer_pose(one.pose, other.pose, body.points, share)
        pose = None if start is None else pose_from_joints(body, start, wanted)
        answers.append(replace(answer, pose=pose, joints_m=wanted if pose is None else body.joints(pose)))
    return answers


def _smoothed_stretches(
    time_s: np.ndarray, frames: Sequence[PassResult], held: np.ndarray, lost_sigma_m: float
) -> np.ndarray:
    """(t, 21, 3) joints, NaN where the patient is lost."""
    before = np.array([frame.joints_m for frame in frames])
    joints = before.copy()
    sigma = np.where(held, lost_sigma_m, [_known_sigma(frame, lost_sigma_m) for frame in frames])
    followed = np.isfinite(joints).all(axis=(1, 2))
    edges = np.flatnonzero(np.diff(followed.astype(np.int64), prepend=0, append=0)).reshape(-1, 2)
    for start, stop in edges.tolist():
        own = slice(start, stop)
        joints[own] = smooth_in_time(time_s[own], joints[own], sigma[own], ACCELERATION)
    return np.where(held[..., None], before, joints)


def _weights_of_back(there: Sequence[PassResult], back: Sequence[PassResult], lost_sigma_m: float) -> np.ndarray:
    """(t, PARTS) share of the second pass in trunk and limbs: by information where the two agree, else 0 or 1."""
    apart_m = np.linalg.norm([f.joints_m - s.joints_m for f, s in zip(there, back, strict=True)], axis=2)
    apart_m = np.nan_to_num(apart_m).reshape(-1, JOINT_COUNT)
    costs = np.array([[_joint_costs(frame.states) for frame in way] for way in (there, back)])
    variance = np.array([[_known_sigma(frame, lost_sigma_m) ** 2 for frame in way] for way in (there, back)])
    weight = np.zeros((len(there), PARTS))
    split = np.zeros(len(there), dtype=bool)
    for part in range(PARTS):
        own = np.isin(LIMB_OF_JOINTS, part)
        distance, cost = apart_m[:, own].max(axis=1), costs[:, :, own].sum(axis=2)
        agree = distance < (APART_M if part else TRUNK_APART_M)
        chosen = _course(np.where(agree, 0.0, cost), distance)
        spread = variance[:, :, own].mean(axis=2)
        weight[:, part] = np.where(agree, spread[0] / spread.sum(axis=0), chosen)
        if part == 0:
            split = ~agree
        weight[split, part] = weight[split, 0]  # limbs hang on the trunk: where that is in two places, they go with it
    return weight


def _joint_costs(states: Sequence[JointState]) -> list[float]:
    known = {JointState.OBSERVED: 0.0, JointState.LOST: LOST_COST}
    return [known.get(state, HIDDEN_COST) for state in states]


def _known_sigma(frame: PassResult, lost_sigma_m: float) -> np.ndarray:
    return np.where(np.isnan(frame.sigma_m), lost_sigma_m, frame.sigma_m)


def _course(cost: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    """(t,) which of two ways, (2, t) cost, is the cheapest course through all frames (Viterbi 1967).

    Changing over costs more the farther the two are apart: limbs do not jump.
    """
    change = SWITCH_COST + SWITCH_COST_PER_M * distance_m
    total, came_from = cost[:, 0].copy(), np.zeros((len(distance_m), 2), dtype=np.int64)
    for frame in range(1, len(distance_m)):
        other = total[::-1] + change[frame]
        came_from[frame] = np.where(other < total, [1, 0], [0, 1])
        total = np.minimum(total, other) + cost[:, frame]
    way = int(total.argmin())
    course = np.zeros(len(distance_m), dtype=np.int64)
    for frame in range(len(distance_m) - 1, -1, -1):
        course[frame] = way
        way = int(came_from[frame, way])
    return course


def _mixed(there: PassResult, back: PassResult, weight: np.ndarray) -> PassResult:
    """Joints, sigma and states of both; weight (21,): share of the second pass.

    The pose is the first pass', the labels those of the pass that the trunk is taken from.
    """
    if there.pose is None or back.pose is None:
        return there if back.pose is None else back
    states = tuple(b if w > 0.5 else a for a, b, w in zip(there.states, back.states, weight, strict=True))
    lost = np.array([state is JointState.LOST for state in states])
    joints = there.joints_m + weight[:, None] * (back.joints_m - there.joints_m)
    sigma = np.where(lost, np.nan, _mixed_sigma(there, back, weight))
    labels = (back if weight[SPINE_BASE] > 0.5 else there).labels
    return PassResult(there.pose, joints, sigma, states, labels)


def _mixed_sigma(there: PassResult, back: PassResult, weight: np.ndarray) -> np.ndarray:
    """(21,) of the mixture of both answers. Both saw the same images: agreement does not reduce sigma, disagreement
    increases it."""
    a = np.where(np.isnan(there.sigma_m), back.sigma_m, there.sigma_m)
    b = np.where(np.isnan(back.sigma_m), there.sigma_m, back.sigma_m)
    apart2 = ((there.joints_m - back.joints_m) ** 2).sum(axis=1) / 3.0
    return np.asarray(np.sqrt((1.0 - weight) * a**2 + weight * b**2 + weight * (1.0 - weight) * apart2))


def _nearer_pose(one: Pose | None, other: Pose | None, points: SkinPoints, weight: np.ndarray) -> Pose | None:
    """Each part's bones from the pose that has more weight there; None where both are lost."""
    if one is None or other is None:
        return one or other
    rotations = one.rotations.copy()
    taken = points.moving[weight[LIMB_OF_BONES] > 0.5]
    rotations[taken] = other.rotations[taken]
    return Pose(rotations, other.root_m if weight[0] > 0.5 else one.root_m)
