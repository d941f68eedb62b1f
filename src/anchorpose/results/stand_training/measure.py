"""All measures of stand training: from joints and contacts to posture, episodes and measures."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from anchorpose.results.frame_time import frame_seconds
from anchorpose.results.records import Contact, Measure
from anchorpose.results.stand_training.assistance import assistance_measures
from anchorpose.results.stand_training.centre_of_mass import centre_of_mass
from anchorpose.results.stand_training.extension import ExtensionConfig, extension_measures, symmetry_measures
from anchorpose.results.stand_training.ranges import range_measures
from anchorpose.results.stand_training.session import Session
from anchorpose.results.stand_training.stance import UprightConfig, stance, upright
from anchorpose.results.stand_training.steps import find_steps, step_episodes, step_measures
from anchorpose.results.stand_training.sway import SwayConfig, sway_measures
from anchorpose.results.stand_training.tasks import task_measures
from anchorpose.results.stand_training.upright import (
    TransitionConfig,
    time_measures,
    transition_episodes,
    transition_measures,
    transitions,
    upright_episodes,
)
from anchorpose.results.tables import UPRIGHT, AngleTable, JointTable, PostureTable
from anchorpose.settings import settings


@settings
class MeasureConfig:
    """The thresholds in the definitions of docs/measures.md, recorded with the measures."""

    upright: UprightConfig = field(default_factory=UprightConfig)
    transitions: TransitionConfig = field(default_factory=TransitionConfig)
    extension: ExtensionConfig = field(default_factory=ExtensionConfig)
    sway: SwayConfig = field(default_factory=SwayConfig)


def measure_session(
    joints: JointTable, angles: AngleTable, contacts: tuple[Contact, ...] | None, config: MeasureConfig
) -> tuple[Session, list[Measure]]:
    """The session with its posture and episodes, and every measure of docs/measures.md.

    contacts: None where they are unknown, which is not the same as no contact.
    """
    body = centre_of_mass(joints)
    found = stance(joints, body.position_m)
    state = upright(found, config.upright)
    moves = transitions(joints, found, state, config.transitions)
    bouts, steps = upright_episodes(joints, found, state), find_steps(joints, state == UPRIGHT)
    session = Session(
        joints=joints,
        angles=angles,
        posture=PostureTable(
            joints.frame,
            joints.time_s,
            body.position_m,
            body.sigma_m,
            state,
            np.maximum(body.state_code, found.state_code),
        ),
        stance=found,
        seconds=frame_seconds(joints.time_s),
        episodes=(*bouts, *transition_episodes(joints, found, moves), *step_episodes(joints, steps)),
        contacts=contacts,
    )
    return session, [
        *time_measures(session, config.upright),
        *transition_measures(session, moves),
        *extension_measures(session, config.extension),
        *sway_measures(session, config.sway),
        *symmetry_measures(session),
        *range_measures(session),
        *task_measures(session, config.transitions),
        *step_measures(session, steps),
        *assistance_measures(session),
    ]
