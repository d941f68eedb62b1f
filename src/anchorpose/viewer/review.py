"""Provide the data of a review, which the viewer shows: the tables of the results, the recording, the frames that users
should check first, and the reviewer's file of corrections.

Only one program at a time may change the file of corrections; a lock file beside it ensures this.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from filelock import FileLock, Timeout

from anchorpose.errors import InputError
from anchorpose.joints import ANCHOR_NAMES, JOINT_NAMES, LIMBS, JointState
from anchorpose.recording.document import validate
from anchorpose.results.corrections import (
    Correction,
    Corrections,
    JointCorrection,
    Withdrawal,
    now_utc,
    parse_correction,
    read_corrections,
    require_recording,
    write_corrections,
)
from anchorpose.results.explained import EXPLAINED, ExplainedTable, worst_moments
from anchorpose.results.frame_table import FrameTable
from anchorpose.results.frame_time import unbroken_runs, worst_rows
from anchorpose.results.records import CONTACTS_FILE, Contact, read_contacts
from anchorpose.results.run_record import RUN_FILE, as_json, matched_share, read_run
from anchorpose.results.tables import ANCHORS, ANGLES, JOINTS, POSES, AnchorTable, AngleTable, JointTable, PoseTable
from anchorpose.results.verify import require_own
from anchorpose.viewer.depth_frames import DepthFrames, open_depth_frames


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Review:
    """The tables of a results folder and the recording from which they were made. poses, anchors, explained: None in
    results of an older release, which did not store them. depth_frames: None if the recording was not given.
    """

    name: str
    run: dict[str, Any]
    joints: JointTable
    angles: AngleTable
    contacts: tuple[Contact, ...]
    poses: PoseTable | None
    anchors: AnchorTable | None
    explained: ExplainedTable | None
    depth_frames: DepthFrames | None

    @property
    def first_s(self) -> float:
        """Return the time from which the page counts seconds: the time of the recording's first frame or, if
        ``run.json`` does not state when the recording began, the time of the first tracked frame.
        """
        return float(self.joints.time_s[0] if self._recorded_s is None else self._recorded_s)

    @property
    def first_s_is_known(self) -> bool:
        """Return whether ``first_s`` is the time of the recording's first frame."""
        from_start = self.run.get("recorded") is None and not (self.run.get("config") or {}).get("start")
        return self._recorded_s is not None or from_start

    @property
    def _recorded_s(self) -> float | None:
        """Return the time at which the recording began, in s; None if ``run.json`` does not state this time, or if it
        is unknown because the first camera measured nothing.
        """
        return (self.run.get("recorded") or {}).get("first_s")

    @property
    def matched_share(self) -> np.ndarray:
        """Return (n,): for each frame, the share of the followed points of the patient's surface that were matched
        (found again) in the next frame; NaN if no points were followed.
        """
        share = matched_share(self.run, len(self.joints.frame))
        return np.full(len(self.joints.frame), np.nan) if share is None else share


def open_review(results: Path, recording: Path | None) -> Review:
    """Read the results, and the recording if it is given; raises InputError if the results cannot be read, or were made
    from another recording.
    """
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    joints, run = JOINTS.read(results / JOINTS.file), read_run(results / RUN_FILE)
    require_own(results, (JOINTS.file, POSES.file, ANCHORS.file, ANGLES.file, EXPLAINED.file, CONTACTS_FILE), run)
    poses, anchors, explained = (_if_there(table, results) for table in (POSES, ANCHORS, EXPLAINED))
    angles = ANGLES.read(results / ANGLES.file)
    tables = {POSES.file: poses, ANCHORS.file: anchors, EXPLAINED.file: explained, ANGLES.file: angles}
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
        explained=explained,
        depth_frames=None if recording is None else open_depth_frames(recording, results, run, joints.frame),
    )


def _if_there(table: FrameTable[Any], results: Path) -> Any:
    path = results / table.file
    return table.read(path) if path.exists() else None


def describe(review: Review) -> dict[str, Any]:
    """Return the data that the viewer's page needs before it shows a frame, for JSON. The ``position`` of a frame
    listed in "worst" or "unexplained" is its row in the results.
    """
    return {
        **describe_scene(review),
        "name": review.name,
        "recording": review.run["recording"],
        "first_s": review.first_s,
        "first_s_is_known": review.first_s_is_known,
        "angles": list(review.angles.names),
        "contacts": [
            {**as_json(contact), "state": contact.state, "toucher": contact.toucher} for contact in review.contacts
        ],
        "worst": as_json(worst_frames(review.joints, review.matched_share, review.run.get("dropped", []))),
        "unexplained": None if review.explained is None else as_json(unexplained_frames(review.explained)),
        "dropped": review.run.get("dropped", []),
        "patient": {
            "tracked": review.run.get("patient"),  # older results lack this entry
            "named": (review.run.get("corrections") or {}).get("patient"),
        },
        "notes": review.run.get("notes", []),
    }


