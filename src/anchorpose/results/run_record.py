"""run.json: what a result was made from, with what, how long it took and what was left out.

The patient's body for run.json: lengths, how sure they are, and how much more frames changed them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.learning import bone_lengths
from anchorpose.body.shape_belief import ShapeBelief, standing_height
from anchorpose.errors import InputError
from anchorpose.recording.document import read_json
from anchorpose.recording.recording import Clock
from anchorpose.results.corrections import JointCorrection, UnusableInterval
from anchorpose.versions import code_digest, versions


@dataclass(frozen=True, slots=True)
class BoneRecord:
    """A bone from joint to joint, the same in every frame; refined_m: by how much later windows changed it."""

    bone: str
    length_m: float
    sigma_m: float
    refined_m: float


@dataclass(frozen=True, slots=True)
class BodyRecord:
    """The body that was tracked with, and how long it was learnt from. Each sigma is that of the fit's own equations.

    They know of noise, of poses and of what was hidden, but not of clothes and bodies unlike those of the shape space.
    """

    learnt_from_s: float
    height_m: float  # standing, without clothes and shoes
    height_sigma_m: float
    clothing_m: float
    bones: tuple[BoneRecord, ...]
    coefficients: tuple[float, ...]  # of the body asset's shape space


def record_body(asset: BodyAsset, belief: ShapeBelief, first: ShapeBelief, seconds: float) -> BodyRecord:
    """belief: what is known of the shape in the end; first: after the first window."""
    height_m, row = standing_height(asset, belief.shape)
    return BodyRecord(
        learnt_from_s=seconds,
        height_m=height_m,
        height_sigma_m=float(np.sqrt(belief.variance(row[None])[0])),
        clothing_m=belief.shape.clothing_m,
        bones=tuple(
            BoneRecord(now.bone, now.length_m, now.sigma_m, now.length_m - before.length_m)
            for now, before in zip(bone_lengths(asset, belief), bone_lengths(asset, first), strict=True)
        ),
        coefficients=tuple(belief.shape.coefficients.tolist()),
    )


RUN_FILE: Final = "run.json"


@dataclass(frozen=True, slots=True, eq=False)
class CameraRecord:
    """The pose that was used for a camera, whether the recording gave it or it was found, and its clock as used."""

    name: str
    camera_to_world: np.ndarray | None  # (4, 4); None where the camera was not used for want of a pose
    source: str  # for example "given", "equipment", "floor"
    clock: Clock = field(default_factory=Clock)


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
class Association:
    """How far each frame's pose rests on matches: matched_share, frame by frame, of the nodes that were asked.

    The place of the others is their prediction. None where nothing was asked: the frame that a track begins with, and
    frames that show nothing of the patient.
    """

    matched_share: tuple[float | None, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """For people: how much was matched on average, and in how many frames nothing was."""
        known = [share for share in self.matched_share if share is not None]
        if not known:
            return []
        without = sum(share == 0 for share in known)
        told = f"{100 * sum(known) / len(known):.0f} % of the followed points were found again in the next frame"
        if without:
            told += (
                f"; in {without} of {len(known)} frames none was, and only the prediction and the surface count there"
            )
        return [told]


@dataclass(frozen=True, slots=True)
class DroppedFrame:
    """A frame, or one camera's picture of it, that was not used, and why."""

    frame: int
    time_s: float
    why: str


@dataclass(frozen=True, slots=True)
class CorrectionsRecord:
    """The reviewer's file: its name and hash, what it says, and a sentence for each joint that is not where he says."""

    file: str
    sha256: str
    unusable: tuple[UnusableInterval, ...]
    joints: tuple[JointCorrection, ...]
    not_honoured: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PictureRecord:
    """A picture kept for the report, under the results folder."""

    file: str  # relative to the results folder
    frame: int
    time_s: float
    camera: str
    caption: str
    why: str = ""  # the frame was chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Everything about a run that its tables do not say."""

    recording: str  # name of the recording folder, not its path: results travel
    config: Any  # the resolved configuration, a dataclass of stage configurations
    inputs_sha256: tuple[tuple[str, str], ...]  # (path in the recording folder, hash)
    cameras: tuple[CameraRecord, ...]
    residuals: tuple[Residual, ...] = ()
    timings: tuple[StageTiming, ...] = ()
    frame_count: int = 0
    association: Association = Association()
    dropped: tuple[DroppedFrame, ...] = ()
    body: BodyRecord | None = None  # None where the patient was never found
    corrections: CorrectionsRecord | None = None
    pictures: tuple[PictureRecord, ...] = ()
    notes: tuple[str, ...] = ()  # sentences for people: what was assumed, what to beware of


def hash_files(files: Iterable[Path], folder: Path) -> tuple[tuple[str, str], ...]:
    """(path relative to ``folder``, SHA-256 in hex) of each file."""
    hashes = []
    for file in files:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        hashes.append((file.relative_to(folder).as_posix(), digest))
    return tuple(hashes)


def write_run_record(path: Path, record: RunRecord) -> None:
    """Writes run.json."""
    document = {
        "format": "anchorpose-run",
        "version": 1,
        "versions": versions(),
        "code": code_digest(),
        "recording": record.recording,
        "frame_count": record.frame_count,
        "cameras": plain(record.cameras),
        "residuals": plain(record.residuals),
        "timings": plain(record.timings),
        "association": plain(record.association),
        "dropped": plain(record.dropped),
        "body": plain(record.body),
        "corrections": plain(record.corrections),
        "pictures": plain(record.pictures),
        "notes": plain(record.notes),
        "config": plain(record.config),
        "inputs_sha256": dict(record.inputs_sha256),
    }
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def read_run_document(path: Path) -> dict[str, Any]:
    """A run.json as it stands in the file; raises InputError unless it is one."""
    run = read_json(path)
    if run.get("format") != "anchorpose-run":
        raise InputError(path, "is not a run.json of anchorpose", "give a results folder made by 'anchorpose track'")
    return run


def plain(value: Any) -> Any:
    """Dataclasses, arrays, enums and paths as what JSON knows; a number that is not finite becomes null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(plain(item) for item in value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Enum):
        return plain(value.value)
    return str(value) if isinstance(value, Path) else value
