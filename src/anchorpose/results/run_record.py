"""run.json: what a result was made from and with, how long it took, what was left out, and the body that was learnt."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose.recording.recording import Clock
from anchorpose.recording.regular_file import open_regular
from anchorpose.results.calibration_file import CalibrationUsed
from anchorpose.results.corrections import JointCorrection, NamedPatient, UnusableInterval
from anchorpose.results.explained import ExplainedSummary
from anchorpose.results.poor_intervals import PoorInterval
from anchorpose.versions import code_digest, machine, versions

if TYPE_CHECKING:  # what reads results needs no OpenCV
    from anchorpose.isolation.depth_noise import DepthNoise

RUN_FILE: Final = "run.json"


@dataclass(frozen=True, slots=True)
class BoneRecord:
    """A bone from joint to joint, the same in every frame; refined_m: change of its length by later frames."""

    bone: str
    length_m: float
    sigma_m: float
    refined_m: float


@dataclass(frozen=True, slots=True)
class BodyRecord:
    """The body that was tracked, and how many seconds it was learnt from.

    Each sigma follows from the fit's equations: it covers noise, poses and what was hidden, but neither clothes nor
    bodies unlike those of the shape space.
    """

    learnt_from_s: float
    height_m: float  # standing, without clothes and shoes
    height_sigma_m: float
    clothes_m: dict[str, float]  # thickness of each piece
    bones: tuple[BoneRecord, ...]
    coefficients: tuple[float, ...]  # of the body asset's shape space


@dataclass(frozen=True, slots=True)
class DepthRecord:
    """What the recording itself shows of a camera's depth: its noise; the step between readings, ``step_per_m z^2``
    at a distance z in metres; how wide edges are."""

    noise: DepthNoise  # older results have noise_per_m, the noise between neighbouring readings over z^2
    step_per_m: float
    edge_px: float


@dataclass(frozen=True, slots=True, eq=False)
class CameraRecord:
    """The pose that was used for a camera, whether it was given or found, and its clock as used."""

    name: str
    camera_to_world: np.ndarray | None  # (4, 4); None where the camera has no pose and was not used
    source: str  # for example "given", "equipment", "floor"
    clock: Clock = field(default_factory=Clock)
    depth: DepthRecord | None = None  # None in older results


@dataclass(frozen=True, slots=True)
class Residual:
    """What a calibration left unexplained."""

    camera: str
    what: str  # for example "equipment, median distance to the model"
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class StageTiming:
    """Time spent in one stage of the flow over the whole run."""

    stage: str
    seconds: float


@dataclass(frozen=True, slots=True)
class MatchedShares:
    """The share of the followed points that association found again, frame by frame.

    The others stay at their prediction. None where there was nothing to match: in the frame that a track begins with,
    and in frames that do not show the patient.
    """

    matched_share: tuple[float | None, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """For people: the mean share, and in how many frames nothing was matched."""
        known = [share for share in self.matched_share if share is not None]
        if not known:
            return []
        without = sum(share == 0 for share in known)
        sentence = f"{100 * sum(known) / len(known):.0f} % of the followed points were found again in the next frame"
        if without:
            sentence += (
                f"; in {without} of {len(known)} frames none was, and only the prediction and the surface count there"
            )
        return [sentence]


@dataclass(frozen=True, slots=True)
class DroppedFrame:
    """A frame, or one camera's depth image of it, that was not used, and why."""

    frame: int
    time_s: float
    why: str


@dataclass(frozen=True, slots=True)
class LostInterval:
    """Frames in a row, both ends included, in which the patient was lost for the same reason."""

    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    why: str


