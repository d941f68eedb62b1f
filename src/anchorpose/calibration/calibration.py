"""Hold the result of calibration: the pose of every camera, its source and its accuracy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from anchorpose import __version__
from anchorpose.camera import Camera
from anchorpose.recording.recording_file import CALIBRATION_FILE, CALIBRATION_FORMAT


class PoseSource(StrEnum):
    """The source of a camera's pose; users read it in run.json."""

    GIVEN = "given"
    FILE = "given by a calibration file"
    RESULTS = "those of the corrected results"
    EQUIPMENT = "found from the equipment"
    MARKERS = "found from markers"
    FLOOR = "floor and patient"
    PEOPLE = "placed by the people it sees"


@dataclass(frozen=True, slots=True)
class PoseFigure:
    """A number that describes the accuracy of a camera's pose; what: the number's name, as users read it."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """The source and the accuracy of one camera's pose. sigma_m: standard deviation of the equipment's position
    relative to the camera (for a pose from markers: of the camera's position); sigma_rad: standard deviation of the
    camera's rotation; both are None if unknown.
    """

    camera: str
    source: PoseSource
    sigma_m: float | None = None
    sigma_rad: float | None = None
    figures: tuple[PoseFigure, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FloorResidual:
    """The fit of the floor plane to one camera's readings: the camera's name, the root-mean-square distance of floor
    readings from the plane, the angle between the plane's normal and Y of the world.
    """

    camera: str
    residual_m: float
    tilt_rad: float


class DoubtSource(StrEnum):
    """The observation that contradicts a camera's pose."""

    FLOOR = "floor"
    UPSIDE_DOWN = "people on a floor above the camera"
    EQUIPMENT = "equipment"
    CAMERAS = "cameras"  # another camera's view of the same surfaces


@dataclass(frozen=True, slots=True)
class PoseDoubt:
    """A contradiction between camera poses and what the cameras see, stated in one sentence. off_m: distance by which
    wrong poses displace the surfaces that the cameras see, NaN where unknown. refuted: True if neither noise nor the
    errors of a tape measure can cause so large a contradiction; tracking is then refused.
    """

    source: DoubtSource
    cameras: tuple[str, ...]
    sentence: str
    off_m: float
    refuted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The calibrated cameras. cameras: all cameras, each with a pose; floor_height_m: Y of the floor in the world, None
    if no camera sees it; notes: assumptions, one sentence each, for the run's report; poses: one record per camera;
    doubts: one per contradiction between a pose and what the cameras see; displaced_m: measured distance between the
    places at which different cameras show the patient; this distance is included in every joint's sigma.
    """

    cameras: tuple[Camera, ...]
    floor_height_m: float | None
    residuals: tuple[FloorResidual, ...]
    notes: tuple[str, ...]
    poses: tuple[PoseRecord, ...]
    doubts: tuple[PoseDoubt, ...] = ()
    displaced_m: float = 0.0


def write_calibration(folder: Path, recording: str, calibration: Calibration) -> None:
    """Write ``folder``/calibration.json; sigma is null for poses that were given or whose accuracy is unknown."""
    document = {
        "format": CALIBRATION_FORMAT,
        "version": 1,
        "versions": {"anchorpose": __version__},
        "recording": recording,
        "cameras": [
            {
                "name": camera.name,
                "camera_to_world": camera.require_pose().tolist(),
                "method": pose.source.value,
                "sigma_m": pose.sigma_m,
                "sigma_deg": None if pose.sigma_rad is None else float(np.degrees(pose.sigma_rad)),
                "residuals": [{"what": f.what, "value": float(f.value), "unit": f.unit} for f in pose.figures],
            }
            for camera, pose in zip(calibration.cameras, calibration.poses, strict=True)
        ],
        "floor_height_m": calibration.floor_height_m,
        "notes": list(calibration.notes),
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / CALIBRATION_FILE).write_text(text + "\n", encoding="utf-8")


def calibration_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """Return a table of texts with one row per camera: name, method, sigma in mm and degrees, rms residuals in mm and
    px.
    """
    rows: list[tuple[str, ...]] = []
    for pose in calibration.poses:
        figures: dict[str, Any] = {figure.unit: figure.value for figure in reversed(pose.figures)}
        rows.append(
            (
                pose.camera,
                pose.source.value,
                "–" if pose.sigma_m is None else f"{1000 * pose.sigma_m:.1f}",
                "–" if pose.sigma_rad is None else f"{np.degrees(pose.sigma_rad):.2f}",
                f"{1000 * figures['m']:.1f}" if "m" in figures else "–",
                f"{figures['px']:.2f}" if "px" in figures else "–",
            )
        )
    return rows
