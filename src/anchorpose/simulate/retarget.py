"""A captured movement on another body: the segments' directions are the subject's, all lengths the patient's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.body.kinematics import BodyMesh
from anchorpose.rotations import FORWARD, RIGHT, UP, orthonormal_frame, rotate, unit
from anchorpose.simulate.capture import Capture, lay_out
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.movement_file import CLIP_HZ, read_clips
from anchorpose.simulate.person import Person
from anchorpose.simulate.posture import OUTWARD, SIDES, Posture, pose_bones, rest_limb
from anchorpose.simulate.timeline import ELBOW_LIMITS, HEAD_LIMITS, STEP_HEIGHT_M, TRUNK_LIMITS, HandGoals, ease

MARGIN_S: Final = 3.0  # before and after the recording, for cameras whose clocks are wrong
LIFT_FROM_M, LIFT_OVER_M = 0.06, 0.06  # Kinect's ankles of standing feet rise and fall by up to 6 cm
MOVING_M_S: Final = 0.30  # faster ankles leave the floor
SHORTEST_STAND_S: Final = 0.25
SAME_PLACE_M: Final = 0.08  # a foot that comes down so near to where it stood has not moved
EASE_S: Final = 0.15  # into and out of a stand
KNEE_SHOWS_M: Final = 0.05  # a knee so far off the line from hip to ankle shows which way it points
KNEE_OUT_LIMITS: Final = (-0.3, 0.8)
HEEL_LIMIT_RAD: Final = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class CapturedActor:
    """A person who does a captured movement. The second axis of limbs is the side; n rows at CLIP_HZ.

    pelvis_m (n, 3); ball_m (n, 2, 3) with the height above the floor as y; foot_yaw (n, 2); heel (n, 2).
    """

    person: Person
    capture: Capture
    pelvis_m: np.ndarray
    ball_m: np.ndarray
    foot_yaw: np.ndarray
    heel: np.ndarray

    def sits(self) -> bool:
        """Whether the person comes down to the height of a seat."""
        knee_m = self.person.body.bone_heads[self.person.body.asset.bone("LeftLeg"), 1]
        return bool(self.pelvis_m[:, 1].min() < SEATED_KNEES * knee_m)

    def lowest_s(self) -> np.ndarray:
        """(1,) when the pelvis is lowest."""
        return np.array([self.capture.start_s + np.argmin(self.pelvis_m[:, 1]) / CLIP_HZ])

    def bones(self, times_s: np.ndarray) -> np.ndarray:
        """(t, b, 4, 4) T_world_rest."""
        return pose_bones(self.person.body, self.posture(times_s))

    def posture(self, times_s: np.ndarray) -> Posture:
        """The posture at times (t,) within the movement."""
        body, capture = self.person.body, self.capture
        at = _Resampler(capture, times_s)
        pelvis, thorax = at.turn(capture.pelvis), at.turn(capture.thorax)
        yaw = at.value(self.foot_yaw)
        arms, axis = unit(at.value(capture.arms)), at.value(capture.arm_axis)
        trunk = _bend(pelvis, thorax, TRUNK_LIMITS)
        thorax = pelvis @ _bend_turn(trunk)
        head = _bend(thorax, _head_turn(thorax, unit(at.value(capture.head))), HEAD_LIMITS)
        shoulder = np.stack([_swing(thorax, arms[:, side, 0], side) for side in (0, 1)], axis=1)
        elbow = np.arccos(np.clip((arms[:, :, 0] * arms[:, :, 1]).sum(axis=2), -1.0, 1.0))
        turns = [_arm_turns(body, side, arms[:, side, 0], axis[:, side], elbow[:, side]) for side in (0, 1)]
        balls_m = body.bone_heads[[body.asset.bone(f"{side}ToeBase") for side in SIDES]]
        free = np.zeros((len(times_s), 2))
        goals = HandGoals.none(len(times_s))
        return Posture(
            pelvis_m=at.value(self.pelvis_m),
            pelvis_turn=pelvis,
            trunk=trunk,
            head=head,
            ball_m=at.value(self.ball_m) + UP * balls_m[:, 1:2],
            foot_yaw=yaw,
            heel_lift=at.value(self.heel),
            knee_out=_knee_out(at.value(capture.knee_m), yaw),
            shoulder=shoulder,
            elbow=elbow,
            pronation=free,
            wrist=free,
            fingers=free + 0.25,
            hand_m=goals.wrist_m,
            hand_turn=goals.turn,
            pull=free,
            arm_turns=np.stack(turns, axis=1),
        )


SEATED_KNEES: Final = 1.35  # times the height of the knees: a pelvis below it is on a seat


class _Resampler:
    """Rows at CLIP_HZ interpolated to times; times outside are an error."""

    def __init__(self, capture: Capture, times_s: np.ndarray) -> None:
        place = (np.asarray(times_s) - capture.start_s) * CLIP_HZ
        last = len(capture.waist_m) - 1
        if place.min() < 0.0 or place.max() > last:
            raise ValueError(f"the movement lasts {last / CLIP_HZ:.1f} s from {capture.start_s:.1f} s on")
        self.row = np.minimum(place.astype(np.int64), last - 1)
        self.share = place - self.row

    def value(self, rows: np.ndarray) -> np.ndarray:
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        return np.asarray((1.0 - share) * rows[self.row] + share * rows[self.row + 1])

    def turn(self, rows: np.ndarray) -> np.ndarray:
        columns = self.value(rows)
        return orthonormal_frame(columns[..., 1], columns[..., 2]) @ _UP_RIGHT.T


_UP_RIGHT: Final = orthonormal_frame(UP, RIGHT)


def retarget(person: Person, capture: Capture) -> CapturedActor:
    """The movement with the person's own lengths; feet that stand do not move, and stand on the floor."""
    body = person.body
    heads, bone = body.bone_heads, body.asset.bone
    hips_m, lengths_m = [], []
    for side in SIDES:
        hip, knee, ankle = (heads[bone(f"{side}{name}")] for name in ("UpLeg", "Leg", "Foot"))
        hips_m.append(hip - heads[bone("Hips")])
        lengths_m.append([np.linalg.norm(knee - hip), np.linalg.norm(ankle - knee)])
    hips = rotate(capture.pelvis[:, None], np.array(hips_m))
    reach = hips + np.einsum("sk,nskj->nsj", np.array(lengths_m), capture.legs)  # pelvis to ankle
    scale = float(np.mean(np.sum(lengths_m, axis=1))) / capture.leg_m
    waist = scale * capture.waist_m * [1.0, 0.0, 1.0]

    lift = scale * _lift(capture.ankle_m)
    free = waist[:, None] + reach  # ankles if nothing held them
    stands = [_stands(free[:, side], lift[:, side]) for side in (0, 1)]
    place = np.stack([_places(free[:, side], stands[side]) for side in (0, 1)], axis=1)
    weight = np.stack([_weights(stand, len(free)) for stand in stands], axis=1)
    lift = np.maximum(lift * (1.0 - weight), _step_lift(place, weight))

    rest_m = np.array([heads[bone(f"{side}Foot"), 1] for side in SIDES])
    heel = _heel_lift(lift)
    yaw = np.stack([_yaws(capture.toes[:, side], stands[side]) for side in (0, 1)], axis=1)
    back = np.array([heads[bone(f"{side}Foot")] - heads[bone(f"{side}ToeBase")] for side in SIDES])
    carried = np.maximum(weight, 1e-3)[..., None]
    wanted = place * [1.0, 0.0, 1.0] + UP * (rest_m + lift)[..., None]
    pelvis = (carried * (wanted - reach)).sum(axis=1) / carried.sum(axis=1)
    pelvis = gaussian_filter1d(pelvis, 0.06 * CLIP_HZ, axis=0, mode="nearest")
    ball = wanted - np.stack(
        [
            np.cos(yaw) * back[:, 0] + np.sin(yaw) * back[:, 2],
            0.0 * yaw,
            np.cos(yaw) * back[:, 2] - np.sin(yaw) * back[:, 0],
        ],
        axis=2,
    )
    ball[..., 1] = lift
    middle = np.median(pelvis, axis=0) * [0, 0, 0] + np.median(ball, axis=0).mean(axis=0) * [1, 0, 1]
    ahead = np.array([heads[bone("LeftToeBase"), 0] - heads[bone("Hips"), 0], 0.0, 0.0])
    shift = ahead - middle
    return CapturedActor(person, capture, pelvis + shift, ball + shift, yaw, heel)


