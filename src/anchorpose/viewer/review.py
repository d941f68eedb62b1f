"""Everything that is looked at in one sitting: the tables, the recording behind them, the corrections so far."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anchorpose.errors import InputError
from anchorpose.results.poses import POSES_FILE, PoseTable, read_poses
from anchorpose.results.records import CONTACTS_FILE, Contact, read_contacts
from anchorpose.results.run_record import RUN_FILE, read_run_document
from anchorpose.results.tables import (
    ANCHORS_FILE,
    ANGLES_FILE,
    JOINTS_FILE,
    AnchorTable,
    AngleTable,
    JointTable,
    read_anchors,
    read_angles,
    read_joints,
)
from anchorpose.viewer.depth_frames import Footage, open_footage


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Review:
    """poses, anchors: None in results of a release that did not keep them. footage: None without a recording."""

    name: str
    run: dict[str, Any]
    joints: JointTable
    angles: AngleTable
    contacts: tuple[Contact, ...]
    poses: PoseTable | None
    anchors: AnchorTable | None
    footage: Footage | None

    @property
    def matched_share(self) -> np.ndarray:
        """(n,) share of the followed points found again in the next frame, NaN where nothing was asked."""
        told = (self.run.get("association") or {}).get("matched_share", [])
        count = len(self.joints.frame)
        if len(told) != count:
            return np.full(count, np.nan)
        return np.array([np.nan if share is None else share for share in told], dtype=np.float64)


def open_review(results: Path, recording: Path | None) -> Review:
    """Raises InputError where the results cannot be read, or the recording is not the one they were made of."""
    joints = read_joints(results / JOINTS_FILE)
    run = read_run_document(results / RUN_FILE)
    poses = read_poses(results / POSES_FILE) if (results / POSES_FILE).exists() else None
    anchors = read_anchors(results / ANCHORS_FILE) if (results / ANCHORS_FILE).exists() else None
    angles = read_angles(results / ANGLES_FILE)
    tables: dict[str, AngleTable | PoseTable | AnchorTable | None] = {
        POSES_FILE: poses, ANCHORS_FILE: anchors, ANGLES_FILE: angles,
    }  # fmt: skip
    for file, table in tables.items():
        if table is not None and not np.array_equal(table.frame, joints.frame):
            raise InputError(results / file, "has other frames than joints.parquet", "track the recording again")
    contacts = read_contacts(results / CONTACTS_FILE) if (results / CONTACTS_FILE).exists() else ()
    return Review(
        name=results.resolve().name,
        run=run,
        joints=joints,
        angles=angles,
        contacts=contacts,
        poses=poses,
        anchors=anchors,
        footage=None if recording is None else open_footage(recording, results, run, joints.frame),
    )
