"""Draw the movements of a session's patient: knees that extend and stay extended, hands on and off the rails, and
incidents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.simulate.aids import HeldEquipment
from anchorpose.simulate.movements import SIDES, Beating, GivingWay
from anchorpose.simulate.patient import LONG_AGO_S, STANCE_M, Actor, draw_waves, resting_channels, seated_offsets
from anchorpose.simulate.person import Person
from anchorpose.simulate.sessions.plan import EXTENDING_S, PAUSE_S, RESTING_DEG, STANDING_UP_S, PlannedTrial
from anchorpose.simulate.timeline import Footwork, Movement, Step, ball_ahead_m, stand

HANDS_S: Final = 0.5  # s, time in which a hand leaves a rail or returns to it
CARRY_S: Final = 0.6  # s, time after standing up until the knees' bend alone determines the pelvis's height
ALWAYS_S: Final = 1e5  # s, a duration that is longer than any session

BUCKLE_DEG: Final = (25.0, 50.0)  # degrees, range of a buckle's depth; a smaller bend does not count as a buckle
BUCKLE_S: Final = (0.2, 0.45)  # s, range of the time in which the knee gives way, as in ``movements.buckle``
CAUGHT_S: Final = (0.2, 0.5)  # s, range of the time for which the knee then stays bent
# bend of the other knee as a share of the buckle's depth; the other knee bends, too, since the pelvis sinks
OTHER_KNEE: Final = 0.4

FAILS_AT_S: Final = 1.5  # s after the onset of the trial at which the failed stand begins
# range of the share of the way from the seated to the standing posture that a failed stand covers; from about 0.7 on,
# the patient would be upright
FAILED_SHARE: Final = (0.42, 0.62)
FAILED_UP_S, FAILED_DOWN_S = 0.8, 0.6  # s, time of rising, and of sinking back
SEATED_FROM_S: Final = PAUSE_S - 0.3  # s from the start of sitting down to the onset of a trial with a failed stand

# m, range of a fall's length, enough to move the extrapolated centre of mass beyond the soles
FALL_M: Final = (0.32, 0.42)
FALL_S: Final = 0.8  # s, duration of the fall forward
# s from the start of the fall until a foot leaves the floor, and from foot off until foot strike
STEP_AFTER_S, STEP_S = 0.45, 0.35
STRIDE_M: Final = 0.35  # m, length of the recovery step
# s from the start of the fall until body and foot begin to go back, and duration of going back
BACK_AFTER_S, BACK_S = 2.5, 1.0
RECOVERY_S: Final = BACK_AFTER_S + BACK_S + HANDS_S

CLONUS_HZ: Final = (3.5, 7.0)  # Hz, range of a clonus's frequency
CLONUS_DEG: Final = (2.0, 5.0)  # degrees, range of a clonus's amplitude at the knee; at the ankle, it is half as large
CLONUS_S: Final = 4.0  # s, duration of a clonus: two analysis windows (2 s each) of the measure of tremor
SWELLS_S: Final = 0.3  # s, time in which a clonus grows at its beginning, and subsides at its end


@dataclass(frozen=True, slots=True)
class Happening:
    """An incident of the drawn movements, such as a buckle."""

    kind: str  # knee_buckle, recovery_step or clonus, each with _left or _right; or failed_stand
    start_s: float  # onset of the incident
    end_s: float  # time of greatest depth of a buckle or failed stand, foot strike of a recovery step, end of a clonus
    side: str | None  # left or right; None for a failed stand


@dataclass(frozen=True, slots=True, eq=False)
class SessionPatient(Actor):
    """The patient of a session of trials."""

    happenings: tuple[Happening, ...] = ()  # incidents, sorted by time

    def sits(self) -> bool:
        """Return whether a trial has a failed stand, for which the patient needs a seat."""
        return any(happening.kind == "failed_stand" for happening in self.happenings)


def draw_session_patient(
    rng: np.random.Generator, person: Person, rails: HeldEquipment | None, plan: Sequence[PlannedTrial]
) -> SessionPatient:
    """Draw the patient's movements in all trials. rails: equipment that the hands hold; None = none."""
    base = resting_channels(person, rails is not None)
    feet = stand(np.array([ball_ahead_m(person.body), 0.0]), 0.0, STANCE_M)
    carried = Movement((*_both("carry", 1.0), *_both("knee", np.radians(RESTING_DEG))), LONG_AGO_S, 1.0, ALWAYS_S, 1.0)
    waves, movements, steps, happenings = draw_waves(rng), [carried], list[Step](), list[Happening]()
    for trial, seed in zip(plan, rng.integers(2**63, size=len(plan)).tolist(), strict=True):
        movements += [_holding(trial), *_hands(trial)]
        if trial.incident is not None:
            draw = _INCIDENTS[trial.incident]
            drawn = draw(np.random.default_rng(seed), person, trial, feet)
            movements += drawn.movements
            steps += drawn.steps
            happenings.append(drawn.happening)
    footwork = Footwork(feet.places_m, feet.yaws, tuple(steps))
    grip_m = None if rails is None else rails.grip_m
    return SessionPatient(person, base, movements, footwork, waves, grip_m, happenings=tuple(happenings))


