"""Write C3D with ezc3d: joints as points, angles as points of the type ANGLES, sigma and states as analog channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import MissingPackage
from anchorpose.exports.formats import STATE_CODES, Product, Samples, Source
from anchorpose.exports.regular_time import regular_samples, stretch_name
from anchorpose.joints import JOINT_NAMES, STATE_NAMES
from anchorpose.options import ExportConfig
from anchorpose.results.records import (
    BUCKLE_LEFT,
    BUCKLE_RIGHT,
    CONTACTS_FILE,
    EPISODES_FILE,
    FAILED_STAND,
    RECOVERY_LEFT,
    RECOVERY_RIGHT,
    SIT_TO_STAND,
    STAND_TO_SIT,
    STEP_LEFT,
    STEP_RIGHT,
    UPRIGHT_EPISODE,
    read_contacts,
    read_episodes,
)

STEM: Final = "joints"
LARGEST_FRAMES: Final = 65535
"""Maximum number of frames in a file, since the format counts frames with 16 bits. A longer recording is split."""

ABOUT_EVENTS: Final = (
    "Events are in the group EVENT: Foot Off and Foot Strike (Left, Right), and in the context General the beginnings "
    "and ends of standing up, sitting down, being upright and contacts"
)
NOT_GIVEN: Final = -1.0  # value of an unknown sigma, since analog channels have no mark for missing values


def write_c3d(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write joints.c3d, or joints_001.c3d and so on if the recording is too long for one file; raises MissingPackage if
    ezc3d is missing.
    """
    regular = regular_samples(source.samples)
    samples = regular.samples
    starts = range(0, len(samples.time_s), LARGEST_FRAMES)
    events, inside, held = read_events(source.folder), 0, 0
    ends_s = [*samples.time_s[starts[1:]], samples.time_s[-1] + 1.0 / regular.rate_hz]
    for number, (start, end_s) in enumerate(zip(starts, ends_s, strict=True)):
        path = stretch_name(STEM, ".c3d", number, len(starts))
        part = samples.rows(slice(start, start + LARGEST_FRAMES))
        of_part = tuple(event for event in events if part.time_s[0] <= event.time_s < end_s)
        inside += len(of_part)
        held += _write_file(folder / path, part, regular.rate_hz, of_part)
    return Product(
        axes="X forward, Y up, Z to the patient's right; POINT:X_SCREEN +X, POINT:Y_SCREEN +Y",
        units="POINT:UNITS mm; angles in degrees; sigma in mm and degrees",
        time=str(regular.base),
        missing="residual -1, as C3D has it; analog sigma -1 and state code 6 (lost)",
        counts=(
            ("files", len(starts)),
            ("frames", len(samples.time_s)),
            ("rate_hz", regular.rate_hz),
            ("recorded_frames", int(regular.interpolation.recorded.sum())),
            ("events", held),
            ("missing_points", int(np.isnan(samples.position_m[..., 0]).sum())),
        ),
        notes=(
            "Angles are points listed in POINT:ANGLES: the angle is X; Y and Z mean nothing and are 0.",
            "The residual of every known point is 0; its sigma is in the analog channel NAME.sigma.",
            f"The analog channels NAME.state are codes: {STATE_CODES}.",
            f"{ABOUT_EVENTS}; {inside - held} of {len(events)} did not fit into a file, which holds {MOST_EVENTS}; "
            f"{len(events) - inside} are at times outside of the recording.",
            f"The first frame is at {float(samples.time_s[0])!r} s; the beginning of each file is in "
            "ANCHORPOSE:START_TIME.",
        ),
        tools=("ezc3d",),
    )


def _write_file(path: Path, samples: Samples, rate_hz: float, events: tuple[Event, ...]) -> int:
    """Write one C3D file; return its number of events."""
    file = _new_file()
    _describe_points(file, samples.angles, rate_hz)
    _describe_channels(file, samples.angles, rate_hz)
    _add_frames(file, samples)
    _about(file, samples)
    held = add_events(file, events, samples.time_s)
    file.write(str(path))
    return held


def _new_file() -> Any:
    try:
        import ezc3d
    except ImportError:
        raise MissingPackage("export --to c3d", "ezc3d", "c3d") from None
    return ezc3d.c3d()


def _describe_points(file: Any, angles: tuple[str, ...], rate_hz: float) -> None:
    about = [*(f"joint centre {name}" for name in JOINT_NAMES), *(f"{name}: degrees in X" for name in angles)]
    _set(file, "POINT", RATE=[rate_hz], LABELS=[*JOINT_NAMES, *angles], DESCRIPTIONS=about, UNITS=["mm"])


def _describe_channels(file: Any, angles: tuple[str, ...], rate_hz: float) -> None:
    units = [*((name, "mm") for name in JOINT_NAMES), *((name, "deg") for name in angles)]
    labels = [f"{name}.{what}" for name, _ in units for what in ("sigma", "state")]
    about = [label.replace(".", ": ") for label in labels]
    per_channel = [each for _, unit in units for each in (unit, "")]
    _set(file, "ANALOG", RATE=[rate_hz], LABELS=labels, UNITS=per_channel, DESCRIPTIONS=about)


def _set(file: Any, group: str, **values: list[Any]) -> None:
    for name, value in values.items():
        file["parameters"][group][name]["value"] = value


