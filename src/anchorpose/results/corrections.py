"""Define a reviewer's corrections of tracked results, and read and write their file.

corrections.json, the format ``anchorpose-corrections``, is read by ``track --corrections`` and written by the viewer.
Frames, times and positions are as in the results' tables, in the same world frame. No entry is ever deleted: a
correction that a reviewer takes back or replaces moves to ``withdrawn``. If a reviewer takes back a correction that had
replaced an earlier correction, the earlier correction is valid again.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, cast

import numpy as np
from pydantic import AfterValidator, ConfigDict, Discriminator, Field, StringConstraints, Tag

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.document import Text, Version, Whole, numbers, read_document, validate
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M, Seconds
from anchorpose.results.folder import write_text_whole
from anchorpose.results.reviewed_recording import ReviewedRecording, recording_of_run, same_world
from anchorpose.settings import STRICT, Unfit, nearest_key, shown

LATEST_FRAME: Final = 2**31 - 1  # largest frame number that the tables can hold (int32)
SUREST_M: Final = 1e-4
"""Minimum sigma of a corrected joint in m. No reviewer can place a joint more precisely, and the inverse square of a
sigma near zero would overflow.
"""


def _require_utc(when: str) -> str:
    try:
        utc = datetime.fromisoformat(when).utcoffset() == timedelta(0)
    except ValueError:
        utc = False
    if not utc:
        raise Unfit(f"is {shown(when)}", "write the time in UTC, such as 2026-03-01T09:30:00Z")
    return when


def _require_joint(name: str) -> str:
    if name not in JOINT_NAMES:
        near = nearest_key(name, JOINT_NAMES)
        remedy = f"did you mean '{near}'" if near else f"name one of {', '.join(JOINT_NAMES)}"
        raise Unfit(f"is {shown(name)}", remedy)
    return name


def _require_near(position_m: np.ndarray) -> tuple[float, ...]:
    if np.abs(position_m).max() > FARTHEST_CAMERA_M:
        raise Unfit(f"is more than {FARTHEST_CAMERA_M:g} m away", "write metres, in the results' world")
    return tuple(position_m.tolist())


Utc = Annotated[str, AfterValidator(_require_utc)]
Sha256 = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
Frame = Annotated[Whole, Field(ge=0, le=LATEST_FRAME, description="the number of a frame")]
Position = Annotated[
    tuple[float, float, float], numbers(3, meaning="x, y and z in metres, world frame"), AfterValidator(_require_near)
]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusableInterval:
    """An interval that no measure may use: the frames from first_frame to last_frame, both included."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    first_frame: Frame
    last_frame: Frame
    start_s: Seconds
    end_s: Seconds
    reason: Text
    who: Text
    when: Utc

    def __post_init__(self) -> None:
        for first, last in (("first_frame", "last_frame"), ("start_s", "end_s")):
            begin, end = getattr(self, first), getattr(self, last)
            if end < begin:
                raise Unfit(f"is {end:g}, before {first} {begin:g}", "exchange the two", last)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCorrection:
    """The corrected position of a joint in one frame, in world coordinates, and the reviewer's uncertainty (one sigma
    per axis).
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    frame: Frame
    time_s: Seconds
    joint: Annotated[str, AfterValidator(_require_joint)]
    position_m: Position
    sigma_m: Annotated[float, Field(ge=SUREST_M, le=1, description="one sigma in metres")]
    reason: Text
    who: Text
    when: Utc


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedPatient:
    """The person whom a reviewer named as the patient: a point on this person's surface, in world coordinates."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    frame: Frame
    time_s: Seconds
    position_m: Position
    reason: Text
    who: Text
    when: Utc

    @property
    def xz_m(self) -> tuple[float, float]:
        """Return the patient's place (x, z) on the floor."""
        return self.position_m[0], self.position_m[2]


Correction = UnusableInterval | JointCorrection | NamedPatient


def _subject(entry: Correction) -> tuple[int, str] | str | None:
    """Return the subject of an entry: a joint in a frame, or the patient. At most one entry per subject is valid.
    Return None for an interval, since several intervals may be valid at once.
    """
    if isinstance(entry, JointCorrection):
        return entry.frame, entry.joint
    return "patient" if isinstance(entry, NamedPatient) else None


def _kind_of(value: Any) -> str:
    """Return the class name of a correction in JSON form. A correction with the key ``joint`` is a ``JointCorrection``;
    another correction with a position names the patient; any other correction is an interval.
    """
    if not isinstance(value, dict):
        return "UnusableInterval"
    return "JointCorrection" if "joint" in value else "NamedPatient" if "position_m" in value else "UnusableInterval"


AnyCorrection = Annotated[
    Annotated[UnusableInterval, Tag("UnusableInterval")]
    | Annotated[JointCorrection, Tag("JointCorrection")]
    | Annotated[NamedPatient, Tag("NamedPatient")],
    Discriminator(_kind_of),
]


