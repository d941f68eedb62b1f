"""What calibration hands on: every camera's pose, how it is known and how well."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from anchorpose.camera import Camera


class PoseSource(StrEnum):
    """How a camera's pose is known; people read it in run.json."""

    GIVEN = "given"
    FILE = "given by a calibration file"
    EQUIPMENT = "found from the equipment"
    MARKERS = "found from markers"
    FLOOR = "floor and patient"
    PEOPLE = "placed by the people it sees"


@dataclass(frozen=True, slots=True)
class PoseFigure:
    """One number on how well a pose fits."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """One camera: sigma_m of the place of the equipment in it and sigma_rad of the direction, None where not known."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """cameras: all with a pose; floor_height_m: the floor's Y in the world, None where no camera sees it; notes: what
    was assumed, one sentence each, for the run's report; poses: one record a camera."""

    cameras: tuple[Camera, ...]
    floor_height_m: float | None
    residuals: tuple[FloorResidual, ...]
    notes: tuple[str, ...]
    poses: tuple[PoseRecord, ...]