@dataclass(frozen=True, slots=True)
class PatientRecord:
    """Who was taken to be the patient: the place (x, z, metres) in the initial frame, and why, as the end of a sentence
    that begins with "who"; rival_xz_m: another person who may be the patient."""

    frame: int
    xz_m: tuple[float, float]
    reason: str
    rival_xz_m: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class CorrectionsRecord:
    """The corrections file: name, hash and entries, and a sentence for each correction that could not be followed."""

    file: str
    sha256: str
    unusable: tuple[UnusableInterval, ...]
    joints: tuple[JointCorrection, ...]
    patient: NamedPatient | None
    not_honoured: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PictureRecord:
    """A picture kept for the report, under the results folder."""

    file: str  # relative to the results folder
    frame: int
    time_s: float
    camera: str
    caption: str
    why: str = ""  # why the frame was chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Everything about a run that its tables do not contain."""

    recording: str  # name of the recording folder, not its path: results travel
    config: Any  # the resolved configuration, a dataclass of stage configurations
    inputs_sha256: tuple[tuple[str, str], ...]  # (path in the recording folder, hash)
    cameras: tuple[CameraRecord, ...]
    floor_height_m: float | None = None  # Y of the floor in the world, None where no camera sees it
    residuals: tuple[Residual, ...] = ()
    timings: tuple[StageTiming, ...] = ()
    frame_count: int = 0
    association: MatchedShares = MatchedShares()
    dropped: tuple[DroppedFrame, ...] = ()
    lost: tuple[LostInterval, ...] = ()
    poor_depth: tuple[PoorInterval, ...] = ()
    explained: ExplainedSummary | None = None  # None where no frame was tracked
    body: BodyRecord | None = None  # None where the patient was never found
    patient: PatientRecord | None = None  # None where nobody was tracked
    corrections: CorrectionsRecord | None = None
    pictures: tuple[PictureRecord, ...] = ()
    calibration: CalibrationUsed | None = None  # None where poses are the recording's, or were found
    identity: str = ""  # SHA-256 over inputs, settings, code and libraries: the same one means the same joints
    notes: tuple[str, ...] = ()  # sentences for people: what was assumed, what needs care


def note_lost(intervals: list[LostInterval], frame: int, time_s: float, why: str) -> None:
    """Take in one more frame: the last interval goes on, a new one begins, or the patient is there (no why)."""
    if not why:
        return
    last = intervals[-1] if intervals else None
    if last is not None and last.why == why and last.last_frame == frame - 1:
        intervals[-1] = dataclasses.replace(last, last_frame=frame, end_s=time_s)
    else:
        intervals.append(LostInterval(frame, frame, time_s, time_s, why))


def hash_files(files: Iterable[Path], folder: Path) -> tuple[tuple[str, str], ...]:
    """(path relative to ``folder``, SHA-256 in hex) of each file."""
    hashes = []
    for file in files:
        with open_regular(file) as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        hashes.append((file.relative_to(folder).as_posix(), digest))
    return tuple(hashes)


def output_files(results: Path) -> list[Path]:
    """Tables and pictures of a results folder, in a fixed order."""
    return sorted((*results.glob("*.parquet"), *results.glob("pictures/*.png")))


def write_run_record(path: Path, record: RunRecord) -> None:
    """Writes run.json, with the hashes of all tables and pictures, which are there already."""
    document = {
        "format": "anchorpose-run",
        "version": 1,
        "versions": versions(),
        "machine": machine(),
        "code": code_digest(),
        "identity": record.identity,
        "recording": record.recording,
        "frame_count": record.frame_count,
        "cameras": as_json(record.cameras),
        "floor_height_m": record.floor_height_m,
        "residuals": as_json(record.residuals),
        "timings": as_json(record.timings),
        "association": as_json(record.association),
        "dropped": as_json(record.dropped),
        "lost": as_json(record.lost),
        "poor_depth": as_json(record.poor_depth),
        "explained": as_json(record.explained),
        "body": as_json(record.body),
        "patient": as_json(record.patient),
        "corrections": as_json(record.corrections),
        "calibration": as_json(record.calibration),
        "pictures": as_json(record.pictures),
        "notes": as_json(record.notes),
        "config": as_json(record.config),
        "inputs_sha256": dict(record.inputs_sha256),
        "outputs_sha256": dict(hash_files(output_files(path.parent), path.parent)),
    }
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def as_json(value: Any) -> Any:
    """Dataclasses, arrays, enums and paths as JSON values; a number that is not finite becomes null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(as_json(item) for item in value)
    if isinstance(value, np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, np.generic):
        return as_json(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Enum):
        return as_json(value.value)
    return str(value) if isinstance(value, Path) else value
