"""Represent a pose of the body (rotations of bones, place of the root, that is, the pelvis), and changes of poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES
from anchorpose.rotations import rotation_matrices, rotation_vectors

MOVING_BONES: Final = (
    "Hips",
    "LowerBack",
    "Spine",
    "Spine1",
    "Neck",
    "Neck1",
    "Head",
    "LeftShoulder",
    "LeftArm",
    "LeftForeArm",
    "LeftHand",
    "RightShoulder",
    "RightArm",
    "RightForeArm",
    "RightHand",
    "LeftUpLeg",
    "LeftLeg",
    "LeftFoot",
    "RightUpLeg",
    "RightLeg",
    "RightFoot",
)
"""The bones whose rotation is estimated. Fingers, toes and the two hip bones of the pelvis keep the rest pose."""

POSE_SIZE: Final = 3 * len(MOVING_BONES) + 3
"""Number of parameters of a pose change: a rotation vector per moving bone, then the root's translation."""

DEGREE: Final = np.pi / 180.0


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A pose of the body."""

    rotations: np.ndarray  # (b, 3, 3) rotation of each bone relative to its parent, in the axes of the rest pose
    root_m: np.ndarray  # (3,) the root bone's head in the world

    def moved(self, change: np.ndarray, moving: np.ndarray) -> Pose:
        """Return the pose after a change (POSE_SIZE,): each rotation becomes ``exp(change) @ rotation`` in the parent's
        frame, and the root moves by the last three values.
        """
        rotations = self.rotations.copy()
        rotations[moving] = rotation_matrices(change[:-3].reshape(-1, 3)) @ rotations[moving]
        return Pose(rotations, self.root_m + change[-3:])

    def change_to(self, after: Pose, moving: np.ndarray) -> np.ndarray:
        """Return the change (POSE_SIZE,) with which ``self.moved(change, moving)`` gives the pose ``after``."""
        turned = after.rotations[moving] @ self.rotations[moving].transpose(0, 2, 1)
        return np.append(rotation_vectors(turned).ravel(), after.root_m - self.root_m)

    def faces_away(self, other: Pose) -> bool:
        """Return whether the pelvis of ``other`` is turned by more than a right angle, about any axis, relative to this
        pose.
        """
        return bool(np.trace(other.rotations[0] @ self.rotations[0].T) < 1.0)

    def rotation_vectors(self, moving: np.ndarray) -> np.ndarray:
        """Return the rotation vectors (m, 3) of the moving bones, radians."""
        return rotation_vectors(self.rotations[moving])


def moving_bones(asset: BodyAsset) -> np.ndarray:
    """Return the bone index (m,) of each of ``MOVING_BONES``."""
    return np.array([asset.bone(name) for name in MOVING_BONES])


def descendants(asset: BodyAsset) -> np.ndarray:
    """Return (m, b) float64: for each moving bone, 1 at this bone and all its descendants, 0 at other bones."""
    below = np.zeros((len(MOVING_BONES), len(asset.bone_names)))
    for row, bone in enumerate(moving_bones(asset)):
        for other in range(len(asset.bone_names)):
            ancestor = other
            while ancestor >= 0 and ancestor != bone:
                ancestor = asset.bone_parents[ancestor]
            below[row, other] = float(ancestor == bone)
    return below


_LIMBS: Final = tuple(
    (f"{side}{part}", bones, tuple(f"{joint}{side}" for joint in joints))
    for side in ("Left", "Right")
    for part, bones, joints in (
        ("Arm", ("Shoulder", "Arm", "ForeArm", "Hand"), ("Shoulder", "Elbow", "Wrist", "Hand")),
        ("Leg", ("UpLeg", "Leg", "Foot"), ("Knee", "Ankle", "Foot")),
    )
)


def _limb_of_bones() -> np.ndarray:
    """Return the limb (m,) of each moving bone: 1 left arm, 2 left leg, 3 right arm, 4 right leg, 0 trunk and head."""
    limb_of = np.zeros(len(MOVING_BONES), dtype=np.int64)
    for number, (name, bones, _) in enumerate(_LIMBS, 1):
        side = "Left" if name.startswith("Left") else "Right"
        limb_of[[MOVING_BONES.index(f"{side}{bone}") for bone in bones]] = number
    return limb_of


def _limb_of_joints() -> np.ndarray:
    limb_of = np.zeros(JOINT_COUNT, dtype=np.int64)
    for number, (_, _, joints) in enumerate(_LIMBS, 1):
        limb_of[[JOINT_NAMES.index(joint) for joint in joints]] = number
    return limb_of


LIMB_OF_BONES: Final = _limb_of_bones()
LIMB_OF_JOINTS: Final = _limb_of_joints()
_BEYOND: Final = ("ForeArm", "Hand", "tLeg", "Foot", "Spine", "Spine1", "Neck", "Neck1", "Head")
SEGMENT_OF_BONES: Final = 2 * LIMB_OF_BONES + np.array([bone.endswith(_BEYOND) for bone in MOVING_BONES])
"""Segment (m,) of each moving bone: half of a limb or of the trunk. A segment's number is twice the number of its limb,
plus 1 for the half of a limb beyond the elbow or knee, and plus 1 for the half of the trunk with chest, neck and
head."""
SEGMENT_OF_JOINTS: Final = 2 * LIMB_OF_JOINTS + np.array(
    [name.startswith(("Wrist", "Hand", "Ankle", "Foot", "SpineM", "SpineS", "Neck", "Head")) for name in JOINT_NAMES]
)
"""Segment (21,) of each joint, numbered as in ``SEGMENT_OF_BONES``."""
PARTS: Final = len(_LIMBS) + 1  # number of parts: the trunk and four limbs

TRUNK: Final = 0  # number of the trunk (with the head) among the five parts