def _both(channel: str, amount: float) -> tuple[tuple[str, float], ...]:
    return tuple((f"{channel}_{side}", float(amount)) for side in SIDES)


def _holding(trial: PlannedTrial) -> Movement:
    """Return the movement in which both knees extend, stay extended, and bend again."""
    offsets = zip(SIDES, trial.held_deg, strict=True)
    knees = tuple((f"knee_{side}", float(np.radians(held_deg - RESTING_DEG))) for side, held_deg in offsets)
    from_s, to_s = trial.holds_s
    return Movement(knees, trial.extends_s, EXTENDING_S, to_s - from_s, EXTENDING_S)


def _hands(trial: PlannedTrial) -> list[Movement]:
    """Return movements that take the hands off the rails. In a trial that is planned without hands, the hands are off
    for the whole trial; in a trial with a failed stand, from before sitting down until standing; and in a trial with a
    recovery step, around this step.
    """
    if trial.hands_off:
        return [_let_go(trial.onset_s - (SEATED_FROM_S + HANDS_S if trial.stands_s is not None else 0.0), trial.end_s)]
    if trial.stands_s is not None:
        return [_let_go(trial.onset_s - SEATED_FROM_S - HANDS_S, trial.stands_s + STANDING_UP_S)]
    return [_let_go(*_falls(trial))] if trial.incident == "recovery-step" else []


def _let_go(from_s: float, to_s: float) -> Movement:
    return Movement(_both("pull", -1.0), from_s, HANDS_S, to_s - from_s - HANDS_S, HANDS_S)


def _falls(trial: PlannedTrial) -> tuple[float, float]:
    """Return the time at which the hands leave the rails for a recovery step, and the time at which they are back on
    the rails. The fall and the recovery are in the middle of the time in which the knees stay extended.
    """
    middle_s = sum(trial.holds_s) / 2.0
    return middle_s - RECOVERY_S / 2.0 - HANDS_S, middle_s + RECOVERY_S / 2.0


@dataclass(frozen=True, slots=True)
class Drawn:
    """The movements and steps that an incident adds to the trial's own movements and steps."""

    happening: Happening
    movements: tuple[Movement, ...]
    steps: tuple[Step, ...] = ()


