"""Transfer a captured movement to another body. The result has the subject's segment directions and the patient's
segment lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from anchorpose.body.kinematics import BodyMesh
from anchorpose.rotations import FORWARD, RIGHT, UP, orthonormal_frame, rotate, turns, turns_about, unit
from anchorpose.simulate.capture import Capture
from anchorpose.simulate.footing import Footing, find_footing
from anchorpose.simulate.movement_file import CLIP_HZ
from anchorpose.simulate.person import Person
from anchorpose.simulate.posture import OUTWARD, SIDES, Captured, Posture, pose_bones, rest_limb
from anchorpose.simulate.timeline import (
    ELBOW_LIMITS,
    HEAD_LIMITS,
    STEP_HEIGHT_M,
    TRUNK_LIMITS,
    HandGoals,
    ball_ahead_m,
    ease,
)

# maximum reach of a leg, divided by its length; at this reach, the knee is still bent by 7 degrees
STRAIGHT_LEG: Final = 0.998
PELVIS_S: Final = 0.06  # s, standard deviation of the Gaussian that smooths the path of the pelvis
# m; a knee at least this far from the line from hip to ankle points in the captured direction
KNEE_SHOWS_M: Final = 0.05
AIR_M: Final = 0.12  # m; a foot at least this high above the floor keeps its angle to the shank
TOES_DOWN_RAD: Final = 0.25  # rad, downward pitch of a foot in the air below an upright shank
FINGERS_RAD: Final = 0.25  # rad, curl of the fingers

_UP_RIGHT: Final = orthonormal_frame(UP, RIGHT)


@dataclass(frozen=True, slots=True, eq=False)
class CapturedActor:
    """A person who does a captured movement. Arrays have n rows at CLIP_HZ. In arrays of feet, the second axis is the
    side, left first.
    """

    person: Person
    capture: Capture
    pelvis_m: np.ndarray  # (n, 3) positions of the pelvis
    ball_m: np.ndarray  # (n, 2, 3) ball of each foot; y is the height above the floor
    foot_yaw: np.ndarray  # (n, 2) rad, direction of each foot, positive to the left
    heel: np.ndarray  # (n, 2) rad, rotation of each foot that raises its heel above its toes; negative = toes raised

    def sits(self) -> bool:
        """Return whether the patient sits on a seat during the movement."""
        return self.capture.seated

    def stay_s(self, from_s: float) -> tuple[float, float]:
        """Return start and end of the time that the patient next spends at the place of training; the end is infinity,
        since a patient with a captured movement never leaves.
        """
        return from_s, np.inf

    def lowest_s(self) -> np.ndarray:
        """Return the time (1,) at which the pelvis is lowest."""
        return np.array([self.capture.start_s + np.argmin(self.pelvis_m[:, 1]) / CLIP_HZ])

    def highest_s(self) -> np.ndarray:
        """Return the time (1,) at which the pelvis is highest."""
        return np.array([self.capture.start_s + np.argmax(self.pelvis_m[:, 1]) / CLIP_HZ])

    def bones(self, times_s: np.ndarray) -> np.ndarray:
        """Return T_world_rest (t, b, 4, 4): the transform of each bone from the rest pose to the world over time."""
        return pose_bones(self.person.body, self.posture(times_s))

    def posture(self, times_s: np.ndarray) -> Posture:
        """Return the posture at times (t,). Raises ValueError for a time before or after the movement."""
        body, capture = self.person.body, self.capture
        at = _Resampler(capture, times_s)
        pelvis = at.turn(capture.pelvis)
        trunk = _bend(pelvis, at.turn(capture.thorax), TRUNK_LIMITS)
        thorax = pelvis @ _bend_turn(trunk)
        arms, axis = unit(at.value(capture.arms)), at.value(capture.arm_axis)
        elbow = np.arccos(np.clip((arms[:, :, 0] * arms[:, :, 1]).sum(axis=2), -1.0, 1.0))
        balls_m = body.bone_heads[[body.asset.bone(f"{side}ToeBase") for side in SIDES]]
        zero, goals = np.zeros((len(times_s), 2)), HandGoals.none(len(times_s))
        return Posture(
            pelvis_m=at.value(self.pelvis_m),
            pelvis_turn=pelvis,
            trunk=trunk,
            head=_bend(thorax, _head_turn(thorax, at.value(capture.head)), HEAD_LIMITS),
            ball_m=at.value(self.ball_m) + UP * balls_m[:, 1:2],
            foot_yaw=at.value(self.foot_yaw),
            heel_lift=at.value(self.heel),
            knee_out=zero,
            shoulder=np.stack([_swing(thorax, arms[:, side, 0], side) for side in (0, 1)], axis=1),
            elbow=elbow,
            pronation=zero,
            wrist=zero,
            fingers=zero + FINGERS_RAD,
            hand_m=goals.wrist_m,
            hand_turn=goals.turn,
            pull=zero,
            captured=Captured(
                arms=np.stack([_arm(body, side, arms[:, side], axis[:, side], elbow[:, side]) for side in (0, 1)], 1),
                knees=_knee_directions(pelvis, at.value(capture.legs), at.value(capture.knee_m)),
                straight_leg=STRAIGHT_LEG,
            ),
        )


class _Resampler:
    """A linear interpolation of a captured movement's arrays, which have rows at CLIP_HZ, at given times."""

    def __init__(self, capture: Capture, times_s: np.ndarray) -> None:
        place = (np.asarray(times_s) - capture.start_s) * CLIP_HZ
        last = len(capture.waist_m) - 1
        rounded = place.round(6)  # because of rounding, the last time may lie slightly after the last row
        if rounded.min() < 0.0 or rounded.max() > last:
            raise ValueError(f"the movement lasts {last / CLIP_HZ:.1f} s from {capture.start_s:.1f} s on")
        self.row = np.minimum(place.astype(np.int64), last - 1)
        self.share = place - self.row

    def value(self, rows: np.ndarray) -> np.ndarray:
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        return np.asarray((1.0 - share) * rows[self.row] + share * rows[self.row + 1])

    def turn(self, rows: np.ndarray) -> np.ndarray:
        columns = self.value(rows)
        return np.asarray(orthonormal_frame(columns[..., 1], columns[..., 2]) @ _UP_RIGHT.T)


