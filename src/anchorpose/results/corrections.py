"""corrections.json: what a reviewer found to be wrong, who says so and when; ``track --corrections`` honours it.

Frames and times are those of the results' tables, positions are in their world frame. Nothing is ever lost from the
file: what a reviewer takes back, or corrects again, moves to ``withdrawn``; it comes back from there where the
correction that replaced it is taken back.

Which recording, and which world, corrections are about.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.recording.document import JsonObject, check_format, nearest_key, read_json_object
from anchorpose.results.folder import write_text_whole

SAME_WORLD_M: Final = 0.001
"""Camera poses closer than this, in every number of the matrix, are of the same world: a metre away from the camera
a joint then moves by a millimetre or two, less than any hand places it to."""


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedRecording:
    """What corrections are about: a name for people, a hash of pictures and times, and the world by its cameras.

    T_world_camera: (4, 4) by name; None for a camera that was not used for want of a pose.
    """

    name: str
    sha256: str
    T_world_camera: dict[str, np.ndarray | None]


def reviewed_recording(
    name: str, inputs_sha256: Iterable[tuple[str, str]], T_world_camera: dict[str, np.ndarray | None]
) -> ReviewedRecording:
    """inputs_sha256: (path in the recording folder, hash) as in run.json.

    The hash is that of pictures and times only: a height added to recording.json makes no other recording of it.
    """
    lines = sorted(
        f"{path} {digest}\n"
        for path, digest in inputs_sha256
        if path.endswith("/timestamps.csv") or Path(path).parent.name == "depth"
    )
    return ReviewedRecording(name, hashlib.sha256("".join(lines).encode()).hexdigest(), T_world_camera)


def recording_of_run(run: dict[str, Any]) -> ReviewedRecording:
    """The recording and the world that a run.json tells of (``read_run_document``)."""
    poses = {
        camera["name"]: None if camera["camera_to_world"] is None else np.array(camera["camera_to_world"])
        for camera in run["cameras"]
    }
    return reviewed_recording(run["recording"], run["inputs_sha256"].items(), poses)


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


CORRECTIONS_FORMAT: Final = "anchorpose-corrections"

LATEST_FRAME: Final = 2**31 - 1
FARTHEST_M: Final = 100.0


@dataclass(frozen=True, slots=True)
class Signature:
    """Who did something, as a pseudonym or initials, and when (UTC, ISO 8601 with Z)."""

    who: str
    when: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusableInterval:
    """Frames first_frame to last_frame, both included, that no measure may rest on."""

    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    reason: str
    who: str
    when: str


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCorrection:
    """Where a joint is in one frame, world frame, and how well the reviewer can tell (one sigma an axis)."""

    frame: int
    time_s: float
    joint: str
    position_m: tuple[float, float, float]
    sigma_m: float
    reason: str
    who: str
    when: str


Entry = UnusableInterval | JointCorrection


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """What holds, and what was taken back (by whom, when)."""

    recording: ReviewedRecording
    unusable: tuple[UnusableInterval, ...] = ()
    joints: tuple[JointCorrection, ...] = ()
    withdrawn: tuple[tuple[Entry, Signature], ...] = ()

    def added(self, entry: Entry) -> Corrections:
        """With one more entry; what held before of the same joint in the same frame counts as withdrawn by it."""
        if isinstance(entry, UnusableInterval):
            return replace(self, unusable=(*self.unusable, entry))
        same = [old for old in self.joints if (old.frame, old.joint) == (entry.frame, entry.joint)]
        by = Signature(entry.who, entry.when)
        return replace(
            self,
            joints=(*(old for old in self.joints if old not in same), entry),
            withdrawn=(*self.withdrawn, *((old, by) for old in same)),
        )

    def taken_back(self, entry: Entry, by: Signature) -> Corrections:
        """Without ``entry``, which moves to ``withdrawn``; what it had replaced holds again. Raises ValueError where it
        does not hold."""
        if entry not in (*self.unusable, *self.joints):
            raise ValueError("there is no such correction (any more)")
        before = self._replaced_by(entry)
        return replace(
            self,
            unusable=tuple(old for old in self.unusable if old != entry),
            joints=(*(old for old in self.joints if old != entry), *(old for old, _ in before)),
            withdrawn=(*(pair for pair in self.withdrawn if pair not in before), (entry, by)),
        )

    def _replaced_by(self, entry: Entry) -> tuple[tuple[JointCorrection, Signature], ...]:
        """The withdrawal, one at most, that ``added`` made for ``entry``: of its joint and frame, signed as it is."""
        signed = Signature(entry.who, entry.when)
        found = [
            (old, by)
            for old, by in self.withdrawn
            if isinstance(entry, JointCorrection)
            and isinstance(old, JointCorrection)
            and (old.frame, old.joint, by) == (entry.frame, entry.joint, signed)
        ]
        return tuple(found[-1:])


def corrections_beside(results: Path) -> Path:
    """``RESULTS.corrections.json``: next to the folder, not in it, so that tracking again does not replace it."""
    folder = results.resolve()
    return folder.with_name(f"{folder.name}.corrections.json")


def now_utc() -> str:
    """The time for ``when``, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def require_recording(path: Path, corrections: Corrections, recording: ReviewedRecording) -> None:
    """Raises InputError where the corrections read from ``path`` are about another recording or another world."""
    theirs = corrections.recording
    if theirs.sha256 != recording.sha256:
        problem = f"is about another recording ('{theirs.name}', other pictures or times)"
        raise InputError(path, problem, "give the corrections that were made of this recording's results")
    if not same_world(theirs.T_world_camera, recording.T_world_camera):
        remedy = "use the calibration that the corrected results were made with, or correct the new results"
        raise InputError(path, "its positions are in another world: the cameras' poses were others", remedy)


