"""C3D by ezc3d: joints as points, angles as points of the type ANGLES, sigma and states as analog channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import MissingPackage
from anchorpose.exports.c3d_events import MOST_EVENTS, add_events, read_events
from anchorpose.exports.formats import STATES, ExportConfig, Product, Source
from anchorpose.exports.regular_time import RegularSamples, regular_samples, stretch_name
from anchorpose.joints import JOINT_NAMES

STEM: Final = "joints"
LARGEST_FRAMES: Final = 65535
"""The format counts frames in 16 bits; a longer recording goes into several files."""

MM_PER_M: Final = 1000.0
LARGEST_RESIDUAL: Final = 255.0  # a byte in the file
NOT_GIVEN: Final = -1.0  # of sigma where there is no value: an analog channel cannot say that it is missing


def write_c3d(folder: Path, source: Source, config: ExportConfig) -> Product:
    """joints.c3d, or joints_001.c3d and so on where the recording is too long for one; MissingPackage without ezc3d."""
    try:
        import ezc3d
    except ImportError:
        raise MissingPackage("export --to c3d", "ezc3d", "c3d") from None
    regular = regular_samples(source.samples)
    starts = range(0, len(regular.samples.time_s), LARGEST_FRAMES)
    events, held = read_events(source.folder), 0
    for number, start in enumerate(starts):
        part = replace(regular, samples=regular.samples.rows(slice(start, start + LARGEST_FRAMES)))
        file = ezc3d.c3d()
        _points(file, part)
        _analogs(file, part)
        _about(file, part)
        held += add_events(file, events, part.samples.time_s)
        file.write(str(folder / stretch_name(STEM, ".c3d", number, len(starts))))
    return Product(
        axes="X forward, Y up, Z to the patient's right; POINT:X_SCREEN +X, POINT:Y_SCREEN +Y",
        units="POINT:UNITS mm; angles in degrees; sigma in mm and degrees",
        time=str(regular.base),
        missing="residual -1, as C3D has it; analog sigma -1 and state code 6 (lost)",
        counts=(
            ("files", len(starts)),
            ("frames", len(regular.samples.time_s)),
            ("rate_hz", regular.rate_hz),
            ("recorded_frames", int(regular.interpolation.recorded.sum())),
            ("events", held),
            ("missing_points", int(np.isnan(regular.samples.position_m[..., 0]).sum())),
        ),
        notes=(
            "Angles are points listed in POINT:ANGLES: the angle is X; Y and Z mean nothing and are 0.",
            "A point's residual is its sigma in whole millimetres, rounded up and at most 255; the analog channels "
            "NAME.sigma have it exactly.",
            "The analog channels NAME.state are codes: "
            + ", ".join(f"{code} {state}" for code, state in enumerate(STATES))
            + ".",
            "Events are in the group EVENT: Foot Off and Foot Strike (Left, Right), and in the context General the "
            "beginnings and ends of standing up, sitting down, being upright and contacts; "
            f"{len(events) - held} of {len(events)} did not fit into a file, which holds {MOST_EVENTS}.",
            f"The first frame is at {float(regular.samples.time_s[0])!r} s; each file says when it begins in "
            "ANCHORPOSE:START_TIME.",
        ),
        tools=("ezc3d",),
    )


def _points(file: Any, regular: RegularSamples) -> None:
    samples = regular.samples
    joints = samples.position_m * MM_PER_M
    angles = np.zeros((*samples.degrees.shape, 3))
    angles[..., 0] = samples.degrees
    angles[np.isnan(samples.degrees)] = np.nan
    places = np.concatenate([joints, angles], axis=1)  # (n, points, 3)
    sigma = np.concatenate([samples.joint_sigma_m * MM_PER_M, samples.sigma_deg], axis=1)
    missing = np.isnan(places).any(axis=2)
    residual = np.where(missing, -1.0, np.clip(np.ceil(np.nan_to_num(sigma)), 1.0, LARGEST_RESIDUAL))
    points = np.ones((4, places.shape[1], places.shape[0]))
    points[:3] = places.transpose(2, 1, 0)
    file["parameters"]["POINT"]["RATE"]["value"] = [regular.rate_hz]
    file["parameters"]["POINT"]["LABELS"]["value"] = [*JOINT_NAMES, *samples.angles]
    file["parameters"]["POINT"]["DESCRIPTIONS"]["value"] = [
        *(f"joint centre {name}" for name in JOINT_NAMES),
        *(f"{name}: degrees in X" for name in samples.angles),
    ]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residual.T[None]
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *residual.T.shape), dtype=bool)


def _analogs(file: Any, regular: RegularSamples) -> None:
    samples = regular.samples
    columns = [
        *_channels(JOINT_NAMES, samples.joint_sigma_m * MM_PER_M, samples.joint_state_code, "mm"),
        *_channels(samples.angles, samples.sigma_deg, samples.angle_state_code, "deg"),
    ]
    parameters = file["parameters"]["ANALOG"]
    parameters["RATE"]["value"] = [regular.rate_hz]
    parameters["LABELS"]["value"] = [label for label, _, _ in columns]
    parameters["UNITS"]["value"] = [unit for _, unit, _ in columns]
    parameters["DESCRIPTIONS"]["value"] = [label.replace(".", ": ") for label, _, _ in columns]
    file["data"]["analogs"] = np.stack([values for _, _, values in columns])[None]


def _channels(
    names: Sequence[str], sigma: np.ndarray, state_code: np.ndarray, unit: str
) -> list[tuple[str, str, np.ndarray]]:
    """(label, unit, values (n,)) of sigma and state of each."""
    filled = np.where(np.isnan(sigma), NOT_GIVEN, sigma)
    return [
        channel
        for column, name in enumerate(names)
        for channel in (
            (f"{name}.sigma", unit, filled[:, column]),
            (f"{name}.state", "", state_code[:, column].astype(np.float64)),
        )
    ]


def _about(file: Any, regular: RegularSamples) -> None:
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Y"])
    if regular.samples.angles:
        file.add_parameter("POINT", "ANGLES", list(regular.samples.angles))
        file.add_parameter("POINT", "ANGLE_UNITS", ["deg"])
        file.add_parameter("POINT", "TYPE_GROUPS", ["ANGLES"])
    file.add_parameter("ANCHORPOSE", "START_TIME", [float(regular.samples.time_s[0])])
    file.add_parameter("ANCHORPOSE", "STATES", list(STATES))
