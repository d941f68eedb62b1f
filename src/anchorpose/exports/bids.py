"""Write a dataset in BIDS-Motion (Jeung et al. 2024, doi:10.1038/s41597-024-03559-8), with one subject and one
recording.

Each column of motion.tsv is a channel. Trials, contacts and episodes are BIDS events, in the file events.tsv beside
motion.tsv.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.exports.formats import (
    STATE_CODES,
    Product,
    Samples,
    Source,
    number_text,
    rounded_text,
    write_rows,
    write_text,
)
from anchorpose.exports.regular_time import near_in_time, nominal_rate_hz
from anchorpose.joints import JOINT_NAMES
from anchorpose.options import ExportConfig
from anchorpose.recording.events import MISSING, Trial, TrialColumn, Trials
from anchorpose.results.frame_time import blocks
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE, read_contacts, read_episodes
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table

WORLD: Final = "world"
CHANNEL_COLUMNS: Final = ("name", "component", "type", "tracked_point", "units", "reference_frame", "description")


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A channel of motion.tsv: the cells of its row in channels.tsv, and its values (n,), NaN where missing."""

    name: str
    component: str
    kind: str
    tracked_point: str
    units: str
    description: str
    values: np.ndarray

    @property
    def row(self) -> tuple[str, ...]:
        """Return the channel's row in channels.tsv."""
        frame = WORLD if self.kind == "POS" else "n/a"
        return self.name, self.component, self.kind, self.tracked_point, self.units, frame, self.description


def channels_of(samples: Samples) -> list[Channel]:
    """Return the channels: the time (latency), joints and angles, then sigma and state code of each joint and angle."""
    since_s = samples.time_s - samples.time_s[0]
    latency = Channel("latency", "n/a", "LATENCY", "n/a", "s", "time since the first frame", since_s)
    places = [
        Channel(f"{name}_{axis}", axis, "POS", name, "m", f"joint centre, {way}", samples.position_m[:, number, index])
        for number, name in enumerate(JOINT_NAMES)
        for index, (axis, way) in enumerate((("x", "forward"), ("y", "up"), ("z", "to the right")))
    ]
    angles = [
        Channel(name, "n/a", "JNTANG", name, "deg", "joint angle", samples.degrees[:, number])
        for number, name in enumerate(samples.angles)
    ]
    of_joints = _quality(JOINT_NAMES, "m", samples.joint_sigma_m, samples.joint_state_code)
    of_angles = _quality(samples.angles, "deg", samples.sigma_deg, samples.angle_state_code)
    return [latency, *places, *angles, *of_joints, *of_angles]


def _quality(names: tuple[str, ...], units: str, sigma: np.ndarray, state_code: np.ndarray) -> list[Channel]:
    kinds = (
        ("sigma", units, "one standard deviation of the error" + (" along each axis" if units == "m" else ""), sigma),
        ("state", "n/a", f"how it is known: {STATE_CODES}", state_code),
    )
    return [
        Channel(f"{name}_{kind}", "n/a", "MISC", name, unit, meaning, values[:, number])
        for number, name in enumerate(names)
        for kind, unit, meaning, values in kinds
    ]


