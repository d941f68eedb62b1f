"""Score answers about joints in the user's real recordings, by comparison with labels set by eye. Real recordings are
the second part of the benchmark; the recordings of the first part are simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_NAMES
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.answers import PLACE, check_places, codes_of, read_table, refuse_row, repeated
from anchorpose.research.benchmark.labels import LABELLERS, labelled_recordings, off_m, read_labels
from anchorpose.research.benchmark.score import Asked, TaskScore, summarise

FILE: Final = "real.csv"
COLUMNS: Final = {"recording": pa.string(), "person": pa.string(), "frame": pa.int64(), "joint": pa.string(), **PLACE}

Joints = dict[tuple[str, str, int], np.ndarray]
"""Joints (21, 3) by recording, person and frame: metres in the first camera's coordinates, NaN = missing."""


def score_real(answers: Path, recordings: Path, labels: Path) -> dict[str, TaskScore]:
    """Return the score by name of the recording, for each labelled recording in the folder ``recordings``.

    The error of a joint is its distance from the label, perpendicular to the line of sight. Each answer is compared
    with the labels of both labellers, and each of these distances counts. A joint too far in front of or behind the
    labelled skin counts as missing. Only people whose head and more than half of whose trunk are seen
    (``LabelledPerson.plain``) are scored. Raises InputError if no recording has labels.
    """
    names = labelled_recordings(labels)
    if not names:
        raise InputError(labels, "has no labels of recordings", "give the folder benchmarks/labels")
    joints, scores = read_real(answers / FILE, labels, names), dict[str, TaskScore]()
    for name in (name for name in names if (recordings / name / "recording.json").is_file()):
        off_m = np.array(list(_distances(name, joints, recordings / name, labels)))
        no = np.zeros(len(off_m), bool)
        if len(off_m):
            error_mm = np.where(np.isfinite(off_m), 1000.0 * off_m, np.nan)
            scores[name] = summarise([Asked(error_mm, no, no, np.full((len(no), 3), np.nan))])
    if not scores:
        raise InputError(recordings, "has no recording with labels", f"it needs folders such as {', '.join(names[:2])}")
    return scores


def _distances(name: str, joints: Joints, folder: Path, labels: Path) -> Iterator[float]:
    """Yield the error of each labelled joint in metres; inf if the answer is missing, or too far in front of or behind
    the labelled skin.
    """
    recording = open_recording(folder)
    camera = replace(recording.cameras[0], T_world_camera=np.eye(4))
    for labeller in LABELLERS:
        for frame, people in read_labels(labels, name, labeller).items():
            depth_m = read_frame(recording, int(np.flatnonzero(recording.streams[0].frame == frame)[0])).depths_m[0]
            for person in people:
                if person.plain and depth_m is not None:
                    missing = np.full((JOINT_COUNT, 3), np.nan)
                    yield from off_m(
                        person, joints.get((name, person.person, frame), missing), depth_m, camera
                    ).values()


def read_real(path: Path, labels: Path, names: Sequence[str]) -> Joints:
    """Read the answers about the labelled recordings ``names``; raises InputError with the first row about a recording,
    person, frame or joint that has no labels, or the first row that repeats an earlier one.
    """
    table = read_table(path, COLUMNS)
    recording, person, frame = table["recording"], table["person"], table["frame"]
    known = (("recording", names), ("joint", JOINT_NAMES))
    recording_code, joint = (codes_of(path, name, table[name], among) for name, among in known)
    place_m = np.column_stack([table[name] for name in PLACE])
    check_places(path, place_m)
    _require_labelled(path, list(zip(recording, person, frame.tolist(), strict=True)), labels, names)
    again = repeated(recording_code, joint, np.unique(person, return_inverse=True)[1], frame)
    refuse_row(path, again, "repeats an earlier row", "give each joint of a person and frame once")
    joints: Joints = {}
    for *key, number, place in zip(recording, person, frame.tolist(), joint, place_m, strict=True):
        joints.setdefault(tuple(key), np.full((JOINT_COUNT, 3), np.nan))[number] = place
    return joints


def _require_labelled(path: Path, rows: list[tuple[str, str, int]], labels: Path, names: Sequence[str]) -> None:
    """Raise InputError with the first row (recording, person, frame) whose person has no labels in its recording, or
    whose frame has no labels.
    """
    frames = [(name, *each) for name in names for who in LABELLERS for each in read_labels(labels, name, who).items()]
    people = {(name, one.person) for name, _, labelled in frames for one in labelled}
    numbers = {(name, number) for name, number, _ in frames}
    unknown = np.array([row[:2] not in people for row in rows], bool)
    refuse_row(path, unknown, "names an unknown person", "use the letters of the recording's labels")
    unlabelled = np.array([(name, number) not in numbers for name, _, number in rows], bool)
    refuse_row(path, unlabelled, "has a frame without labels", "answer the labelled frames only")
