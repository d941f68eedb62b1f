"""Record in run.json how results were made: inputs, settings, program, durations, omitted frames and the body that was
learnt from the recording.

The same dataclasses define the content that is written and the content that may be read. A run.json may have been
edited or come from another program: unknown keys are ignored, and a key may be missing if its field has a default.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field
from pydantic_core import to_jsonable_python

from anchorpose.body.visibility import PoorDepth, PoorKind
from anchorpose.errors import InputError
from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.recording.document import LARGEST_WITH_HASHES, FileInFolder, Text, Version, read_json, validate
from anchorpose.recording.events import GIVEN, RecordedSpan
from anchorpose.recording.recording_file import CameraPose, Seconds
from anchorpose.recording.regular_file import LARGEST_ARRAYS, open_regular, require_regular
from anchorpose.results.corrections import CorrectionsRecord, Frame, Sha256
from anchorpose.results.explained import ExplainedSummary
from anchorpose.results.reviewed_recording import CameraClock
from anchorpose.settings import Unfit
from anchorpose.versions import code_digest, machine, versions

RUN_FILE: Final = "run.json"

PICTURES: Final = "pictures"
"""Name of the folder, in the results folder, with the report's pictures."""

NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Share = Annotated[float, Field(ge=0, le=1)]
NEAREST_M, FARTHEST_READING_M = 1e-3, 1e3  # m, limits of the depths for which a noise model states sigma
_is_sha256: Final = re.compile("[0-9a-f]{64}").fullmatch


@dataclass(frozen=True, slots=True)
class BoneRecord:
    """A bone between two joints, which has the same length in every frame. refined_m: the final length minus the length
    that was learnt from the first window of frames, in m.
    """

    bone: str
    length_m: NotNegative
    sigma_m: NotNegative
    refined_m: float = 0.0


@dataclass(frozen=True, slots=True)
class BodyRecord:
    """The tracked body, and the number of seconds of the recording from which it was learnt.

    height_sigma_m is computed from the equations by which the body is fitted. This sigma includes the effects of noise,
    poses and hidden parts. If the patient's height was not stated, this sigma also allows for bodies of other
    heights, which would fit the images, too. A bone's sigma also includes a systematic error for clothes and for bodies
    outside the shape space.
    """

    learnt_from_s: float
    height_m: NotNegative  # standing height, without clothes and shoes
    height_sigma_m: NotNegative
    clothes_m: dict[str, float]  # m, thickness by piece of clothing
    bones: tuple[BoneRecord, ...]
    coefficients: tuple[float, ...]  # coefficients of the body model's shape space


def _require_noise(noise: DepthNoise) -> DepthNoise:
    """Raise Unfit unless the noise model gives a usable sigma at every depth."""
    if not noise.at_m or len(noise.at_m) != len(noise.sigma_at_m):
        raise Unfit("does not have one sigma per depth", "track the recording again", "sigma_at_m")
    numbers = (*noise.sigma_at_m, noise.shared_px, *(at_m if at_m > NEAREST_M else -1 for at_m in noise.at_m))
    if not all(0 <= number <= FARTHEST_READING_M for number in numbers):
        raise Unfit("has numbers that are no depth, no sigma or no count of pixels", "track the recording again")
    return noise


@dataclass(frozen=True, slots=True)
class DepthRecord:
    """The properties of a camera's depth, measured in the recording itself: noise, steps between values, and width of
    edges. At a distance z in metres, the step between neighbouring values of depth is ``step_per_m z^2``. edge_px:
    width of depth edges in pixels.
    """

    noise: Annotated[DepthNoise, AfterValidator(_require_noise)]
    step_per_m: NotNegative
    edge_px: NotNegative


@dataclass(frozen=True, slots=True, eq=False)
class CameraRecord:
    """The pose and the clock of a camera that tracking used, and the source of the pose."""

    name: Text
    camera_to_world: CameraPose | None  # (4, 4); None for a camera without a pose, which was not used
    source: str  # for example "given", "equipment", "floor"
    clock: CameraClock | None = None
    depth: DepthRecord | None = None  # None in older results


