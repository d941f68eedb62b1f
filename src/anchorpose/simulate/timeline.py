"""Lay out smooth movements and steps in time, and compute the posture of patients and therapists from them.

A channel is one number of a posture over time, such as a joint angle (radians) or a shift of the pelvis (metres).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.kinematics import BodyMesh
from anchorpose.rotations import UP, turns, turns_about
from anchorpose.simulate.carried_pelvis import knee_bend
from anchorpose.simulate.posture import OUTWARD, Posture

TRUNK_CHANNELS = (
    "pelvis_forward",
    "pelvis_up",
    "pelvis_right",
    "pelvis_flex",
    "pelvis_side",
    "pelvis_turn",
    "trunk_flex",
    "trunk_side",
    "trunk_turn",
    "head_flex",
    "head_side",
    "head_turn",
)
SIDE_CHANNELS = (
    "shoulder_flex",
    "shoulder_abduct",
    "shoulder_inward",
    "elbow",
    "pronate",
    "wrist",
    "fingers",
    "knee_out",
    "heel",
    "pull",
    "knee",
    "carry",
)
CHANNELS = (*TRUNK_CHANNELS, *(f"{name}_{side}" for side in ("left", "right") for name in SIDE_CHANNELS))
CHANNEL_INDEX = {name: index for index, name in enumerate(CHANNELS)}

STEP_HEIGHT_M = 0.07  # m, height to which a step raises the ball of the foot
TOE_OFF_RAD = 0.5  # rad, maximum rotation of the foot in a step, by which the heel rises
BODY_LAG_S = 0.3  # s, half the window over which the trunk's path is smoothed: a trunk moves more evenly than feet
WALK_STEP_S = 0.5  # s, duration of a walking step

ELBOW_LIMITS = (0.12, 2.5)  # rad of flexion: from nearly straight to the hand at the shoulder
SHOULDER_LIMITS = (-0.9, 3.0)
TRUNK_LIMITS = (-0.6, 1.3)
HEAD_LIMITS = (-1.2, 1.2)
ARM_SWING = 1.1  # rad of shoulder flexion for each metre by which the opposite foot is in front of the body


@dataclass(frozen=True, slots=True)
class Movement:
    """Offsets that a movement adds to some channels. The offsets grow from 0, stay, and return to 0."""

    # each channel that the movement changes, and its offset in metres or radians
    offsets: tuple[tuple[str, float], ...]
    start_s: float
    rise_s: float  # s, time in which the offsets grow
    hold_s: float  # s, time for which the offsets stay
    fall_s: float  # s, time in which the offsets return to 0

    @property
    def end_s(self) -> float:
        """Return the time at which the movement ends."""
        return self.start_s + self.rise_s + self.hold_s + self.fall_s

    def strength(self, times_s: np.ndarray) -> np.ndarray:
        """Return the share (t,) of the offsets that applies at each time, 0 to 1."""
        coming = self.coming((times_s - self.start_s) / self.rise_s)
        return coming - ease((times_s - self.start_s - self.rise_s - self.hold_s) / self.fall_s)

    def coming(self, x: np.ndarray) -> np.ndarray:
        """Return the share (t,) of the offsets that applies at x (t,), growing from 0 to 1. x: the time since the
        start, divided by ``rise_s``, the time in which the offsets grow.
        """
        return ease(x)


@dataclass(frozen=True, slots=True)
class Step:
    """A step of one foot."""

    side: int  # 0 = left, 1 = right
    start_s: float
    duration_s: float
    place_m: tuple[float, float]  # x and z of the ball of the foot after the step
    yaw: float  # rad, direction of the foot after the step


@dataclass(frozen=True, slots=True, eq=False)
class Footwork:
    """The initial stance of the feet, and the steps, sorted by time."""

    places_m: np.ndarray  # (2, 2) x and z of the ball of the left and the right foot
    yaws: np.ndarray  # (2,) rad, directions of the feet
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FootTrack:
    """The path of both feet over time."""

    ball_m: np.ndarray  # (t, 2, 3) ball of each foot; y is its lift above the floor
    yaw: np.ndarray  # (t, 2) rad, directions of the feet
    heel: np.ndarray  # (t, 2) rad, rotation that raises the heel


def ease(x: np.ndarray) -> np.ndarray:
    """Return the minimum-jerk curve at x, 0 to 1 (Flash and Hogan 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985)."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def channel_values(base: np.ndarray, movements: list[Movement], times_s: np.ndarray) -> np.ndarray:
    """Return the channels' values (c, t): the values at rest ``base`` (c,) plus the offsets of all movements."""
    values = np.repeat(base[:, None], len(times_s), axis=1)
    for movement in movements:
        strength = movement.strength(times_s)
        for channel, amount in movement.offsets:
            values[CHANNEL_INDEX[channel]] += amount * strength
    return values