def _lift(ankle_m: np.ndarray) -> np.ndarray:
    """(n, 2) how high the ankles (n, 2, 3) are above where they stand; 0 within what Kinect's ankles waver."""
    height = ankle_m[..., 1] - np.percentile(ankle_m[..., 1], 20.0, axis=0)
    return np.asarray(height * ease((height - LIFT_FROM_M) / LIFT_OVER_M))


def _stands(ankle_m: np.ndarray, lift_m: np.ndarray) -> list[tuple[int, int]]:
    """Spans of rows (from, until) in which a foot stands still; ankle_m (n, 3), lift_m (n,)."""
    speed = np.linalg.norm(np.gradient(gaussian_filter1d(ankle_m[:, [0, 2]], 2.0, axis=0), axis=0), axis=1) * CLIP_HZ
    still = (speed < MOVING_M_S) & (lift_m < 0.01)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int64)))
    spans = [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= SHORTEST_STAND_S * CLIP_HZ]
    merged: list[tuple[int, int]] = []
    for a, b in spans or [(0, len(ankle_m))]:
        if merged:
            before = np.median(ankle_m[merged[-1][0] : merged[-1][1]], axis=0)
            near = np.linalg.norm((np.median(ankle_m[a:b], axis=0) - before)[[0, 2]]) < SAME_PLACE_M
            if near and lift_m[merged[-1][1] : a].max(initial=0.0) < 0.03:
                merged[-1] = (merged[-1][0], b)
                continue
        merged.append((a, b))
    return merged


