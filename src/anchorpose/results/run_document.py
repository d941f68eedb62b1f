"""Reading a run.json, which may have been edited or come from another program: everything in it is checked first.

Keys that later releases add are ignored, and keys that earlier ones did not write may be missing.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, StringConstraints, model_validator

from anchorpose.errors import InputError
from anchorpose.recording.document import (
    LARGEST_WITH_HASHES,
    Entry,
    FileInFolder,
    Text,
    Version,
    read_json,
    validate,
)
from anchorpose.recording.recording_file import CameraPose
from anchorpose.recording.timestamps import Seconds
from anchorpose.results.corrections import Frame
from anchorpose.results.corrections_file import CameraEntry, HeldByRun
from anchorpose.settings import Unfit

PICTURES: Final = "pictures"
"""The folder in the results that holds what the report shows."""

NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Sha256 = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
_is_sha256: Final = re.compile("[0-9a-f]{64}").fullmatch
Share = Annotated[float, Field(ge=0, le=1)]


class NoiseOfRun(Entry):
    """See ``DepthNoise``."""

    at_m: tuple[Annotated[float, Field(gt=1e-3, le=1e3, description="a depth in metres")], ...]
    sigma_at_m: tuple[NotNegative, ...]
    slants: tuple[float | None, float | None] = (None, None)
    shared_px: NotNegative = 1.0
    flying: float | None = None
    holes: float | None = None
    measured: bool = True

    @model_validator(mode="after")
    def _require_pairs(self) -> NoiseOfRun:
        if not self.at_m or len(self.at_m) != len(self.sigma_at_m):
            raise Unfit("does not have one sigma per depth", "track the recording again", "sigma_at_m")
        return self


class DepthOfRun(Entry):
    """See ``DepthRecord``; older results have ``noise_per_m`` in place of ``noise``."""

    step_per_m: NotNegative
    edge_px: NotNegative
    noise: NoiseOfRun | None = None
    noise_per_m: NotNegative | None = None

    @model_validator(mode="after")
    def _require_noise(self) -> DepthOfRun:
        if (self.noise is None) == (self.noise_per_m is None):
            raise Unfit("has no noise, or two of them", "track the recording again")
        return self


class CameraOfRun(CameraEntry, extra="ignore"):
    """See ``CameraRecord``."""

    camera_to_world: CameraPose | None
    source: str
    depth: DepthOfRun | None = None


class ResidualOfRun(Entry, extra="ignore"):
    camera: str
    what: str
    value: float | None
    unit: str


class TimingOfRun(Entry, extra="ignore"):
    stage: str
    seconds: float


class MatchedOfRun(Entry, extra="ignore"):
    matched_share: tuple[Share | None, ...] = ()


class MomentOfRun(Entry, extra="ignore"):
    """A frame that was left out."""

    frame: Frame
    time_s: Seconds
    why: str


class IntervalOfRun(Entry, extra="ignore"):
    """Frames in a row in which the patient is lost, or depth is poor."""

    first_frame: Frame
    last_frame: Frame
    start_s: Seconds
    end_s: Seconds
    why: str


class BoneOfRun(Entry, extra="ignore"):
    bone: str
    length_m: NotNegative
    sigma_m: NotNegative


class BodyOfRun(Entry, extra="ignore"):
    height_m: NotNegative
    height_sigma_m: NotNegative
    clothes_m: dict[str, float] = Field(default_factory=dict)
    bones: tuple[BoneOfRun, ...]
    coefficients: tuple[float, ...]


class PatientOfRun(Entry, extra="ignore"):
    frame: Frame
    xz_m: tuple[float, float]
    reason: str
    rival_xz_m: tuple[float, float] | None = None


class FileOfRun(Entry, extra="ignore"):
    file: str
    sha256: Sha256


class CorrectionsOfRun(HeldByRun):
    file: str
    sha256: Sha256


class PictureOfRun(Entry, extra="ignore"):
    file: FileInFolder
    frame: Frame
    time_s: Seconds
    camera: str
    caption: str
    why: str = ""


class RunDocument(Entry, extra="ignore"):
    """What is read of a run.json; see ``RunRecord``."""

    format: Literal["anchorpose-run"]
    version: Version
    versions: dict[str, str] = Field(default_factory=dict)
    code: str = ""
    identity: str = ""
    recording: Text
    frame_count: int = 0
    cameras: tuple[CameraOfRun, ...]
    floor_height_m: float | None = None
    residuals: tuple[ResidualOfRun, ...] = ()
    timings: tuple[TimingOfRun, ...] = ()
    association: MatchedOfRun = MatchedOfRun()
    dropped: tuple[MomentOfRun, ...] = ()
    lost: tuple[IntervalOfRun, ...] = ()
    poor_depth: tuple[IntervalOfRun, ...] = ()
    body: BodyOfRun | None = None
    patient: PatientOfRun | None = None
    corrections: CorrectionsOfRun | None = None
    pictures: tuple[PictureOfRun, ...] = ()
    notes: tuple[str, ...] = ()
    config: dict[str, Any] | None = None
    calibration: FileOfRun | None = None
    inputs_sha256: dict[str, Sha256]
    outputs_sha256: dict[str, Sha256] = Field(default_factory=dict)


def _less_sound_hashes(run: dict[str, Any]) -> dict[str, Any]:
    """The content without hashes that are sound: the 324,000 of an hour's inputs would cost more than the rest."""
    hashes = run.get("inputs_sha256")
    if not isinstance(hashes, dict):
        return run
    doubtful = {name: digest for name, digest in hashes.items() if not (isinstance(digest, str) and _is_sha256(digest))}
    return {**run, "inputs_sha256": doubtful}


def read_run(path: Path) -> dict[str, Any]:
    """The content of a run.json as it stands there, checked against ``RunDocument``.

    Raises InputError for another file, for a value that cannot be used, and for a picture that is not in the results.
    """
    run = read_json(path, LARGEST_WITH_HASHES)
    if run.get("format") != "anchorpose-run":
        raise InputError(path, "is not a run.json of anchorpose", "give a results folder made by 'anchorpose track'")
    document = validate(path, RunDocument, _less_sound_hashes(run))
    inside = path.resolve().parent / PICTURES
    for index, picture in enumerate(document.pictures):
        if not (path.parent / picture.file).resolve().is_relative_to(inside):
            problem = f"pictures[{index}].file is '{picture.file}', not a file in the results' folder {PICTURES}"
            raise InputError(path, problem, "correct it: the report shows no other files")
    return run
