"""From the joints of a results folder to its angles, posture, episodes and measures, and the measures in words."""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.results.frame_time import frame_seconds
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.processing import ProcessingConfig, process_angles
from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    MEASURES_FILE,
    Contact,
    Measure,
    read_contacts,
    write_episodes,
    write_measures,
)
from anchorpose.results.stand_training.assistance import assistance_measures
from anchorpose.results.stand_training.centre_of_mass import SwayConfig, centre_of_mass, sway_measures
from anchorpose.results.stand_training.extension import (
    ExtensionConfig,
    extension_measures,
    range_measures,
    symmetry_measures,
)
from anchorpose.results.stand_training.stance import Session, UprightConfig, stance, upright
from anchorpose.results.stand_training.steps import find_steps, step_episodes, step_measures
from anchorpose.results.stand_training.tasks import task_measures
from anchorpose.results.stand_training.upright import (
    TransitionConfig,
    time_measures,
    transition_episodes,
    transition_measures,
    transitions,
    upright_episodes,
)
from anchorpose.results.tables import (
    ANGLES_FILE,
    JOINTS_FILE,
    POSTURE_FILE,
    PROCESSED_FILE,
    PROCESSING,
    UPRIGHT,
    AngleTable,
    JointTable,
    PostureTable,
    read_joints,
    write_angles,
    write_posture,
    write_processed_angles,
)
from anchorpose.results.verify import require_own
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


WRITTEN: Final = (ANGLES_FILE, POSTURE_FILE, EPISODES_FILE, MEASURES_FILE, PROCESSED_FILE)
"""What ``write_measured`` writes, or removes."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasureResult:
    """All measures; policy: that of ``ProcessedAngles``, None without processing."""

    measures: tuple[Measure, ...]
    policy: str | None


def write_measured(results: Path, processing: ProcessingConfig, config: MeasureConfig) -> MeasureResult:
    """Writes angles, posture, episodes and measures of a results folder, and the processed angles if any.

    Angles and measures always come from the joints as tracked: ``processing`` makes angles_processed.parquet and
    nothing else, and without processing that file is removed. All files are written before the first is
    replaced.
    Raises InputError where joints or contacts cannot be used, AnchorposeError where the filter does not fit.
    """
    require_own(results, (JOINTS_FILE, CONTACTS_FILE))
    joints = read_joints(results / JOINTS_FILE)
    contacts = read_contacts(results / CONTACTS_FILE) if (results / CONTACTS_FILE).exists() else None
    work = Path(tempfile.mkdtemp(prefix=".measuring-", dir=results))
    try:
        processed = process_angles(joints, processing) if processing.active else None
        if processed is not None:
            write_processed_angles(work / PROCESSED_FILE, processed)
        angles = joint_angles(joints)
        session, measures = measure_session(joints, angles, contacts, config)
        write_angles(work / ANGLES_FILE, angles)
        write_posture(work / POSTURE_FILE, session.posture)
        write_episodes(work / EPISODES_FILE, session.episodes)
        write_measures(work / MEASURES_FILE, measures, asdict(config))
        for written in sorted(work.iterdir()):
            written.replace(results / written.name)
        if processed is None:
            (results / PROCESSED_FILE).unlink(missing_ok=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return MeasureResult(tuple(measures), None if processed is None else processed.policy)


def processing_sentence(policy: str) -> str:
    """How many joint positions were smoothed, filled and left alone; policy: of ``ProcessedAngles``."""
    counted = json.loads(policy)
    counts = [f"{counted[f'joint_frames_{name}']} {name}" for name in (*PROCESSING, "lost")]
    return f"Of the joint positions of all frames, {', '.join(counts)}."
