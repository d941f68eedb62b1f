"""Results folders made up for the tests of the report: a patient who sits, stands up, squats and is held."""

import json
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from results_builder import make_frame, standing_joints, write_results
from session_builder import contact

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, JointState
from anchorpose.results.measuring import MeasureConfig
from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    MEASURES_FILE,
    Contact,
    Episode,
    Measure,
    write_contacts,
    write_episodes,
    write_measures,
)
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, POSTURE_FILE, JointFrame, PostureTable, read_joints, write_posture

RATE_HZ = 30.0

KNEE = {"measure": "knee_flexion_upright_mean", "unit": "deg"}
MEASURES = (
    Measure(measure="recorded_time", value=4.0, unit="s", frames=120),
    Measure(measure="unknown_time", value=0.0, unit="s", frames=120),
    Measure(measure="upright_share", value=0.8125, unit="1", sigma=0.03, frames=120, inferred_share=0.25),
    Measure(measure="upright_time", value=3.25, unit="s", sigma=0.12, frames=120, inferred_share=0.25),
    Measure(measure="sit_to_stand_count", value=1.0, unit="count", frames=120),
    Measure(**KNEE, side="left", value=12.345, sigma=1.5, frames=90, inferred_share=0.5),
    Measure(**KNEE, side="right", value=None, frames=0, why="the right knee is lost <always>"),
    Measure(measure="sway_time", value=2.5, unit="s", frames=80),
    Measure(measure="sway_path", value=432.1, unit="mm", sigma=50.0, frames=80, inferred_share=0.0),
    Measure(measure="assistance_share_upright", value=0.4, unit="1", sigma=0.02, frames=120, inferred_share=0.004),
    Measure(measure="assistance_time", side="left", part="knee_left", value=0.67, unit="s", sigma=0.03, frames=20),
    Measure(
        measure="assistance_time", side="left", part="knee_left", person="person 1", value=0.67, unit="s", frames=20
    ),
)


def squat(frame: int, count: int) -> np.ndarray:
    """(21, 3) metres: knees forward and down with the frames, twice over the recording."""
    deep = 0.5 - 0.5 * np.cos(4 * np.pi * frame / max(count, 1))
    joints = standing_joints()
    for name in JOINT_NAMES:
        if not name.startswith(("Ankle", "Foot", "Knee")):
            joints[JOINT_INDEX[name]] -= (0.1 * deep, 0.25 * deep, 0.0)
    for side, more in (("Left", 1.0), ("Right", 0.8)):
        joints[JOINT_INDEX[f"Knee{side}"]] += (0.2 * deep * more, -0.05 * deep, 0.0)
    return joints


def squats(count: int, seed: int = 5) -> list[JointFrame]:
    """A noisy recording: the left leg is hidden by a person in the middle third, the head lost at the end."""
    random, frames = np.random.default_rng(seed), []
    for frame in range(count):
        hidden = count // 3 <= frame < 2 * count // 3
        leg = ("KneeLeft", "AnkleLeft", "FootLeft") if hidden else ()
        states = dict.fromkeys(leg, JointState.HIDDEN_BY_PERSON) | {"HandRight": JointState.HIDDEN_BY_EQUIPMENT}
        joints = squat(frame, count) + random.normal(scale=0.003, size=(21, 3))
        lost = ("Head",) if frame >= count - count // 10 else ()
        made = make_frame(frame, frame / RATE_HZ, joints, lost, 0.008, states)
        made.sigma_m[[JOINT_INDEX[name] for name in leg]] = 0.04
        frames.append(made)
    return frames


def write_session(
    folder: Path,
    frames: list[JointFrame],
    measures: Iterable[Measure] = MEASURES,
    contacts: Iterable[Contact] | None = None,
    **run: object,
) -> Path:
    """A results folder with all tables; run: what else its run.json says."""
    write_results(folder, frames)
    document = json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))
    document |= {"association": {"matched_share": [None] + [0.9] * (len(frames) - 1)}} | run
    (folder / RUN_FILE).write_text(json.dumps(document), encoding="utf-8")
    with write_contacts(folder / CONTACTS_FILE) as table:
        for contact in _contacts(frames) if contacts is None else contacts:
            table.append(contact)
    write_measured(folder, measures)
    return folder


def write_measured(folder: Path, measures: Iterable[Measure] = MEASURES) -> None:
    """posture, episodes and measures of the joints that stand in a folder."""
    joints = read_joints(folder / JOINTS_FILE)
    count, place = len(joints.frame), joints.position_m[:, JOINT_INDEX["SpineBase"]]
    upright = np.where(np.isnan(place[:, 1]), -1, np.arange(count) >= count // 4).astype(np.int8)
    posture = PostureTable(
        joints.frame,
        joints.time_s,
        place,
        np.full(count, 0.01),
        upright,
        joints.state_code[:, JOINT_INDEX["SpineBase"]],
    )
    write_posture(folder / POSTURE_FILE, posture)
    write_episodes(folder / EPISODES_FILE, _episodes(joints.frame, joints.time_s))
    write_measures(folder / MEASURES_FILE, tuple(measures), asdict(MeasureConfig()))


def _episodes(frame: np.ndarray, time_s: np.ndarray) -> list[Episode]:
    count = len(frame)
    kinds = (("sit_to_stand", count // 5, count // 4), ("upright", count // 4, count - 1))
    return [
        Episode(
            kind=kind,
            first_frame=int(frame[a]),
            last_frame=int(frame[b]),
            start_s=float(time_s[a]),
            end_s=float(time_s[b]),
            state=JointState.OBSERVED,
        )
        for kind, a, b in kinds
    ]


def _contacts(frames: list[JointFrame]) -> list[Contact]:
    """Person 1 holds the left knee, seen; person 2 the pelvis, mostly inferred."""
    count = len(frames)
    spans = (("knee_left", 1, count // 3, count // 2, 0.9), ("pelvis", 2, count // 4, count - 1, 0.2))
    return [
        replace(
            contact(part, f"person {person}", frames[first].frame, frames[last].frame, seen),
            start_s=frames[first].time_s,
            end_s=frames[last].time_s,
        )
        for part, person, first, last, seen in spans
    ]