@dataclass(frozen=True, slots=True)
class Withdrawal:
    """The record that a correction was taken back: the correction, the reviewer who took it back (a pseudonym or
    initials), and the time (UTC, ISO 8601 with Z).
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    entry: AnyCorrection
    who: Text
    when: Utc


def _require_each_once(joints: tuple[JointCorrection, ...]) -> tuple[JointCorrection, ...]:
    for (frame, joint), count in Counter((each.frame, each.joint) for each in joints).items():
        if count > 1:
            raise Unfit(f"has {joint} of frame {frame} twice", "keep one of the two")
    return joints


EachJointOnce = Annotated[tuple[JointCorrection, ...], AfterValidator(_require_each_once)]


@dataclass(frozen=True, slots=True)
class CorrectionsRecord:
    """The corrections as recorded in run.json: name, hash and entries of their file. not_honoured: a sentence for each
    corrected joint that is not at its corrected position in the results.
    """

    file: str
    sha256: Sha256
    unusable: tuple[UnusableInterval, ...]
    joints: EachJointOnce
    patient: NamedPatient | None = None
    not_honoured: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """All corrections of a recording: valid ones, and withdrawn ones (taken back or replaced). patient: None if no
    reviewer named the patient.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    recording: ReviewedRecording
    unusable: tuple[UnusableInterval, ...] = ()
    joints: EachJointOnce = ()
    patient: NamedPatient | None = None
    withdrawn: tuple[Withdrawal, ...] = ()

    @property
    def valid(self) -> tuple[Correction, ...]:
        """Return all valid corrections."""
        return (*self.unusable, *self.joints, *(() if self.patient is None else (self.patient,)))

    def same_subject(self, entry: Correction) -> Correction | None:
        """Return the valid entry that ``entry`` would replace if it were added; None if it would replace none."""
        about = _subject(entry)
        return next((old for old in self.valid if about is not None and _subject(old) == about), None)

    def added(self, entry: Correction) -> Corrections:
        """Return the corrections with one more entry. The new entry replaces (withdraws) an earlier entry about the
        same joint in the same frame; a new entry that names the patient replaces the earlier one.
        """
        same = self.same_subject(entry)
        replaced = () if same is None else (Withdrawal(same, entry.who, entry.when),)
        return self._holding((*(old for old in self.valid if old != same), entry), (*self.withdrawn, *replaced))

    def taken_back(self, withdrawal: Withdrawal) -> Corrections:
        """Return the corrections without the entry of ``withdrawal``, which moves to ``withdrawn``; an entry that it
        had replaced is valid again. Raises ValueError if the entry is not valid.
        """
        entry = withdrawal.entry
        if entry not in self.valid:
            raise ValueError("this correction does not exist, or was withdrawn")
        about = _subject(entry)
        replaced = [  # ``added`` stored the replaced entry with the author and time of the new entry
            old
            for old in self.withdrawn
            if about is not None and (_subject(old.entry), old.who, old.when) == (about, entry.who, entry.when)
        ][-1:]
        return self._holding(
            (*(old for old in self.valid if old != entry), *(old.entry for old in replaced)),
            (*(old for old in self.withdrawn if old not in replaced), withdrawal),
        )

    def _holding(self, valid: tuple[Correction, ...], withdrawn: tuple[Withdrawal, ...]) -> Corrections:
        return Corrections(
            self.recording,
            tuple(entry for entry in valid if isinstance(entry, UnusableInterval)),
            tuple(entry for entry in valid if isinstance(entry, JointCorrection)),
            next((entry for entry in valid if isinstance(entry, NamedPatient)), None),
            withdrawn,
        )


def now_utc() -> str:
    """Return the present time in UTC, to the second, as corrections store it in the field ``when``."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def require_recording(path: Path, corrections: Corrections, recording: ReviewedRecording) -> None:
    """Raise InputError if the corrections read from ``path`` are about another recording or other camera poses."""
    theirs = corrections.recording
    if theirs.sha256 != recording.sha256:
        problem = f"is about another recording ('{theirs.name}', other depth images or times)"
        raise InputError(path, problem, "give the corrections that were made of this recording's results")
    if not same_world(theirs.poses, recording.poses):
        remedy = "use the calibration that the corrected results were made with, or correct the new results"
        raise InputError(path, "its positions are in another world: the camera poses were different", remedy)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CorrectionsDocument(Corrections):
    """The content of corrections.json."""

    format: Literal["anchorpose-corrections"]
    version: Version
    unusable: tuple[UnusableInterval, ...]
    joints: EachJointOnce


def corrections_beside(results: Path) -> Path:
    """Return ``RESULTS.corrections.json``, a path beside the results folder, since a new run replaces that folder."""
    folder = results.resolve()
    return folder.with_name(f"{folder.name}.corrections.json")


def read_corrections(path: Path) -> Corrections:
    """Read a corrections.json; raises InputError, which names the file, the place in the file and a remedy."""
    return read_document(path, CorrectionsDocument)


def corrections_of_run(path: Path, run: dict[str, Any]) -> Corrections:
    """Return the corrections (possibly none) with which the results of ``run`` were tracked, so that the next review
    begins with them. run: content of the run.json at ``path``. Raises InputError if the corrections cannot be used.
    """
    recording, part = recording_of_run(run), {"corrections": run.get("corrections")}
    held = validate(path, dict[str, CorrectionsRecord | None], part)["corrections"]
    return Corrections(recording) if held is None else Corrections(recording, held.unusable, held.joints, held.patient)


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write corrections.json completely or not at all; raises InputError for corrections that cannot be read back."""
    document = {"format": "anchorpose-corrections", "version": 1, **asdict(corrections)}
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False, default=np.ndarray.tolist)
    validate(path, CorrectionsDocument, json.loads(text))
    write_text_whole(path, text + "\n")


def parse_correction(path: Path, values: dict[str, Any]) -> Correction:
    """Parse one correction in the JSON form of the file; raises InputError, which names ``path``, if the values are not
    a correction.
    """
    found: Correction = validate(path, cast("Any", AnyCorrection), values)
    return found
