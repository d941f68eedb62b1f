"""Declare the tables that have one row per record: contacts, episodes, measures, and segmented images."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pyarrow.compute as pc

from anchorpose import __version__
from anchorpose.body.contact_regions import REGIONS
from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JointState
from anchorpose.recording.document import parse_json
from anchorpose.recording.events import MOST_TRIALS
from anchorpose.recording.recording_file import FARTHEST_TIME_S
from anchorpose.results.corrections import LATEST_FRAME
from anchorpose.results.parquet import (
    MEASURE_AGAIN,
    TRACK_AGAIN,
    RecordTable,
    RowGroups,
    read_any_parquet,
    read_parquet_schema,
    require_columns,
    schema_of,
)

SEEN, INFERRED = "seen", "inferred"

PERSON: Final = "person"
"""Value of the column ``with`` for a contact with a person, not with equipment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """A contact: one part of the patient's body that one person, or one part of the equipment, touched without a break.

    part: one of ``REGIONS``. ``with_``: ``PERSON``, or the name of a part in the equipment's model. person: a name that
    stays the same as long as this person is followed; None for equipment. first_frame, last_frame and start_s, end_s:
    first and last frame of the contact (both included), and their times. seen_share: share of the person's touching
    skin that some camera saw at the time of the touch, mean over the frames; the position of unseen skin is remembered
    from earlier frames. For equipment, seen_share is the share of the frames in which some camera saw the patient's
    skin beside the part. area_cm2: touched area of skin, mean over the frames. gap_mm: smallest measured distance
    between the two surfaces (the patient's surface is the outside of skin or clothes); negative if the patient's
    surface was measured inside the equipment.
    """

    part: str
    person: str | None
    with_: str = PERSON
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    seen_share: float
    area_cm2: float
    gap_mm: float

    @property
    def state(self) -> str:
        """Return ``seen`` if ``seen_share`` is at least a half, else ``inferred``."""
        return SEEN if self.seen_share >= 0.5 else INFERRED

    @property
    def toucher(self) -> str:
        """Return the name of the person, or of the part of the equipment, that touches."""
        return self.with_ if self.person is None else self.person


def with_people(contacts: Iterable[Contact]) -> tuple[Contact, ...]:
    """Return the contacts with people."""
    return tuple(contact for contact in contacts if contact.person is not None)


def with_equipment(contacts: Iterable[Contact]) -> tuple[Contact, ...]:
    """Return the contacts with parts of the equipment."""
    return tuple(contact for contact in contacts if contact.person is None)


LARGEST_VALUE: Final = 1e12
"""Maximum absolute value of a measure and of its sigma; real values are far smaller, in every unit."""

_SPAN_LIMITS: Final = {
    **dict.fromkeys(("first_frame", "last_frame"), (0, LATEST_FRAME)),
    **dict.fromkeys(("start_s", "end_s"), (-FARTHEST_TIME_S, FARTHEST_TIME_S)),
}

CONTACTS: Final = RecordTable(
    file="contacts.parquet",
    record=Contact,
    schema=schema_of(Contact, "part", "with", "person", *_SPAN_LIMITS, "state", "seen_share", "area_cm2", "gap_mm"),
    known={"part": REGIONS},
    limits={**_SPAN_LIMITS, "seen_share": (0, 1), "area_cm2": (0, LARGEST_VALUE), "gap_mm": (-1e6, 1e6)},
    later={"with": PERSON},
    remedy=TRACK_AGAIN,
)
CONTACTS_FILE, read_contacts = CONTACTS.file, CONTACTS.read

EQUIPMENT_KEY: Final = "equipment_parts"
"""Key in the metadata of contacts.parquet: a JSON list of the equipment's parts that were searched for contacts."""


def write_contacts(path: Path, equipment: Sequence[str] = ()) -> AbstractContextManager[RowGroups[Contact]]:
    """Open contacts.parquet for writing. equipment: names of the parts of the equipment's model; empty without a
    model.
    """
    return CONTACTS.open(path, {EQUIPMENT_KEY: json.dumps(list(equipment))})


def read_equipment_names(path: Path) -> tuple[str, ...]:
    """Read the names of the equipment's parts that were searched for contacts.

    The result is empty if the recording had no model of the equipment, or if the file is from a program version that
    did not search for contacts with equipment. It is then unknown whether the patient held on to the equipment. Raises
    InputError if the list cannot be read.
    """
    text = (read_parquet_schema(path).metadata or {}).get(EQUIPMENT_KEY.encode(), b"[]")
    try:
        names = parse_json(text)
    except ValueError:
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(path, "its list of the equipment's parts cannot be read", TRACK_AGAIN)
    return tuple(names)


UPRIGHT_EPISODE, SIT_TO_STAND, STAND_TO_SIT = "upright", "sit_to_stand", "stand_to_sit"

STEP_LEFT, STEP_RIGHT = "step_left", "step_right"

BUCKLE_LEFT, BUCKLE_RIGHT = "knee_buckle_left", "knee_buckle_right"