def _buckle(rng: np.random.Generator, person: Person, trial: PlannedTrial, feet: Footwork) -> Drawn:
    side, other = rng.permutation(SIDES).tolist()
    depth, fall_s, caught_s = np.radians(rng.uniform(*BUCKLE_DEG)), rng.uniform(*BUCKLE_S), rng.uniform(*CAUGHT_S)
    from_s, to_s = trial.holds_s
    start_s = float(rng.uniform(from_s + 0.5, to_s - fall_s - caught_s - EXTENDING_S))
    knees = ((f"knee_{side}", float(depth)), (f"knee_{other}", float(OTHER_KNEE * depth)))
    gives_way = GivingWay(knees, start_s, float(fall_s), float(caught_s), EXTENDING_S)
    return Drawn(Happening(f"knee_buckle_{side}", start_s, start_s + float(fall_s), side), (gives_way,))


def _clonus(rng: np.random.Generator, person: Person, trial: PlannedTrial, feet: Footwork) -> Drawn:
    side = str(rng.choice(SIDES))
    from_s, to_s = trial.holds_s
    start_s = float(rng.uniform(from_s, to_s - CLONUS_S))
    knee = ((f"knee_{side}", float(np.radians(rng.uniform(*CLONUS_DEG)))),)
    shaking = Beating(knee, start_s, SWELLS_S, CLONUS_S - 2.0 * SWELLS_S, SWELLS_S, float(rng.uniform(*CLONUS_HZ)))
    return Drawn(Happening(f"clonus_{side}", start_s, start_s + CLONUS_S, side), (shaking,))


def _recovery(rng: np.random.Generator, person: Person, trial: PlannedTrial, feet: Footwork) -> Drawn:
    """Draw a fall forward, the step that catches it, and the return of body and foot."""
    foot, start_s, to_s = int(rng.integers(2)), _falls(trial)[0] + HANDS_S, _falls(trial)[1]
    fall = Movement(
        (("pelvis_forward", float(rng.uniform(*FALL_M)) - STRIDE_M / 2.0),),
        start_s,
        FALL_S,
        BACK_AFTER_S - FALL_S,
        to_s - start_s - BACK_AFTER_S,
    )
    x, z = feet.places_m[foot].tolist()
    yaw, lifts_s = float(feet.yaws[foot]), start_s + STEP_AFTER_S
    steps = (
        Step(foot, lifts_s, STEP_S, (x + STRIDE_M, z), yaw),
        Step(foot, start_s + BACK_AFTER_S, BACK_S, (x, z), yaw),
    )
    return Drawn(Happening(f"recovery_step_{SIDES[foot]}", start_s, lifts_s + STEP_S, SIDES[foot]), (fall,), steps)


def _failed_stand(rng: np.random.Generator, person: Person, trial: PlannedTrial, feet: Footwork) -> Drawn:
    """Draw movements in which the patient sits down before the trial, half rises, sinks back, and then stands up."""
    assert trial.stands_s is not None
    seated, lean = seated_offsets(person), (("trunk_flex", float(rng.uniform(0.3, 0.6))), ("pelvis_flex", 0.25))
    sits_s, fails_s = trial.onset_s - SEATED_FROM_S, trial.onset_s + FAILS_AT_S
    share = float(rng.uniform(*FAILED_SHARE))
    up = tuple((channel, -share * amount) for channel, amount in seated)
    stays_s = trial.stands_s - sits_s - STANDING_UP_S
    return Drawn(
        Happening("failed_stand", fails_s, fails_s + FAILED_UP_S, None),
        (
            Movement(_both("carry", -1.0), sits_s - CARRY_S, CARRY_S, stays_s + 2.0 * STANDING_UP_S, CARRY_S),
            Movement(seated, sits_s, STANDING_UP_S, stays_s, STANDING_UP_S),
            Movement(up, fails_s, FAILED_UP_S, 0.0, FAILED_DOWN_S),
            Movement(lean, fails_s - 0.3, 0.8, 0.05, 0.7),
            Movement(lean, trial.stands_s - 0.5, 0.9, 0.1, 1.2),
        ),
    )


_INCIDENTS: Final = {"buckle": _buckle, "clonus": _clonus, "recovery-step": _recovery, "failed-stand": _failed_stand}
