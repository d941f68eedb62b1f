"""Make poses wrong on purpose, as trackers get them wrong: an arm in the trunk, limbs exchanged, the body turned.

Only the limbs named by ``Spoil.limbs`` move; bones keep their length and joints stay within their range.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import joint_bones
from anchorpose.body.evidence import trunk_and_arms
from anchorpose.body.fit import limited, prior_equations
from anchorpose.body.pose import LIMB_OF_BONES, LIMB_OF_JOINTS, POSE_SIZE, Pose
from anchorpose.body.skin_points import Body, joint_jacobian, pose_points
from anchorpose.joints import JOINT_INDEX

STEPS: Final = 15  # of the Gauss-Newton method; an arm turns by up to 30 degrees in each step
REACHED_M: Final = 0.02  # how well a limb meets its target
SLAB_M: Final = 0.05  # half the height of the slice of the trunk whose middle is taken
OTHER: Final = {"Left": "Right", "Right": "Left"}
ARM: Final = ("Wrist", "Hand")
LEG: Final = ("Knee", "Ankle", "Foot")


class Kind(StrEnum):
    """What is spoilt."""

    ARM_IN_TRUNK = "arm-in-trunk"  # a hand inside the belly or the chest
    ARMS_EXCHANGED = "arms-exchanged"  # each hand where the other one is, or as near to it as the arm reaches
    LEG_ON_LEG = "leg-on-leg"  # knee, ankle and foot where those of the other leg are
    TURNED_ROUND = "turned-round"  # by 180 degrees about the vertical through the pelvis, limbs and all


@dataclass(frozen=True, slots=True)
class Spoil:
    """How to make a pose wrong. side: of the moved limb, ``Left`` or ``Right``; height: of a hand in the trunk, from 0
    (pelvis) to 1 (shoulders)."""

    kind: Kind
    side: str = "Left"
    height: float = 0.4

    @property
    def limbs(self) -> tuple[str, ...]:
        """Return the limbs that become wrong, by their names in ``anchorpose.results.evaluate.LIMBS_JUDGED``."""
        match self.kind:
            case Kind.ARM_IN_TRUNK:
                return (f"arm_{self.side.lower()}",)
            case Kind.ARMS_EXCHANGED:
                return ("arm_left", "arm_right")
            case Kind.LEG_ON_LEG:
                return ("leg_left", "leg_right")
            case Kind.TURNED_ROUND:
                return ("arm_left", "arm_right", "leg_left", "leg_right", "trunk_and_head")


def spoilt(body: Body, pose: Pose, spoil: Spoil) -> Pose:
    """Return the pose with the limbs that ``spoil`` names in the wrong place."""
    joints, side = body.joints(pose), spoil.side
    match spoil.kind:
        case Kind.ARM_IN_TRUNK:
            return aimed(body, pose, {f"Hand{side}": middle_of_trunk(body, pose, spoil.height)})
        case Kind.ARMS_EXCHANGED:
            return _on_the_other(body, _on_the_other(body, pose, joints, "Left", ARM), joints, "Right", ARM)
        case Kind.LEG_ON_LEG:
            return _on_the_other(body, pose, joints, side, LEG)
        case Kind.TURNED_ROUND:
            return turned_round(body, pose)


def _on_the_other(body: Body, pose: Pose, joints_m: np.ndarray, side: str, limb: tuple[str, ...]) -> Pose:
    """Aim one side's limb at where the other side's joints are in ``joints_m`` (21, 3)."""
    return aimed(body, pose, {f"{joint}{side}": joints_m[JOINT_INDEX[f"{joint}{OTHER[side]}"]] for joint in limb})


def turned_round(body: Body, pose: Pose) -> Pose:
    """Turn the body by half a turn about the vertical through the pelvis."""
    root = int(np.flatnonzero(body.points.asset.bone_parents < 0)[0])
    rotations = pose.rotations.copy()
    rotations[root] = Rotation.from_euler("y", np.pi).as_matrix() @ rotations[root]
    return Pose(rotations, pose.root_m)


def aimed(body: Body, pose: Pose, targets_m: Mapping[str, np.ndarray]) -> Pose:
    """Move the joints of one limb as near as they reach to targets (3,) in the world; nothing else moves."""
    joints = np.array([JOINT_INDEX[name] for name in targets_m])
    (limb,) = set(LIMB_OF_JOINTS[joints].tolist())
    free = np.repeat(np.append(limb == LIMB_OF_BONES, False), 3)  # the last: the root's place
    bones, goals = joint_bones(body.points.asset)[joints], np.array(list(targets_m.values()))
    for _ in range(STEPS):
        transforms = body.transforms(pose)
        at = body.mesh.joints(transforms)[joints]
        rows = joint_jacobian(body, transforms, bones, at).reshape(-1, POSE_SIZE)[:, free]
        prior = prior_equations(body.points, pose, None)
        hessian = prior.hessian[np.ix_(free, free)] + rows.T @ rows / REACHED_M**2
        hessian += 1e-3 * np.diag(np.diag(hessian))
        gradient = prior.gradient[free] + rows.T @ (at - goals).ravel() / REACHED_M**2
        change = np.zeros(POSE_SIZE)
        change[free] = -np.linalg.solve(hessian, gradient)
        pose = pose.moved(limited(change), body.points.moving)
    return pose


def middle_of_trunk(body: Body, pose: Pose, height: float) -> np.ndarray:
    """Return the middle (3,) of the trunk's skin at a height between pelvis (0) and shoulders (1)."""
    joints, skin = body.joints(pose), pose_points(body, pose).points_m[trunk_and_arms(body.points)[0]]
    base, top = joints[JOINT_INDEX["SpineBase"]], joints[JOINT_INDEX["SpineShoulder"]]
    axis = (top - base) / np.linalg.norm(top - base)
    level = float((1.0 - height) * (base @ axis) + height * (top @ axis))
    slab = skin[np.abs(skin @ axis - level) < SLAB_M]
    return np.asarray((slab.min(axis=0) + slab.max(axis=0)) / 2.0)
