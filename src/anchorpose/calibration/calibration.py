"""The result of calibration: the pose of every camera, where it comes from and how accurate it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from anchorpose.camera import Camera


class PoseSource(StrEnum):
    """Where a camera's pose comes from; users read it in run.json."""

    GIVEN = "given"
    FILE = "given by a calibration file"
    RESULTS = "those of the corrected results"
    EQUIPMENT = "found from the equipment"
    MARKERS = "found from markers"
    FLOOR = "floor and patient"
    PEOPLE = "placed by the people it sees"


@dataclass(frozen=True, slots=True)
class PoseFigure:
    """One number that says how well a pose fits."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """One camera: sigma_m of the position of the equipment in it and sigma_rad of the direction, None where unknown."""

    camera: str
    source: PoseSource
    sigma_m: float | None = None
    sigma_rad: float | None = None
    figures: tuple[PoseFigure, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FloorResidual:
    """How well one camera sees the floor: its name, rms of the plane, share of readings on it, tilt against world Y."""

    camera: str
    residual_m: float
    inlier_share: float
    tilt_rad: float


class DoubtSource(StrEnum):
    """What contradicts a pose."""

    FLOOR = "floor"
    UPSIDE_DOWN = "people on a floor above the camera"
    EQUIPMENT = "equipment"
    CAMERAS = "cameras"  # another camera, which sees the same surfaces


@dataclass(frozen=True, slots=True)
class PoseDoubt:
    """What contradicts the poses of cameras, as one sentence; off_m: how far they displace what is seen, NaN where
    that is not known; refuted: by far more than noise and tapes explain, so that nothing may be tracked with them."""

    source: DoubtSource
    cameras: tuple[str, ...]
    sentence: str
    off_m: float
    refuted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """cameras: all with a pose; floor_height_m: Y of the floor in the world, None where no camera sees it; notes: what
    was assumed, one sentence each, for the run's report; poses: one record per camera; doubts: what contradicts them;
    displaced_m: how far cameras are known to displace the patient, a part of every joint's error."""

    cameras: tuple[Camera, ...]
    floor_height_m: float | None
    residuals: tuple[FloorResidual, ...]
    notes: tuple[str, ...]
    poses: tuple[PoseRecord, ...]
    doubts: tuple[PoseDoubt, ...] = ()
    displaced_m: float = 0.0
