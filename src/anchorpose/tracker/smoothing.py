"""Combine the forward and the backward pass limb by limb, and smooth the joints over time.

A limb that one pass loses behind a person is often tracked by the other pass. If both passes agree on a limb, the limb
is averaged over both. If the passes disagree, the limb is taken from the pass in which cameras see more of the limb at
its estimated place. Joints are then smoothed by a Kalman smoother (Rauch, Tung and Striebel 1965, doi:10.2514/3.3166).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.evidence import gather_evidence
from anchorpose.body.explanation import Explanation, explain
from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.pose import LIMB_OF_BONES, LIMB_OF_JOINTS, PARTS, TRUNK, Pose
from anchorpose.body.skin_points import Body, SkinPoints, pose_points
from anchorpose.isolation.scene import find_all_pieces
from anchorpose.isolation.separation import view_of
from anchorpose.isolation.view import View
from anchorpose.joints import JOINT_COUNT, LOST, STATE_CODE, JointState
from anchorpose.recording.recording import FrameSet
from anchorpose.results.records import LabelImage, decode_labels
from anchorpose.surface.patient_surface import blank_view, patient_surface
from anchorpose.surface.surface import seen_part
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.room import Room, Run

FIRST_SPEED_M_S: Final = 1.0  # m/s, standard deviation of a joint's velocity before any observation
# m, the width of a wrist; a limb is averaged over both passes if the two places of each joint of the limb are closer
# together than this
APART_M: Final = 0.06
# m, half a shoulder breadth; if the trunks of both passes are farther apart than this, all limbs are taken from the
# pass that gives the trunk
TRUNK_APART_M: Final = 0.15
# cost of taking a limb from a pass in a frame, for each joint of the limb that is hidden in this pass; a seen joint
# costs 0
HIDDEN_COST: Final = 0.5
LOST_COST: Final = 2.0  # cost of taking a limb from a pass in a frame, for each joint that is lost in this pass
# cost of switching from one pass to the other; less than the cost of a joint that is hidden in one frame
SWITCH_COST: Final = 0.2
# additional cost of switching, per metre that the limb jumps; a jump of 0.2 m costs as much as one lost joint
SWITCH_COST_PER_M: Final = 10.0
AT_ONCE: Final = 3  # number of joints smoothed together; all joints of an hour at once would fill the memory
# m/s per square root of a second, standard deviation of the change of a joint's velocity in 1 s. The value follows from
# a hand that starts to reach: it gains a velocity of 1 m/s in 0.25 s, and 1 / sqrt(0.25) = 2
ACCELERATION: Final = 2.0


def smooth_in_time(time_s: np.ndarray, joints_m: np.ndarray, sigma_m: np.ndarray, acceleration: float) -> np.ndarray:
    """Return the most likely positions over time (t, j, 3) of joints observed at joints_m (t, j, 3) with sigma_m (t,
    j). The velocity of a joint is modelled as a random walk: the standard deviation of its change grows with the square
    root of time, by ``acceleration`` m/s in one second.

    Every axis of every joint is smoothed separately. time_s (t,): strictly rising or falling.
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
    """Run the Kalman filter. Return four lists: for each frame, position and velocity (j, 2, 3), and their covariance
    (j, 2, 2); for each frame but the first, the same two values as predicted from the frame before.
    """
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
    """Return the covariance (2, 2) that position and velocity gain in a time step if ``acceleration`` is 1."""
    return np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])


_STATES: Final = tuple(JointState)
_JOINT_COST: Final = np.array(
    [{JointState.OBSERVED: 0.0, JointState.LOST: LOST_COST}.get(state, HIDDEN_COST) for state in _STATES]
)


@dataclass(frozen=True, slots=True, eq=False)
class PassResult:
    """The result of one pass, or of both passes combined, in one frame. A result takes a few kilobytes of memory."""

    pose: Pose | None  # None if the patient is lost
    joints_m: np.ndarray  # (21, 3) m, joints of the pose, not NaN for lost joints; NaN only if the patient is lost
    sigma_m: np.ndarray  # (21,) m, standard deviation of each joint's position; NaN for lost joints
    states: tuple[JointState, ...]


def pass_result(body: Body, estimate: Estimate, usable: bool) -> PassResult:
    """Return the part of an estimate that is kept until the other pass reaches the same frame; it has no pose if the
    frame is not ``usable``.
    """
    if estimate.belief is None or not usable:
        blank = np.full((JOINT_COUNT, 3), np.nan)
        return PassResult(None, blank, blank[:, 0].copy(), (JointState.LOST,) * JOINT_COUNT)
    pose = estimate.belief.pose
    return PassResult(pose, body.joints(pose), estimate.sigma_m, estimate.states)


