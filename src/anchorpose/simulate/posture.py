"""Represent a posture over time in anatomical terms, and compute the rotations of the bones.

Side 0 is left, side 1 is right. Angles are radians from upright standing with arms that hang down, thumbs forward. The
feet are placed first, and two-bone inverse kinematics then places the legs, so a standing foot does not move with the
trunk. Arms follow their angles, but an arm that holds something is pulled towards a target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.kinematics import BodyMesh
from anchorpose.rotations import FORWARD, RIGHT, UP, orthonormal_frame, rotate, turns, turns_about, unit
from anchorpose.simulate.carried_pelvis import KneeBend, Legs, carried_pelvis

SIDES = ("Left", "Right")
OUTWARD = np.array([-1.0, 1.0])  # per side, sign of the direction along Z that leads away from the middle
# maximum reach as a share of a limb's length; below 1, since a straight limb does not define the plane in which it
# bends
FULL_REACH = 0.985
# maximum reach / leg length if the bend of the knees is given; at this reach, the bend is 0.2 degrees
STRAIGHT_REACH = 1.0 - 1e-6
# m, range of heights over which the pelvis gradually approaches the greatest height that straight legs allow
HEIGHT_SOFTNESS_M = 0.004
SPINE_SHARES = (("LowerBack", 0.5), ("Spine", 0.5), ("Spine1", 0.0))  # each bone's share of the trunk's bend
NECK_SHARES = (("Neck", 0.4), ("Neck1", 0.6), ("Head", 0.0))  # each bone's share of the head's bend
CLAVICLE_SHARE = 0.25  # clavicle's share of the arm's elevation beyond 30 degrees (scapulohumeral rhythm)
# m, about the length of an upper arm: the elbow of an arm that holds something bends towards a point this far behind
# the place that the elbow would have otherwise, since people who hold rails beside the hips have their elbows behind
# the hands.
ELBOW_BEHIND_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Captured:
    """Parts of a captured posture, which replace ``shoulder``, ``elbow`` and ``knee_out`` of ``Posture``. In such a
    posture, the toes turn with the foot while ``heel_lift`` is negative (toes raised).
    """

    arms: np.ndarray  # (t, 2, 2, 3, 3) rotations of upper arm and forearm in the world
    knees: np.ndarray  # (t, 2, 3) directions to which the knees point
    straight_leg: float  # maximum reach of a leg as a share of its length


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posture:
    """A posture over time: the first axis of all arrays is the time (t). The second axis of arrays (t, 2, ...) is the
    side: left, right.
    """

    # (t, 3) intended position of the pelvis; the pelvis is lower where straight legs do not reach this position
    pelvis_m: np.ndarray
    pelvis_turn: np.ndarray  # (t, 3, 3) rotation of the pelvis from rest
    trunk: np.ndarray  # (t, 3) rad, bend forward, bend to the right, turn to the left
    head: np.ndarray  # (t, 3) rad, bend forward, bend to the right, turn to the left
    ball_m: np.ndarray  # (t, 2, 3) ball of each foot
    foot_yaw: np.ndarray  # (t, 2) rad, direction of each foot, positive to the left
    heel_lift: np.ndarray  # (t, 2) rad, rotation of each foot about its ball, positive = heel up
    knee_out: np.ndarray  # (t, 2) rad, outward deviation of the left and the right knee from the direction of the foot
    shoulder: np.ndarray  # (t, 2, 3) rad, flexion, abduction, inward rotation
    elbow: np.ndarray  # (t, 2) rad, flexion, 0 = straight
    pronation: np.ndarray  # (t, 2) rad, rotation of the forearm
    wrist: np.ndarray  # (t, 2) rad, flexion towards the palm
    fingers: np.ndarray  # (t, 2) rad, curl of the fingers
    hand_m: np.ndarray  # (t, 2, 3) place to which the wrist is pulled; unused if ``pull`` is 0
    hand_turn: np.ndarray  # (t, 2, 3, 3) rotation of the hand bone from rest; unused if ``pull`` is 0
    pull: np.ndarray  # (t, 2) from 0 (the arm follows its angles) to 1 (the hand is at its target)
    captured: Captured | None = None  # parts of a captured movement that replace some angles; None = none are replaced
    knees: KneeBend | None = None  # given bend of the knees, which sets the pelvis's height; None = not given


@dataclass(frozen=True, slots=True, eq=False)
class RestLimb:
    """The two bones of a limb in the rest pose: directions and lengths of the bones, axis and bend of the joint between
    them.
    """

    first: np.ndarray
    second: np.ndarray
    axis: np.ndarray
    lengths: tuple[float, float]
    rest_bend: float


def rest_limb(body: BodyMesh, names: tuple[str, str, str]) -> RestLimb:
    start, middle, end = (body.bone_heads[body.asset.bone(name)] for name in names)
    first, second = unit(middle - start), unit(end - middle)
    return RestLimb(
        first=first,
        second=second,
        axis=unit(np.cross(first, second)),
        lengths=(float(np.linalg.norm(middle - start)), float(np.linalg.norm(end - middle))),
        rest_bend=float(np.arccos(np.clip(first @ second, -1.0, 1.0))),
    )


def pose_bones(body: BodyMesh, posture: Posture) -> np.ndarray:
    """Return (t, b, 4, 4) float64 T_world_rest of every bone."""
    return _Poser(body, len(posture.pelvis_m)).run(posture)


def palm_normal(body: BodyMesh, side: int) -> np.ndarray:
    """Return the direction (3,) out of the palm in the rest pose."""
    name = SIDES[side]
    fingers = body.bone_tails[body.asset.bone(f"{name}FingerBase")] - body.bone_heads[body.asset.bone(f"{name}Hand")]
    thumb = body.bone_tails[body.asset.bone(f"{name[0]}Thumb")] - body.bone_heads[body.asset.bone(f"{name}Hand")]
    normal = unit(np.cross(fingers, thumb))
    return normal * np.sign(normal @ np.array([0.0, -1.0, -OUTWARD[side]]))


def finger_direction(body: BodyMesh, side: int) -> np.ndarray:
    """Return the direction (3,) from the wrist to the fingers in the rest pose."""
    name = SIDES[side]
    return unit(body.bone_tails[body.asset.bone(f"{name}FingerBase")] - body.bone_heads[body.asset.bone(f"{name}Hand")])


class _Poser:
    """The rotations and places of all bones, computed from the pelvis outwards for all times at once."""

    def __init__(self, body: BodyMesh, times: int) -> None:
        self.body = body
        self.turn = np.tile(np.eye(3), (times, len(body.bone_heads), 1, 1))
        self.place = np.zeros((times, len(body.bone_heads), 3))

    def run(self, posture: Posture) -> np.ndarray:
        ankles_m, feet = self._feet(posture)
        self._pelvis(posture, ankles_m)
        for side in (0, 1):
            self._leg(posture, side, ankles_m[:, side], feet[:, side])
        self._spine(posture)
        for side in (0, 1):
            self._arm(posture, side)
        transforms = np.zeros((*self.turn.shape[:2], 4, 4))
        transforms[..., :3, :3] = self.turn
        transforms[..., :3, 3] = self.place - rotate(self.turn, self.body.bone_heads)
        transforms[..., 3, 3] = 1.0
        return transforms

    def _bone(self, name: str) -> int:
        return self.body.asset.bone(name)

    def _set(self, name: str, turn: np.ndarray) -> None:
        """Set a bone's rotation in the world, and place its head (its near end) where it is attached to its parent."""
        bone = self._bone(name)
        parent = self.body.asset.bone_parents[bone]
        offset = self.body.bone_heads[bone] - self.body.bone_heads[parent]
        self.turn[:, bone] = turn
        self.place[:, bone] = self.place[:, parent] + rotate(self.turn[:, parent], offset)

    def _follow(self, name: str, local: np.ndarray | None = None) -> None:
        """Set a bone's rotation relative to its parent; None = the bone moves rigidly with its parent."""
        parent = self.turn[:, self.body.asset.bone_parents[self._bone(name)]]
        self._set(name, parent if local is None else parent @ local)

    def _feet(self, posture: Posture) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankles (t, 2, 3) and the rotations of the feet (t, 2, 3, 3), world."""
        turn = turns_about(UP, posture.foot_yaw) @ turns_about(RIGHT, -posture.heel_lift)
        heads = self.body.bone_heads
        offsets = np.array([heads[self._bone(f"{s}Foot")] - heads[self._bone(f"{s}ToeBase")] for s in SIDES])
        return posture.ball_m + rotate(turn, offsets), turn

    def _pelvis(self, posture: Posture, ankles_m: np.ndarray) -> None:
        hips = self._bone("Hips")
        self.turn[:, hips] = posture.pelvis_turn
        place = posture.pelvis_m.copy()
        highest = [place[:, 1]]
        for side, name in enumerate(SIDES):
            offset = rotate(
                posture.pelvis_turn, self.body.bone_heads[self._bone(f"{name}UpLeg")] - self.body.bone_heads[hips]
            )
            length = full_reach(posture) * sum(
                rest_limb(self.body, (f"{name}UpLeg", f"{name}Leg", f"{name}Foot")).lengths
            )
            gap = place + offset - ankles_m[:, side]
            rise = np.sqrt(np.maximum(length**2 - gap[:, 0] ** 2 - gap[:, 2] ** 2, 0.01))
            highest.append(ankles_m[:, side, 1] - offset[:, 1] + rise)
        lowest = np.min(highest, axis=0)
        excess = sum(np.exp((lowest - height) / HEIGHT_SOFTNESS_M) for height in highest)
        place[:, 1] = lowest - HEIGHT_SOFTNESS_M * np.log(excess)
        if posture.knees is not None:
            legs = self._legs_from(hips)
            place, self.turn[:, hips] = carried_pelvis(posture.knees, legs, ankles_m, place, posture.pelvis_turn)
        self.place[:, hips] = place
        for name in ("LHipJoint", "RHipJoint"):
            self._follow(name)

    def _legs_from(self, hips: int) -> Legs:
        heads = self.body.bone_heads
        limbs = [rest_limb(self.body, (f"{name}UpLeg", f"{name}Leg", f"{name}Foot")) for name in SIDES]
        offsets = [heads[self._bone(f"{name}UpLeg")] - heads[hips] for name in SIDES]
        return Legs(np.array(offsets), np.array([limb.lengths for limb in limbs]))

    def _leg(self, posture: Posture, side: int, ankle_m: np.ndarray, foot: np.ndarray) -> None:
        name = SIDES[side]
        limb = rest_limb(self.body, (f"{name}UpLeg", f"{name}Leg", f"{name}Foot"))
        self._follow(f"{name}UpLeg")
        hip_m = self.place[:, self._bone(f"{name}UpLeg")]
        ahead = posture.foot_yaw[:, side] - OUTWARD[side] * posture.knee_out[:, side]
        pole = rotate(turns_about(UP, ahead), FORWARD) if posture.captured is None else posture.captured.knees[:, side]
        reach = full_reach(posture) if posture.knees is None else STRAIGHT_REACH
        thigh, shank = _reach(limb, hip_m, ankle_m, pole, reach)
        self._set(f"{name}UpLeg", thigh)
        self._set(f"{name}Leg", shank)
        self._set(f"{name}Foot", foot)
        toes = turns_about(UP, posture.foot_yaw[:, side])
        if posture.captured is not None:
            toes = np.where((posture.heel_lift[:, side] < 0.0)[:, None, None], foot, toes)
        self._set(f"{name}ToeBase", toes)

    def _spine(self, posture: Posture) -> None:
        for shares, angles in ((SPINE_SHARES, posture.trunk), (NECK_SHARES, posture.head)):
            bend = np.stack([angles[:, 1], angles[:, 2], -angles[:, 0]], axis=1)
            for name, share in shares:
                self._follow(name, turns(share * bend))

    def _arm(self, posture: Posture, side: int) -> None:
        name, outward = SIDES[side], OUTWARD[side]
        flexion, abduction, inward = posture.shoulder[:, side].T
        swing = np.stack([-outward * abduction, np.zeros_like(flexion), flexion], axis=1)
        raised = np.logaddexp(0.0, (np.linalg.norm(swing, axis=1) - 0.5) * 8.0) / 8.0
        self._follow(f"{name}Shoulder", turns_about(FORWARD, -outward * CLAVICLE_SHARE * raised))
        self._follow(f"{name}Arm")

        limb = rest_limb(self.body, (f"{name}Arm", f"{name}ForeArm", f"{name}Hand"))
        hanging = orthonormal_frame(-UP, RIGHT) @ orthonormal_frame(limb.first, limb.axis).T
        thorax = self.turn[:, self._bone("Spine1")]
        upper = thorax @ turns(swing) @ turns_about(UP, outward * inward) @ hanging
        fore = upper @ turns_about(limb.axis, posture.elbow[:, side] - limb.rest_bend)
        if posture.captured is not None:
            upper, fore = posture.captured.arms[:, side, 0], posture.captured.arms[:, side, 1]
        upper, fore = self._pulled(posture, side, limb, upper, fore)

        self._set(f"{name}Arm", upper)
        self._set(f"{name}ForeArm", fore @ turns_about(limb.second, -outward * posture.pronation[:, side]))
        palm, along = palm_normal(self.body, side), finger_direction(self.body, side)
        across = unit(np.cross(along, palm))
        free = self.turn[:, self._bone(f"{name}ForeArm")] @ turns_about(across, posture.wrist[:, side])
        held = Rotation.from_matrix(np.swapaxes(free, -1, -2) @ posture.hand_turn[:, side]).as_rotvec()
        self._set(f"{name}Hand", free @ turns(posture.pull[:, side, None] * held))
        curl = turns_about(across, posture.fingers[:, side])
        self._follow(f"{name[0]}Thumb")
        self._follow(f"{name}FingerBase", curl)
        self._follow(f"{name}HandFinger1", curl)

    def _pulled(
        self, posture: Posture, side: int, limb: RestLimb, upper: np.ndarray, fore: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (t, 3, 3) of upper arm and forearm after the wrist is pulled to its target. The elbow points
        backward.
        """
        pull = posture.pull[:, side, None]
        if not pull.any():
            return upper, fore
        shoulder_m = self.place[:, self._bone(f"{SIDES[side]}Arm")]
        elbow_m = shoulder_m + limb.lengths[0] * rotate(upper, limb.first)
        wrist_m = elbow_m + limb.lengths[1] * rotate(fore, limb.second)
        goal_m = wrist_m + pull * (posture.hand_m[:, side] - wrist_m)
        backward = ELBOW_BEHIND_M * unit(OUTWARD[side] * 0.4 * RIGHT - FORWARD)
        behind = rotate(self.turn[:, self._bone("Spine1")], backward)
        return _reach(limb, shoulder_m, goal_m, elbow_m - shoulder_m + pull * behind)


