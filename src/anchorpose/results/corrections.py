"""What a reviewer found to be wrong, with the reviewer and the time, and the recording and world it is about.

Frames and times are those of the results' tables, positions are in their world frame. Nothing is ever lost: what a
reviewer takes back, or corrects again, moves to ``withdrawn``; it comes back from there where the correction that
replaced it is taken back.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.document import Text, Whole, numbers
from anchorpose.recording.recording import Clock
from anchorpose.recording.timestamps import Seconds
from anchorpose.settings import STRICT, Unfit, nearest_key, shown

SAME_WORLD_M: Final = 0.001
"""Camera poses closer than this, in every number of the matrix, are of the same world: a metre away from the camera
a joint then moves by a millimetre or two, less than anybody can place it by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedRecording:
    """What corrections are about: a name for people, a hash of depth images and times, and the world by its cameras.

    T_world_camera: (4, 4) by name; None for a camera that was not used for want of a pose. clocks, by name, and the
    height of the floor: as they were used, so that they need not be found again; none where this is not known.
    """

    name: str
    sha256: str
    T_world_camera: dict[str, np.ndarray | None]
    clocks: dict[str, Clock] = field(default_factory=dict)
    floor_height_m: float | None = None


def reviewed_recording(
    name: str,
    inputs_sha256: Iterable[tuple[str, str]],
    T_world_camera: dict[str, np.ndarray | None],
    clocks: dict[str, Clock] | None = None,
    floor_height_m: float | None = None,
) -> ReviewedRecording:
    """inputs_sha256: (path in the recording folder, hash) as in run.json.

    The hash covers depth images and times only: a height added to recording.json does not make it another recording.
    """
    lines = sorted(
        f"{path} {digest}\n"
        for path, digest in inputs_sha256
        if path.endswith("/timestamps.csv") or path.split("/")[-2:-1] == ["depth"]
    )
    whole = hashlib.sha256()
    for line in lines:
        whole.update(line.encode())
    return ReviewedRecording(name, whole.hexdigest(), T_world_camera, clocks or {}, floor_height_m)


def recording_of_run(run: dict[str, Any]) -> ReviewedRecording:
    """The recording and the world of a run.json (``read_run``)."""
    poses = {
        camera["name"]: None if camera["camera_to_world"] is None else np.array(camera["camera_to_world"])
        for camera in run["cameras"]
    }
    clocks = {camera["name"]: Clock(**camera["clock"]) for camera in run["cameras"] if camera.get("clock")}
    floor_m = run.get("floor_height_m")  # older results do not state it
    return reviewed_recording(run["recording"], run["inputs_sha256"].items(), poses, clocks, floor_m)


def poses_of(cameras: Iterable[Camera]) -> dict[str, np.ndarray | None]:
    """T_world_camera by name, for ``reviewed_recording``."""
    return {camera.name: camera.T_world_camera for camera in cameras}


def same_world(a: dict[str, np.ndarray | None], b: dict[str, np.ndarray | None]) -> bool:
    """Whether two sets of camera poses, (4, 4) by name, are the same but for rounding."""
    if a.keys() != b.keys():
        return False
    for name, pose in a.items():
        other = b[name]
        if pose is None or other is None:
            if pose is not other:
                return False
        elif not np.allclose(pose, other, rtol=0, atol=SAME_WORLD_M):
            return False
    return True


LATEST_FRAME: Final = 2**31 - 1
FARTHEST_M: Final = 100.0

SUREST_M: Final = 1e-4
"""Least sigma of a corrected joint: nobody places one within a tenth of a millimetre, and less would overflow."""


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
    if np.abs(position_m).max() > FARTHEST_M:
        raise Unfit(f"is more than {FARTHEST_M:g} m away", "write metres, in the results' world")
    return tuple(position_m.tolist())


Utc = Annotated[str, AfterValidator(_require_utc)]
Frame = Annotated[Whole, Field(ge=0, le=LATEST_FRAME, description="the number of a frame")]
Position = Annotated[
    tuple[float, float, float],
    numbers(3, meaning="x, y and z in metres, world frame"),
    AfterValidator(_require_near),
]


