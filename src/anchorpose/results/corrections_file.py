"""corrections.json, the format ``anchorpose-corrections``; read by ``track --corrections``, written by the viewer."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final, Literal, cast

from pydantic import Discriminator, Field, Tag, model_validator

from anchorpose.recording.document import Entry, Text, Version, read_document, validate
from anchorpose.recording.recording import Clock
from anchorpose.recording.recording_file import CameraPose
from anchorpose.recording.timestamps import Seconds
from anchorpose.results.corrections import (
    FARTHEST_M,
    Correction,
    Corrections,
    JointCorrection,
    NamedPatient,
    ReviewedRecording,
    Signature,
    UnusableInterval,
    Utc,
    recording_of_run,
)
from anchorpose.results.folder import write_text_whole
from anchorpose.settings import Unfit

CORRECTIONS_FORMAT: Final = "anchorpose-corrections"

LARGEST_DRIFT: Final = 0.1
"""Seconds per second: the clocks of cameras differ by a thousandth at most."""


def _kind_of(value: Any) -> str:
    """A correction is of a joint where it has the key ``joint``, else of the patient where it has a place."""
    if not isinstance(value, dict):
        return "UnusableInterval"
    return "JointCorrection" if "joint" in value else "NamedPatient" if "position_m" in value else "UnusableInterval"


AnyCorrection = Annotated[
    Annotated[UnusableInterval, Tag("UnusableInterval")]
    | Annotated[JointCorrection, Tag("JointCorrection")]
    | Annotated[NamedPatient, Tag("NamedPatient")],
    Discriminator(_kind_of),
]


class WithdrawalEntry(Entry):
    """One correction that was taken back, who did so and when."""

    entry: AnyCorrection
    who: Text
    when: Utc


class ClockEntry(Entry):
    """See ``recording.Clock``."""

    ahead_s: Seconds
    drift: Annotated[float, Field(ge=-LARGEST_DRIFT, le=LARGEST_DRIFT, description="seconds per second")]
    at_s: Seconds


class CameraEntry(Entry):
    """A camera and its pose, if it was used, and its clock, if the results state it."""

    name: Text
    camera_to_world: CameraPose | None = None
    clock: ClockEntry | None = None


class RecordingEntry(Entry):
    """See ``ReviewedRecording``."""

    name: Text
    sha256: Text
    cameras: tuple[CameraEntry, ...]
    floor_height_m: (
        Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, description="metres, along the world's Y")] | None
    ) = None


class HeldEntry(Entry):
    """The corrections that hold, as in run.json and corrections.json."""

    unusable: tuple[UnusableInterval, ...]
    joints: tuple[JointCorrection, ...]
    patient: NamedPatient | None = None

    @model_validator(mode="after")
    def _require_each_joint_once(self) -> HeldEntry:
        seen = set[tuple[int, str]]()
        for index, joint in enumerate(self.joints):
            if (joint.frame, joint.joint) in seen:
                problem = f"corrects {joint.joint} of frame {joint.frame} a second time"
                raise Unfit(problem, "keep one of the two", f"joints[{index}]")
            seen.add((joint.frame, joint.joint))
        return self


class HeldByRun(HeldEntry, extra="ignore"):
    """The same beside the other keys that run.json has there."""


class RunEntry(Entry):
    """The part of run.json that is about corrections."""

    corrections: HeldByRun | None = None


class CorrectionsDocument(HeldEntry):
    """corrections.json."""

    format: Literal["anchorpose-corrections"]
    version: Version
    recording: RecordingEntry
    withdrawn: tuple[WithdrawalEntry, ...] | None = None


def corrections_beside(results: Path) -> Path:
    """``RESULTS.corrections.json``: next to the folder, not in it, so that tracking again does not replace it."""
    folder = results.resolve()
    return folder.with_name(f"{folder.name}.corrections.json")


def read_corrections(path: Path) -> Corrections:
    """A corrections.json; raises InputError naming the file, the place in it and the remedy."""
    document = read_document(path, CorrectionsDocument)
    about = document.recording
    poses = {camera.name: camera.camera_to_world for camera in about.cameras}
    clocks = {camera.name: Clock(**camera.clock.model_dump()) for camera in about.cameras if camera.clock is not None}
    return Corrections(
        ReviewedRecording(about.name, about.sha256, poses, clocks, about.floor_height_m),
        document.unusable,
        document.joints,
        document.patient,
        tuple((taken.entry, Signature(taken.who, taken.when)) for taken in document.withdrawn or ()),
    )


def corrections_of_run(path: Path, run: dict[str, Any]) -> Corrections:
    """The corrections that the results of the run.json at ``path`` were tracked with: the next review begins with them.

    None of them where it was tracked without. Raises InputError where they cannot be used.
    """
    held = validate(path, RunEntry, {"corrections": run.get("corrections")}).corrections
    recording = recording_of_run(run)
    return Corrections(recording) if held is None else Corrections(recording, held.unusable, held.joints, held.patient)


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write the whole file or leave it as it was; raises InputError for corrections that could not be read back."""
    recording = corrections.recording
    document = {
        "format": CORRECTIONS_FORMAT,
        "version": 1,
        "recording": {
            "name": recording.name,
            "sha256": recording.sha256,
            "cameras": [
                {
                    "name": name,
                    "camera_to_world": None if pose is None else pose.tolist(),
                    "clock": asdict(recording.clocks[name]) if name in recording.clocks else None,
                }
                for name, pose in recording.T_world_camera.items()
            ],
            "floor_height_m": recording.floor_height_m,
        },
        "unusable": [asdict(entry) for entry in corrections.unusable],
        "joints": [asdict(entry) for entry in corrections.joints],
        "patient": None if corrections.patient is None else asdict(corrections.patient),
        "withdrawn": [{"entry": asdict(entry), "who": by.who, "when": by.when} for entry, by in corrections.withdrawn],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    validate(path, CorrectionsDocument, document)
    write_text_whole(path, text + "\n")


def parse_correction(path: Path, values: dict[str, Any]) -> Correction:
    """One correction as in the file; raises InputError with the name ``path``."""
    found: Correction = validate(path, cast("Any", AnyCorrection), values)
    return found


def parse_withdrawal(path: Path, values: dict[str, Any]) -> tuple[Correction, Signature]:
    """One correction that was taken back, with who did so, as in the file; raises InputError."""
    taken = validate(path, WithdrawalEntry, values)
    return taken.entry, Signature(taken.who, taken.when)
