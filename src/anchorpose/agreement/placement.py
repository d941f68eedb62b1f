"""Find the pose of another system's frame of reference in the world of the results, and the constant offsets between
both systems' joints.

Even without errors, the joints of two systems differ by their definitions: for example, one system places the knee's
centre midway between two markers, the other computes it from the body's surface. An offset due to definitions is
constant in the axes of the body segment (of the thigh, for a knee), so it can be separated from errors, which are not
constant. An offset that all joints share looks like a shift of the other system's frame, unless the person turns. Such
an offset is therefore attributed to the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import transform_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.angle_definition import Axes, pelvis_axes, trunk_axes
from anchorpose.rotations import fit_rigid_transform, rigid, rotation_matrices, rotation_vectors, unit

ROUNDS: Final = 15  # maximum number of Gauss-Newton steps
LEAST_FRAMES: Final = 10
"""Minimum number of frames in which both systems have a joint; a joint with fewer frames is not used."""

FARTHEST: Final = 4.0
"""Limit of the distance that the fit leaves between both systems' positions of a joint, as a multiple of the median of
these distances. In frames beyond the limit, the joint gets less weight, since one of the systems has probably lost it.
"""

TURN_PRIOR_FRAMES: Final = 15.0
SHIFT_PRIOR_FRAMES: Final = 300.0
"""Weights, in frames, of the prior that offsets are zero. A weight of 300 counts as much as 300 used frames (see
``MOST_FRAMES``). The frame's rotation comes from a fit with ``TURN_PRIOR_FRAMES``, which suits offsets of some
millimetres. The frame's position comes from a fit with ``SHIFT_PRIOR_FRAMES``: when the posture changes, markers slide
with the skin, which looks like a shift of the frame. In 26 simulated laboratories (suite ``laboratory`` of
``benchmarks/run.py``), a single weight for both fits gave root-mean-square errors of the frame of 0.15 degrees and 2
mm, or of 0.2 degrees and 1 mm; two weights give 0.15 degrees and 1 mm.
"""

ERROR_M: Final = 0.005
"""Length in m that is added to a joint's sigma in quadrature. This length allows for errors of the reference, and for
stated sigmas that are too small.
"""

MOST_FRAMES: Final = 1000
"""Number of frames to which a long recording is thinned (to at most twice as many), since neighbouring frames are
nearly equal.
"""

_LIMBS: Final = {
    "Knee": ("Hip", "Knee", "pelvis"),
    "Ankle": ("Knee", "Ankle", "pelvis"),
    "Foot": ("Ankle", "Foot", "pelvis"),
    "Elbow": ("Shoulder", "Elbow", "trunk"),
    "Wrist": ("Elbow", "Wrist", "trunk"),
    "Hand": ("Elbow", "Wrist", "trunk"),
}
"""By joint: the joints at the upper and the lower end of the limb in whose axes the joint's offset is constant, and the
part of the body (pelvis or trunk) from whose axes the limb's axes are derived.
"""

_ON_PELVIS: Final = ("SpineBase", "HipLeft", "HipRight")


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """The pose T_world_reference (4, 4) of the reference's frame, and offset_m (21, 3): the constant difference between
    the joints of the results and of the reference (results minus reference), in the axes of each joint's segment.

    The axes are x forward, y up, z to the right when the person stands with limbs hanging. offset_m is NaN for joints
    that one of the systems lacks. translation_sigma_m, rotation_sigma_deg: standard deviations of the frame's position
    and rotation, from their changes when each joint is left out in turn; NaN where the frame was given.
    """

    T_world_reference: np.ndarray
    offset_m: np.ndarray
    translation_sigma_m: float
    rotation_sigma_deg: float


def segment_axes(position_m: np.ndarray) -> np.ndarray:
    """Return the axes (n, 21, 3, 3) of each joint's segment, as columns x, y, z; position_m (n, 21, 3), NaN where
    unknown.

    A limb's axes are the axes of pelvis or trunk after the smallest rotation that aligns -y (for the foot, x) with the
    limb.
    """
    points = {name: position_m[:, index].T for name, index in JOINT_INDEX.items()}
    base = {"pelvis": _columns(pelvis_axes(points)), "trunk": _columns(trunk_axes(points))}
    axes = np.repeat(base["trunk"][:, None], JOINT_COUNT, axis=1)
    for name in _ON_PELVIS:
        axes[:, JOINT_INDEX[name]] = base["pelvis"]
    for joint, (upper, lower, root) in _LIMBS.items():
        for side in ("Left", "Right"):
            along = unit((points[f"{lower}{side}"] - points[f"{upper}{side}"]).T)
            hanging = -base[root][:, :, 1]
            if joint == "Foot":  # the foot points forward when the leg hangs, so x is aligned with it
                hanging = base[root][:, :, 0]
            axes[:, JOINT_INDEX[f"{joint}{side}"]] = _shortest_turn(hanging, along) @ base[root]
    return axes


def place(
    ours_m: np.ndarray, sigma_m: np.ndarray, theirs_m: np.ndarray, axes: np.ndarray, given: np.ndarray | None = None
) -> Placement:
    """Find the pose of the reference's frame, and the offsets that are due to the two definitions of joints, from the
    joints (n, 21, 3) of both systems at the same times.

    ours_m, sigma_m (n, 21), axes (n, 21, 3, 3): joints of the results, their sigma and ``segment_axes``; theirs_m:
    joints of the reference. given: T_world_reference, if known; then only the offsets are found. Raises
    DegenerateGeometry if the common joints do not determine a frame.
    """
    weight = _weights(ours_m, sigma_m, theirs_m)
    both = weight > 0
    T = _frame(ours_m, theirs_m, axes, weight) if given is None else given
    offset = _fit(ours_m, theirs_m, axes, weight, TURN_PRIOR_FRAMES, T)[1]
    joints = np.flatnonzero(both.any(axis=0))
    sigma = (np.nan, np.nan)
    if given is None and len(joints) > 3:
        others = [_frame(ours_m, theirs_m, axes, weight * (np.arange(JOINT_COUNT) != joint)) for joint in joints]
        sigma = _spread(T, others, ours_m[both].mean(axis=0))
    return Placement(T, offset, *sigma)


def _weights(ours_m: np.ndarray, sigma_m: np.ndarray, theirs_m: np.ndarray) -> np.ndarray:
    """Return weights (n, 21) with mean 1: 0 where one system lacks the joint, smaller where sigma is larger."""
    both = np.isfinite(ours_m).all(axis=2) & np.isfinite(theirs_m).all(axis=2) & np.isfinite(sigma_m)
    both[:, both.sum(axis=0) < LEAST_FRAMES] = False
    weight = np.where(both, 1.0 / (np.where(both, sigma_m, 0.0) ** 2 + ERROR_M**2), 0.0)
    return weight / weight[both].mean() if both.any() else weight


def _frame(ours_m: np.ndarray, theirs_m: np.ndarray, axes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return T_world_reference. Two fits are combined: the frame's rotation comes from a fit whose prior holds the
    offsets of the joints weakly near zero, its position from a fit with a strong prior. ``SHIFT_PRIOR_FRAMES`` gives
    the reason.
    """
    turned, placed = (
        _fit(ours_m, theirs_m, axes, weight, prior)[0] for prior in (TURN_PRIOR_FRAMES, SHIFT_PRIOR_FRAMES)
    )
    middle = theirs_m[weight > 0].mean(axis=0)
    return rigid(turned[:3, :3], transform_points(placed, middle) - turned[:3, :3] @ middle)