def full_reach(posture: Posture) -> float:
    """Return the maximum reach of a leg as a share of its length."""
    return FULL_REACH if posture.captured is None else posture.captured.straight_leg


def _reach(
    limb: RestLimb, start_m: np.ndarray, goal_m: np.ndarray, pole: np.ndarray, full: float = FULL_REACH
) -> tuple[np.ndarray, np.ndarray]:
    """Return world rotations (t, 3, 3) of both bones of a limb that starts at ``start_m`` and ends at ``goal_m``. The
    middle joint (knee or elbow) moves aside in the direction ``pole``, world. If the goal is out of reach, the limb
    points at it.
    """
    first_m, second_m = limb.lengths
    gap = goal_m - start_m
    reach_m = np.linalg.norm(gap, axis=1)
    along = gap / reach_m[:, None]
    reach_m = np.clip(reach_m, abs(first_m - second_m) + 0.01, full * (first_m + second_m))
    shadow_m = (first_m**2 - second_m**2 + reach_m**2) / (2.0 * reach_m)
    height_m = np.sqrt(np.maximum(first_m**2 - shadow_m**2, 0.0))
    aside = unit(pole - (pole * along).sum(axis=1, keepdims=True) * along)
    middle = shadow_m[:, None] * along + height_m[:, None] * aside
    first = unit(middle)
    second = unit(reach_m[:, None] * along - middle)
    axis = np.cross(first, second)
    return tuple(
        orthonormal_frame(now, axis) @ orthonormal_frame(rest, limb.axis).T
        for now, rest in ((first, limb.first), (second, limb.second))
    )