def retarget(person: Person, capture: Capture) -> CapturedActor:
    """Return the captured movement, done by a person who faces +X. Standing feet are on the floor and do not move."""
    body = person.body
    hips_m, lengths_m, back = _legs(body)
    scale = float(lengths_m.sum(axis=1).mean()) / capture.leg_m
    reach = rotate(capture.pelvis[:, None], hips_m) + np.einsum("sk,nskj->nsj", lengths_m, capture.legs)
    free = scale * capture.waist_m[:, None] * [1.0, 0.0, 1.0] + reach  # ankles, not yet placed on the floor
    foot_m = float(np.hypot(back[:, 0], back[:, 2]).mean())
    feet = find_footing(free, scale * capture.ankle_m[..., 1], capture.toes, foot_m)
    heading, sole_m = turns_about(UP, feet.yaw), _sole_m(body)
    risen = rotate(heading @ turns_about(RIGHT, -feet.heel), back) - rotate(heading, back)
    pelvis = _carried_pelvis(feet, feet.place_m + sole_m + risen - reach)
    feet = _swung(feet, pelvis[:, None] + reach - sole_m)
    pitch = _hanging_pitch(capture, feet, foot_m)
    ball = feet.place_m - rotate(heading @ turns_about(RIGHT, -pitch), back)
    ball[..., 1] += back[:, 1]
    shift = ball_ahead_m(body) * FORWARD - np.median(ball, axis=0).mean(axis=0) * [1.0, 0.0, 1.0]
    return CapturedActor(person, capture, pelvis + shift, ball + shift, feet.yaw, feet.heel + pitch)