def read_corrections(path: Path) -> Corrections:
    """A corrections.json; raises InputError naming the file, the place in it and the remedy."""
    return _parse(read_json_object(path))


def _parse(top: JsonObject) -> Corrections:
    top.only("format", "version", "recording", "unusable", "joints", "withdrawn")
    check_format(top, CORRECTIONS_FORMAT)
    withdrawn = tuple(parse_withdrawal(item) for item in top.objects("withdrawn")) if top.has("withdrawn") else ()
    return replace(_holding(top, _recording(top.object("recording"))), withdrawn=withdrawn)


def corrections_of_run(path: Path, run: dict[str, Any]) -> Corrections:
    """What the results of the run.json at ``path`` were tracked with, none where there was nothing: a review of them
    goes on from there. Raises InputError where it tells of corrections that are none."""
    top, recording = JsonObject(path, "", run), recording_of_run(run)
    return _holding(top.object("corrections"), recording) if top.has("corrections") else Corrections(recording)


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Writes the file so that it holds all of it, or what it held before; raises InputError for what could not be
    read back."""
    recording = corrections.recording
    poses = recording.T_world_camera.items()
    document = {
        "format": CORRECTIONS_FORMAT,
        "version": 1,
        "recording": {
            "name": recording.name,
            "sha256": recording.sha256,
            "cameras": [{"name": n, "camera_to_world": None if T is None else T.tolist()} for n, T in poses],
        },
        "unusable": [asdict(entry) for entry in corrections.unusable],
        "joints": [asdict(entry) for entry in corrections.joints],
        "withdrawn": [{"entry": asdict(entry), "who": by.who, "when": by.when} for entry, by in corrections.withdrawn],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    _parse(JsonObject(path, "", json.loads(text)))
    write_text_whole(path, text + "\n")


def parse_entry(item: JsonObject) -> Entry:
    """One correction as in the file: of a joint where it has the key ``joint``, else an interval."""
    return _joint(item) if "joint" in item.values else _interval(item)


def parse_withdrawal(item: JsonObject) -> tuple[Entry, Signature]:
    """One correction that was taken back, and who did so, as in the file."""
    item.only("entry", "who", "when")
    return parse_entry(item.object("entry")), _signature(item)


def _holding(item: JsonObject, recording: ReviewedRecording) -> Corrections:
    """The lists ``unusable`` and ``joints`` of an object; raises InputError where a joint is corrected twice."""
    joints = tuple(_joint(entry) for entry in item.objects("joints"))
    seen = set[tuple[int, str]]()
    for index, joint in enumerate(joints):
        if (joint.frame, joint.joint) in seen:
            problem = f"corrects {joint.joint} of frame {joint.frame} a second time"
            raise item.refuse(f"joints[{index}]", problem, "keep one of the two")
        seen.add((joint.frame, joint.joint))
    return Corrections(recording, tuple(_interval(entry) for entry in item.objects("unusable")), joints)


def _recording(item: JsonObject) -> ReviewedRecording:
    item.only("name", "sha256", "cameras")
    poses = {
        camera.text("name"): camera.numbers("camera_to_world", (4, 4), "the pose as a 4 x 4 matrix")
        if camera.has("camera_to_world")
        else None
        for camera in item.objects("cameras")
    }
    return ReviewedRecording(item.text("name"), item.text("sha256"), poses)


def _interval(item: JsonObject) -> UnusableInterval:
    item.only("first_frame", "last_frame", "start_s", "end_s", "reason", "who", "when")
    first, last = _frame(item, "first_frame"), _frame(item, "last_frame")
    start_s = item.number("start_s", meaning="a time in seconds")
    end_s = item.number("end_s", meaning="a time in seconds")
    if last < first:
        raise item.refuse("last_frame", f"is {last}, before first_frame {first}", "exchange the two")
    if end_s < start_s:
        raise item.refuse("end_s", f"is {end_s:g}, before start_s {start_s:g}", "exchange the two")
    by = _signature(item)
    return UnusableInterval(
        first_frame=first, last_frame=last, start_s=start_s, end_s=end_s, reason=item.text("reason"),
        who=by.who, when=by.when,
    )  # fmt: skip


def _joint(item: JsonObject) -> JointCorrection:
    item.only("frame", "time_s", "joint", "position_m", "sigma_m", "reason", "who", "when")
    name, by = item.text("joint"), _signature(item)
    if name not in JOINT_NAMES:
        near = nearest_key(name, {joint.lower() for joint in JOINT_NAMES})
        meant = next((joint for joint in JOINT_NAMES if joint.lower() == near), None)
        remedy = f"did you mean '{meant}'" if meant else f"name one of {', '.join(JOINT_NAMES)}"
        raise item.refuse("joint", f"is '{name}'", remedy)
    x, y, z = item.numbers("position_m", (3,), "x, y and z in metres, world frame").tolist()
    if max(abs(x), abs(y), abs(z)) > FARTHEST_M:
        raise item.refuse("position_m", f"is more than {FARTHEST_M:g} m away", "write metres, in the results' world")
    return JointCorrection(
        frame=_frame(item, "frame"), time_s=item.number("time_s", meaning="a time in seconds"), joint=name,
        position_m=(x, y, z), sigma_m=item.number("sigma_m", above=0, at_most=1, meaning="one sigma in metres"),
        reason=item.text("reason"), who=by.who, when=by.when,
    )  # fmt: skip


def _signature(item: JsonObject) -> Signature:
    when = item.text("when")
    try:
        utc = datetime.fromisoformat(when).utcoffset() == timedelta(0)
    except ValueError:
        utc = False
    if not utc:
        raise item.refuse("when", f"is '{when}'", "write the time in UTC, such as 2026-03-01T09:30:00Z")
    return Signature(item.text("who"), when)


def _frame(item: JsonObject, key: str) -> int:
    return item.whole_number(key, above=-1, at_most=LATEST_FRAME, meaning="a frame's number")