FAILED_STAND: Final = "failed_stand"

RECOVERY_LEFT, RECOVERY_RIGHT = "recovery_step_left", "recovery_step_right"

EVENT_KINDS: Final = (BUCKLE_LEFT, BUCKLE_RIGHT, FAILED_STAND, RECOVERY_LEFT, RECOVERY_RIGHT)
"""Kinds of episodes that are events: something went wrong. Only events have a ``depth``."""

EPISODE_KINDS: Final = (UPRIGHT_EPISODE, SIT_TO_STAND, STAND_TO_SIT, STEP_LEFT, STEP_RIGHT, *EVENT_KINDS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """An unbroken stretch of time in which the patient was upright, stood up, sat down, or swung a foot; or an event: a
    knee that buckled, a stand that failed, or a recovery step.

    kind: one of ``EPISODE_KINDS``. first_frame, last_frame and start_s, end_s: first and last frame of the episode
    (both included), and their times. state: worst state, in any frame of the episode, of the joints by which the
    episode was recognised. side, depth, sigma and unit are None unless the episode is an event. side: "left", "right",
    or None for a failed stand. depth: how deep or how far the event went, in ``unit``; sigma: its standard deviation.
    """

    kind: str
    first_frame: int
    last_frame: int
    start_s: float
    end_s: float
    state: JointState
    side: str | None = None
    depth: float | None = None
    sigma: float | None = None
    unit: str | None = None

    @property
    def seconds(self) -> float:
        """Return the time from the episode's first frame to its last."""
        return self.end_s - self.start_s


EPISODES: Final = RecordTable(
    file="episodes.parquet",
    record=Episode,
    schema=schema_of(Episode),
    known={"kind": EPISODE_KINDS, "state": tuple(str(state) for state in JointState), "side": ("left", "right", None)},
    limits={**_SPAN_LIMITS, "depth": (0, LARGEST_VALUE), "sigma": (0, LARGEST_VALUE)},
    later=dict.fromkeys(("side", "depth", "sigma", "unit")),
    remedy=MEASURE_AGAIN,
)
EPISODES_FILE: Final = EPISODES.file


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Write episodes.parquet, the episodes in the order in which they begin."""
    EPISODES.write(path, sorted(episodes, key=lambda each: (each.start_s, EPISODE_KINDS.index(each.kind))))


def read_episodes(path: Path) -> tuple[Episode, ...]:
    """Return all rows of an episodes.parquet; raises InputError if the file is not such a table."""
    return tuple(replace(episode, state=JointState(episode.state)) for episode in EPISODES.read(path))


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """The value of one measure of docs/measures.md.

    side: "left", "right" or None. part: a region of the body (``REGIONS``); person: the name of a person in
    contacts.parquet, or the initials of a rater. part and person are None if the measure is not about a single part or
    person. value: None if unknown; ``why`` then states the reason. sigma: one standard deviation of the value, None if
    unknown, as for counts. frames: number of frames on which the value is based. inferred_share: share of these frames
    in which a joint that the measure uses was inferred rather than seen. condition, trial: condition and trial of
    events.tsv (numbered from 1) to which the value belongs. condition and trial are None for the whole recording; only
    trial is None for a whole condition. Raises ValueError unless exactly one of value and why is given, and for a trial
    without a condition.
    """

    measure: str
    side: str | None = None
    part: str | None = None
    person: str | None = None
    value: float | None
    unit: str
    sigma: float | None = None
    frames: int
    inferred_share: float | None = None
    why: str | None = None
    condition: str | None = None
    trial: int | None = None

    def __post_init__(self) -> None:
        if (self.value is None) != (self.why is not None):
            raise ValueError(f"{self.measure} has the value {self.value} and the reason for none {self.why!r}")
        if self.trial is not None and self.condition is None:
            raise ValueError(f"{self.measure} has the trial {self.trial} without a condition")

    @property
    def key(self) -> MeasureKey:
        """Return the identity of the measured quantity: measure, side, part and person, but neither trial nor
        condition.
        """
        return self.measure, self.side, self.part, self.person


MeasureKey = tuple[str, str | None, str | None, str | None]

MEASURES: Final = RecordTable(
    file="measures.parquet",
    record=Measure,
    schema=schema_of(Measure),
    limits={
        "value": (-LARGEST_VALUE, LARGEST_VALUE),
        "sigma": (0, LARGEST_VALUE),
        "frames": (0, LATEST_FRAME),
        "inferred_share": (0, 1),
        "trial": (1, MOST_TRIALS),
    },
    may_be_empty=False,
    later={"condition": None, "trial": None},
    remedy=MEASURE_AGAIN,
)
MEASURES_FILE: Final = MEASURES.file


def read_measures(path: Path) -> tuple[Measure, ...]:
    """Read the measures of the whole recording; raises InputError if the file is not such a table."""
    return tuple(row for row in MEASURES.read(path) if row.condition is None)


def read_trial_measures(path: Path) -> tuple[Measure, ...]:
    """Read the measures of all trials, then of all conditions; no measures if the results have no trials. Raises
    InputError if the file is not such a table.
    """
    return tuple(row for row in MEASURES.read(path) if row.condition is not None)


DEFINITION_KEY: Final = "measure_definition"
"""Key in the metadata of measures.parquet; its value is ``Definition`` as JSON."""


@dataclass(frozen=True, slots=True)
class Definition:
    """The definition by which measures were computed. Under another definition, a measure of the same name may be
    another quantity.

    anchorpose: the version of the program. config: the settings of the measures (``MeasureConfig``), as nested dicts of
    JSON values.
    """

    anchorpose: str
    config: dict[str, Any]


def write_measures(path: Path, measures: Sequence[Measure], config: dict[str, Any]) -> None:
    """Write measures.parquet in the order given, with the program's version and ``config`` as its ``Definition``."""
    definition = json.dumps({"anchorpose": __version__, "config": config}, sort_keys=True)
    MEASURES.write(path, measures, {DEFINITION_KEY: definition})


def read_definition(path: Path) -> Definition | None:
    """Return the definition of a measures.parquet; None if the file is from a version that did not store the
    definition.

    Raises InputError if the definition cannot be read.
    """
    text = (read_parquet_schema(path).metadata or {}).get(DEFINITION_KEY.encode())
    if text is None:
        return None
    try:
        return Definition(**parse_json(text))
    except (ValueError, TypeError):
        raise InputError(path, "its definition of the measures cannot be read", MEASURE_AGAIN) from None


FRAMES_KEPT: Final = 64  # number of frames whose label images (of all cameras) are kept in memory: under a megabyte

ROOM: Final = 0
"""Label of pixels without equipment or a person: the room, clutter (``PixelLabel``), and pixels without a reading."""

_PNG_SETTINGS: Final = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
"""Settings of the PNG encoder for label images. Label images have large areas of one value, for which run-length coding
makes the smallest files: 5 kB per image.
"""


@dataclass(frozen=True, slots=True)
class LabelImage:
    """One camera's segmentation in one frame. labels: an 8-bit PNG of ``PixelLabel``, with ``ROOM`` at pixels that show
    neither a person nor equipment.
    """

    frame: int
    camera: str
    labels: bytes


PEOPLE: Final = RecordTable(
    file="people.parquet",
    record=LabelImage,
    schema=schema_of(LabelImage),
    rows_per_group=256,  # about half a megabyte of images
    remedy=TRACK_AGAIN,
)
PEOPLE_FILE, write_people = PEOPLE.file, PEOPLE.open


def encode_labels(frame: int, camera: str, view: View) -> LabelImage:
    """Encode the labels of people and equipment in one camera's view."""
    labelled = (view.labels >= PixelLabel.PATIENT) | (view.labels == PixelLabel.EQUIPMENT)
    labels = np.where(labelled, view.labels, np.uint8(ROOM))
    _, encoded = cv2.imencode(".png", labels, _PNG_SETTINGS)
    return LabelImage(frame, camera, encoded.tobytes())


def decode_labels(image: LabelImage) -> np.ndarray:
    """Decode labels (height, width) uint8. Raises ValueError if the bytes are not an 8-bit image."""
    labels = cv2.imdecode(np.frombuffer(image.labels, np.uint8), cv2.IMREAD_UNCHANGED)
    if labels is None or labels.dtype != np.uint8 or labels.ndim != 2:
        raise ValueError(f"frame {image.frame}, camera {image.camera}: the labels are not an 8-bit image")
    return labels


def read_people(path: Path, frames: Sequence[int] | None = None) -> dict[tuple[int, str], LabelImage]:
    """Return the label images, still encoded, of some frames or of all frames (None), by frame and camera; raises
    InputError if a frame and camera occur twice.
    """
    rows = PEOPLE.read(path, None if frames is None else pc.field("frame").isin(frames))
    images = {(row.frame, row.camera): row for row in rows}
    if len(images) != len(rows):
        raise InputError(path, "has two pictures of one frame and camera", TRACK_AGAIN)
    return images


def frames_of_people(path: Path) -> np.ndarray:
    """Return (k,) int32, increasing: the numbers of the frames that have a label image. The images are not read."""
    return np.unique(read_any_parquet(path, columns=["frame"])["frame"].to_numpy())


class StoredPeople:
    """The label images of a people.parquet, read on demand, since all images of an hour would fill the memory.

    Raises InputError if the file is not such a table. Several threads may use one object.
    """

    def __init__(self, path: Path) -> None:
        require_columns(path, read_parquet_schema(path), PEOPLE.schema)
        self._read = lru_cache(FRAMES_KEPT)(lambda frame: read_people(path, [frame]))

    def get(self, frame: int, camera: str) -> LabelImage | None:
        """Return the image of a frame and camera, still encoded; None if the file has no such image. Raises InputError
        if the file cannot be read.
        """
        return self._read(frame).get((frame, camera))