@dataclass(frozen=True, slots=True, eq=False)
class PassCourse:
    """The joints of all frames of one pass, or of both passes combined, as arrays; poses and labels are left out."""

    joints_m: np.ndarray  # (t, 21, 3) m, places of the joints in each frame
    sigma_m: np.ndarray  # (t, 21) m, standard deviation of each joint's position; NaN for lost joints
    state_code: np.ndarray  # (t, 21) int8, code of each joint's state
    found: np.ndarray  # (t,) bool, whether the frame has a pose


def course_of(frames: Iterable[PassResult], count: int) -> PassCourse:
    """Collect the results of ``count`` frames of a pass in arrays; the frames are read one at a time."""
    joints, sigma = np.full((count, JOINT_COUNT, 3), np.nan), np.full((count, JOINT_COUNT), np.nan)
    code, found = np.full((count, JOINT_COUNT), LOST, np.int8), np.zeros(count, bool)
    for row, frame in enumerate(frames):
        joints[row], sigma[row], found[row] = frame.joints_m, frame.sigma_m, frame.pose is not None
        code[row] = [STATE_CODE[state] for state in frame.states]
    return PassCourse(joints, sigma, code, found)


@dataclass(frozen=True, slots=True, eq=False)
class Smoothing:
    """The result of combining both passes: their weights, and the combined frames."""

    # (t, PARTS) weight of the second pass for trunk and limbs, 0 to 1; the first pass has 1 minus this weight
    weight: np.ndarray
    course: PassCourse  # all frames with combined and smoothed joints, to which the body is fitted later


def smooth(time_s: np.ndarray, there: PassCourse, back: PassCourse, held: np.ndarray, lost_sigma_m: float) -> Smoothing:
    """Combine and smooth the frames (t,) of two passes. there: the frames of the first pass; back: the frames of the
    second pass, in the order of the first pass.

    held (t, 21) bool: joints that a reviewer placed, and all joints of the same limbs. These joints stay in place, and
    they hardly affect other frames, since ``lost_sigma_m`` is used as their sigma. Frames in which both passes lost the
    patient stay lost; joints are smoothed over each stretch between such frames.
    """
    weight = _weights_of_back(there, back, lost_sigma_m)
    mixed = _mixed(there, back, weight[:, LIMB_OF_JOINTS])
    return Smoothing(weight, replace(mixed, joints_m=_smoothed_stretches(time_s, mixed, held, lost_sigma_m)))


def smoothed_result(body: Body, there: PassResult, back: PassResult, smoothing: Smoothing, row: int) -> PassResult:
    """Pose the body to fit the smoothed joints of a frame, with the body's bone lengths and within the ranges of its
    joints.
    """
    weight, course = smoothing.weight[row], smoothing.course
    start, joints_m = _nearer_pose(there.pose, back.pose, body.points, weight), course.joints_m[row]
    pose = None if start is None else pose_from_joints(body, start, joints_m)
    return PassResult(
        pose=pose,
        joints_m=joints_m if pose is None else body.joints(pose),
        sigma_m=course.sigma_m[row],
        states=tuple(_STATES[code] for code in course.state_code[row].tolist()),
    )


def trunk_of_back(there: PassResult, back: PassResult, smoothing: Smoothing, row: int) -> bool:
    """Return whether the trunk of a frame is taken from the second pass: this pass has more weight, or the first pass
    lost the patient.
    """
    if there.pose is None or back.pose is None:
        return there.pose is None and back.pose is not None
    return bool(smoothing.weight[row, TRUNK] > 0.5)


def _smoothed_stretches(time_s: np.ndarray, mixed: PassCourse, held: np.ndarray, lost_sigma_m: float) -> np.ndarray:
    """Return the smoothed joints (t, 21, 3), NaN where the patient is lost."""
    joints = mixed.joints_m.copy()
    sigma = np.where(held, lost_sigma_m, _known_sigma(mixed, lost_sigma_m))
    followed = np.isfinite(joints).all(axis=(1, 2))
    edges = np.flatnonzero(np.diff(followed.astype(np.int64), prepend=0, append=0)).reshape(-1, 2)
    for start, stop in edges.tolist():
        own = slice(start, stop)
        for first in range(0, JOINT_COUNT, AT_ONCE):
            some = slice(first, first + AT_ONCE)
            joints[own, some] = smooth_in_time(time_s[own], joints[own, some], sigma[own, some], ACCELERATION)
    joints[held] = mixed.joints_m[held]
    return joints


