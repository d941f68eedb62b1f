"""Draw the patient: a person at the origin who does a random series of motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.rotations import FORWARD, UP, orthonormal_frame
from anchorpose.simulate.aids import HeldEquipment
from anchorpose.simulate.config import NAMED_ONLY, SimulationConfig
from anchorpose.simulate.movements import ARM_MOTIONS, LEG_MOTIONS, REST_ELBOW, Situation, buckle, draw_pace, timed
from anchorpose.simulate.person import Person
from anchorpose.simulate.posture import OUTWARD, finger_direction, palm_normal, pose_bones
from anchorpose.simulate.timeline import (
    CHANNEL_INDEX,
    CHANNELS,
    Footwork,
    HandGoals,
    Movement,
    Step,
    ball_ahead_m,
    channel_values,
    final_stance,
    posture_from,
    stance_places,
    stand,
    standing_pelvis_m,
    walk,
    walk_seconds,
    yaw_towards,
)

FARTHEST_FORWARD_M = 0.3  # m, maximum forward position of the feet; beyond it, the next steps lead backward
SWAY_M = 0.005  # m, maximum amplitude of each sinusoid of the pelvis's sway
TREMOR_RAD = 0.004  # rad, maximum amplitude of each sinusoid of the arms' tremor
PALM_ABOVE_BONE_M = 0.018  # m, distance from the hand's bone to the skin of the palm
GRIP_TILT_RAD = 0.5  # rad, angle by which the fingers of a hand on a rail point downward
WRIST_TO_GRIP_M = 0.06  # m, distance from the wrist to the point of the hand that lies on the rail
SIT_CHANCE = 0.4  # probability that a patient with a stool begins or ends a mixed series of motions on the stool
LONG_AGO_S = -100.0  # s, start time for movements that are already complete when the recording begins
OUTSIDE_M = 2.4  # m, distance to which a patient walks if it is not known which places the cameras see
STANCE_M = 0.26  # m, distance between the feet


@dataclass(frozen=True, slots=True, eq=False)
class Wave:
    """A sum of small sinusoids that is added to one channel (``timeline.CHANNELS``) as sway or tremor."""

    channel: str
    amplitude: np.ndarray
    frequency_hz: np.ndarray
    phase: np.ndarray

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Return the offset (t,) at times (t,)."""
        angle = 2.0 * np.pi * times_s[:, None] * self.frequency_hz + self.phase
        return (self.amplitude * np.sin(angle)).sum(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Actor:
    """A person with all movements and steps that this person does in a recording."""

    person: Person
    base: np.ndarray  # (c,) values of the channels at rest, in the order of ``CHANNELS``
    movements: list[Movement]
    footwork: Footwork  # initial stance and steps
    waves: tuple[Wave, ...]  # sway and tremor
    grip_m: np.ndarray | None = None  # (2, 3) places on the rails that the hands hold; None without rails
    gone_s: tuple[tuple[float, float], ...] = ()  # s, start of each walk out and end of the walk back

    def channels(self, times_s: np.ndarray) -> np.ndarray:
        """Return the values of all channels (c, t)."""
        values = channel_values(self.base, self.movements, times_s)
        for wave in self.waves:
            values[CHANNEL_INDEX[wave.channel]] += wave.at(times_s)
        return values

    def sits(self) -> bool:
        """Return whether the person is seated at any time of the recording."""
        seated = seated_offsets(self.person)[0]
        return any(seated in movement.offsets for movement in self.movements)

    def stay_s(self, from_s: float) -> tuple[float, float]:
        """Return start and end of the time that the person next spends at the place of training; start >= from_s."""
        for leaves_s, returns_s in self.gone_s:
            if from_s < leaves_s:
                return from_s, leaves_s
            from_s = max(from_s, returns_s)
        return from_s, np.inf

    def bones(self, times_s: np.ndarray) -> np.ndarray:
        """Return T_world_rest (t, b, 4, 4): the transform of each bone from the rest pose to the world over time."""
        goals = HandGoals.none(len(times_s))
        if self.grip_m is not None:
            goals = _rail_goals(self.person, self.grip_m, len(times_s))
        posture = posture_from(self.person.body, self.channels(times_s), self.footwork, times_s, goals)
        return pose_bones(self.person.body, posture)


def resting_channels(person: Person, in_frame: bool) -> np.ndarray:
    """Return the channels' values (c,) for a patient at rest: upright, with the arms beside the body or on the rails of
    a frame.
    """
    base = np.zeros(len(CHANNELS))
    base[CHANNEL_INDEX["pelvis_up"]] = 0.03  # 0.03 m above the pelvis of the rest pose, in which the knees are bent
    for side in ("left", "right"):
        base[CHANNEL_INDEX[f"shoulder_abduct_{side}"]] = 0.45 if in_frame else 0.27
        base[CHANNEL_INDEX[f"shoulder_flex_{side}"]] = 0.25 if in_frame else 0.0
        base[CHANNEL_INDEX[f"elbow_{side}"]] = 1.25 if in_frame else REST_ELBOW
        base[CHANNEL_INDEX[f"fingers_{side}"]] = 0.25
        base[CHANNEL_INDEX[f"pull_{side}"]] = 1.0 if in_frame else 0.0
    return base


def draw_waves(rng: np.random.Generator) -> tuple[Wave, ...]:
    """Draw sway of pelvis, trunk and head below 1 Hz, and tremor of the arms at 4 to 8 Hz."""

    def wave(channel: str, amplitude: float, lowest_hz: float, highest_hz: float) -> Wave:
        amplitudes = amplitude * rng.uniform(0.3, 1.0, 3)
        return Wave(channel, amplitudes, rng.uniform(lowest_hz, highest_hz, 3), rng.uniform(0.0, 2.0 * np.pi, 3))

    sway = [wave(channel, SWAY_M, 0.1, 0.7) for channel in ("pelvis_forward", "pelvis_right")]
    lean = [wave(channel, 2.0 * SWAY_M, 0.1, 0.6) for channel in ("trunk_flex", "trunk_side", "head_turn", "head_flex")]
    tremor = [
        wave(f"{channel}_{side}", TREMOR_RAD, 4.0, 8.0)
        for channel in ("shoulder_flex", "elbow")
        for side in ("left", "right")
    ]
    return (*sway, *lean, *tremor)


def draw_patient(
    rng: np.random.Generator,
    config: SimulationConfig,
    person: Person,
    frame: HeldEquipment | None,
    ways_out_m: np.ndarray | None = None,
) -> Actor:
    """Draw a patient's movements for the whole recording. frame: equipment that the hands hold; None = none.

    ways_out_m (2, 2): x and z of the places out of view to which the patient walks, left and right. It is None if the
    patient is never away, and in a cluttered room, where the patient's walk is set later. Raises AnchorposeError if
    the recording is too short for the walks.
    """
    base = resting_channels(person, frame is not None)
    if frame is None:
        _loosen_arms(rng, base)
    footwork = _first_stance(rng, person)
    here = Situation(
        leg_m=standing_pelvis_m(person.body), in_frame=frame is not None, elbow=float(base[CHANNEL_INDEX["elbow_left"]])
    )
    begin_s, end_s, sitting = _draw_sitting(rng, config, person)
    footwork, gone_s = _come_and_go(rng, footwork, config, ways_out_m)
    legs, arms = _chosen(config)
    movements = [*sitting]
    now = begin_s
    while legs and now < end_s:
        name, pace = str(rng.choice(legs)), draw_pace(rng, config.speed)
        if name == "steps":
            footwork, shifts = _draw_steps(rng, footwork, now, pace, here)
            movements += shifts
            now = footwork.steps[-1].start_s + footwork.steps[-1].duration_s + 0.3
        elif name == "buckle":
            movements.append(buckle(rng, now + rng.uniform(1.0, 2.0)))
            now = movements[-1].end_s
        else:
            movements.append(timed(rng, LEG_MOTIONS[name](rng, here), now, pace))
            now = movements[-1].end_s + rng.uniform(-0.2, 0.3)
    movements += _of_arms(rng, arms, config, here)
    movements = [m for m in movements if all(m.end_s <= leaves or m.start_s >= returns for leaves, returns in gone_s)]
    grip_m = None if frame is None else frame.grip_m
    return Actor(person, base, movements, footwork, draw_waves(rng), grip_m, gone_s)


def _of_arms(rng: np.random.Generator, names: list[str], config: SimulationConfig, here: Situation) -> list[Movement]:
    """Draw movements of the arms, one after the other, until the recording ends."""
    movements, now = list[Movement](), rng.uniform(0.0, 0.6)
    while names and now < config.seconds:
        movements.append(timed(rng, ARM_MOTIONS[str(rng.choice(names))](rng, here), now, draw_pace(rng, config.speed)))
        now = movements[-1].end_s + rng.uniform(-0.2, 0.2)
    return movements


def _chosen(config: SimulationConfig) -> tuple[list[str], list[str]]:
    """Return the names of the movements of legs and of arms from which a patient's movements are drawn."""
    mixed = "mixed" in config.motions
    legs = [m for m in (*LEG_MOTIONS, "steps") if mixed or m in config.motions]
    legs += [m for m in NAMED_ONLY if m in config.motions]
    if config.away_s:
        legs = [m for m in legs if m != "steps"]  # a patient who walks in and out makes no other steps
    return legs, [m for m in ARM_MOTIONS if mixed or m in config.motions]


def _come_and_go(
    rng: np.random.Generator, footwork: Footwork, config: SimulationConfig, ways_out_m: np.ndarray | None
) -> tuple[Footwork, tuple[tuple[float, float], ...]]:
    """Append to ``footwork``, for each absence in ``config.away_s``, a walk out to one side, which ends when the
    absence begins, and a walk back, which begins when the absence ends. Also return ``Actor.gone_s``.
    """
    home, facing, gone_s = footwork.places_m.mean(axis=0), float(footwork.yaws.mean()), []
    for away_s, back_s in config.away_s:
        aside = np.array([rng.uniform(-0.3, 0.0), rng.choice([-1.0, 1.0]) * OUTSIDE_M])
        outside = home + aside if ways_out_m is None else ways_out_m[int(aside[1] > 0.0)]
        outward, leaves_s = yaw_towards(home, outside), -np.inf
        if away_s <= 0.0:
            footwork = stand(outside, yaw_towards(outside, home), STANCE_M)
        else:
            leaves_s = away_s - walk_seconds(footwork, outside, outward, STANCE_M)
            footwork = walk(footwork, outside, outward, leaves_s, STANCE_M)
        returns_s = back_s + walk_seconds(footwork, home, facing, STANCE_M)
        footwork = walk(footwork, home, facing, back_s, STANCE_M)
        gone_s.append((leaves_s, returns_s))
    if ways_out_m is None:
        return footwork, ()
    _require_time_to_walk(gone_s, config)
    return footwork, tuple(gone_s)


def _require_time_to_walk(gone_s: list[tuple[float, float]], config: SimulationConfig) -> None:
    """Raise AnchorposeError if a walk begins before the recording or before the previous return, or ends after the
    recording.
    """
    times_s = [0.0, *(time_s for span in gone_s for time_s in span if np.isfinite(time_s)), config.seconds]
    if times_s != sorted(times_s):
        raise AnchorposeError(
            f"In {config.seconds:g} s the patient has no time to walk out of the cameras' view and back, which takes "
            f"{gone_s[-1][1] - config.away_s[-1][1]:g} s each way; simulate a longer recording."
        )


def _loosen_arms(rng: np.random.Generator, base: np.ndarray) -> None:
    """Abduct and bend the resting arms in ``base`` by random angles, as people hold their arms for balance."""
    away = rng.uniform(0.0, 1.0)
    for side in ("left", "right"):
        base[CHANNEL_INDEX[f"shoulder_abduct_{side}"]] += 0.35 * away * rng.uniform(0.7, 1.0)
        base[CHANNEL_INDEX[f"elbow_{side}"]] += 0.6 * away * rng.uniform(0.5, 1.0)


def _first_stance(rng: np.random.Generator, person: Person) -> Footwork:
    """Place the ankles below a pelvis at the origin, feet 0.2 to 0.32 m apart, toes slightly out."""
    places = stance_places(np.array([ball_ahead_m(person.body), 0.0]), 0.0, rng.uniform(0.20, 0.32))
    return Footwork(places + rng.uniform(-0.02, 0.02, (2, 2)), -OUTWARD * rng.uniform(0.0, 0.15, 2))


def _draw_sitting(
    rng: np.random.Generator, config: SimulationConfig, person: Person
) -> tuple[float, float, list[Movement]]:
    """Draw whether the patient stands up from a seat, sits down, or only stands. Return the start and end (s) of
    standing, and the movements.
    """
    named = "sit-to-stand" in config.motions
    possible = named or ("mixed" in config.motions and config.stool and config.equipment == "none")
    if not possible or (not named and rng.random() > SIT_CHANCE):
        return rng.uniform(0.0, 0.5), config.seconds, []
    pace = draw_pace(rng, config.speed)
    seated, leaning = seated_offsets(person), (("trunk_flex", rng.uniform(0.3, 0.6)), ("pelvis_flex", 0.25))
    take_s = 1.8 * pace
    if rng.random() < 0.5:
        up_s = rng.uniform(0.15, 0.4) * config.seconds
        rising = Movement(seated, LONG_AGO_S, 1.0, up_s - LONG_AGO_S - 1.0, take_s)
        lean = Movement(leaning, up_s - 0.6 * pace, 0.9 * pace, 0.1, 1.2 * pace)
        return up_s + take_s, config.seconds, [rising, lean]
    down_s = max(rng.uniform(0.6, 0.8) * config.seconds - take_s, 0.2)
    lowering = Movement(seated, down_s, take_s, 1e3, 1.0)
    lean = Movement(leaning, down_s - 0.2 * pace, 1.2 * pace, 0.1, 0.9 * pace)
    return rng.uniform(0.0, 0.5), down_s - 2.0, [lowering, lean]


def seated_offsets(person: Person) -> tuple[tuple[str, float], ...]:
    """Return the channel offsets of a seated posture: thighs level, shanks upright."""
    heads, asset = person.body.bone_heads, person.body.asset
    thigh_m = float(np.linalg.norm(heads[asset.bone("LeftLeg")] - heads[asset.bone("LeftUpLeg")]))
    return (
        ("pelvis_up", -(thigh_m - 0.02)),
        ("pelvis_forward", -0.93 * thigh_m),
        ("trunk_flex", 0.15),
        ("knee_out_left", 0.15),
        ("knee_out_right", 0.15),
    )


def _draw_steps(
    rng: np.random.Generator, footwork: Footwork, start_s: float, pace: float, here: Situation
) -> tuple[Footwork, list[Movement]]:
    """Draw 2 or 4 steps in place, forward or backward; steps 3 and 4 bring the feet back to their places. The pelvis
    shifts over the standing foot.

    Return ``footwork`` with the steps appended, and the shifts of the pelvis.
    """
    places, yaws = final_stance(footwork)
    stride_m = 0.0 if here.in_frame or rng.random() < 0.4 else rng.uniform(0.12, 0.28)
    if float(np.mean(np.asarray(places)[:, 0])) > FARTHEST_FORWARD_M:
        stride_m = -stride_m  # steps lead backward now, since ten minutes of forward steps would lead to the camera
    duration_s = 0.7 * pace + 0.15
    first, steps, shifts = int(rng.integers(2)), [], []
    now = start_s + 0.35 * pace
    for k in range(2 * int(rng.integers(1, 3))):
        side = (first + k) % 2
        ahead = stride_m if k < 2 else 0.0
        place = (float(places[side, 0] + ahead), float(places[side, 1]))
        steps.append(Step(side, now, duration_s, place, float(yaws[side])))
        lean = -OUTWARD[side] * rng.uniform(0.05, 0.08)
        shifts.append(Movement((("pelvis_right", lean),), now - 0.35 * pace, 0.4 * pace, duration_s * 0.5, 0.4 * pace))
        now += duration_s + 0.3 * pace
    return Footwork(footwork.places_m, footwork.yaws, (*footwork.steps, *steps)), shifts


def _rail_goals(person: Person, grip_m: np.ndarray, times: int) -> HandGoals:
    """Return the hands' goals: palms on the rails, and fingers that point forward and down. Wrists are above the rails,
    so no forearm touches a rail.
    """
    fingers = np.cos(GRIP_TILT_RAD) * FORWARD - np.sin(GRIP_TILT_RAD) * UP
    palm_out = -np.sin(GRIP_TILT_RAD) * FORWARD - np.cos(GRIP_TILT_RAD) * UP
    wrists, turns = [], []
    for side in (0, 1):
        along, palm = finger_direction(person.body, side), palm_normal(person.body, side)
        turns.append(orthonormal_frame(fingers, palm_out) @ orthonormal_frame(along, palm).T)
        wrists.append(grip_m[side] - PALM_ABOVE_BONE_M * palm_out - WRIST_TO_GRIP_M * fingers)
    return HandGoals(np.tile(wrists, (times, 1, 1)), np.tile(turns, (times, 1, 1, 1)))
