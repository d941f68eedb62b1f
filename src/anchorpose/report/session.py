"""One results folder as the report reads it: all its tables, or one sentence on what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import STATE_CODE, JointState
from anchorpose.report.axis import Bins, make_bins
from anchorpose.report.ledger import Ledger
from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    MEASURES_FILE,
    Contact,
    Definition,
    Episode,
    Measure,
    read_contacts,
    read_definition,
    read_episodes,
    read_measures,
)
from anchorpose.results.run_record import RUN_FILE, read_run_document
from anchorpose.results.stand_training.stance import stance
from anchorpose.results.tables import (
    ANGLES_FILE,
    JOINTS_FILE,
    POSTURE_FILE,
    AngleTable,
    JointTable,
    PostureTable,
    read_angles,
    read_joints,
    read_posture,
)

MEASURED: Final = (ANGLES_FILE, POSTURE_FILE, EPISODES_FILE, MEASURES_FILE)
"""What 'anchorpose measure' writes, from the joints."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """The tables of one recording. bins: how its frames are grouped in every chart of its page.

    posture_seen (n,) bool: whether all joints that determine posture were seen; the state in posture.parquet is that of
    the centre of mass. definition: how the measures were computed, None where their file does not say. contacts: None
    where the folder has no table of them, so that touch is not known.
    """

    folder: Path
    run: dict[str, Any]
    joints: JointTable
    angles: AngleTable
    posture: PostureTable
    posture_seen: np.ndarray
    episodes: tuple[Episode, ...]
    measures: tuple[Measure, ...]
    definition: Definition | None
    contacts: tuple[Contact, ...] | None
    bins: Bins
    ledger: Ledger

    @property
    def recording(self) -> str:
        """The name of the recording."""
        return str(self.run.get("recording", self.folder.resolve().name))


def read_session(folder: Path, name: str = "") -> Session:
    """All tables of a results folder; name: of its numbers, where a page shows several sessions.

    Raises InputError where one (but contacts.parquet) is missing, damaged, or does not fit the joints.
    """
    joints, run = read_joints(folder / JOINTS_FILE), read_run_document(folder / RUN_FILE)
    for file in MEASURED:
        if not (folder / file).is_file():
            problem = "is missing: the folder was written by an older version, or by hand"
            raise InputError(folder / file, problem, f"run 'anchorpose measure {folder}' and try again")
    angles, posture = read_angles(folder / ANGLES_FILE), read_posture(folder / POSTURE_FILE)
    for file, frame in ((ANGLES_FILE, angles.frame), (POSTURE_FILE, posture.frame)):
        if not np.array_equal(frame, joints.frame):
            problem, remedy = "has other frames than joints.parquet", f"run 'anchorpose measure {folder}'"
            raise InputError(folder / file, problem, remedy)
    return Session(
        folder=folder,
        run=run,
        joints=joints,
        angles=angles,
        posture=posture,
        posture_seen=stance(joints).state_code == STATE_CODE[JointState.OBSERVED],
        episodes=read_episodes(folder / EPISODES_FILE),
        measures=read_measures(folder / MEASURES_FILE),
        definition=read_definition(folder / MEASURES_FILE),
        contacts=read_contacts(folder / CONTACTS_FILE) if (folder / CONTACTS_FILE).is_file() else None,
        bins=make_bins(joints.frame, joints.time_s, name),
        ledger=Ledger(folder, name),
    )