def motion_rows(channels: Sequence[Channel]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of motion.tsv: one row per frame, with the text of one cell per channel."""
    for rows in blocks(len(channels[0].values)):
        columns = (channel.values[rows].tolist() for channel in channels)
        yield from zip(*([rounded_text(value, 6, MISSING) for value in column] for column in columns), strict=True)


EVENT_COLUMNS: Final = ("onset", "duration", "trial_type", "trial", "part", "person", "state")


def events_of(folder: Path, start_s: float, trials: Trials | None) -> list[tuple[str, ...]]:
    """Return the rows of events.tsv, sorted by onset: one row for each trial, contact and episode in a results folder.

    A row has ``EVENT_COLUMNS``, then the columns that the user added to the trials; onsets are in s since ``start_s``.
    """
    own = 0 if trials is None else len(trials.columns)
    found: list[tuple[float, float, tuple[str, ...]]] = [] if trials is None else [_trial_row(t) for t in trials.rows]
    if (folder / CONTACTS_FILE).exists():
        found += [
            (each.start_s, each.end_s, ("contact", MISSING, each.part, each.toucher, each.state, *[MISSING] * own))
            for each in read_contacts(folder / CONTACTS_FILE)
        ]
    if (folder / EPISODES_FILE).exists():
        found += [
            (each.start_s, each.end_s, (each.kind, *[MISSING] * 3, str(each.state), *[MISSING] * own))
            for each in read_episodes(folder / EPISODES_FILE)
        ]
    return [
        (rounded_text(start - start_s, 6, MISSING), rounded_text(end - start, 6, MISSING), *texts)
        for start, end, texts in sorted(found)
    ]


def _trial_row(trial: Trial) -> tuple[float, float, tuple[str, ...]]:
    cells = (
        MISSING if cell is None else number_text(cell) if isinstance(cell, float) else cell for cell in trial.cells
    )
    return trial.start_s, trial.end_s, (trial.condition, str(trial.number), *[MISSING] * 3, *cells)


def events_sidecar(trials: Trials | None) -> dict[str, Any]:
    """Return the content of the events' JSON file: units and meaning of the columns, meaning of the types of events."""
    conditions = () if trials is None else trials.conditions
    return {
        "onset": {"Description": "start of the event since the first frame of the motion", "Units": "s"},
        "duration": {"Description": "from the start of the event to its end", "Units": "s"},
        "trial_type": {
            "Description": "a condition, where trial has a number; otherwise what happened",
            "Levels": dict.fromkeys(conditions, "a condition with its name in the events file") | EVENT_TYPES,
        },
        "trial": {"Description": "number of the trial in the order of the events file; n/a for other events"},
        "part": {"Description": "region of the patient's body that is touched"},
        "person": {
            "Description": "who touches; a person keeps the name while followed, equipment has the name of its part"
        },
        "state": {"Description": "whether the event was seen or is inferred"},
        **({} if trials is None else {column.name: _own_column(column) for column in trials.columns}),
    }


def _own_column(column: TrialColumn) -> dict[str, str]:
    units = {} if column.unit is None else {"Units": column.unit}
    return {"Description": column.description or "as given in the events file", **units}


EVENT_TYPES: Final = {
    "contact": "another person's skin is within about 3 cm of the patient's, or the equipment touches it",
    "upright": "the patient stands upright",
    "sit_to_stand": "the patient stands up",
    "stand_to_sit": "the patient sits down",
    "step_left": "the left foot swings, from foot off to foot strike",
    "step_right": "the right foot swings, from foot off to foot strike",
    "knee_buckle_left": "the left knee gives way, until it is bent the most",
    "knee_buckle_right": "the right knee gives way, until it is bent the most",
    "failed_stand": "the patient leaves the seat, until highest, and sinks back without having stood",
    "recovery_step_left": "from a loss of balance until the left foot is placed",
    "recovery_step_right": "from a loss of balance until the right foot is placed",
}


BIDS_VERSION: Final = "1.10.0"
TRACKING_SYSTEM: Final = "anchorpose"

_README: Final = """Joint centres and joint angles of one person, found by anchorpose {version} in depth recordings.

Positions are in metres, X forward, Y up, Z to the person's right; angles in degrees. Every joint has a standard
deviation and a state code in channels of the type MISC. {missing} is written where nothing was found.
The subject's label is a pseudonym. No name, date or place is in these files, unless your events file has one.
Research use only; not a medical device.
"""


def write_bids(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write a BIDS dataset: its description, the participants, and the subject's motion at the recorded times."""
    channels = channels_of(source.samples)
    _dataset(folder, config)
    entities = [f"sub-{config.subject}", *([f"ses-{config.session}"] if config.session else [])]
    motion = folder.joinpath(*entities, "motion")
    motion.mkdir(parents=True)
    recording = "_".join([*entities, f"task-{config.task}"])
    _events(motion / f"{recording}_events", source)
    stem = f"{recording}_tracksys-{TRACKING_SYSTEM}"
    write_rows(motion / f"{stem}_motion.tsv", "\t", motion_rows(channels))
    write_rows(motion / f"{stem}_channels.tsv", "\t", [CHANNEL_COLUMNS], (channel.row for channel in channels))
    _write_json(motion / f"{stem}_channels.json", _channels_sidecar())
    sidecar = _motion_sidecar(source.samples.time_s, channels, config)
    _write_json(motion / f"{stem}_motion.json", sidecar)
    return Product(
        axes="X forward, Y up, Z to the patient's right (channels.json, reference_frame world)",
        units="metres, degrees, seconds (channels.tsv)",
        time="as recorded, in the LATENCY channel from the first frame on",
        missing=MISSING,
        counts=(("frames", len(source.frame)), ("channels", len(channels)), ("rate_hz", sidecar["SamplingFrequency"])),
        notes=(
            f"The subject is sub-{config.subject}, a pseudonym; give another with --subject.",
            f"The first frame is at {float(source.samples.time_s[0])!r} s of the recording.",
        ),
    )


def _events(stem: Path, source: Source) -> None:
    """Write events.tsv and its JSON file. Without events, write neither, as BIDS requires."""
    trials = read_trial_table(source.folder / TRIALS_FILE) if (source.folder / TRIALS_FILE).exists() else None
    events = events_of(source.folder, float(source.samples.time_s[0]), trials)
    if events:
        own = () if trials is None else tuple(column.name for column in trials.columns)
        write_rows(stem.with_suffix(".tsv"), "\t", [(*EVENT_COLUMNS, *own)], events)
        _write_json(stem.with_suffix(".json"), events_sidecar(trials))


def _dataset(folder: Path, config: ExportConfig) -> None:
    description = {
        "Name": "Joint centres and angles by anchorpose",
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "anchorpose", "Version": __version__}],
    }
    _write_json(folder / "dataset_description.json", description)
    write_text(folder / ".bidsignore", "export.json\n")
    write_text(folder / "README", _README.format(version=__version__, missing=MISSING))
    write_text(folder / "participants.tsv", f"participant_id\nsub-{config.subject}\n")
    _write_json(folder / "participants.json", {"participant_id": {"Description": "pseudonym of the person"}})


def _motion_sidecar(time_s: np.ndarray, channels: list[Channel], config: ExportConfig) -> dict[str, Any]:
    kinds = [channel.kind for channel in channels]
    span_s = float(time_s[-1] - time_s[0])
    return {
        "TaskName": config.task,
        "SamplingFrequency": nominal_rate_hz(time_s),
        "SamplingFrequencyEffective": round((len(time_s) - 1) / span_s, 6),
        "RecordingDuration": round(span_s, 6),
        "RecordingType": "continuous" if near_in_time(time_s).all() else "discontinuous",
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
    write_text(path, json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
