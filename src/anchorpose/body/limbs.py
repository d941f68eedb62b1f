"""Arms and legs: which bones and joints belong to each, and what is left to the trunk."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.body.pose import MOVING_BONES
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES

_LIMBS: Final = tuple(
    (f"{side}{part}", bones, tuple(f"{joint}{side}" for joint in joints))
    for side in ("Left", "Right")
    for part, bones, joints in (
        ("Arm", ("Shoulder", "Arm", "ForeArm", "Hand"), ("Shoulder", "Elbow", "Wrist", "Hand")),
        ("Leg", ("UpLeg", "Leg", "Foot"), ("Knee", "Ankle", "Foot")),
    )
)


def _limb_of_bones() -> np.ndarray:
    """(m,) the limb of each moving bone, counted from 1; 0 is the trunk with the head."""
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
PARTS: Final = len(_LIMBS) + 1

TRUNK: Final = 0