@dataclass(frozen=True, slots=True)
class Signature:
    """Who did something, as a pseudonym or initials, and when (UTC, ISO 8601 with Z)."""

    who: str
    when: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusableInterval:
    """Frames first_frame to last_frame, both included, that no measure may use."""

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
    """Where a joint is in one frame, world frame, and the reviewer's uncertainty (one sigma per axis)."""

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
    """Who the patient is: a point on the person's surface in one frame, world frame."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    frame: Frame
    time_s: Seconds
    position_m: Position
    reason: Text
    who: Text
    when: Utc

    @property
    def xz_m(self) -> tuple[float, float]:
        """The place on the floor."""
        return self.position_m[0], self.position_m[2]


Correction = UnusableInterval | JointCorrection | NamedPatient


def _subject(entry: Correction) -> tuple[int, str] | str | None:
    """What an entry is about, of which one entry holds at a time: a joint in a frame, or who the patient is; None for
    an interval, of which any number may hold."""
    if isinstance(entry, JointCorrection):
        return entry.frame, entry.joint
    return "patient" if isinstance(entry, NamedPatient) else None


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """The corrections that hold, and those that were taken back (by whom, when). patient: None where nobody was
    named."""

    recording: ReviewedRecording
    unusable: tuple[UnusableInterval, ...] = ()
    joints: tuple[JointCorrection, ...] = ()
    patient: NamedPatient | None = None
    withdrawn: tuple[tuple[Correction, Signature], ...] = ()

    @property
    def valid(self) -> tuple[Correction, ...]:
        """All that hold."""
        return (*self.unusable, *self.joints, *(() if self.patient is None else (self.patient,)))

    def added(self, entry: Correction) -> Corrections:
        """With one more entry; an earlier one about the same joint in the same frame, or about who the patient is, is
        withdrawn by it."""
        about = _subject(entry)
        same = [old for old in self.valid if about is not None and _subject(old) == about]
        by = Signature(entry.who, entry.when)
        return self._holding(
            (*(old for old in self.valid if old not in same), entry), (*self.withdrawn, *((old, by) for old in same))
        )

    def taken_back(self, entry: Correction, by: Signature) -> Corrections:
        """Without ``entry``, which moves to ``withdrawn``; what it had replaced holds again. Raises ValueError where it
        does not hold."""
        if entry not in self.valid:
            raise ValueError("there is no such correction (any more)")
        before = self._replaced_by(entry)
        return self._holding(
            (*(old for old in self.valid if old != entry), *(old for old, _ in before)),
            (*(pair for pair in self.withdrawn if pair not in before), (entry, by)),
        )

    def _holding(
        self, valid: tuple[Correction, ...], withdrawn: tuple[tuple[Correction, Signature], ...]
    ) -> Corrections:
        return Corrections(
            self.recording,
            tuple(entry for entry in valid if isinstance(entry, UnusableInterval)),
            tuple(entry for entry in valid if isinstance(entry, JointCorrection)),
            next((entry for entry in valid if isinstance(entry, NamedPatient)), None),
            withdrawn,
        )

    def _replaced_by(self, entry: Correction) -> tuple[tuple[Correction, Signature], ...]:
        """The withdrawal, one at most, that ``added`` made for ``entry``: of what it is about, signed as it is."""
        about, signed = _subject(entry), Signature(entry.who, entry.when)
        found = [
            (old, by) for old, by in self.withdrawn if about is not None and (_subject(old), by) == (about, signed)
        ]
        return tuple(found[-1:])


def now_utc() -> str:
    """The time for ``when``, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def require_recording(path: Path, corrections: Corrections, recording: ReviewedRecording) -> None:
    """Raises InputError where the corrections read from ``path`` are about another recording or another world."""
    theirs = corrections.recording
    if theirs.sha256 != recording.sha256:
        problem = f"is about another recording ('{theirs.name}', other depth images or times)"
        raise InputError(path, problem, "give the corrections that were made of this recording's results")
    if not same_world(theirs.T_world_camera, recording.T_world_camera):
        remedy = "use the calibration that the corrected results were made with, or correct the new results"
        raise InputError(path, "its positions are in another world: the camera poses were different", remedy)