def foot_track(footwork: Footwork, times_s: np.ndarray) -> FootTrack:
    """Return the path of both feet at the given times. A foot does not move between its steps."""
    ball = np.zeros((len(times_s), 2, 3))
    ball[:, :, [0, 2]] = footwork.places_m
    yaw = np.tile(footwork.yaws, (len(times_s), 1))
    heel = np.zeros((len(times_s), 2))
    places, yaws = footwork.places_m.copy(), footwork.yaws.copy()
    for step in footwork.steps:
        x = np.clip((times_s - step.start_s) / step.duration_s, 0.0, 1.0)
        done, side = ease(x), step.side
        ball[:, side, [0, 2]] += done[:, None] * (np.array(step.place_m) - places[side])
        ball[:, side, 1] += STEP_HEIGHT_M * np.sin(np.pi * done) ** 2
        yaw[:, side] += done * (step.yaw - yaws[side])
        heel[:, side] += TOE_OFF_RAD * np.sin(np.pi * np.sqrt(done)) ** 2
        places[side], yaws[side] = step.place_m, step.yaw
    return FootTrack(ball, yaw, heel)


def body_course(footwork: Footwork, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the body's place (t, 2), x and z, and the direction (t,) that it faces, radians to the left of +X. Place
    and direction are the means of both feet, smoothed over time.
    """
    weights = np.hanning(9)[1:-1]
    place, yaw = np.zeros((len(times_s), 2)), np.zeros(len(times_s))
    for weight, lag in zip(weights / weights.sum(), np.linspace(-BODY_LAG_S, BODY_LAG_S, len(weights)), strict=True):
        track = foot_track(footwork, times_s + lag)
        place += weight * track.ball_m[:, :, [0, 2]].mean(axis=1)
        yaw += weight * track.yaw.mean(axis=1)
    return place, yaw


def walk(footwork: Footwork, goal_m: np.ndarray, facing: float, start_s: float, stance_m: float) -> Footwork:
    """Append a walk to ``footwork``: straight to ``goal_m`` (x, z); the last steps turn to ``facing``."""
    places, yaws = final_stance(footwork)
    here = places.mean(axis=0)
    gap = goal_m - here
    distance = float(np.linalg.norm(gap))
    count = max(4, int(np.ceil(distance / 0.42)) + 2)
    course = yaw_towards(here, goal_m) if distance > 0.3 else facing
    course = yaws.mean() + _wrap(course - yaws.mean())
    facing = course + _wrap(facing - course)
    first = int(np.argmin(places @ np.array([np.cos(course), -np.sin(course)])))
    steps = []
    for k in range(count):
        side = (first + k) % 2
        heading = course + (facing - course) * float(ease(np.array((k - count + 4) / 2.0)))
        middle = here + gap * min(1.0, (k + 1) / (count - 2))
        place = stance_places(middle, heading, stance_m)[side]
        steps.append(Step(side, start_s + k * WALK_STEP_S, WALK_STEP_S, (float(place[0]), float(place[1])), heading))
    return Footwork(footwork.places_m, footwork.yaws, (*footwork.steps, *steps))


def walk_seconds(footwork: Footwork, goal_m: np.ndarray, facing: float, stance_m: float) -> float:
    """Return the duration of the walk that ``walk`` would append."""
    return (len(walk(footwork, goal_m, facing, 0.0, stance_m).steps) - len(footwork.steps)) * WALK_STEP_S


def walk_until(footwork: Footwork, goal_m: np.ndarray, facing: float, at_s: float, stance_m: float) -> Footwork:
    """Append a walk to ``footwork`` that arrives at the time ``at_s``."""
    return walk(footwork, goal_m, facing, at_s - walk_seconds(footwork, goal_m, facing, stance_m), stance_m)


def yaw_towards(here_m: np.ndarray, there_m: np.ndarray) -> float:
    """Return the direction from one place (x, z) to another, radians to the left of +X."""
    gap = there_m - here_m
    return float(np.arctan2(-gap[1], gap[0]))


def final_stance(footwork: Footwork) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (2, 2), x and z, and the directions (2,), radians to the left of +X, of the feet after the last
    step.
    """
    places, yaws = footwork.places_m.copy(), footwork.yaws.copy()
    for step in footwork.steps:
        places[step.side], yaws[step.side] = step.place_m, step.yaw
    return places, yaws


def stand(middle_m: np.ndarray, yaw: float, stance_m: float) -> Footwork:
    """Return the stance of a person who stands at ``middle_m`` (x, z) and faces ``yaw``, without steps."""
    return Footwork(stance_places(middle_m, yaw, stance_m), np.full(2, yaw))


def stance_places(middle_m: np.ndarray, yaw: float, stance_m: float) -> np.ndarray:
    """Return the places (2, 2), x and z, of left and right foot of a person at ``middle_m`` who faces ``yaw``."""
    right = np.array([np.sin(yaw), np.cos(yaw)])
    return middle_m + np.array([[-0.5], [0.5]]) * stance_m * right


def _wrap(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


@dataclass(frozen=True, slots=True, eq=False)
class HandGoals:
    """The place and rotation to which each hand is pulled while it holds something."""

    wrist_m: np.ndarray  # (t, 2, 3) place of the wrist
    turn: np.ndarray  # (t, 2, 3, 3) rotation of the hand from rest

    @staticmethod
    def none(times: int) -> HandGoals:
        """Return placeholder goals, which have no effect on hands that hold nothing."""
        return HandGoals(np.zeros((times, 2, 3)), np.tile(np.eye(3), (times, 2, 1, 1)))


def standing_pelvis_m(body: BodyMesh) -> float:
    """Return the height of the pelvis's centre above the floor in the rest pose."""
    return float(body.bone_heads[body.asset.bone("Hips"), 1])


def ball_ahead_m(body: BodyMesh) -> float:
    """Return the distance in x from the pelvis to the ball of the left foot, in the rest pose."""
    return float(body.bone_heads[body.asset.bone("LeftToeBase"), 0] - body.bone_heads[body.asset.bone("Hips"), 0])


def posture_from(
    body: BodyMesh, channels: np.ndarray, footwork: Footwork, times_s: np.ndarray, goals: HandGoals
) -> Posture:
    """Return the posture at ``times_s`` (t,) for the channels' values (c, t), the steps and the hands' goals."""
    feet = foot_track(footwork, times_s)
    place, yaw = body_course(footwork, times_s)
    pelvis_m, pelvis_turn = _pelvis(body, channels, place, yaw)
    balls_m = body.bone_heads[[body.asset.bone("LeftToeBase"), body.asset.bone("RightToeBase")]]
    stride_m = np.einsum(
        "tsi,ti->ts", feet.ball_m[:, ::-1, [0, 2]] - place[:, None], np.stack([np.cos(yaw), -np.sin(yaw)], axis=1)
    )
    flexion = _both(channels, "shoulder_flex") + ARM_SWING * stride_m
    shoulder = np.stack([flexion, _both(channels, "shoulder_abduct"), _both(channels, "shoulder_inward")], axis=2)
    return Posture(
        pelvis_m=pelvis_m,
        pelvis_turn=pelvis_turn,
        trunk=_three(channels, "trunk").clip(*TRUNK_LIMITS),
        head=_three(channels, "head").clip(*HEAD_LIMITS),
        ball_m=feet.ball_m + UP * balls_m[:, 1:2],
        foot_yaw=feet.yaw - OUTWARD * 0.05,
        heel_lift=feet.heel + _both(channels, "heel").clip(0.0, 1.0),
        knee_out=_both(channels, "knee_out"),
        shoulder=shoulder.clip(*SHOULDER_LIMITS),
        elbow=_both(channels, "elbow").clip(*ELBOW_LIMITS),
        pronation=_both(channels, "pronate"),
        wrist=_both(channels, "wrist"),
        fingers=_both(channels, "fingers"),
        hand_m=goals.wrist_m,
        hand_turn=goals.turn,
        pull=_both(channels, "pull").clip(0.0, 1.0),
        knees=knee_bend(_both(channels, "knee"), _both(channels, "carry"), feet.ball_m[:, :, 1] / STEP_HEIGHT_M),
    )


def _pelvis(body: BodyMesh, channels: np.ndarray, place: np.ndarray, yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the position (t, 3) of the pelvis, and its rotation from rest (t, 3, 3). The body is at ``place`` (t, 2)
    and faces ``yaw`` (t,).
    """

    def channel(name: str) -> np.ndarray:
        return np.asarray(channels[CHANNEL_INDEX[f"pelvis_{name}"]])

    heading = turns_about(UP, yaw)
    offset = np.stack([channel("forward") - ball_ahead_m(body), channel("up"), channel("right")], axis=1)
    floor = np.stack([place[:, 0], np.full(len(yaw), standing_pelvis_m(body)), place[:, 1]], axis=1)
    lean = np.stack([channel("side"), channel("turn"), -channel("flex")], axis=1)
    return floor + np.einsum("tij,tj->ti", heading, offset), heading @ turns(lean)


def _both(channels: np.ndarray, name: str) -> np.ndarray:
    """Return the values (t, 2) of one channel for both sides, left first."""
    return np.stack([channels[CHANNEL_INDEX[f"{name}_left"]], channels[CHANNEL_INDEX[f"{name}_right"]]], axis=1)


def _three(channels: np.ndarray, name: str) -> np.ndarray:
    """Return three channels of trunk or head, (t, 3): bend forward, bend to the right, turn to the left."""
    return np.stack([channels[CHANNEL_INDEX[f"{name}_{way}"]] for way in ("flex", "side", "turn")], axis=1)
