"""From the joints of a results folder to its angles, posture, episodes and measures, and the measures in words."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Sequence
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
from anchorpose.results.uncertainty import NORMAL_95
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


_SHOWN: Final = {
    "recorded_time": "recorded",
    "found_time": "patient found",
    "unknown_time": "posture not known",
    "upright_time": "upright",
    "upright_share": "upright, of the time in which posture is known",
    "longest_upright_bout": "longest time upright without a break",
    "sit_to_stand_count": "stood up from sitting",
    "sit_to_stand_duration_mean": "standing up took, mean",
    "stand_to_sit_count": "sat down",
    "stand_to_sit_duration_mean": "sitting down took, mean",
    "knee_flexion_upright_mean": "knee flexion while upright, mean",
    "knee_flexion_upright_least": "knee flexion while upright, least",
    "hip_flexion_upright_mean": "hip flexion while upright, mean",
    "knee_straight_time": "knee straight while upright (within 10°)",
    "knee_flexion_difference": "knee flexion, left less right",
    "load_share": "load on this foot, if standing still",
    "sway_velocity": "sway, mean velocity",
    "sway_ellipse_area": "sway, 95 % ellipse",
    "five_times_sit_to_stand": "five times sit to stand",
    "functional_reach": "functional reach",
    "single_leg_stance": "standing on one leg",
    "step_count": "steps",
    "assistance_time": "touched by others",
    "hands_free_upright_time": "upright with nobody's hands on",
    "hands_on_at_once_most": "most places touched at once",
}
"""The measures that are printed, in this order; all others are in measures.parquet."""

SHORT_S: Final = 0.001
"""Less unknown time than this is rounding."""

_UNIT: Final = {"1": "%", "deg": "°", "count": "", "cm2": "cm²"}


def measure_rows(measures: Sequence[Measure]) -> list[tuple[str, str, str, str]]:
    """What, value with its 95 % range, share that was inferred, and why there is no value; one row per measure."""
    rows, lower_bounds = [], _lower_bounds(measures)
    for name, words in _SHOWN.items():
        for row in measures:
            if row.measure == name and not (row.measure == "assistance_time" and row.person and row.part):
                inferred = "" if row.inferred_share is None else f"{100 * row.inferred_share:.0f} %"
                at_least = "at least " if row.value is not None and row.measure in lower_bounds else ""
                rows.append((_label(words, row), at_least + _value(row), inferred, row.why or ""))
    return rows


def processing_sentence(policy: str) -> str:
    """How many joint positions were smoothed, filled and left alone; policy: of ``ProcessedAngles``."""
    counted = json.loads(policy)
    counts = [f"{counted[f'joint_frames_{name}']} {name}" for name in (*PROCESSING, "lost")]
    return f"Of the joint positions of all frames, {', '.join(counts)}."


def _lower_bounds(measures: Sequence[Measure]) -> set[str]:
    """The measures whose true value may be larger, since part of the recording is unknown."""
    seconds = {row.measure: row.value for row in measures if row.value is not None and row.unit == "s"}
    found: set[str] = set()
    if seconds.get("unknown_time", 0.0) > SHORT_S:
        found |= {"upright_time", "sit_to_stand_count", "stand_to_sit_count"}
    if seconds.get("recorded_time", 0.0) - seconds.get("found_time", 0.0) > SHORT_S:
        found |= {"assistance_time"}
    return found


def _label(words: str, row: Measure) -> str:
    if row.part is not None:
        return f"  {row.part.replace('_', ' ')}"
    if row.person is not None:
        return f"  by {row.person}"
    return f"{words}, {row.side}" if row.side is not None else words


def _value(row: Measure) -> str:
    if row.value is None:
        return "unknown"
    factor = 100.0 if row.unit == "1" else 1.0
    unit = _UNIT.get(row.unit, row.unit)
    digits = 0 if row.unit == "count" and float(row.value).is_integer() else 1
    spread = "" if row.sigma is None else f" ± {NORMAL_95 * factor * row.sigma:.1f}"
    return f"{factor * row.value:.{digits}f}{spread} {unit}".rstrip()
