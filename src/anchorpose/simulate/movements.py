"""Define the motions of a patient in stand training. Each motion adds random offsets to some channels, the numbers that
describe a posture (``timeline``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anchorpose.simulate.timeline import Movement

Offsets = tuple[tuple[str, float], ...]
SIDES = ("left", "right")
PACE = {"slow": 1.5, "normal": 1.0, "fast": 0.6}  # factors on movement times; in a fast reach, the wrist exceeds 3 m/s
REST_ELBOW = 0.35  # rad, elbow flexion of hanging arms
STRAIGHT_ELBOW = 0.15  # rad, elbow flexion of stretched arms


@dataclass(frozen=True, slots=True)
class Situation:
    """The circumstances that limit how large motions may be."""

    leg_m: float  # length of the patient's leg
    in_frame: bool  # whether the patient stands in a frame, whose bars limit motions
    elbow: float  # rad, flexion of the elbows at rest


def squat(rng: np.random.Generator, here: Situation) -> Offsets:
    depth = rng.uniform(0.10, 0.20 if here.in_frame else 0.34) * here.leg_m / 0.85
    arms = () if here.in_frame else _each_side("shoulder_flex", rng.uniform(2.0, 4.0) * depth)
    return (
        ("pelvis_up", -depth),
        ("pelvis_forward", -(0.95 if here.in_frame else 0.72) * depth),
        ("pelvis_flex", 0.8 * depth),
        ("trunk_flex", rng.uniform(0.8, 1.4) * depth),
        *_each_side("knee_out", rng.uniform(0.0, 0.2)),
        *arms,
    )


def weight_shift(rng: np.random.Generator, here: Situation) -> Offsets:
    way = rng.choice([-1.0, 1.0])
    return (
        ("pelvis_right", way * rng.uniform(0.04, 0.09)),
        ("pelvis_side", -way * rng.uniform(0.0, 0.06)),
        ("trunk_side", -way * rng.uniform(0.0, 0.12)),
        ("pelvis_turn", rng.uniform(-0.08, 0.08)),
    )


def trunk(rng: np.random.Generator, here: Situation) -> Offsets:
    way = rng.choice([-1.0, 1.0])
    match rng.integers(3):
        case 0:
            return (("trunk_turn", way * rng.uniform(0.25, 0.6)), ("pelvis_turn", way * rng.uniform(0.0, 0.15)))
        case 1:
            bend = rng.uniform(0.25, 0.4 if here.in_frame else 0.8)
            return (("trunk_flex", bend), ("pelvis_flex", 0.5 * bend), ("pelvis_forward", -0.16 * bend))
        case _:
            return (("trunk_side", way * rng.uniform(0.15, 0.35)), ("pelvis_right", -way * 0.03))


def reach(rng: np.random.Generator, here: Situation) -> Offsets:
    sides = [("left",), ("right",), SIDES][rng.integers(3)]
    straighten = STRAIGHT_ELBOW - here.elbow + rng.uniform(0.0, 0.3)
    found: list[tuple[str, float]] = []
    direction = rng.integers(3)
    for side in sides:
        rise = (
            [(f"shoulder_flex_{side}", rng.uniform(1.0, 1.5)), (f"shoulder_abduct_{side}", rng.uniform(-0.1, 0.3))],
            [(f"shoulder_abduct_{side}", rng.uniform(0.9, 1.3)), (f"shoulder_flex_{side}", rng.uniform(0.0, 0.4))],
            [(f"shoulder_flex_{side}", rng.uniform(2.0, 2.6)), (f"shoulder_abduct_{side}", rng.uniform(0.0, 0.3))],
        )[direction]
        found += [*rise, (f"elbow_{side}", straighten), (f"pronate_{side}", rng.uniform(0.0, 0.8))]
        found += [(f"pull_{side}", -1.0)]
    if len(sides) == 1:
        way = 1.0 if sides[0] == "right" else -1.0
        found += [("trunk_turn", way * rng.uniform(0.0, 0.3)), ("head_turn", -way * rng.uniform(0.0, 0.3))]
    return (*found, ("trunk_flex", rng.uniform(0.0, 0.25)))


def arm_raise(rng: np.random.Generator, here: Situation) -> Offsets:
    channel = ("shoulder_flex", "shoulder_abduct")[rng.integers(2)]
    return (
        *_each_side(channel, rng.uniform(1.2, 2.4) if channel == "shoulder_flex" else rng.uniform(0.9, 1.5)),
        *_each_side("elbow", STRAIGHT_ELBOW - here.elbow + rng.uniform(0.0, 0.6)),
        *_each_side("pull", -1.0),
    )


def head(rng: np.random.Generator, here: Situation) -> Offsets:
    return (
        ("head_turn", rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.9)),
        ("head_flex", rng.uniform(-0.3, 0.4)),
        ("head_side", rng.uniform(-0.25, 0.25)),
    )


def rails(rng: np.random.Generator, here: Situation) -> Offsets:
    """Return offsets that take a hand off its rail; without rails, offsets that bend both arms as if on rails."""
    if here.in_frame:
        side = SIDES[rng.integers(2)]
        return ((f"pull_{side}", -1.0), (f"elbow_{side}", rng.uniform(-0.2, 0.6)))
    return (
        *_each_side("elbow", rng.uniform(0.9, 1.2)),
        *_each_side("shoulder_abduct", rng.uniform(0.1, 0.3)),
        *_each_side("shoulder_flex", rng.uniform(0.0, 0.3)),
    )


def standing(rng: np.random.Generator, here: Situation) -> Offsets:
    return ()


LEG_MOTIONS: dict[str, Callable[[np.random.Generator, Situation], Offsets]] = {
    "squat": squat,
    "weight-shift": weight_shift,
    "trunk": trunk,
    "standing": standing,
}
ARM_MOTIONS: dict[str, Callable[[np.random.Generator, Situation], Offsets]] = {
    "reach": reach,
    "arm-raise": arm_raise,
    "head": head,
    "rails": rails,
    "standing": standing,
}


def timed(rng: np.random.Generator, offsets: Offsets, start_s: float, pace: float) -> Movement:
    """Return a movement whose offsets grow, and later return to 0, in about a second each at the normal pace (1)."""
    rise_s, fall_s = rng.uniform(0.8, 1.5, 2) * pace
    return Movement(offsets, start_s, rise_s, rng.uniform(0.1, 0.9) * pace, fall_s)


class GivingWay(Movement):
    """A movement that begins like a fall: it accelerates evenly, and slows down in the last third of ``rise_s``, the
    time in which its offsets grow.
    """

    __slots__ = ()

    def coming(self, x: np.ndarray) -> np.ndarray:
        """Return the share of the movement's offsets that applies at x, growing from 0 to 1. x: the time since the
        start, divided by ``rise_s``, the time in which the offsets grow. When the movement begins to slow, its speed is
        twice the average.
        """
        x = np.clip(x, 0.0, 1.0)
        return np.asarray(np.where(x < 2.0 / 3.0, 1.5 * x**2, 1.0 - 3.0 * (1.0 - x) ** 2))


@dataclass(frozen=True, slots=True)
class Beating(Movement):
    """A movement that oscillates between its offsets and their opposite, such as a clonus."""

    frequency_hz: float  # number of oscillations per second

    def strength(self, times_s: np.ndarray) -> np.ndarray:
        """Return the factor (t,), -1 to 1, on the offsets."""
        beat = np.sin(2.0 * np.pi * self.frequency_hz * (times_s - self.start_s))
        return np.asarray(beat * Movement.strength(self, times_s))


def buckle(rng: np.random.Generator, start_s: float) -> Movement:
    """Return a movement in which one knee gives way within 0.2 to 0.45 s, so that the pelvis sinks on this side; then
    the leg straightens within a second.
    """
    # way: 1 = the right knee, -1 = the left knee
    way, drop_m = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.07, 0.10))
    offsets = (("pelvis_up", -drop_m), ("pelvis_side", 0.2 * way), ("pelvis_right", -0.03 * way))
    fall_s, caught_s = rng.uniform(0.2, 0.45), rng.uniform(0.2, 0.5)
    return Movement(offsets, start_s, float(fall_s), float(caught_s), 1.0)


def draw_pace(rng: np.random.Generator, speed: str) -> float:
    """Return a factor on durations: the factor of ``speed`` in ``PACE``, or a random factor for the speed ``mixed``."""
    return PACE[str(rng.choice(list(PACE)))] if speed == "mixed" else PACE[speed]


def _each_side(channel: str, amount: float) -> Offsets:
    return tuple((f"{channel}_{side}", float(amount)) for side in SIDES)
