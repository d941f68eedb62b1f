"""Read all tables of a results folder for the report. If a table is missing, the error states this in one sentence."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import STATE_CODE, JointState
from anchorpose.recording.events import Trials
from anchorpose.report.chart import Bins, make_bins
from anchorpose.report.words import counted
from anchorpose.results.explained import EXPLAINED_FILE, ExplainedTable, read_explained
from anchorpose.results.parquet import TRACK_AGAIN
from anchorpose.results.ratings import rating_measures
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
    read_trial_measures,
)
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.stand_training.stance import stance_state
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
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table
from anchorpose.results.verify import require_own

MEASURED: Final = (ANGLES_FILE, POSTURE_FILE, EPISODES_FILE, MEASURES_FILE)
"""Files that 'anchorpose measure' computes from the joints."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """All tables of a results folder.

    name: name of the session on a page with several sessions, else empty. run: the content of run.json without the
    hashes of the inputs. inputs: the hashes of the inputs, as (file, (hash,)), with one hash for all images of a
    camera. definition: the definition by which the measures were computed, None if their file does not state it.
    posture_seen (n,) bool: whether all joints that determine posture were seen; this differs from the state codes in
    posture.parquet, which are about all joints that determine the centre of mass. contacts: None if the folder has no
    table of contacts; it is then unknown whether the patient was touched. explained: the table of how well each pose
    fits the depth images of its frame, None if the folder lacks it. bins: how frames are grouped in all charts. trials:
    None for results without trials. trial_measures: measures of all trials, then of all conditions.
    """

    folder: Path
    name: str
    run: dict[str, Any]
    inputs: tuple[tuple[str, tuple[str]], ...]
    measures: tuple[Measure, ...]
    definition: Definition | None
    joints: JointTable
    angles: AngleTable
    posture: PostureTable
    posture_seen: np.ndarray
    episodes: tuple[Episode, ...]
    contacts: tuple[Contact, ...] | None
    explained: ExplainedTable | None
    bins: Bins
    trials: Trials | None = None
    trial_measures: tuple[Measure, ...] = ()

    @property
    def recording(self) -> str:
        """Return the name of the recording."""
        return str(self.run.get("recording", self.folder.resolve().name))


def read_session(folder: Path, name: str = "") -> Session:
    """Read all tables of a results folder.

    Raises InputError if a table is missing (except contacts and explained), is damaged, was replaced, or does not have
    the same frames as the table of joints.
    """
    run = read_run(folder / RUN_FILE)
    for file in MEASURED:
        if not (folder / file).is_file():
            problem = "is missing: the folder was written by an older version, or by hand"
            raise InputError(folder / file, problem, f"run 'anchorpose measure {folder}' and try again")
    require_own(folder, (JOINTS_FILE, CONTACTS_FILE, EXPLAINED_FILE, TRIALS_FILE, *MEASURED), run)
    joints = read_joints(folder / JOINTS_FILE)
    trials = read_trial_table(folder / TRIALS_FILE) if (folder / TRIALS_FILE).is_file() else None
    rated = () if trials is None else rating_measures(folder, run, trials)
    angles, posture = read_angles(folder / ANGLES_FILE), read_posture(folder / POSTURE_FILE)
    explained = read_explained(folder / EXPLAINED_FILE) if (folder / EXPLAINED_FILE).is_file() else None
    for file, table in ((ANGLES_FILE, angles), (POSTURE_FILE, posture), (EXPLAINED_FILE, explained)):
        if table is not None and not np.array_equal(table.frame, joints.frame):
            remedy = TRACK_AGAIN if file == EXPLAINED_FILE else f"run 'anchorpose measure {folder}'"
            raise InputError(folder / file, "has other frames than joints.parquet", remedy)
    return Session(
        folder=folder,
        name=name,
        inputs=input_hashes(run.pop("inputs_sha256")),
        run=run,
        measures=read_measures(folder / MEASURES_FILE),
        definition=read_definition(folder / MEASURES_FILE),
        joints=joints,
        angles=angles,
        posture=posture,
        posture_seen=stance_state(joints) == STATE_CODE[JointState.OBSERVED],
        episodes=read_episodes(folder / EPISODES_FILE),
        contacts=read_contacts(folder / CONTACTS_FILE) if (folder / CONTACTS_FILE).is_file() else None,
        explained=explained,
        bins=make_bins(joints.frame, joints.time_s, name),
        trials=trials,
        trial_measures=(*read_trial_measures(folder / MEASURES_FILE), *rated),
    )


def input_hashes(hashes: dict[str, str]) -> tuple[tuple[str, tuple[str]], ...]:
    """Return one hash per input file, except depth images: these share one hash per camera."""
    pictures: dict[str, list[str]] = {}
    named = list[tuple[str, tuple[str]]]()
    for file, digest in sorted(hashes.items()):
        folder, _, name = file.rpartition("/")
        if name.split(".")[0].isdigit():
            pictures.setdefault(folder, []).append(digest)
        else:
            named.append((file, (digest,)))
    grouped = [
        (
            f"{folder}: {counted(len(digests), 'picture')}, the hash of their hashes in run.json, in order of names",
            (hashlib.sha256("\n".join(digests).encode("ascii")).hexdigest(),),
        )
        for folder, digests in pictures.items()
    ]
    return (*named, *grouped)
