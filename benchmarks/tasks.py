"""Suite of clinical tests that simulated patients do in front of one camera, some slowly or not completely, and in
front of three cameras with a therapist."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from measure_scores import measures_against_truth
from recordings import MOVEMENTS, Simulated
from suite import Case, Use

from anchorpose.simulate.clinic import Programme
from anchorpose.simulate.config import TaskName, single
from anchorpose.simulate.movements import REST_ELBOW, STRAIGHT_ELBOW
from anchorpose.simulate.patient import LONG_AGO_S, Actor, draw_waves, resting_channels, seated_offsets
from anchorpose.simulate.person import Person
from anchorpose.simulate.posture import OUTWARD
from anchorpose.simulate.timeline import Footwork, Movement, Step, ball_ahead_m, final_stance, stand

TASK_SEED: Final[dict[Use, int]] = {"tuning": 71_000, "held-out": 74_000}
SLOW: Final = 1.8
SIDES: Final = ("left", "right")


def rises(rng: np.random.Generator, person: Person, pace: float = 1.0, whole: int = 5) -> Actor:
    """Return a patient who rises five times and sits down between; rises after the first ``whole`` stop half-way."""
    seated = seated_offsets(person)
    rise_s, stood_s, sat_s = rng.uniform((1.0, 0.5, 0.3), (1.5, 0.9, 0.7)) * (pace, pace, 1.0)
    cycle_s, first_s = 2.0 * rise_s + stood_s + sat_s, rng.uniform(2.5, 3.5)
    movements = [Movement(seated, LONG_AGO_S, 1.0, 1e3, 1.0)]
    for k in range(5):
        up = tuple((channel, -amount * (1.0 if k < whole else 0.5)) for channel, amount in seated)
        lean = (("trunk_flex", rng.uniform(0.3, 0.6)), ("pelvis_flex", 0.25))
        start_s, stays_s = first_s + k * cycle_s, stood_s if k < 4 or whole < 5 else 1e3
        movements += [
            Movement(up, start_s, rise_s, stays_s, rise_s),
            Movement(lean, start_s - 0.3 * rise_s, 0.6 * rise_s, 0.05, 0.7 * rise_s),
            Movement(lean, start_s + rise_s + stays_s, 0.6 * rise_s, 0.05, 0.6 * rise_s),
        ]
    return _actor(rng, person, movements)


def reaches(rng: np.random.Generator, person: Person, pace: float = 1.0, share: float = 1.0) -> Actor:
    """Return a patient who raises one arm forward and leans forward, then the other arm. share: of a usual reach."""
    movements, start_s = [], rng.uniform(1.5, 2.0)
    for side in rng.permutation(SIDES):
        raised = (
            (f"shoulder_flex_{side}", 1.5),
            (f"shoulder_abduct_{side}", -0.2),
            (f"elbow_{side}", STRAIGHT_ELBOW - REST_ELBOW),
        )
        bend, tilt = share * rng.uniform((0.25, 0.1), (0.45, 0.25))
        lean = (
            ("trunk_flex", bend),
            ("pelvis_flex", tilt),
            ("pelvis_forward", -0.3 * tilt),
            (f"shoulder_flex_{side}", bend + tilt),
        )
        movements += [
            Movement(raised, start_s, 1.0, 1.5 + pace * 3.0, 1.0),
            Movement(lean, start_s + 2.0, 1.3 * pace, 0.5 * pace, 1.0 * pace),
        ]
        start_s += 4.0 + 3.0 * pace
    return _actor(rng, person, movements)


def stances(rng: np.random.Generator, person: Person, seconds: float = 8.0) -> Actor:
    """Return a patient who lifts each foot in turn for about ``seconds``, with the weight over the standing foot."""
    footwork, movements, start_s = _feet(rng, person), [], rng.uniform(1.5, 2.5)
    places, yaws = final_stance(footwork)
    steps = []
    for side in rng.permutation(2):
        lasts_s = seconds * rng.uniform(0.75, 1.25)
        steps.append(Step(int(side), start_s, lasts_s, tuple(places[side]), float(yaws[side])))
        shift = (("pelvis_right", -OUTWARD[side] * rng.uniform(0.05, 0.08)),)
        movements.append(Movement(shift, start_s - 0.5, 0.6, lasts_s - 0.2, 0.6))
        start_s += lasts_s + 1.5
    return _actor(rng, person, movements, replace(footwork, steps=tuple(steps)))


def _feet(rng: np.random.Generator, person: Person) -> Footwork:
    return stand(np.array([ball_ahead_m(person.body), 0.0]), 0.0, rng.uniform(0.20, 0.30))


def _actor(
    rng: np.random.Generator, person: Person, movements: list[Movement], footwork: Footwork | None = None
) -> Actor:
    """Return a person who does these movements and sways."""
    feet = _feet(rng, person) if footwork is None else footwork
    return Actor(person, resting_channels(person, in_frame=False), movements, feet, draw_waves(rng))


MIXED: Final = ("squat", "reach", "arm-raise", "trunk", "head")
BEHIND: Final[TaskName] = "trunk from behind"
CAPTURED: Final = ("sit-to-stand", "hurdle-step", "leg-raise", "deep-squat")
THREE: Final[dict[str, Any]] = {"cameras": 3, "therapists": 1, "therapist_tasks": (BEHIND,)}


def task_recordings(first_seed: int) -> Iterator[Simulated]:
    """Yield the recordings, each with a seed of its own: another body, other clothes, other amounts and durations."""
    seeds = iter(range(first_seed, first_seed + 1000))

    def one(name: str, seconds: float, programme: Programme | None = None, **changes: Any) -> Simulated:
        config = replace(single(next(seeds), seconds), stool=True, **changes)
        return Simulated(f"task-{name}-{config.seed}", config, programme)

    yield one("rises", 26.0, rises)
    yield one("rises-slow", 38.0, partial(rises, pace=SLOW))
    yield one("rises-half", 26.0, partial(rises, whole=3))
    yield one("reach", 18.0, reaches)
    yield one("reach-slow", 22.0, partial(reaches, pace=SLOW))
    yield one("reach-small", 18.0, partial(reaches, share=0.1))
    yield one("stance", 26.0, stances)
    yield one("stance-short", 10.0, partial(stances, seconds=1.8))
    yield one("steps", 20.0, motions=("steps",))
    yield one("steps-slow", 20.0, motions=("steps",), speed="slow")
    yield one("mixed", 20.0, motions=MIXED)
    yield one("mixed-slow", 20.0, motions=MIXED, speed="slow")
    yield one("three-rises", 26.0, rises, **(THREE | {"therapist_tasks": ("left knee from the front",)}))
    yield one("three-reach", 18.0, reaches, **THREE)
    yield one("three-stance", 26.0, stances, **THREE)
    yield one("three-steps", 20.0, motions=("steps",), **THREE)
    for name in CAPTURED:
        yield one(name, 24.0, movement_file=MOVEMENTS, movement=name)


def tasks(use: Use, quick: bool) -> Iterator[Case]:
    """Yield the recordings of the tests; the table has a row per measure and per angle."""
    found = list(task_recordings(TASK_SEED[use]))
    for recording in found[3:12:3] if quick else found:
        yield Case("measures", recording, measures_against_truth)
