"""Compute angles, axes of knees and elbows, posture, episodes and measures (including assistance) from the joints of a
results folder.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.recording.events import Trials
from anchorpose.results.frame_time import frame_seconds
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.processing import ProcessingConfig, process_angles
from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    MEASURES_FILE,
    Contact,
    Measure,
    read_contacts,
    read_equipment_names,
    write_episodes,
    write_measures,
)
from anchorpose.results.revolute_joints import AXES_FILE, revolute_axes, write_axes
from anchorpose.results.stand_training.buckles import find_buckles
from anchorpose.results.stand_training.centre_of_mass import SwayConfig, centre_of_mass, sway_measures
from anchorpose.results.stand_training.event import Event, EventConfig, event_episodes
from anchorpose.results.stand_training.event_measures import event_measures
from anchorpose.results.stand_training.extension import (
    ExtensionConfig,
    extension_measures,
    range_measures,
    symmetry_measures,
)
from anchorpose.results.stand_training.failed_stands import find_failed_stands
from anchorpose.results.stand_training.independence import IndependenceConfig, extended_states, independence_measures
from anchorpose.results.stand_training.recovery_steps import find_recovery_steps
from anchorpose.results.stand_training.stance import Session, UprightConfig, stance, unknown, upright
from anchorpose.results.stand_training.steps import Step, find_steps, step_episodes, step_measures
from anchorpose.results.stand_training.tasks import task_measures
from anchorpose.results.stand_training.touch import NEVER_FOUND, NO_CONTACTS, NO_UPRIGHT, time_with_sigma, touch_of
from anchorpose.results.stand_training.tremor import TremorConfig, tremor_measures
from anchorpose.results.stand_training.upright import (
    Transition,
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
    POLICY_KEY,
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
from anchorpose.results.trial_measures import begun_within, completely_within, measures_by_trial, trial_intervals
from anchorpose.results.trial_table import INTERVALS_FILE, TRIALS_FILE, read_trial_table, write_intervals, write_trials
from anchorpose.results.verify import require_own
from anchorpose.settings import settings

CONTACT_MEASURES: Final = (
    ("assistance_time", "s"),
    ("contacts", "count"),
    ("assistance_share_upright", "1"),
    ("hands_free_upright_time", "s"),
    ("hands_free_upright_share", "1"),
    ("hands_on_at_once_mean", "count"),
    ("hands_on_at_once_most", "count"),
)


def assistance_measures(session: Session) -> list[Measure]:
    """Return the measures of assistance: first the time and number of contacts with people, then the measures while the
    patient is upright. Time and number are given in total, per person, per part of the patient's body, and per pair of
    person and part.

    Frames in which the patient was not found do not count, since contacts are unknown in them.
    """
    contacts = session.helping
    if contacts is None or not session.found.any():
        why = NO_CONTACTS if contacts is None else NEVER_FOUND
        return [unknown(name, unit, why) for name, unit in CONTACT_MEASURES]
    pairs = {(c.part, c.toucher) for c in contacts}
    persons, parts = sorted({(None, who) for _, who in pairs}), sorted({(part, None) for part, _ in pairs})
    groups: dict[tuple[str | None, str | None], list[Contact]]
    groups = {key: [] for key in ((None, None), *persons, *parts, *sorted(pairs))}
    for contact in contacts:
        for key in product((None, contact.part), (None, contact.toucher)):
            groups[key].append(contact)
    rows = [row for (part, person), some in groups.items() for row in _of_group(session, some, part, person)]
    return rows + _while_upright(session, contacts)


def _of_group(session: Session, contacts: Sequence[Contact], part: str | None, person: str | None) -> list[Measure]:
    touch = touch_of(session.joints.frame, contacts).where(session.found)
    time_s, sigma_s = time_with_sigma(touch, session.seconds, session.joints.time_s)
    frames, shared = int((touch.at_once > 0).sum()), touch.inferred_share
    side = next((end for end in ("left", "right") if part is not None and part.endswith(f"_{end}")), None)
    common: dict[str, Any] = {"side": side, "part": part, "person": person, "frames": frames, "inferred_share": shared}
    return [
        Measure(measure="assistance_time", value=time_s, unit="s", sigma=sigma_s, **common),
        Measure(measure="contacts", value=float(len(contacts)), unit="count", **common),
    ]


def _while_upright(session: Session, contacts: Sequence[Contact]) -> list[Measure]:
    """Return measures of assistance while the patient is upright: the share of the upright time in which people's hands
    are on the patient; the time and share in which no hand is on the patient; and the mean and largest number of
    simultaneous contacts.
    """
    standing = session.upright
    frames, upright_s = int(standing.sum()), float(session.seconds[standing].sum())
    if not upright_s:
        return [unknown(name, unit, NO_UPRIGHT) for name, unit in CONTACT_MEASURES[2:]]
    helped = touch_of(session.joints.frame, contacts).where(session.found & standing)
    at_once = helped.at_once[standing]
    helped_s, sigma_s = time_with_sigma(helped, session.seconds, session.joints.time_s)
    mean = float(np.average(at_once, weights=session.seconds[standing]))
    shared = helped.inferred_share
    of_help = (shared, None, None, shared, shared)  # None, since hands-free time has no contacts
    values = (helped_s / upright_s, upright_s - helped_s, 1.0 - helped_s / upright_s, mean, float(at_once.max()))
    share_sigma = None if sigma_s is None else sigma_s / upright_s
    sigmas = (share_sigma, sigma_s, share_sigma, None, None)
    return [
        Measure(measure=name, value=value, unit=unit, sigma=sigma, frames=frames, inferred_share=inferred)
        for (name, unit), value, sigma, inferred in zip(CONTACT_MEASURES[2:], values, sigmas, of_help, strict=True)
    ]


@settings
class MeasureConfig:
    """The thresholds in the definitions of measures (docs/measures.md). The thresholds are stored in the file of the
    measures.
    """

    upright: UprightConfig = field(default_factory=UprightConfig)
    transitions: TransitionConfig = field(default_factory=TransitionConfig)
    extension: ExtensionConfig = field(default_factory=ExtensionConfig)
    sway: SwayConfig = field(default_factory=SwayConfig)
    independence: IndependenceConfig = field(default_factory=IndependenceConfig)
    events: EventConfig = field(default_factory=EventConfig)
    tremor: TremorConfig = field(default_factory=TremorConfig)


def measure_session(
    joints: JointTable,
    angles: AngleTable,
    contacts: tuple[Contact, ...] | None,
    config: MeasureConfig,
    trials: Trials | None = None,
    equipment: Sequence[str] = (),
) -> tuple[Session, list[Measure]]:
    """Return the session with its posture and episodes, and every measure of docs/measures.md.

    contacts: contacts with people and equipment; None if unknown, which is not the same as no contact. equipment: the
    parts that were searched for contacts; without such parts, it is unknown whether the patient held on to anything.
    With trials, the measures of the whole recording are followed by the measures of every trial and of every condition.
    """
    quiet, moves, steps = _quiet_session(joints, angles, contacts, config, equipment)
    events = find_events(quiet, steps, config)
    session = replace(quiet, episodes=(*quiet.episodes, *event_episodes(joints, events)))
    measures = _measures(session, moves, steps, events, config)
    if trials is None:
        return session, measures

    def of_trial(part: Session, rows: slice) -> list[Measure]:
        own_moves, own_steps = completely_within(moves, rows), completely_within(steps, rows)
        return _measures(part, own_moves, own_steps, begun_within(events, rows), config)

    return session, [*measures, *measures_by_trial(session, trials, measures, config.sway.settle_s, of_trial)]


def _quiet_session(
    joints: JointTable,
    angles: AngleTable,
    contacts: tuple[Contact, ...] | None,
    config: MeasureConfig,
    equipment: Sequence[str],
) -> tuple[Session, list[Transition], list[Step]]:
    """Return the session with all its episodes except events, and its transitions and steps. Events are searched for
    later, in this session.
    """
    body = centre_of_mass(joints)
    found = stance(joints, body.position_m)
    state = upright(found, config.upright)
    moves = transitions(joints, found, state, config.transitions)
    bouts, steps = upright_episodes(joints, found, state), find_steps(joints, state == UPRIGHT)
    worst = np.maximum(body.state_code, found.state_code)
    session = Session(
        joints=joints,
        angles=angles,
        posture=PostureTable(joints.frame, joints.time_s, body.position_m, body.sigma_m, state, worst),
        stance=found,
        seconds=frame_seconds(joints.time_s),
        episodes=(*bouts, *transition_episodes(joints, found, moves), *step_episodes(joints, steps)),
        contacts=contacts,
        equipment=tuple(equipment),
        shifted_upright=np.stack([upright(found, config.upright, shift) for shift in (-1.0, 1.0)], axis=1),
        extended=extended_states(angles, found, config.independence),
        onset_s=float(joints.time_s[0]),
    )
    return session, moves, steps


def find_events(session: Session, steps: list[Step], config: MeasureConfig) -> list[Event]:
    """Return buckling knees, failed stands and recovery steps of a session, in this order, each kind in the order of
    time. ``session.episodes`` must contain the transitions between sitting and standing.
    """
    return [
        *find_buckles(session, config.events),
        *find_failed_stands(session, config.transitions, config.events),
        *find_recovery_steps(session, steps, config.events),
    ]


def _measures(
    session: Session, moves: list[Transition], steps: list[Step], events: list[Event], config: MeasureConfig
) -> list[Measure]:
    """Return every measure of a whole session, or of a session that was cut to a trial. moves: the transitions between
    sitting and standing in this session; steps, events: the steps and the events in it.
    """
    return [
        *time_measures(session),
        *transition_measures(session, moves),
        *extension_measures(session, config.extension),
        *sway_measures(session, config.sway),
        *symmetry_measures(session),
        *range_measures(session),
        *task_measures(session, config.transitions),
        *step_measures(session, steps),
        *event_measures(session, events, config.events),
        *tremor_measures(session, config.tremor),
        *assistance_measures(session),
        *independence_measures(session),
    ]


@dataclass(frozen=True, slots=True, eq=False)
class MeasureResult:
    """The result of measuring a folder. measures: measures of the whole recording; policy: settings and outcome of
    smoothing and filling, as JSON, None without processing; trials: the trials that were measured as well, None without
    trials.
    """

    measures: tuple[Measure, ...]
    policy: str | None
    trials: Trials | None = None


def write_measured(
    results: Path, processing: ProcessingConfig, config: MeasureConfig, trials: Trials | None = None
) -> MeasureResult:
    """Write angles, axes, posture, episodes and measures of a results folder, and the processed angles if processing is
    chosen.

    trials: the trials that replace the folder's trials; None keeps the folder's trials. Angles and measures always come
    from the joints as tracked. ``processing`` affects only angles_processed.parquet, which is removed if no processing
    is chosen. No old file is replaced before all new files are written. Raises InputError if joints or contacts cannot
    be used, AnchorposeError if the filter does not fit the frame rate.
    """
    require_own(results, (JOINTS_FILE, CONTACTS_FILE, *((TRIALS_FILE,) if trials is None else ())))
    if trials is None and (results / TRIALS_FILE).exists():
        trials = read_trial_table(results / TRIALS_FILE)
    joints = read_joints(results / JOINTS_FILE)
    path = results / CONTACTS_FILE
    contacts, equipment = (read_contacts(path), read_equipment_names(path)) if path.exists() else (None, ())
    work = Path(tempfile.mkdtemp(prefix=".measuring-", dir=results))
    try:
        processed, policy = process_angles(joints, processing) if processing.active else (None, None)
        if processed is not None and policy is not None:
            write_processed_angles(work / PROCESSED_FILE, processed, {POLICY_KEY: policy})
        angles = joint_angles(joints)
        session, measures = measure_session(joints, angles, contacts, config, trials, equipment)
        write_angles(work / ANGLES_FILE, angles)
        write_axes(work / AXES_FILE, revolute_axes(joints))
        write_posture(work / POSTURE_FILE, session.posture)
        write_episodes(work / EPISODES_FILE, session.episodes)
        write_measures(work / MEASURES_FILE, measures, asdict(config))
        if trials is not None:
            write_trials(work / TRIALS_FILE, trials)
            write_intervals(work / INTERVALS_FILE, trial_intervals(session, trials))
        for written in sorted(work.iterdir()):
            written.replace(results / written.name)
        if processed is None:
            (results / PROCESSED_FILE).unlink(missing_ok=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    whole = tuple(row for row in measures if row.condition is None)
    return MeasureResult(whole, policy, trials)


def processing_sentence(policy: str) -> str:
    """Return a sentence on how many joint positions were smoothed, filled and left as measured. policy: the settings
    and outcome of smoothing and filling, as JSON.
    """
    counted = json.loads(policy)
    counts = [f"{counted[f'joint_frames_{name}']} {name}" for name in (*PROCESSING, "lost")]
    return f"Of the joint positions of all frames, {', '.join(counts)}."