def _add(file: Any, group: str, **values: Any) -> None:
    for name, value in values.items():
        file.add_parameter(group, name, value)


def _add_frames(file: Any, samples: Samples) -> None:
    """Add the values of all points and analog channels to the file, in the order of their labels."""
    angles = np.zeros((*samples.degrees.shape, 3))
    angles[..., 0] = samples.degrees
    places = np.concatenate([1000.0 * samples.position_m, angles], axis=1)
    sigma = np.concatenate([1000.0 * samples.joint_sigma_m, samples.sigma_deg], axis=1)
    missing = np.isnan(places).any(axis=2)
    state_code = np.concatenate([samples.joint_state_code, samples.angle_state_code], axis=1)
    channels = np.stack([np.where(np.isnan(sigma), NOT_GIVEN, sigma), state_code], axis=2)
    points = np.ones((4, *missing.T.shape))
    points[:3] = places.transpose(2, 1, 0)
    file["data"]["points"] = points
    # the residual does not state sigma, since programs interpret residuals other than 0 and -1 in different ways
    file["data"]["meta_points"]["residuals"] = np.where(missing, -1.0, 0.0).T[None]
    file["data"]["analogs"] = channels.reshape(len(channels), -1).T[None]


def _about(file: Any, samples: Samples) -> None:
    _add(file, "POINT", X_SCREEN=["+X"], Y_SCREEN=["+Y"])
    if samples.angles:
        _add(file, "POINT", ANGLES=list(samples.angles), ANGLE_UNITS=["deg"], TYPE_GROUPS=["ANGLES"])
    _add(file, "ANCHORPOSE", START_TIME=[float(samples.time_s[0])], STATES=list(STATE_NAMES))


MOST_EVENTS: Final = 255
"""Maximum number of events in a file, since the format stores this number in one byte."""

GENERAL: Final = "General"

_NAMES: Final = {
    STEP_LEFT: ("Left", "Foot Off", "Foot Strike"),
    STEP_RIGHT: ("Right", "Foot Off", "Foot Strike"),
    SIT_TO_STAND: (GENERAL, "Stand Up Start", "Stand Up End"),
    STAND_TO_SIT: (GENERAL, "Sit Down Start", "Sit Down End"),
    UPRIGHT_EPISODE: (GENERAL, "Upright Start", "Upright End"),
    BUCKLE_LEFT: ("Left", "Knee Buckle Start", "Knee Buckle Deepest"),
    BUCKLE_RIGHT: ("Right", "Knee Buckle Start", "Knee Buckle Deepest"),
    FAILED_STAND: (GENERAL, "Failed Stand Start", "Failed Stand Highest"),
    RECOVERY_LEFT: ("Left", "Balance Lost", "Recovery Step"),
    RECOVERY_RIGHT: ("Right", "Balance Lost", "Recovery Step"),
}


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """An event at a moment on the results' clock. description: state of the joints in an episode, or who touched which
    part of the body.
    """

    time_s: float
    context: str
    label: str
    description: str


def read_events(folder: Path) -> tuple[Event, ...]:
    """Return the beginnings and ends of all episodes and contacts in a results folder, in the order of time; empty if
    the folder has no tables of episodes and contacts.
    """
    return tuple(sorted([*_of_episodes(folder / EPISODES_FILE), *_of_contacts(folder / CONTACTS_FILE)]))


def _of_episodes(path: Path) -> Iterator[Event]:
    for episode in read_episodes(path) if path.is_file() else ():
        context, begins, ends = _NAMES[episode.kind]
        yield Event(episode.start_s, context, begins, str(episode.state))
        yield Event(episode.end_s, context, ends, str(episode.state))


def _of_contacts(path: Path) -> Iterator[Event]:
    for contact in read_contacts(path) if path.is_file() else ():
        words = f"{contact.part} by {contact.toucher}, {contact.state}"
        yield Event(contact.start_s, GENERAL, "Contact Start", words)
        yield Event(contact.end_s, GENERAL, "Contact End", words)


def add_events(file: Any, events: tuple[Event, ...], time_s: np.ndarray) -> int:
    """Add the C3D group EVENT to an ezc3d file whose frames are at time_s (n,); return the number of events added.

    An event may lie up to one frame interval after the last frame of the file, for example if the samples were
    resampled to a fixed rate. Such an event gets the time of the last frame. If the events are more than
    ``MOST_EVENTS``, events with the context ``GENERAL`` (contacts and posture) are left out first.
    """
    kept = sorted(sorted(events, key=lambda event: event.context == GENERAL)[:MOST_EVENTS])
    if not kept:
        return 0
    seconds = np.minimum([event.time_s for event in kept], time_s[-1]) - time_s[0]
    contexts, labels, about = ([getattr(event, name) for event in kept] for name in ("context", "label", "description"))
    times, zeros = np.stack([np.floor(seconds / 60.0), seconds % 60.0]), [0] * len(kept)
    _add(file, "EVENT", USED=[len(kept)], CONTEXTS=contexts, LABELS=labels, DESCRIPTIONS=about)
    _add(file, "EVENT", SUBJECTS=[""] * len(kept), TIMES=times, ICON_IDS=zeros, GENERIC_FLAGS=zeros)
    return len(kept)