def _weights(stands: list[tuple[int, int]], rows: int) -> np.ndarray:
    """(n,) 1 while the foot stands, 0 while it is on its way, eased."""
    row, weight = np.arange(rows), np.zeros(rows)
    fade = EASE_S * CLIP_HZ
    for a, b in stands:
        came = np.ones(rows) if a == 0 else ease((row - a) / fade + 1.0)
        goes = np.ones(rows) if b == rows else ease((b - 1 - row) / fade + 1.0)
        weight = np.maximum(weight, came * goes)
    return weight


def _places(ankle_m: np.ndarray, stands: list[tuple[int, int]]) -> np.ndarray:
    """(n, 3) the ankle's course, still while the foot stands; on its way shifted so as to begin and end there."""
    rows = np.arange(len(ankle_m))
    known, offset = [], []
    course = ankle_m.copy()
    for a, b in stands:
        place = np.median(ankle_m[a:b], axis=0)
        course[a:b] = place
        known += [a, b - 1]
        offset += [place - ankle_m[a], place - ankle_m[b - 1]]
    between = np.ones(len(rows), dtype=bool)
    for a, b in stands:
        between[a:b] = False
    for axis in range(3):
        shift = np.interp(rows, known, [o[axis] for o in offset])
        course[between, axis] += shift[between]
    return course


