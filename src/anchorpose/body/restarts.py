"""Other poses worth trying when a limb is not where it was expected: arms as they are held, legs that stand or sit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import DEGREE, Pose, hinge_axes

_DIRECTIONS = (
    (0.2, -1.0, 0.3),
    (1.0, -0.3, 0.2),
    (0.2, -0.2, 1.0),
    (0.5, 0.7, 0.5),
    (0.2, 1.0, 0.2),
    (0.7, -0.7, -0.2),
)
"""Of the right upper arm in the trunk's axes, X forward, Y up, Z to the right: down, forward, sideways, up, across."""

_ELBOW_TURNS = tuple(turn * DEGREE for turn in (-90.0, -45.0, 0.0, 45.0, 90.0, 180.0))
"""Of a bent forearm about the upper arm, from where it is."""

_ELBOWS = (15.0 * DEGREE, 90.0 * DEGREE)
_SEATED = 85.0 * DEGREE  # of hip and knee alike: the shank hangs down


def arm_restarts(asset: BodyAsset, pose: Pose, side: str) -> Iterator[Pose]:
    """The pose with one arm, ``Left`` or ``Right``, laid elsewhere: the forearm alone, then the whole arm.

    The elbow is nearly straight or bent; a bent forearm is turned about the upper arm, the whole arm is laid in each of
    some directions.
    """
    arm, forearm, hand = (asset.bone(f"{side}{bone}") for bone in ("Arm", "ForeArm", "Hand"))
    rest = asset.bone_heads[forearm] - asset.bone_heads[arm]
    axes, bend = hinge_axes(asset, f"{side}ForeArm")
    along = rest / np.linalg.norm(rest)
    for turn in _ELBOW_TURNS:
        rotations = pose.rotations.copy()
        rotations[arm] = pose.rotations[arm] @ Rotation.from_rotvec(along * turn).as_matrix()
        rotations[forearm] = Rotation.from_rotvec(axes[0] * (_ELBOWS[1] - bend)).as_matrix()
        rotations[hand] = np.eye(3)
        yield Pose(rotations, pose.root_m)
    for direction in _DIRECTIONS:
        wanted = np.array(direction) * (1.0, 1.0, 1.0 if side == "Right" else -1.0)
        for elbow in _ELBOWS:
            rotations = pose.rotations.copy()
            rotations[arm] = _shortest_turn(rest, wanted)
            rotations[forearm] = Rotation.from_rotvec(axes[0] * (elbow - bend)).as_matrix()
            rotations[hand] = np.eye(3)
            yield Pose(rotations, pose.root_m)


def leg_restarts(asset: BodyAsset, pose: Pose) -> Iterator[Pose]:
    """The pose with both legs, or one, standing straight or sitting."""
    for sides in (("Left", "Right"), ("Left",), ("Right",)):
        for flexed in (0.0, _SEATED):
            rotations = pose.rotations.copy()
            for side in sides:
                thigh, shank, *foot = (asset.bone(f"{side}{bone}") for bone in ("UpLeg", "Leg", "Foot", "ToeBase"))
                axes, bend = hinge_axes(asset, f"{side}Leg")
                rotations[thigh] = Rotation.from_rotvec(-axes[0] * flexed).as_matrix()
                rotations[shank] = Rotation.from_rotvec(axes[0] * (flexed - bend)).as_matrix()
                rotations[foot] = np.eye(3)
            yield Pose(rotations, pose.root_m)


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that takes one direction to another by the shortest way."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis), start @ end
    turn = axis / max(float(sine), 1e-9) * np.arctan2(sine, cosine)
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())
