"""One results folder as the report reads it: all its tables, or one sentence on what is missing; its frames in groups.

A long recording on a narrow page is drawn in groups of frames, each by its lowest and highest value. Every k-th frame
would lose what lasts one frame: a jerk, a gap, the worst moment. The lowest and highest of each group are what a line
through all frames would cover, so peaks keep their place and height.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import STATE_CODE, JointState
from anchorpose.report.frame_columns import FrameColumns
from anchorpose.report.ledger import Ledger
from anchorpose.report.words import counted
from anchorpose.results.explained import EXPLAINED_FILE, ExplainedTable, read_explained
from anchorpose.results.parquet import TRACK_AGAIN
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
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.stand_training.stance import stance_state
from anchorpose.results.tables import (
    ANGLES,
    ANGLES_FILE,
    JOINTS,
    JOINTS_FILE,
    POSTURE_FILE,
    AngleTable,
    JointTable,
    PostureTable,
    read_angles,
    read_joints,
    read_posture,
)
from anchorpose.results.verify import require_own

MOST_BINS: Final = 600
"""Groups at most: about one and a half pixels each on a page, a third of a millimetre on paper."""

PAUSE: Final = 3.0
"""A gap of more than this many usual intervals between frames is a pause, across which no line is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Groups of neighbouring frames. start (b,) first row of each group; time_s (n,), frame (n,) of all frames.

    after_pause (b,) bool: no line connects this group with the one before. clock: the name of the session, where a page
    shows several.
    """

    frame: np.ndarray
    time_s: np.ndarray
    start: np.ndarray
    after_pause: np.ndarray
    clock: str = ""

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.start)

    @property
    def last(self) -> np.ndarray:
        """(b,) last row of each group."""
        return np.append(self.start[1:], len(self.frame)) - 1

    @property
    def thinned(self) -> bool:
        """Whether any group holds more than one frame."""
        return self.count < len(self.frame)

    @property
    def place(self) -> np.ndarray:
        """(b,) where the middle of each group lies between the first frame (0) and the last (1)."""
        middle = (self.time_s[self.start] + self.time_s[self.last]) / 2.0
        return self.place_of(middle)

    def place_of(self, time_s: np.ndarray) -> np.ndarray:
        """Where a time lies between the first frame (0) and the last (1); one frame alone lies in the middle."""
        span = self.time_s[-1] - self.time_s[0]
        return (time_s - self.time_s[0]) / span if span > 0 else np.full(np.shape(time_s), 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """The lowest and highest known value of each group, (b,) each, NaN where no frame of it has one.

    rising (b,) bool: the lowest comes first.
    """

    low: np.ndarray
    high: np.ndarray
    rising: np.ndarray


def make_bins(frame: np.ndarray, time_s: np.ndarray, clock: str = "", most: int = MOST_BINS) -> Bins:
    """At most ``most`` groups of equally many frames; one frame each where that suffices."""
    count = min(len(frame), most)
    start = np.arange(count) * len(frame) // count
    step = np.diff(time_s)
    pauses = np.append(False, step > PAUSE * np.median(step)) if len(step) else np.zeros(1, dtype=bool)
    return Bins(frame, time_s, start, np.logical_or.reduceat(pauses, start), clock)


def envelope(values: np.ndarray, bins: Bins) -> Envelope:
    """values (n,), NaN where not known."""
    low, high = np.fmin.reduceat(values, bins.start), np.fmax.reduceat(values, bins.start)
    group = np.repeat(np.arange(bins.count), np.diff(np.append(bins.start, len(values))))
    rows = np.arange(len(values))
    at_low = np.minimum.reduceat(np.where(values == low[group], rows, len(values)), bins.start)
    at_high = np.minimum.reduceat(np.where(values == high[group], rows, len(values)), bins.start)
    return Envelope(low, high, at_low <= at_high)


def worst(state_code: np.ndarray, bins: Bins) -> np.ndarray:
    """(b,) the worst state of each group."""
    return np.maximum.reduceat(state_code, bins.start)


MEASURED: Final = (ANGLES_FILE, POSTURE_FILE, EPISODES_FILE, MEASURES_FILE)
"""What 'anchorpose measure' writes, from the joints."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionHead:
    """What a results folder states of the whole recording.

    run: the content of run.json without the hashes of the inputs, of which ``inputs`` has one for all images of a
    camera: (file, (hash,)). definition: how the measures were computed, None where their file does not say.
    """

    folder: Path
    run: dict[str, Any]
    inputs: tuple[tuple[str, tuple[str]], ...]
    measures: tuple[Measure, ...]
    definition: Definition | None
    ledger: Ledger

    @property
    def recording(self) -> str:
        """The name of the recording."""
        return str(self.run.get("recording", self.folder.resolve().name))