def _step_lift(place_m: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(n, 2) least height of a foot on its way to another place."""
    speed = np.linalg.norm(np.gradient(place_m[..., [0, 2]], axis=0), axis=2) * CLIP_HZ
    return np.asarray((1.0 - weight) * 0.5 * STEP_HEIGHT_M * np.clip(speed / MOVING_M_S, 0.0, 1.0))


def _yaws(toes: np.ndarray, stands: list[tuple[int, int]]) -> np.ndarray:
    """(n,) radians to the left that the foot points: one value while it stands; toes (n, 3)."""
    yaw = np.arctan2(-toes[:, 2], toes[:, 0])
    known, value = [], []
    for a, b in stands:
        known += [a, b - 1]
        value += [float(np.median(yaw[a:b]).clip(-YAW_LIMIT, YAW_LIMIT))] * 2
    return np.interp(np.arange(len(yaw)), known, value)


YAW_LIMIT: Final = 0.5


def _heel_lift(lift_m: np.ndarray) -> np.ndarray:
    """(n, 2) radians: a foot in the air hangs down a little."""
    return np.asarray(0.35 * ease(lift_m / 0.15))


def _knee_out(knee_m: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(t, 2) how far the knees point outward of the feet."""
    way = np.arctan2(-knee_m[..., 2], knee_m[..., 0])
    shows = np.clip(np.hypot(knee_m[..., 0], knee_m[..., 2]) / KNEE_SHOWS_M, 0.0, 1.0) ** 2
    out = -OUTWARD * (way - yaw)
    return np.asarray(shows * np.clip(out, *KNEE_OUT_LIMITS))


def _bend(parent: np.ndarray, child: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """(t, 3) bend forward, to the right, turn to the left, from one segment to the next, within limits."""
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(np.swapaxes(parent, -1, -2) @ child).as_rotvec()
    return np.stack([-vector[:, 2], vector[:, 0], vector[:, 1]], axis=1).clip(*limits)


def _bend_turn(bend: np.ndarray) -> np.ndarray:
    from anchorpose.rotations import turns

    return turns(np.stack([bend[:, 1], bend[:, 2], -bend[:, 0]], axis=1))


def _head_turn(thorax: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(t, 3, 3) the head's turn: its top towards ``up``, its face where the thorax faces."""
    return orthonormal_frame(up, thorax[:, :, 2]) @ _UP_RIGHT.T


def _swing(thorax: np.ndarray, upper: np.ndarray, side: int) -> np.ndarray:
    """(t, 3) flexion, abduction, 0 of an upper arm along ``upper`` (t, 3)."""
    local = rotate(np.swapaxes(thorax, -1, -2), upper)
    axis = np.cross(-UP, local)
    angle = np.arctan2(np.linalg.norm(axis, axis=1), -local[:, 1])
    swing = angle[:, None] * unit(axis + 1e-12 * FORWARD)
    return np.stack([swing[:, 2], -OUTWARD[side] * swing[:, 0], np.zeros(len(swing))], axis=1)


def _arm_turns(body: BodyMesh, side: int, upper: np.ndarray, axis: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """(t, 2, 3, 3) world turns of upper arm and forearm."""
    name = SIDES[side]
    limb = rest_limb(body, (f"{name}Arm", f"{name}ForeArm", f"{name}Hand"))
    first = orthonormal_frame(upper, axis) @ orthonormal_frame(limb.first, limb.axis).T
    from anchorpose.rotations import turns_about

    second = first @ turns_about(limb.axis, elbow.clip(*ELBOW_LIMITS) - limb.rest_bend)
    return np.stack([first, second], axis=1)


def draw_captured(rng: np.random.Generator, config: SimulationConfig, person: Person) -> CapturedActor:
    """The configuration's movement, from a moment on that is drawn: a recording may begin in the middle of one."""
    if config.movement_file is None or config.movement is None:
        raise ValueError("a captured movement needs movement_file and movement")
    clips = read_clips(config.movement_file, config.movement, rng, config.subjects)
    first, phase = int(rng.integers(len(clips.names))), float(rng.uniform())
    return retarget(person, lay_out(clips, first, phase, -MARGIN_S, config.seconds + MARGIN_S))
