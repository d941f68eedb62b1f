"""From channels and feet to a posture: the step that patients and therapists share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.kinematics import ShapedBody
from anchorpose.rotations import UP, turns, turns_about
from anchorpose.simulate.posture import OUTWARD, Posture
from anchorpose.simulate.timeline import CHANNEL_INDEX, Footwork, body_course, foot_track

ELBOW_LIMITS = (0.12, 2.5)  # radians: nearly straight to hand at the shoulder
SHOULDER_LIMITS = (-0.9, 3.0)
TRUNK_LIMITS = (-0.6, 1.3)
HEAD_LIMITS = (-1.2, 1.2)
ARM_SWING = 1.1  # radians a metre that the opposite foot is ahead


@dataclass(frozen=True, slots=True, eq=False)
class HandGoals:
    """Where each hand goes while it is pulled: wrist (t, 2, 3) metres and turn of the hand from rest (t, 2, 3, 3)."""

    wrist_m: np.ndarray
    turn: np.ndarray

    @staticmethod
    def none(times: int) -> HandGoals:
        """For people who hold nothing."""
        return HandGoals(np.zeros((times, 2, 3)), np.tile(np.eye(3), (times, 2, 1, 1)))


def standing_pelvis_m(body: ShapedBody) -> float:
    """Height of the pelvis's centre above the floor in the rest pose."""
    return float(body.bone_heads[body.asset.bone("Hips"), 1])


def ball_ahead_m(body: ShapedBody) -> float:
    """How far the balls of the feet are ahead of the pelvis in upright standing."""
    return float(body.bone_heads[body.asset.bone("LeftToeBase"), 0] - body.bone_heads[body.asset.bone("Hips"), 0])


def posture_from(
    body: ShapedBody, channels: np.ndarray, footwork: Footwork, times_s: np.ndarray, goals: HandGoals
) -> Posture:
    """The posture at ``times_s`` (t,) for channels (c, t)."""
    feet = foot_track(footwork, times_s)
    place, yaw = body_course(footwork, times_s)

    def channel(name: str) -> np.ndarray:
        return channels[CHANNEL_INDEX[name]]

    def both(name: str) -> np.ndarray:
        return np.stack([channel(f"{name}_left"), channel(f"{name}_right")], axis=1)

    heading = turns_about(UP, yaw)
    balls_m = body.bone_heads[[body.asset.bone("LeftToeBase"), body.asset.bone("RightToeBase")]]
    ball_m = feet.ball_m + UP * balls_m[:, 1:2]
    offset = np.stack(
        [channel("pelvis_forward") - ball_ahead_m(body), channel("pelvis_up"), channel("pelvis_right")], axis=1
    )
    floor = np.stack([place[:, 0], np.full(len(times_s), standing_pelvis_m(body)), place[:, 1]], axis=1)
    lean = np.stack([channel("pelvis_side"), channel("pelvis_turn"), -channel("pelvis_flex")], axis=1)

    stride_m = np.einsum(
        "tsi,ti->ts", feet.ball_m[:, ::-1, [0, 2]] - place[:, None], np.stack([np.cos(yaw), -np.sin(yaw)], axis=1)
    )
    flexion = both("shoulder_flex") + ARM_SWING * stride_m
    shoulder = np.stack([flexion, both("shoulder_abduct"), both("shoulder_inward")], axis=2)
    return Posture(
        pelvis_m=floor + np.einsum("tij,tj->ti", heading, offset),
        pelvis_turn=heading @ turns(lean),
        trunk=np.stack([channel(f"trunk_{k}") for k in ("flex", "side", "turn")], axis=1).clip(*TRUNK_LIMITS),
        head=np.stack([channel(f"head_{k}") for k in ("flex", "side", "turn")], axis=1).clip(*HEAD_LIMITS),
        ball_m=ball_m,
        foot_yaw=feet.yaw - OUTWARD * 0.05,
        heel_lift=feet.heel + both("heel").clip(0.0, 1.0),
        knee_out=both("knee_out"),
        shoulder=shoulder.clip(*SHOULDER_LIMITS),
        elbow=both("elbow").clip(*ELBOW_LIMITS),
        pronation=both("pronate"),
        wrist=both("wrist"),
        fingers=both("fingers"),
        hand_m=goals.wrist_m,
        hand_turn=goals.turn,
        pull=both("pull").clip(0.0, 1.0),
    )
