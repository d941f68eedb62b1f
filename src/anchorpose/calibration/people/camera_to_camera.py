"""Where several cameras stand to each other when nothing but people and the floor is known.

Each camera's floor gives its tilt and height. The turn about the vertical and the shift over the floor come from
people in common view: first their places over time (``ground_search``), then their surfaces at the same moments
(``surface_fit``). Fitting walls and floor as well made it worse on simulated clinics (5 instead of 2 mm): a time-of-
flight camera's steady error bends large far planes, and along a wall nothing tells a shift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum

import numpy as np

from anchorpose.calibration.floor import FloorPlane, NoFloor
from anchorpose.calibration.people.common_view import LevelView, level_view, search_ground
from anchorpose.calibration.people.surface_fit import SurfaceFit, fit_people
from anchorpose.camera import Camera, invert_rigid
from anchorpose.recording.pairing import pair_frames
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraToCameraConfig:
    """How cameras are placed against each other, and what is not to be trusted."""

    moments: int = 24  # spread over the recording: people should have walked about between them
    least_moments: int = 6
    least_span_s: float = 8.0  # within less people hardly walk: of four seconds a wrong placing was once believed
    step_px: int = 3
    places: int = 8  # of the search that are looked at more closely; the right one was among the first three
    worst_impossible: float = 0.1  # of people beside those of the other camera: right placings had 0.01 to 0.06
    least_common: float = 0.3  # below this the cameras look past each other, and nothing can contradict
    worst_residual_m: float = 0.008  # right placings had 2 or 3 mm; a front laid upon a back 11
    worst_sigma_m: float = 0.005
    worst_sigma_rad: float = 0.0052  # 0.3 degrees
    apart_m: float = 0.05  # placings that differ by more are two

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")

    def first_look(self) -> CameraToCameraConfig:
        """What does while clocks are only known to 50 ms: poses to compare them by, not to measure with."""
        return replace(
            self,
            worst_residual_m=3.0 * self.worst_residual_m,
            worst_sigma_m=4.0 * self.worst_sigma_m,
            worst_sigma_rad=4.0 * self.worst_sigma_rad,
        )


class NoCameraToCamera(StrEnum):
    """Why cameras could not be placed against each other: a result, an empty room tells nothing."""

    NO_FLOOR = "a camera sees no floor"
    FEW_MOMENTS = "the cameras have too few pictures at the same moments"
    TOO_SHORT = "within so short a recording people do not walk about"
    NOTHING_COMMON = "too little of the people is seen by two cameras at once"
    CONTRADICTED = "every placing would have people fall beside those another camera sees"
    AMBIGUOUS = "people stand where several placings are possible"
    UNSURE = "the surfaces seen by two cameras leave the placing vague"


@dataclass(frozen=True, slots=True, eq=False)
class CameraLink:
    """How ``second`` was placed against ``first``, both positions in the list of cameras."""

    first: int
    second: int
    fit: SurfaceFit


@dataclass(frozen=True, slots=True, eq=False)
class CameraToCamera:
    """T_first_camera: one (4, 4) a camera, the first the identity; links: all but one camera's."""

    T_first_camera: tuple[np.ndarray, ...]
    links: tuple[CameraLink, ...]


def find_camera_to_camera(
    recording: Recording, floors: Sequence[FloorPlane | NoFloor], config: CameraToCameraConfig
) -> CameraToCamera | NoCameraToCamera:
    """Every camera's pose against the first camera's, from pictures of ``recording``, whose clocks are put together.

    floors: one a camera. Cameras that share little with the first are placed through another one.
    """
    planes = [floor for floor in floors if isinstance(floor, FloorPlane)]
    if len(planes) < len(floors):
        return NoCameraToCamera.NO_FLOOR
    frames = common_frames(recording, config.moments)
    if len(frames) < config.least_moments:
        return NoCameraToCamera.FEW_MOMENTS
    return place_cameras(recording.cameras, planes, recording.backgrounds_m, frames, config)


def place_cameras(
    cameras: Sequence[Camera],
    floors: Sequence[FloorPlane],
    backgrounds_m: Sequence[np.ndarray | None],
    frames: Sequence[FrameSet],
    config: CameraToCameraConfig,
) -> CameraToCamera | NoCameraToCamera:
    """The same from frames in which every camera has a picture, in the order of time."""
    if frames[-1].time_s - frames[0].time_s < config.least_span_s:
        return NoCameraToCamera.TOO_SHORT
    views = [
        level_view(
            camera, floor, background, [d for frame in frames if (d := frame.depths_m[k]) is not None], config.step_px
        )
        for k, (camera, floor, background) in enumerate(zip(cameras, floors, backgrounds_m, strict=True))
    ]
    placed, links, refusal = {0: np.eye(4)}, list[CameraLink](), NoCameraToCamera.NOTHING_COMMON
    tried = set[tuple[int, int]]()
    while len(placed) < len(views):
        pairs = [(a, b) for a in placed for b in range(len(views)) if b not in placed and (a, b) not in tried]
        if not pairs:
            return refusal
        first, second = pairs[0]
        tried.add((first, second))
        fit = _place(views[first], views[second], config)
        if isinstance(fit, NoCameraToCamera):
            refusal = fit
            continue
        placed[second] = placed[first] @ fit.T_first_second
        links.append(CameraLink(first, second, fit))
    return CameraToCamera(tuple(placed[k] for k in range(len(views))), tuple(links))


def common_frames(recording: Recording, moments: int) -> list[FrameSet]:
    """Frames spread over the recording in which all cameras have a picture, nearest to each other in time."""
    pairs = pair_frames(recording)
    whole = np.flatnonzero((pairs >= 0).all(axis=1))
    if not len(whole):
        return []
    times = np.stack([stream.time_s[pairs[whole, k]] for k, stream in enumerate(recording.streams)], axis=1)
    parts = np.array_split(np.arange(len(whole)), min(moments, len(whole)))
    chosen = [int(whole[part[int(np.ptp(times[part], axis=1).argmin())]]) for part in parts]
    found = [next(iter(read_frames(recording, k, k + 1))) for k in chosen]
    return [frame for frame in found if all(depth is not None for depth in frame.depths_m)]


def _place(first: LevelView, second: LevelView, config: CameraToCameraConfig) -> SurfaceFit | NoCameraToCamera:
    """The second camera against the first, or why not."""
    to_first = invert_rigid(first.T_level_camera)
    fits = [
        fit
        for place in search_ground(first, second, config.places)
        if (fit := fit_people(first, second, to_first @ place.T_first_second @ second.T_level_camera)) is not None
        and fit.common >= config.least_common
    ]
    if not fits:
        return NoCameraToCamera.NOTHING_COMMON
    possible = [fit for fit in fits if fit.impossible <= config.worst_impossible]
    if not possible:
        return NoCameraToCamera.CONTRADICTED
    sure = [fit for fit in possible if _is_sure(fit, config)]
    if not sure:
        return NoCameraToCamera.UNSURE
    best = min(sure, key=lambda fit: fit.residual_m)
    others = [fit for fit in sure if _distance_m(fit, best) > config.apart_m]
    return NoCameraToCamera.AMBIGUOUS if others else best


def _is_sure(fit: SurfaceFit, config: CameraToCameraConfig) -> bool:
    return (
        fit.residual_m <= config.worst_residual_m
        and fit.sigma_m <= config.worst_sigma_m
        and fit.sigma_rad <= config.worst_sigma_rad
    )


def _distance_m(one: SurfaceFit, other: SurfaceFit) -> float:
    return float(np.linalg.norm(one.T_first_second[:3, 3] - other.T_first_second[:3, 3]))
