"""Score answers about joints in the user's real recordings by labels set by eye: a second part of the benchmark."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.answers import PLACE, check_places, read_table
from anchorpose.research.benchmark.labels import LABELLERS, off_m, read_labels
from anchorpose.research.benchmark.score import Asked, TaskScore, summarise

FILE: Final = "real.csv"
COLUMNS: Final = {"recording": pa.string(), "person": pa.string(), "frame": pa.int64(), "joint": pa.string(), **PLACE}

Joints = dict[tuple[str, str, int], np.ndarray]
"""Joints (21, 3) by recording, person and frame: metres in the first camera's coordinates, NaN = missing."""


def score_real(answers: Path, recordings: Path, labels: Path) -> dict[str, TaskScore]:
    """Return the score by name of the recording, for each labelled recording in the folder ``recordings``.

    The error of a joint is its distance from the label, perpendicular to the line of sight. The labels of both
    labellers count. A joint that is not at the labelled person's depth counts as missing. Raises InputError if no
    recording has labels.
    """
    joints, scores = _read(answers / FILE), dict[str, TaskScore]()
    names = sorted({path.name.split(".")[0] for path in labels.glob("*.first.json")})
    unknown = sorted({name for name, _, _ in joints} - set(names))
    if unknown:
        raise InputError(answers / FILE, f"names the recording '{unknown[0]}'", f"use {', '.join(names)}")
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
    """Yield the error of each labelled joint in metres; inf if the answer is missing or not at the label's depth."""
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


def _read(path: Path) -> Joints:
    table = read_table(path, COLUMNS)
    check_places(path, np.column_stack([table[name] for name in PLACE]))
    joints: Joints = {}
    for recording, person, frame, joint, *place in zip(*(table[name] for name in COLUMNS), strict=True):
        if joint not in JOINT_INDEX:
            raise InputError(path, f"names the unknown joint '{joint}'", f"use names such as {next(iter(JOINT_INDEX))}")
        key = (str(recording), str(person), int(frame))
        joints.setdefault(key, np.full((JOINT_COUNT, 3), np.nan))[JOINT_INDEX[joint]] = place
    return joints
