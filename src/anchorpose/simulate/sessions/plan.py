"""Plan all trials and incidents of a session with and without stimulation, from its settings and seed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from anchorpose.settings import NotNegative, Positive, settings
from anchorpose.simulate.choices import When

OFF, ON = "off", "on"
Incident = Literal["buckle", "failed-stand", "recovery-step", "clonus"]
INCIDENTS: Final[tuple[Incident, ...]] = ("buckle", "failed-stand", "recovery-step", "clonus")

SHORTEST_TRIAL_S: Final = 10.0  # s, enough for a failed stand, standing up, and two seconds with extended knees
PAUSE_S: Final = 4.0  # s before every trial and after the last, in which the patient sits down or bends the knees
BLOCK: Final = 2  # number of trials of each condition in a block; the order within a block is random

# degrees, knee flexion of the standing patient between extensions; it exceeds 25 degrees, at which the measures end an
# extension
RESTING_DEG: Final = 30.0
HELD_DEG: Final = (9.0, 15.0)  # degrees, range of the flexion of extended knees without stimulation
SIDES_DEG: Final = 2.0  # degrees, maximum difference in flexion between a patient's extended knees
# degrees, standard deviation, between trials, of the flexion of extended knees; assumed for a patient with similar
# trials
SCATTER_DEG: Final = 1.5
LEAST_DEG: Final = 1.0  # degrees, minimum knee flexion: the flexion of a straight knee
LATENCY_S: Final = (0.8, 1.6)  # s, range of the time from a trial's onset until the knees begin to extend
EXTENDING_S: Final = 1.0  # s, time in which the knees extend, and in which they bend again
# Time from the moment at which the knees begin to bend again to the end of the trial, as a share of the trial, unless
# stimulation holds the knees extended longer.
LETS_GO: Final = 0.15


@settings
class SessionConfig:
    """Settings of a session: half of the trials have stimulation, and their order is random within blocks of four."""

    trials: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 12
    trial_s: Annotated[float, Field(ge=SHORTEST_TRIAL_S, le=3600)] = 20.0
    amplitude_v: Positive = 4.0  # V, amplitude of the stimulation in the trials with stimulation
    effect_deg: Annotated[float, Field(ge=0, le=10)] = 5.0  # degrees by which stimulated knees are straighter
    effect_s: NotNegative = 0.0  # s by which stimulated knees stay extended longer, at most until the trial's end
    helped: When = "off"  # trials in which therapists hold knees and hips, from beginning to end
    hands_off: When = "on"  # trials in which the hands are off the rails, from beginning to end
    # number of incidents of each kind in ``INCIDENTS``; incidents are in random trials, at most one per trial
    incidents: Annotated[int, Field(ge=0)] = 1

    def __post_init__(self) -> None:
        if len(INCIDENTS) * self.incidents > self.trials:
            most = self.trials // len(INCIDENTS)
            raise ValueError(f"{self.trials} trials have room for {most} of each incident at most; ask for fewer")

    @property
    def seconds(self) -> float:
        """Return the duration of the recording."""
        return PAUSE_S + self.trials * (self.trial_s + PAUSE_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTrial:
    """One trial: all times except the duration are seconds since the first frame."""

    onset_s: float
    duration_s: float
    amplitude_v: float  # V, 0 = without stimulation
    block: int
    helped: bool
    hands_off: bool
    held_deg: tuple[float, float]  # flexion of the left and the right knee while they stay extended
    extends_s: float  # s, time at which the knees begin to extend
    lets_go_s: float  # s, time at which the knees begin to bend again
    # s, time at which the patient stands up after a failed stand; None without a failed stand
    stands_s: float | None = None
    incident: Incident | None = None

    @property
    def condition(self) -> str:
        """Return the trial's condition, ``on`` or ``off``, which events.tsv has in the column trial_type."""
        return ON if self.amplitude_v > 0 else OFF

    @property
    def end_s(self) -> float:
        """Return the time at which the trial ends."""
        return self.onset_s + self.duration_s

    @property
    def holds_s(self) -> tuple[float, float]:
        """Return start and end of the time in which the knees stay extended."""
        return self.extends_s + EXTENDING_S, self.lets_go_s


STANDS_AT_S: Final = 5.0  # s from the onset of a trial with a failed stand until the patient stands up
STANDING_UP_S: Final = 1.8  # s, duration of standing up, and of sitting down
UP_S: Final = STANDS_AT_S + STANDING_UP_S  # s from the onset of a failed stand's trial until the patient is upright


def draw_plan(rng: np.random.Generator, config: SessionConfig) -> tuple[PlannedTrial, ...]:
    """Draw the trials in the order of time. The random draws do not depend on the stimulation's effects."""
    stimulated, blocks = _draw_order(rng, config.trials)
    base_deg = rng.uniform(*HELD_DEG) + rng.uniform(-0.5, 0.5) * SIDES_DEG * np.array([1.0, -1.0])
    scatter_deg = rng.normal(0.0, SCATTER_DEG, config.trials)
    latencies_s = rng.uniform(*LATENCY_S, config.trials)
    incidents = _draw_incidents(rng, config)
    found = []
    for k, (on, block, incident) in enumerate(zip(stimulated, blocks, incidents, strict=True)):
        onset_s, fails = PAUSE_S + k * (config.trial_s + PAUSE_S), incident == "failed-stand"
        held_deg = np.maximum(base_deg + scatter_deg[k] - config.effect_deg * on, LEAST_DEG)
        lets_go_s = config.trial_s * (1.0 - LETS_GO) + config.effect_s * on
        found.append(
            PlannedTrial(
                onset_s=onset_s,
                duration_s=config.trial_s,
                amplitude_v=config.amplitude_v * on,
                block=block,
                helped=_during(config.helped, on),
                hands_off=_during(config.hands_off, on),
                held_deg=(float(held_deg[0]), float(held_deg[1])),
                extends_s=onset_s + (UP_S if fails else float(latencies_s[k])),
                lets_go_s=onset_s + min(lets_go_s, config.trial_s),
                stands_s=onset_s + STANDS_AT_S if fails else None,
                incident=incident,
            )
        )
    return tuple(found)


def _draw_order(rng: np.random.Generator, trials: int) -> tuple[list[bool], list[int]]:
    """Draw which trials are stimulated, and number their blocks from 1. The first trial has no stimulation, because
    its condition is the reference for comparisons.
    """
    order, blocks = list[bool](), list[int]()
    edges = [*range(0, trials, 2 * BLOCK), trials]
    for number, (first, end) in enumerate(pairwise(edges), 1):
        drawn = rng.permutation([False, True] * ((end - first) // 2)).tolist()
        order += [not each for each in drawn] if not order and drawn[0] else drawn
        blocks += [number] * (end - first)
    return order, blocks


def _draw_incidents(rng: np.random.Generator, config: SessionConfig) -> list[Incident | None]:
    """Draw the incident of each trial, None for a trial without an incident."""
    found: list[Incident | None] = [None] * config.trials
    places = rng.permutation(config.trials)[: len(INCIDENTS) * config.incidents]
    for number, place in enumerate(places.tolist()):
        found[place] = INCIDENTS[number % len(INCIDENTS)]
    return found


def _during(when: When, stimulated: bool) -> bool:
    return when == "both" or when == (ON if stimulated else OFF)