def describe_scene(review: Review) -> dict[str, Any]:
    """Return the data that every page needs before it draws the frames of a review: names, cameras and equipment, but
    no results of tracking.
    """
    depth_frames = review.depth_frames
    return {
        "frames": len(review.joints.frame),
        "joints": list(JOINT_NAMES),
        "limbs": [list(limb) for limb in LIMBS],
        "states": [str(state) for state in JointState],
        "anchors": list(ANCHOR_NAMES),
        "has": {
            "body": review.poses is not None and review.run.get("body") is not None,
            "anchors": review.anchors is not None,
            "recording": depth_frames is not None,
            "people": depth_frames is not None and depth_frames.people is not None,
        },
        "cameras": [] if depth_frames is None else _cameras(depth_frames),
        "equipment": None if depth_frames is None else _equipment(depth_frames),
    }


def _cameras(depth_frames: DepthFrames) -> list[dict[str, Any]]:
    return [
        {
            "name": camera.name,
            "width": camera.width,
            "height": camera.height,
            "depth_scale": camera.depth_scale,
            "fx": camera.intrinsics.fx,
            "fy": camera.intrinsics.fy,
            "cx": camera.intrinsics.cx,
            "cy": camera.intrinsics.cy,
            "camera_to_world": None if camera.T_world_camera is None else camera.T_world_camera.tolist(),
        }
        for camera in depth_frames.cameras
    ]


def _equipment(depth_frames: DepthFrames) -> dict[str, Any] | None:
    model = depth_frames.recording.equipment
    if model is None:
        return None
    vertices, faces = model.triangles()
    return {"vertices": vertices.round(4).ravel().tolist(), "faces": faces.ravel().tolist()}


# s, minimum time between two frames in the list of frames to check; frames nearer in time show the same situation
APART_S: Final = 1.0
MOST_OF_A_KIND: Final = 12  # maximum number of frames to check that are listed for the same kind of reason
# minimum share of matched surface points (``Review.matched_share``); a frame with a smaller share is listed; in good
# recordings, the share is 0.95 to 1
FEW_MATCHED: Final = 0.9


@dataclass(frozen=True, slots=True)
class WorstFrame:
    """A frame that the user should check: its row in the results, the reason in words, and the joint that the reason is
    about, if any.
    """

    position: int
    reason: str
    joint: int | None


def unexplained_frames(table: ExplainedTable) -> tuple[WorstFrame, ...]:
    """Return the frames in which the pose fits the depth images worst, the worst first. The same frames are listed in
    run.json and in the report.
    """
    rows = {int(number): row for row, number in enumerate(table.frame)}
    return tuple(WorstFrame(rows[moment.frame], moment.reason, None) for moment in worst_moments(table))


def worst_frames(
    joints: JointTable, matched_share: np.ndarray, dropped: Sequence[dict[str, Any]]
) -> tuple[WorstFrame, ...]:
    """Return frames to check: first frames with lost joints, then frames with unusable depth images, then frames with
    few matches, then frames with a large sigma.

    matched_share (n,): for each frame, the share of surface points that were matched in the next frame (``Review``).
    For each kind of reason, the worst frame comes first, then the worst frame that is at least a second away from it,
    and so on. Of successive frames with unusable depth images (``dropped``), only the first is listed; the longest such
    series is the worst.
    """

    def worst(badness: np.ndarray) -> list[int]:
        return worst_rows(badness, joints.time_s, APART_S, MOST_OF_A_KIND)

    count = joints.lost.sum(axis=1)
    lost = [
        WorstFrame(row, _lost(joints.lost[row]), None) for row in worst(np.where(count, count.astype(float), np.nan))
    ]
    why = {drop["frame"]: drop["why"] for drop in dropped}
    outage = np.full(len(joints.frame), np.nan)
    for run in unbroken_runs(np.isin(joints.frame, list(why)), joints.time_s):
        outage[run.start] = run.stop - run.start
    unusable = [WorstFrame(row, why[joints.frame[row]], None) for row in worst(outage)]
    few = np.where(matched_share < FEW_MATCHED, 1.0 - matched_share, np.nan)
    text = "{:.0f} % of the points found again in the next frame"
    unmatched = [WorstFrame(row, text.format(100 * matched_share[row]), None) for row in worst(few)]
    sigma_m = np.where(np.isnan(joints.sigma_m), -np.inf, joints.sigma_m)
    largest_m, joint = sigma_m.max(axis=1), sigma_m.argmax(axis=1).tolist()
    uncertain = [
        WorstFrame(row, f"{JOINT_NAMES[joint[row]]}: sigma {1000 * largest_m[row]:.0f} mm", joint[row])
        for row in worst(np.where(np.isfinite(largest_m), largest_m, np.nan))
    ]
    return (*lost, *unusable, *unmatched, *uncertain)