def _weights_of_back(there: PassCourse, back: PassCourse, lost_sigma_m: float) -> np.ndarray:
    """Return (t, PARTS) the weight of the second pass for trunk and limbs. Where both passes agree, the passes are
    weighted by their inverse variances; elsewhere, the weight is 0 or 1.
    """
    apart_m = np.nan_to_num(np.linalg.norm(there.joints_m - back.joints_m, axis=2))
    costs = np.array([_JOINT_COST[way.state_code] for way in (there, back)])
    variance = np.array([_known_sigma(way, lost_sigma_m) ** 2 for way in (there, back)])
    weight = np.zeros((len(apart_m), PARTS))
    split = np.zeros(len(apart_m), dtype=bool)
    for part in range(PARTS):
        own = np.isin(LIMB_OF_JOINTS, part)
        distance, cost = apart_m[:, own].max(axis=1), costs[:, :, own].sum(axis=2)
        agree = distance < (APART_M if part else TRUNK_APART_M)
        chosen = cheapest_course(np.where(agree, 0.0, cost), distance)
        spread = variance[:, :, own].mean(axis=2)
        weight[:, part] = np.where(agree, spread[0] / spread.sum(axis=0), chosen)
        if part == 0:
            split = ~agree
        # if the passes disagree on the trunk, the limbs are taken from the pass that gives the trunk
        weight[split, part] = weight[split, 0]
    return weight


def _known_sigma(course: PassCourse, lost_sigma_m: float) -> np.ndarray:
    return np.where(np.isnan(course.sigma_m), lost_sigma_m, course.sigma_m)


def seen_less(answer: PassResult) -> float:
    """Return the sum of ``HIDDEN_COST`` or ``LOST_COST`` over all joints that no camera sees; 0 if cameras see all
    joints.
    """
    return float(_JOINT_COST[[STATE_CODE[state] for state in answer.states]].sum())


def cheapest_course(cost: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    """Choose the first or the second of two courses (for example, passes) in each frame, so that the total cost is
    least (Viterbi 1967). Return the number (t,) of the chosen course in each frame, 0 or 1. cost (2, t): cost of each
    course in each frame. The farther apart the courses are, the more a switch costs, since limbs do not jump.
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


def _mixed(there: PassCourse, back: PassCourse, weight: np.ndarray) -> PassCourse:
    """Mix joints, sigma and states of both passes. weight (t, 21): weight of the second pass in frames in which both
    passes found the patient.
    """
    share = np.where((there.found & back.found)[:, None], weight, back.found[:, None].astype(np.float64))
    code = np.where(share > 0.5, back.state_code, there.state_code)
    joints = there.joints_m + share[..., None] * (back.joints_m - there.joints_m)
    one = np.where(there.found[:, None, None], there.joints_m, back.joints_m)
    joints = np.where(np.isnan(joints), one, joints)
    sigma = np.where(code == LOST, np.nan, _mixed_sigma(there, back, share))
    return PassCourse(joints, sigma, code, there.found | back.found)


def _mixed_sigma(there: PassCourse, back: PassCourse, weight: np.ndarray) -> np.ndarray:
    """Return sigma (t, 21) of the joints that are mixed from both passes. Disagreement of the passes increases sigma.
    Agreement does not reduce sigma, since both passes used the same images.
    """
    a = np.where(np.isnan(there.sigma_m), back.sigma_m, there.sigma_m)
    b = np.where(np.isnan(back.sigma_m), there.sigma_m, back.sigma_m)
    apart2 = np.nan_to_num(((there.joints_m - back.joints_m) ** 2).sum(axis=2) / 3.0)
    return np.asarray(np.sqrt((1.0 - weight) * a**2 + weight * b**2 + weight * (1.0 - weight) * apart2))


def _nearer_pose(one: Pose | None, other: Pose | None, points: SkinPoints, weight: np.ndarray) -> Pose | None:
    """Return a pose in which each body part is taken from the pose with more weight for this part. If one pose is
    missing, return the other pose; None if both are missing. weight (PARTS,): weight of ``other``.
    """
    if one is None or other is None:
        return one or other
    rotations = one.rotations.copy()
    taken = points.moving[weight[LIMB_OF_BONES] > 0.5]
    rotations[taken] = other.rotations[taken]
    return Pose(rotations, other.root_m if weight[0] > 0.5 else one.root_m)


def explain_smoothed(
    frame_set: FrameSet, answer: PassResult, labels: tuple[LabelImage, ...], body: Body, run: Run
) -> Explanation | None:
    """Compute how well the combined pose fits a frame; None without a pose.

    frame_set: the frame, read again, since all frames' depth images would fill the memory.
    """
    if answer.pose is None:
        return None
    cameras = run.room.cameras
    views = labelled_views(frame_set, labels, run.room)
    shown = [blank_view(camera) if view is None else view for view, camera in zip(views, cameras, strict=True)]
    surface = seen_part(patient_surface(shown, cameras, None, run.config.surface))
    return explain(body.points, pose_points(body, answer.pose), gather_evidence(surface, views, cameras))


def labelled_views(frame_set: FrameSet, images: tuple[LabelImage, ...], room: Room) -> tuple[View | None, ...]:
    """Decode one view per camera from ``images``; None for a camera without a depth image."""
    labels = {image.camera: decode_labels(image) for image in images}
    return tuple(
        None
        if pixels is None or camera.name not in labels
        else view_of(pixels, labels[camera.name][pixels.row, pixels.column])
        for camera, pixels in zip(room.cameras, find_all_pieces(frame_set, room.scenes), strict=True)
    )