@dataclass(frozen=True, slots=True)
class Residual:
    """An error that remains after a calibration: its camera, its kind (``what``), its value and its unit."""

    camera: str
    what: str  # for example "equipment, median distance to the model"
    value: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class StageTiming:
    """The total computing time of one stage in the run."""

    stage: str
    seconds: float


@dataclass(frozen=True, slots=True)
class MatchedShares:
    """The share of each frame's nodes (points of the patient's surface) that were found again in the next frame by the
    track tree, an optional method of following nodes.

    Nodes that were not found stay at their predicted position. The share is None if the track tree was not used; by
    default, it is not used.
    """

    matched_share: tuple[Share | None, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """Return sentences for people: on the mean share of nodes (points of the patient's surface) that were found
        again in the next frame, and on the number of frames of which no node was found again.
        """
        known = [share for share in self.matched_share if share is not None]
        if not known:
            return []
        without = sum(share == 0 for share in known)
        sentence = f"{100 * sum(known) / len(known):.0f} % of the followed points were found again in the next frame"
        if without:
            sentence += f"; in {without} of {len(known)} frames no point was, so joints rest on prediction and surface"
        return [sentence]


@dataclass(frozen=True, slots=True)
class DroppedFrame:
    """A frame, or one camera's depth image in a frame, that was not used, and the reason."""

    frame: Frame
    time_s: Seconds
    why: str


@dataclass(frozen=True, slots=True)
class LostInterval:
    """Successive frames, both ends included, in which the patient was lost for the same reason."""

    first_frame: Frame
    last_frame: Frame
    start_s: Seconds
    end_s: Seconds
    why: str


@dataclass(frozen=True, slots=True)
class PoorInterval:
    """Successive frames, both ends included, in which the depth of one camera is too poor to locate joints, for the
    same reason.

    worst: the largest amount in these frames (``PoorDepth.amount``): in m, the width of an edge or the height of a
    step; for holes, the share of the patient's camera-facing skin without a usable reading. why: a sentence without its
    full stop.
    """

    camera: str
    kind: PoorKind
    first_frame: Frame
    last_frame: Frame
    start_s: Seconds
    end_s: Seconds
    worst: float
    why: str


@dataclass(frozen=True, slots=True)
class PatientRecord:
    """The person whom the program tracked as the patient. xz_m: this person's place (x, z) on the floor, in metres, in
    the initial frame. reason: why the person was chosen, such as "was at the given place in frame 7". rival_xz_m: place
    of another person who may be the patient.
    """

    frame: Frame
    xz_m: tuple[float, float]
    reason: str
    rival_xz_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class CalibrationUsed:
    """The name and the hash of the calibration.json whose poses replaced the poses of a recording."""

    file: str
    sha256: Sha256


@dataclass(frozen=True, slots=True)
class PictureRecord:
    """A picture that is kept for the report, in the results folder."""

    file: FileInFolder  # path of the picture, relative to the results folder
    frame: Frame
    time_s: Seconds
    camera: str
    caption: str
    why: str = ""  # why the frame was chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """All information on a run that is not in the tables of its results. The fields are in the order of run.json."""

    format: Literal["anchorpose-run"] = "anchorpose-run"
    version: Version = 1
    versions: dict[str, str] = field(default_factory=dict)  # versions of this package and its libraries
    machine: dict[str, Any] = field(default_factory=dict)
    code: str = ""  # hash of the package's code
    identity: str = ""  # SHA-256 of inputs, settings, code and libraries: equal identities mean equal joints
    recording: Text  # name of the recording folder, not its path, since results may be moved
    recorded: RecordedSpan | None = None  # start and end of the recording; None if the tracked frames show them
    frame_count: int = 0
    cameras: tuple[CameraRecord, ...]
    floor_height_m: float | None = None  # Y of the floor in the world, None if no camera sees it
    residuals: tuple[Residual, ...] = ()
    timings: tuple[StageTiming, ...] = ()
    association: MatchedShares = MatchedShares()
    dropped: tuple[DroppedFrame, ...] = ()
    lost: tuple[LostInterval, ...] = ()
    poor_depth: tuple[PoorInterval, ...] = ()
    explained: ExplainedSummary | None = None  # None if no frame was tracked
    body: BodyRecord | None = None  # None if the patient was never found
    patient: PatientRecord | None = None  # None if no patient was found
    corrections: CorrectionsRecord | None = None
    calibration: CalibrationUsed | None = None  # None if the recording gives the poses, or tracking found them
    pictures: tuple[PictureRecord, ...] = ()
    notes: tuple[str, ...] = ()  # sentences for readers of the results: assumptions and cautions
    config: Any = None  # the resolved configuration, a dataclass of stage configurations
    inputs_sha256: dict[str, Sha256]  # hash of each file, by its path in the recording folder
    outputs_sha256: dict[str, Sha256] = field(default_factory=dict)  # hash of each file, by its path in the results


def note_lost(intervals: list[LostInterval], before: int | None, frame: int, time_s: float, why: str) -> None:
    """Add one more frame to the intervals in which the patient is lost: it continues the last interval or begins a new
    one. If ``why`` is empty, the patient was found and nothing is added.

    before: number of the preceding frame; None for the first frame. The numbers of successive frames need not be
    consecutive.
    """
    if not why:
        return
    last = intervals[-1] if intervals else None
    if last is not None and last.why == why and last.last_frame == before:
        intervals[-1] = replace(last, last_frame=frame, end_s=time_s)
    else:
        intervals.append(LostInterval(frame, frame, time_s, time_s, why))


def note_poor(
    intervals: list[PoorInterval], before: int | None, frame: int, time_s: float, poor: Sequence[PoorDepth]
) -> None:
    """Add a frame to the intervals of poor depth: for each camera in ``poor``, the frame continues or begins an
    interval. before: number of the preceding frame; None for the first frame.
    """
    for one in poor:
        at = next((k for k in range(len(intervals) - 1, -1, -1) if _goes_on(intervals[k], before, one)), None)
        if at is None:
            at = len(intervals)
            intervals.append(PoorInterval(one.camera, one.kind, frame, frame, time_s, time_s, one.amount, ""))
        worst = max(one.amount, intervals[at].worst)
        why = sentence(PoorDepth(one.camera, one.kind, worst))
        intervals[at] = replace(intervals[at], last_frame=frame, end_s=time_s, worst=worst, why=why)


def _goes_on(interval: PoorInterval, before: int | None, poor: PoorDepth) -> bool:
    return (interval.camera, interval.kind, interval.last_frame) == (poor.camera, poor.kind, before)


_TOO_COARSE: Final = {PoorKind.EDGES: "edges are drawn out over", PoorKind.STEPS: "depth has steps of"}


def sentence(poor: PoorDepth) -> str:
    """Return a sentence for people on a camera's poor depth, without a full stop."""
    if poor.kind in _TOO_COARSE:
        return (
            f"camera {poor.camera}: {_TOO_COARSE[poor.kind]} {1000 * poor.amount:.0f} mm at the patient, "
            "more than an arm is thick: joints show where the patient is, not the posture"
        )
    return (
        f"camera {poor.camera}: {100 * poor.amount:.0f} % of the patient's skin towards it has no usable reading: "
        f"joints are known by the rest"
    )


def hash_files(
    files: Iterable[Path], folder: Path, known: Mapping[str, str] = MappingProxyType({})
) -> tuple[tuple[str, str], ...]:
    """Return (path relative to ``folder``, SHA-256 in hex) of each file. known: hashes, by path, of files that were
    hashed before; these files are not read.

    Raises InputError for a file above ``LARGEST_ARRAYS`` bytes, larger than any table or image.
    """
    hashes = []
    for file in files:
        name = file.relative_to(folder).as_posix()
        if name in known:
            hashes.append((name, known[name]))
            continue
        require_regular(file, LARGEST_ARRAYS)
        with open_regular(file) as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        hashes.append((name, digest))
    return tuple(hashes)


def output_files(results: Path) -> list[Path]:
    """Return tables and pictures of a results folder, in a fixed order."""
    return sorted((*results.glob("*.parquet"), *results.glob("pictures/*.png")))


def write_run_record(path: Path, record: RunRecord) -> None:
    """Write run.json, with the hashes of the program and of all tables and pictures, which must exist already."""
    outputs = dict(hash_files(output_files(path.parent), path.parent))
    whole = replace(record, versions=versions(), machine=machine(), code=code_digest(), outputs_sha256=outputs)
    text = json.dumps(as_json(whole), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_run(path: Path) -> dict[str, Any]:
    """Return the content of a run.json, unchanged, after checking it against ``RunRecord``.

    Raises InputError if the file is not a run.json, has an unusable value, or names a picture outside of the results'
    folder of pictures.
    """
    run = read_json(path, LARGEST_WITH_HASHES)
    if run.get("format") != "anchorpose-run":
        raise InputError(path, "is not a run.json of anchorpose", "give a results folder made by 'anchorpose track'")
    record = validate(path, RunRecord, _less_sound_hashes(run))
    inside = path.resolve().parent / PICTURES
    for index, picture in enumerate(record.pictures):
        if not (path.parent / picture.file).resolve().is_relative_to(inside):
            problem = f"pictures[{index}].file is '{picture.file}', not a file in the results' folder {PICTURES}"
            raise InputError(path, problem, "correct it: the report shows no other files")
    return run


def _less_sound_hashes(run: dict[str, Any]) -> dict[str, Any]:
    """Return the content of run.json without the well-formed hashes of inputs. An hour's recording has 324,000 hashes;
    checking them one by one with the record would take longer than all other checks.
    """
    hashes = run.get("inputs_sha256")
    if not isinstance(hashes, dict):
        return run
    doubtful = {name: digest for name, digest in hashes.items() if not (isinstance(digest, str) and _is_sha256(digest))}
    return {**run, "inputs_sha256": doubtful}


def matched_share(run: dict[str, Any], count: int) -> np.ndarray | None:
    """Return (count,) the share of the followed surface points that were matched in the next frame, NaN where no point
    was followed (``association.matched_share`` in run.json). Return None unless run.json states the share for each of
    the ``count`` frames.
    """
    shares = run.get("association", {}).get("matched_share", [])
    if len(shares) != count:
        return None
    return np.array([np.nan if share is None else share for share in shares], dtype=np.float64)


def as_json(value: Any) -> Any:
    """Convert dataclasses, arrays, sets, enums and paths to JSON values; a number that is not finite becomes null.

    A set becomes a sorted list, so that it gives the same bytes in every run. Raises TypeError for an object of any
    other type that has no JSON form.
    """
    if is_dataclass(value) and not isinstance(value, type):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(as_json(item) for item in value)
    return to_jsonable_python(value, inf_nan_mode="null", fallback=_refuse)


def _refuse(value: object) -> None:
    raise TypeError(f"an object of the type {type(value).__name__} has no JSON form")


def recording_digest(inputs: Iterable[tuple[str, str]]) -> str | None:
    """Return one hash of all input files of the recording from which results were made, except the files of its trials;
    None if no input file is known.

    inputs: name and SHA-256 of each input file. To find out whether results come from the same recording, this single
    hash is compared, since the hashes of an hour's depth images fill a hundred megabytes.
    """
    files = sorted(f"{name} {sha}" for name, sha in inputs if not name.startswith(("events.", GIVEN)))
    return hashlib.sha256("\n".join(files).encode()).hexdigest() if files else None