def _lost(lost: np.ndarray) -> str:
    names = [JOINT_NAMES[joint] for joint in np.flatnonzero(lost)]
    return "all joints lost" if len(names) == len(JOINT_NAMES) else f"lost: {', '.join(names)}"


PATIENCE_S: Final = 10.0
"""Maximum waiting time in s for the lock. A change of a file takes milliseconds, so a program that holds the lock for
so long has stopped working.
"""

POLL_S: Final = 0.005


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a file until the ``with`` block ends, so that other threads and programs that lock the same file must wait.

    The operating system releases the lock if the program crashes, so that no other program waits in vain; the empty
    lock file stays. Raises InputError if another program holds the lock for ``PATIENCE_S``, or if no lock is possible.
    """
    lock = FileLock(path.with_name(f".{path.name}.lock"))
    try:
        lock.acquire(timeout=PATIENCE_S, poll_interval=POLL_S)
    except Timeout:
        problem = "is locked by another program that does not finish"
        raise InputError(path, problem, "try again") from None
    except (OSError, NotImplementedError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(path, f"cannot be locked ({why})", "choose another place for it") from None
    try:
        yield
    finally:
        lock.release()


class CorrectedMeanwhile(ValueError):
    """The error for a correction that is refused because the page showed outdated data: since then, the correction of
    the same joint, or of the patient, was added, replaced or withdrawn.

    current: all corrections at present.
    """

    def __init__(self, current: Corrections, refused: Correction) -> None:
        of_joint, valid = isinstance(refused, JointCorrection), current.same_subject(refused)
        if valid is None:
            change = f"The correction of {'this joint' if of_joint else 'the patient'} was withdrawn"
        else:
            change = f"{valid.who} {'corrected this joint' if of_joint else 'named the patient'}"
        super().__init__(f"{change} meanwhile; look at it and save again.")
        self.current = current


class CorrectionFile:
    """A file of corrections, to which corrections are added and in which they are withdrawn.

    For each change, the file is locked and read again, so that several viewers can change it at the same time. initial:
    the corrections that are valid while the file does not exist, which are the corrections with which the results were
    tracked. The first change writes these corrections to the file, too, so that they are kept. Raises InputError if the
    file cannot be used, or is about another recording or other camera poses.
    """

    def __init__(self, path: Path, initial: Corrections, joints: JointTable) -> None:
        self.path, self.initial = path, initial
        self._time_s = dict(zip(joints.frame.tolist(), joints.time_s.tolist(), strict=True))
        self.current()

    def current(self) -> Corrections:
        """Return the present content of the file of corrections; if the file does not exist yet, return the initial
        corrections.
        """
        if not self.path.exists():
            return self.initial
        found = read_corrections(self.path)
        require_recording(self.path, found, self.initial.recording)
        return found

    def add(self, given: dict[str, Any], replaces: dict[str, Any] | None = None) -> Corrections:
        """Add a correction. This function writes the times of the correction's frames, and the present time in the
        field ``when``, into the correction.

        replaces: the correction of the same joint, or of the patient, that the page showed to the reviewer as valid,
        exactly as in the file; None if it showed none. Raises InputError if the correction cannot be added,
        CorrectedMeanwhile if another correction than ``replaces`` is valid.
        """
        timed = {**given, "when": now_utc()}
        for frame, time_key in (("first_frame", "start_s"), ("last_frame", "end_s"), ("frame", "time_s")):
            if frame in given:
                timed[time_key] = self._time_of(given[frame])
        entry = parse_correction(Path("correction"), timed)
        seen = None if replaces is None else parse_correction(Path("correction"), replaces)
        with locked(self.path):
            before = self.current()
            if before.same_subject(entry) != seen:
                raise CorrectedMeanwhile(before, entry)
            after = before.added(entry)
            write_corrections(self.path, after)
        return after

    def take_back(self, given: dict[str, Any]) -> Corrections:
        """Withdraw a correction: move it to the list of withdrawn corrections in the file. given: ``entry``, the
        correction exactly as in the file, and ``who``, the user's name or initials. Raises InputError, or ValueError if
        the entry does not exist.
        """
        withdrawal = validate(Path("correction"), Withdrawal, {**given, "when": now_utc()})
        with locked(self.path):
            after = self.current().taken_back(withdrawal)
            write_corrections(self.path, after)
        return after

    def _time_of(self, frame: Any) -> float:
        if frame not in self._time_s:
            raise ValueError(f"the results have no frame {frame}")
        return self._time_s[frame]


def valid_corrections(corrections: Corrections) -> dict[str, Any]:
    """Return the corrections that are valid (not withdrawn), as values for JSON in the form that the page reads."""
    return {
        "unusable": as_json(corrections.unusable),
        "joints": as_json(corrections.joints),
        "patient": as_json(corrections.patient),
    }
