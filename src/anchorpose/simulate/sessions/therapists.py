"""Draw the therapists of a session, who crouch beside the patient. In trials with help, each therapist holds a knee and
a hip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.holds import Task, choose_hold, tasks_on
from anchorpose.simulate.patient import LONG_AGO_S, Actor, draw_waves, resting_channels
from anchorpose.simulate.person import draw_person
from anchorpose.simulate.sessions.patient import ALWAYS_S
from anchorpose.simulate.sessions.plan import PlannedTrial
from anchorpose.simulate.therapist import STANCE_M, Therapist, choose_spot, crouch_offsets, grasp
from anchorpose.simulate.timeline import Movement, stand

GRASP_S: Final = 0.4  # s, time in which hands reach the patient before a trial's onset, and leave after its end
# channel offsets that keep a therapist who does not help away from the patient
AWAY: Final = (("pelvis_forward", -0.30), ("trunk_flex", -0.35))
COMES_S: Final = 0.8  # s, time in which a therapist moves nearer before the hands reach out, and away at the end


def draw_session_therapists(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor, plan: Sequence[PlannedTrial]
) -> tuple[Therapist, ...]:
    """Draw the configuration's number of therapists, at most one on each side of the patient. The therapists stay in
    place. No therapist kneels on a side on which the patient lacks the knee.
    """
    possible = tasks_on(patient, config)
    tasks = [task for name in config.therapist_tasks for task in possible if task.name == name]
    return tuple(_draw(rng, config, patient, plan, task) for task in tasks[: config.therapists])


def _draw(
    rng: np.random.Generator, config: SimulationConfig, patient: Actor, plan: Sequence[PlannedTrial], task: Task
) -> Therapist:
    person, azimuth = draw_person(rng, config.clothing_m), rng.uniform(*task.azimuth)
    inward = np.array([-np.cos(azimuth), 0.0, np.sin(azimuth)])
    hold = choose_hold(patient, task, inward, plan[0].holds_s[0])
    base = resting_channels(person, in_frame=False)
    crouch, spot = choose_spot(person, base, hold)
    crouching = Movement(crouch_offsets(crouch), LONG_AGO_S, 1.0, ALWAYS_S, 1.0)
    away = Movement(AWAY, LONG_AGO_S, 1.0, ALWAYS_S, 1.0)
    helping = [movement for trial in plan if trial.helped for movement in _help(trial)]
    actor = Actor(person, base, [crouching, away, *helping], stand(spot, azimuth + np.pi, STANCE_M), draw_waves(rng))
    return Therapist(actor, hold)


def _help(trial: PlannedTrial) -> tuple[Movement, Movement]:
    """Return movements with which a therapist holds the patient for the whole trial, or from the time at which the
    knees extend if a failed stand comes first.
    """
    from_s = trial.onset_s if trial.stands_s is None else trial.extends_s
    lasts_s, near = trial.end_s - from_s, tuple((channel, -amount) for channel, amount in AWAY)
    comes = Movement(near, from_s - GRASP_S - COMES_S, COMES_S, lasts_s + 2.0 * GRASP_S, COMES_S)
    return comes, grasp(from_s - GRASP_S, GRASP_S, lasts_s, GRASP_S)