def residual(ours_m: np.ndarray, theirs_m: np.ndarray, axes: np.ndarray, offset_m: np.ndarray) -> np.ndarray:
    """Return (n, 21, 3), in the world frame: the results' joints minus the reference's joints minus the joints'
    offsets.
    """
    return ours_m - theirs_m - np.einsum("njik,jk->nji", axes, offset_m)


def _fit(
    ours_m: np.ndarray,
    theirs_m: np.ndarray,
    axes: np.ndarray,
    joint_weight: np.ndarray,
    prior_frames: float,
    given: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return T_world_reference and offsets (21, 3), NaN for joints without data, fitted together by Gauss-Newton steps.
    prior_frames: weight of the prior that a joint's offset is zero, as the number of frames with this joint that would
    weigh as much; given: T_world_reference, if known.
    """
    known = (joint_weight > 0) & np.isfinite(axes).all(axis=(2, 3))
    every = max(1, len(known) // MOST_FRAMES)
    known[np.arange(len(known)) % every != 0] = False
    frame, joint = np.nonzero(known)
    joints, column = np.unique(joint, return_inverse=True)
    source, target, own, certain = (values[frame, joint] for values in (theirs_m, ours_m, axes, joint_weight))
    T = fit_rigid_transform(source, target) if given is None else given
    offset = np.zeros((len(joints), 3))
    for _ in range(ROUNDS):
        placed = transform_points(T, source)
        left = target - placed - np.einsum("kij,kj->ki", own, offset[column])
        far = np.linalg.norm(left, axis=1)
        weight = certain * np.minimum(1.0, FARTHEST * np.median(far) / np.maximum(far, 1e-9)) ** 2
        centre = placed.mean(axis=0)
        use = (column, weight, prior_frames * float(weight.mean()))
        turn, shift, change = _step(left, placed - centre, own, use, offset, given is None)
        offset += change
        T = _turned(T, turn, shift, centre)
        if max(np.abs(turn).max(), np.abs(shift).max(), np.abs(change).max()) < 1e-6:
            break
    found = np.full((JOINT_COUNT, 3), np.nan)
    found[joints] = offset
    return T, found


def _step(
    left: np.ndarray,
    lever: np.ndarray,
    own: np.ndarray,
    use: tuple[np.ndarray, np.ndarray, float],
    offset: np.ndarray,
    frame_too: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rotation vector and shift of the frame, and the change of the offsets (j, 3).

    left (k, 3): differences between both systems' points that the present fit leaves; lever (k, 3): the reference's
    points relative to their centre; own (k, 3, 3): segment axes; use: a tuple with the index (k,) of each point's
    offset, the weight (k,) of each point, and the weight of the prior of each offset. If ``frame_too`` is False, only
    offsets change.
    """
    (column, weight, prior), count = use, len(offset)
    jacobian = np.zeros((len(left), 3, 6))
    x, y, z = lever.T
    jacobian[:, 0, 1], jacobian[:, 0, 2], jacobian[:, 1, 0] = z, -y, -z
    jacobian[:, 1, 2], jacobian[:, 2, 0], jacobian[:, 2, 1] = x, y, -x
    jacobian[:, :, 3:] = np.eye(3)
    matrix, right = np.zeros((6 + 3 * count, 6 + 3 * count)), np.zeros(6 + 3 * count)
    weighted = weight[:, None, None] * jacobian
    matrix[:6, :6] = np.einsum("kia,kib->ab", weighted, jacobian)
    right[:6] = np.einsum("kia,ki->a", weighted, left)
    for j in range(count):
        mine, at = column == j, slice(6 + 3 * j, 9 + 3 * j)
        cross = np.einsum("kia,kib->ab", weighted[mine], own[mine])
        matrix[:6, at], matrix[at, :6] = cross, cross.T
        matrix[at, at] = (weight[mine].sum() + prior) * np.eye(3)
        right[at] = np.einsum("kib,ki->b", weight[mine][:, None, None] * own[mine], left[mine]) - prior * offset[j]
    free = slice(None) if frame_too else slice(6, None)
    step = np.zeros(len(right))
    step[free] = np.linalg.solve(matrix[free, free], right[free])
    return step[:3], step[3:6], step[6:].reshape(count, 3)


def _turned(T: np.ndarray, turn: np.ndarray, shift: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    """Return the rigid transform T, followed by a small rotation about the point ``centre_m`` and a shift."""
    rotation = rotation_matrices(turn[None])[0]
    return np.asarray(rigid(rotation, centre_m - rotation @ centre_m + shift) @ T)


def _spread(T: np.ndarray, others: list[np.ndarray], centre_m: np.ndarray) -> tuple[float, float]:
    """Return the standard deviations per axis of the position of the body's centre (m) and of the frame's rotation
    (degrees), by the jackknife: each of ``others`` is the frame as found without one joint.
    """
    source = np.linalg.inv(T) @ np.append(centre_m, 1.0)
    shift = np.array([(other @ source)[:3] - centre_m for other in others])
    turn = rotation_vectors(np.array([other[:3, :3] @ T[:3, :3].T for other in others]))
    factor = (len(others) - 1.0) / len(others)
    metres, radians = (np.sqrt(factor * ((each - each.mean(axis=0)) ** 2).sum() / 3.0) for each in (shift, turn))
    return float(metres), float(np.degrees(radians))


def _columns(axes: Axes) -> np.ndarray:
    """Return matrices (n, 3, 3) whose columns are the axes x, y, z."""
    return np.stack([axes.x, axes.y, axes.z], axis=-1).transpose(1, 0, 2)


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the smallest rotations (n, 3, 3) that turn unit vectors ``start`` into unit vectors ``end`` (n, 3 each);
    NaN if the two are opposite.
    """
    axis, cosine = np.cross(start, end), (start * end).sum(axis=1)
    zero = np.zeros(len(axis))
    x, y, z = axis.T
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    scale = np.where(cosine > -0.999, 1.0 / np.where(cosine > -0.999, 1.0 + cosine, 1.0), np.nan)
    return np.eye(3) + skew + scale[:, None, None] * (skew @ skew)