def _legs(body: BodyMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vectors (2, 3) from the pelvis to the hips, lengths (2, 2) of thigh and shank, and vectors (2, 3) from the
    balls of the feet to the ankles.
    """
    heads, bone = body.bone_heads, body.asset.bone
    hip, knee, ankle, ball = (
        np.array([heads[bone(f"{side}{name}")] for side in SIDES]) for name in ("UpLeg", "Leg", "Foot", "ToeBase")
    )
    lengths = np.stack([np.linalg.norm(knee - hip, axis=1), np.linalg.norm(ankle - knee, axis=1)], axis=1)
    return hip - heads[bone("Hips")], lengths, ankle - ball


def _sole_m(body: BodyMesh) -> np.ndarray:
    """Return the vectors (2, 3) from the floor up to the ankles of flat feet."""
    return np.array([body.bone_heads[body.asset.bone(f"{side}Foot"), 1] * UP for side in SIDES])


def _carried_pelvis(feet: Footing, wanted_m: np.ndarray) -> np.ndarray:
    """Return the position of the pelvis (n, 3): the mean of ``wanted_m``, weighted by ``feet.stands`` and smoothed.
    wanted_m (n, 2, 3): the position of the pelvis at which the left leg ends at the left foot, and the position at
    which the right leg ends at the right foot.
    """
    weight = np.maximum(feet.stands, 1e-3)[..., None]
    pelvis = (weight * wanted_m).sum(axis=1) / weight.sum(axis=1)
    return gaussian_filter1d(pelvis, PELVIS_S * CLIP_HZ, axis=0, mode="nearest")


def _swung(feet: Footing, leg_end_m: np.ndarray) -> Footing:
    """Move feet in the air to the ends of the legs (n, 2, 3), but not below half of ``STEP_HEIGHT_M``, or below their
    present height if that is less. Then lower both feet until one foot is on the floor.
    """
    place = feet.place_m + (1.0 - feet.stands)[..., None] * (leg_end_m - feet.place_m)
    least_m = np.minimum(feet.place_m[..., 1], 0.5 * STEP_HEIGHT_M)
    place[..., 1] = np.maximum(place[..., 1], least_m)
    place[..., 1] -= place[..., 1].min(axis=1, keepdims=True)  # the lower foot is on the floor: nobody jumps
    return replace(feet, place_m=place)


def _hanging_pitch(capture: Capture, feet: Footing, foot_m: float) -> np.ndarray:
    """Return the pitch (n, 2) of each foot about its ankle, radians, 0 = flat, positive with toes down. A foot at least
    ``AIR_M`` above the floor keeps its angle to the shank, unless its toes would touch the floor.
    """
    shank = capture.legs[:, :, 1]
    ahead = shank[..., 0] * np.cos(feet.yaw) - shank[..., 2] * np.sin(feet.yaw)
    pitch = TOES_DOWN_RAD - np.arctan2(ahead, -shank[..., 1])
    # pitch at which the toes of a foot in the air would touch the floor
    deepest = np.arcsin(np.clip(feet.place_m[..., 1] / foot_m, 0.0, 1.0))
    return np.asarray(ease(feet.place_m[..., 1] / AIR_M) * np.minimum(pitch, deepest))


def _knee_directions(pelvis: np.ndarray, legs: np.ndarray, knee_m: np.ndarray) -> np.ndarray:
    """Return the directions (t, 2, 3) in which the knees point: as captured if the knees are clearly bent, else
    straight ahead.
    """
    along = legs.sum(axis=2)
    forward = unit(np.cross(pelvis[:, None, :, 2], along))
    off_m = np.linalg.norm(knee_m, axis=2, keepdims=True)
    shown = knee_m / np.maximum(off_m, 1e-9)
    agrees = np.clip(2.0 * (shown * forward).sum(axis=2, keepdims=True), 0.0, 1.0)
    return np.asarray(forward + ease(off_m / KNEE_SHOWS_M) * agrees * (shown - forward))


def _bend(parent: np.ndarray, child: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """Return the rotation ``child`` relative to ``parent`` as angles (t, 3), rad, clipped to the limits: bend forward,
    bend to the right, turn to the left.
    """
    vector = Rotation.from_matrix(np.swapaxes(parent, -1, -2) @ child).as_rotvec()
    return np.asarray(np.stack([-vector[:, 2], vector[:, 0], vector[:, 1]], axis=1).clip(*limits))


def _bend_turn(bend: np.ndarray) -> np.ndarray:
    """Return the rotation (t, 3, 3) for angles (t, 3), rad: bend forward, bend to the right, turn to the left."""
    return turns(np.stack([bend[:, 1], bend[:, 2], -bend[:, 0]], axis=1))


def _head_turn(thorax: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the head's rotation (t, 3, 3): its top points along ``up``, and it faces the same way as the thorax."""
    return np.asarray(orthonormal_frame(up, thorax[:, :, 2]) @ _UP_RIGHT.T)


def _swing(thorax: np.ndarray, upper: np.ndarray, side: int) -> np.ndarray:
    """Return shoulder angles (t, 3), rad, of an upper arm that points along ``upper`` (t, 3): flexion, abduction, and 0
    for the rotation about the arm.
    """
    local = rotate(np.swapaxes(thorax, -1, -2), upper)
    axis = np.cross(-UP, local)
    sine = np.linalg.norm(axis, axis=1)
    swing = np.arctan2(sine, -local[:, 1])[:, None] * axis / np.maximum(sine, 1e-9)[:, None]
    return np.stack([swing[:, 2], -OUTWARD[side] * swing[:, 0], np.zeros(len(swing))], axis=1)


def _arm(body: BodyMesh, side: int, arm: np.ndarray, axis: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Return world rotations (t, 2, 3, 3) of upper arm and forearm, which point along ``arm`` (t, 2, 3).

    axis (t, 3): axis of the elbow; elbow (t,): its flexion, rad.
    """
    name = SIDES[side]
    limb = rest_limb(body, (f"{name}Arm", f"{name}ForeArm", f"{name}Hand"))
    upper = orthonormal_frame(arm[:, 0], axis) @ orthonormal_frame(limb.first, limb.axis).T
    return np.stack([upper, upper @ turns_about(limb.axis, elbow.clip(*ELBOW_LIMITS) - limb.rest_bend)], axis=1)
