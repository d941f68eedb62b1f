"""BIDS-Motion (Jeung et al. 2024, doi:10.1038/s41597-024-03559-8): a dataset of one subject with one recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.exports.bids_channels import CHANNEL_COLUMNS, WORLD, Channel, channels_of
from anchorpose.exports.bids_events import EVENT_COLUMNS, events_of, events_sidecar
from anchorpose.exports.numbers_text import rounded_text, rows_text
from anchorpose.exports.product import ExportConfig, Product
from anchorpose.exports.regular_time import nominal_rate_hz, without_gaps
from anchorpose.exports.source import Source
from anchorpose.joints import JOINT_NAMES

BIDS_VERSION: Final = "1.10.0"
TRACKING_SYSTEM: Final = "anchorpose"
MISSING: Final = "n/a"

_README: Final = """Joint centres and joint angles of one person, found by anchorpose {version} in depth recordings.

Positions are in metres, X forward, Y up, Z to the person's right; angles in degrees. Every joint has a standard
deviation and a state code in channels of the type MISC. {missing} is written where nothing was found.
The subject's label is a pseudonym. No name, date or place is in these files.
Research use only; not a medical device.
"""


def write_bids(folder: Path, source: Source, config: ExportConfig) -> Product:
    """A dataset folder: description, participants, and motion of the subject, times as recorded."""
    channels = channels_of(source.samples)
    _dataset(folder, config)
    entities = [f"sub-{config.subject}", *([f"ses-{config.session}"] if config.session else [])]
    motion = folder.joinpath(*entities, "motion")
    motion.mkdir(parents=True)
    recording = "_".join([*entities, f"task-{config.task}"])
    _events(motion / f"{recording}_events", source)
    stem = f"{recording}_tracksys-{TRACKING_SYSTEM}"
    columns = ([rounded_text(value, channel.digits, MISSING) for value in channel.values] for channel in channels)
    (motion / f"{stem}_motion.tsv").write_text(
        rows_text(zip(*columns, strict=True), "\t"), encoding="utf-8", newline="\n"
    )
    rows = [CHANNEL_COLUMNS, *(channel.row for channel in channels)]
    (motion / f"{stem}_channels.tsv").write_text(rows_text(rows, "\t"), encoding="utf-8", newline="\n")
    _write_json(motion / f"{stem}_channels.json", _channels_sidecar())
    sidecar = _motion_sidecar(source.samples.time_s, channels, config)
    _write_json(motion / f"{stem}_motion.json", sidecar)
    return Product(
        axes="X forward, Y up, Z to the patient's right (channels.json, reference_frame world)",
        units="metres, degrees, seconds (channels.tsv)",
        time="as recorded, in the LATENCY channel from the first frame on",
        missing=MISSING,
        counts=(("frames", len(source.frame)), ("channels", len(channels)),
                ("rate_hz", sidecar["SamplingFrequency"])),
        notes=(
            f"The subject is sub-{config.subject}, a pseudonym; give another with --subject.",
            f"The first frame is at {float(source.samples.time_s[0])!r} s of the recording.",
        ),
    )  # fmt: skip


def _events(stem: Path, source: Source) -> None:
    """Nothing where nothing happened: BIDS has no events file without events."""
    events = events_of(source.folder, float(source.samples.time_s[0]), MISSING)
    if events:
        stem.with_suffix(".tsv").write_text(rows_text([EVENT_COLUMNS, *events], "\t"), encoding="utf-8", newline="\n")
        _write_json(stem.with_suffix(".json"), events_sidecar())


def _dataset(folder: Path, config: ExportConfig) -> None:
    description = {
        "Name": "Joint centres and angles by anchorpose",
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "anchorpose", "Version": __version__}],
    }
    _write_json(folder / "dataset_description.json", description)
    (folder / ".bidsignore").write_text("export.json\n", encoding="utf-8", newline="\n")
    (folder / "README").write_text(_README.format(version=__version__, missing=MISSING), encoding="utf-8", newline="\n")
    (folder / "participants.tsv").write_text(f"participant_id\nsub-{config.subject}\n", encoding="utf-8", newline="\n")
    _write_json(folder / "participants.json", {"participant_id": {"Description": "pseudonym of the person"}})


def _motion_sidecar(time_s: np.ndarray, channels: list[Channel], config: ExportConfig) -> dict[str, Any]:
    kinds = [channel.kind for channel in channels]
    span_s = float(time_s[-1] - time_s[0])
    return {
        "TaskName": config.task,
        "SamplingFrequency": nominal_rate_hz(time_s),
        "SamplingFrequencyEffective": round((len(time_s) - 1) / span_s, 6),
        "RecordingDuration": round(span_s, 6),
        "RecordingType": "continuous" if without_gaps(time_s) else "discontinuous",
        "TrackingSystemName": TRACKING_SYSTEM,
        "TrackedPointsCount": len(JOINT_NAMES),
        "SoftwareVersions": f"anchorpose {__version__}",
        "MissingValues": MISSING,
        "MotionChannelCount": len(channels),
        **{f"{kind}ChannelCount": kinds.count(kind) for kind in ("POS", "JNTANG", "LATENCY", "MISC")},
        **{f"{kind}ChannelCount": 0 for kind in ("ACCEL", "ANGACCEL", "GYRO", "MAGN", "ORNT", "VEL")},
    }


def _channels_sidecar() -> dict[str, Any]:
    return {
        "reference_frame": {
            "Levels": {
                WORLD: {
                    "SpatialAxes": "ASR",
                    "RotationRule": "right-hand",
                    "RotationOrder": MISSING,
                    "Description": "fixed to the room: X forward (anterior), Y up (superior), Z to the right",
                }
            }
        }
    }


def _write_json(path: Path, document: dict[str, Any]) -> None:
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")