@dataclass(frozen=True, slots=True, eq=False)
class Session(SessionHead):
    """The tables of one recording. bins: how its frames are grouped in every chart of its page.

    posture_seen (n,) bool: whether all joints that determine posture were seen; the state in posture.parquet is that of
    the centre of mass. contacts: None where the folder has no table of them, so that touch is not known. explained: how
    well each pose explains its frame, None in results of a release that did not keep it.
    """

    joints: JointTable
    angles: AngleTable
    posture: PostureTable
    posture_seen: np.ndarray
    episodes: tuple[Episode, ...]
    contacts: tuple[Contact, ...] | None
    explained: ExplainedTable | None
    bins: Bins


def read_session(folder: Path) -> Session:
    """All tables of a results folder.

    Raises InputError where one (but contacts and explained) is missing, damaged, or does not fit the joints.
    """
    return read_frames(read_head(folder))


def read_head(folder: Path, name: str = "") -> SessionHead:
    """Run and measures of a results folder; name: of its numbers, where a page shows several sessions.

    Raises InputError where one is damaged, or a table of 'anchorpose measure' is missing.
    """
    run = read_run(folder / RUN_FILE)
    inputs = input_hashes(
        run.pop("inputs_sha256", None) or {}
    )  # first: an hour has 324,000, which then leave the memory
    for file in MEASURED:
        if not (folder / file).is_file():
            problem = "is missing: the folder was written by an older version, or by hand"
            raise InputError(folder / file, problem, f"run 'anchorpose measure {folder}' and try again")
    require_own(folder, (JOINTS_FILE, CONTACTS_FILE, EXPLAINED_FILE, *MEASURED), run)
    return SessionHead(
        folder=folder,
        run=run,
        inputs=inputs,
        measures=read_measures(folder / MEASURES_FILE),
        definition=read_definition(folder / MEASURES_FILE),
        ledger=Ledger(folder, name),
    )


def read_frames(head: SessionHead) -> Session:
    """All tables of a session; its ledger then holds those of joints and angles.

    Raises InputError as ``read_session``.
    """
    folder = head.folder
    joints = read_joints(folder / JOINTS_FILE)
    angles, posture = read_angles(folder / ANGLES_FILE), read_posture(folder / POSTURE_FILE)
    explained = read_explained(folder / EXPLAINED_FILE) if (folder / EXPLAINED_FILE).is_file() else None
    frames = {ANGLES_FILE: angles.frame, POSTURE_FILE: posture.frame}
    if explained is not None:
        frames[EXPLAINED_FILE] = explained.frame
    for file, frame in frames.items():
        if not np.array_equal(frame, joints.frame):
            remedy = TRACK_AGAIN if file == EXPLAINED_FILE else f"run 'anchorpose measure {folder}'"
            raise InputError(folder / file, "has other frames than joints.parquet", remedy)
    head.ledger.hold({JOINTS_FILE: FrameColumns(JOINTS, joints), ANGLES_FILE: FrameColumns(ANGLES, angles)})
    return Session(
        **{each.name: getattr(head, each.name) for each in fields(head)},
        joints=joints,
        angles=angles,
        posture=posture,
        posture_seen=stance_state(joints) == STATE_CODE[JointState.OBSERVED],
        episodes=read_episodes(folder / EPISODES_FILE),
        contacts=read_contacts(folder / CONTACTS_FILE) if (folder / CONTACTS_FILE).is_file() else None,
        explained=explained,
        bins=make_bins(joints.frame, joints.time_s, head.ledger.name),
    )


def input_hashes(hashes: dict[str, str]) -> tuple[tuple[str, tuple[str]], ...]:
    """Every file but the numbered pictures; those of a camera are covered by one hash of all their hashes."""
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
