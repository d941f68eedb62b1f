"""Find the poses of cameras relative to each other from the floor and the people that they see.

The floor that a camera sees gives the camera's tilt and height. The rotation about the vertical and the shift over the
floor come from the people that two cameras see: first from people's places over time (``search_ground``), then from
people's surfaces at the same moments (``common_view``). Walls and floor are left out of this fit, since their depth
stays the same if a camera is shifted along them. With walls and floor in the fit, the error on simulated clinics was 5
mm instead of 2 mm, since the systematic error of a time-of-flight camera bends large distant planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from anchorpose.calibration.common_view import LevelView, SurfaceFit, fit_people, level_view
from anchorpose.calibration.first_frames import FloorPlane, NoFloor
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import FrameSet, Recording, depths_of, pair_frames
from anchorpose.rotations import rigid, rotation_about_y
from anchorpose.settings import Count, settings

LEAST_MOMENTS: Final = 6
# s, minimum duration of a recording from which cameras are placed; in a shorter recording, people walk too little to
# show how the cameras are placed, and a recording of 4 s gave a wrong placement
LEAST_SPAN_S: Final = 8.0
# number of placements from the search that are refined; the correct placement was always among the best three
PLACES: Final = 8
# maximum share of one camera's points on people that may lie where the other camera sees no people; correct placements
# had 0.01 to 0.06
WORST_IMPOSSIBLE: Final = 0.1
# minimum share of one camera's points on people that must lie inside the other camera's image; with a smaller share,
# nothing would contradict a wrong placement
LEAST_COMMON: Final = 0.3
# m, maximum residual of fitted surfaces; correct placements had 2 or 3 mm, a placement that fits the front of a body to
# its back had 11 mm
WORST_RESIDUAL_M: Final = 0.008
WORST_SIGMA_M: Final = 0.005
WORST_SIGMA_RAD: Final = 0.0052  # rad, maximum sigma of the rotation between two cameras: 0.3 degrees
# factors by which the limits of the residual and of the sigmas are multiplied while the clocks are known only to 50 ms
ROUGH_RESIDUAL, ROUGH_SIGMA = 3.0, 4.0
# m; the choice is ambiguous if the second camera's position in another accepted placement differs from its position in
# the best placement by more than this
DISTINCT_M: Final = 0.05

CELL_M: Final = 0.1
MAPPED_MOMENTS: Final = 12  # number of moments for which maps of the ground are made; more moments do not help
# m, maximum distance of mapped points from their camera along each axis of the map; few readings are farther away
REACH_M: Final = 6.0
BLUR_M: Final = (
    # m, sigma of the maps' Gaussian blur; two cameras see different sides of a body, and the blur makes them overlap
    0.12
)
# number of yaw angles tried; a step of 3 degrees moves a person at a distance of 5 m by half a body's breadth
TURNS: Final = 120
BODY_M: Final = 0.1  # m, approximate distance from the visible skin of a trunk to the trunk's middle
# m above the floor, lowest and highest mapped points: the range lies above the noise of floor readings and below the
# ceiling
LOW_M, HIGH_M = 0.2, 2.2
APART_RAD, APART_M = 0.35, 0.4  # rad and m; search results that differ by less than both limits are the same placement


@settings
class PlacingConfig:
    """Settings for placing cameras without poses relative to each other, by means of the people that they see."""

    # number of moments (times with a frame of every camera) that are compared; they are spread over the recording, so
    # that people move between them
    moments: Count = 24
    step_px: Count = 3  # pixels; every third pixel of every third row is compared


class NoCameraToCamera(StrEnum):
    """The reason why cameras could not be placed relative to each other. Such a reason is a result and not an error: an
    empty room, for example, shows no people to compare.
    """

    NO_FLOOR = "a camera sees no floor"
    FEW_MOMENTS = "the cameras have too few depth frames at the same moments"
    TOO_SHORT = "the recording is too short for people to walk about"
    NOTHING_COMMON = "too little of the people is seen by two cameras at once"
    CONTRADICTED = "in every placement people fall beside those another camera sees"
    AMBIGUOUS = "people stand where several placements are possible"
    UNSURE = "the surfaces seen by two cameras do not fix the placement accurately enough"


@dataclass(frozen=True, slots=True, eq=False)
class CameraLink:
    """The placement of camera ``second`` relative to camera ``first``; both are positions in the list of cameras."""

    first: int
    second: int
    fit: SurfaceFit


@dataclass(frozen=True, slots=True, eq=False)
class CameraToCamera:
    """The poses of all cameras relative to the first camera, T_first_camera (4, 4) each, the identity for the first
    camera; links: one for each other camera.
    """

    T_first_camera: tuple[np.ndarray, ...]
    links: tuple[CameraLink, ...]


def find_camera_to_camera(
    recording: Recording, floors: Sequence[FloorPlane | NoFloor], config: PlacingConfig, rough_clocks: bool = False
) -> CameraToCamera | NoCameraToCamera:
    """Find the pose of every camera relative to the first camera, from a recording in which all cameras' clocks are
    synchronised.

    floors: one per camera. A camera whose view overlaps too little with that of the first camera is placed relative to
    another placed camera. rough_clocks: whether the clocks are known only to 50 ms. If so, worse fits are accepted,
    since the poses found serve only to compare the clocks.
    """
    planes = [floor for floor in floors if isinstance(floor, FloorPlane)]
    if len(planes) < len(floors):
        return NoCameraToCamera.NO_FLOOR
    frames = _common_frames(recording, config.moments)
    if len(frames) < LEAST_MOMENTS:
        return NoCameraToCamera.FEW_MOMENTS
    return place_cameras(recording.cameras, planes, recording.backgrounds_m, frames, config, rough_clocks)


def place_cameras(
    cameras: Sequence[Camera],
    floors: Sequence[FloorPlane],
    backgrounds_m: Sequence[np.ndarray | None],
    frames: Sequence[FrameSet],
    config: PlacingConfig,
    rough_clocks: bool = False,
) -> CameraToCamera | NoCameraToCamera:
    """Find the pose of every camera relative to the first camera; frames: frame sets in chronological order, each with
    a depth image of every camera.
    """
    if frames[-1].time_s - frames[0].time_s < LEAST_SPAN_S:
        return NoCameraToCamera.TOO_SHORT
    views = [
        level_view(camera, floor, background, depths_of(frames, k), config.step_px)
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
        fit = _place(views[first], views[second], rough_clocks)
        if isinstance(fit, NoCameraToCamera):
            refusal = fit
            continue
        placed[second] = placed[first] @ fit.T_first_second
        links.append(CameraLink(first, second, fit))
    return CameraToCamera(tuple(placed[k] for k in range(len(views))), tuple(links))


def _common_frames(recording: Recording, moments: int) -> list[FrameSet]:
    """Return frame sets, spread over the recording, in which all cameras have a depth image, taken at about the same
    time.
    """
    pairs = pair_frames(recording)
    whole = np.flatnonzero((pairs >= 0).all(axis=1))
    if not len(whole):
        return []
    times = np.stack([stream.time_s[pairs[whole, k]] for k, stream in enumerate(recording.streams)], axis=1)
    parts = np.array_split(np.arange(len(whole)), min(moments, len(whole)))
    chosen = [int(whole[part[int(np.ptp(times[part], axis=1).argmin())]]) for part in parts]
    found = [read_frame(recording, k) for k in chosen]
    return [frame for frame in found if all(depth is not None for depth in frame.depths_m)]


def _place(first: LevelView, second: LevelView, rough_clocks: bool) -> SurfaceFit | NoCameraToCamera:
    """Place the second camera relative to the first, or return the reason why no placement is accepted."""
    to_first = invert_rigid(first.T_level_camera)
    fits = [
        fit
        for T_first_second in search_ground(first, second)
        if (fit := fit_people(first, second, to_first @ T_first_second @ second.T_level_camera)) is not None
        and fit.common >= LEAST_COMMON
    ]
    if not fits:
        return NoCameraToCamera.NOTHING_COMMON
    possible = [fit for fit in fits if fit.impossible <= WORST_IMPOSSIBLE]
    if not possible:
        return NoCameraToCamera.CONTRADICTED
    accurate = [fit for fit in possible if _is_accurate(fit, rough_clocks)]
    if not accurate:
        return NoCameraToCamera.UNSURE
    best = min(accurate, key=lambda fit: fit.residual_m)
    away_m = [np.linalg.norm(fit.T_first_second[:3, 3] - best.T_first_second[:3, 3]) for fit in accurate]
    return NoCameraToCamera.AMBIGUOUS if max(away_m) > DISTINCT_M else best


def _is_accurate(fit: SurfaceFit, rough_clocks: bool) -> bool:
    residual, sigma = (ROUGH_RESIDUAL, ROUGH_SIGMA) if rough_clocks else (1.0, 1.0)
    return (
        fit.residual_m <= residual * WORST_RESIDUAL_M
        and fit.sigma_m <= sigma * WORST_SIGMA_M
        and fit.sigma_rad <= sigma * WORST_SIGMA_RAD
    )


def search_ground(first: LevelView, second: LevelView) -> list[np.ndarray]:
    """Return the ``PLACES`` best distinct placements of the second camera relative to the first, best first. Each is
    T_first_second (4, 4) between the level coordinate frames (Y up, origin on the floor) of the two views.

    If the floor is known, the pose between two cameras is a rotation about the vertical and a shift over the floor. For
    every rotation, the two cameras' maps of the ground are correlated at all shifts at once. Each camera has one map of
    the people per moment, and one map of the room's walls and furniture.
    """
    maps = _maps(first, 0.0)
    size = next_fast_len(2 * maps.shape[1])
    spectra = rfft2(maps, s=(size, size))
    # the last map shows the room; it has half of the weight of all maps of people together, so that people count more
    weight = np.array([1.0 / max(1, len(maps) - 1)] * (len(maps) - 1) + [0.5])
    found: list[tuple[float, float, float, float]] = []
    for turn in np.arange(TURNS) * 2.0 * np.pi / TURNS:
        other = rfft2(_maps(second, float(turn)), s=(size, size))
        score = irfft2((spectra * other.conj() * weight[:, None, None]).sum(axis=0), s=(size, size))
        for _ in range(2):
            row, column = np.unravel_index(int(score.argmax()), score.shape)
            shift = [(k if k < size // 2 else k - size) * CELL_M for k in (int(row), int(column))]
            found.append((float(score[row, column]), float(turn), shift[0], shift[1]))
            _erase(score, int(row), int(column))
    return [rigid(rotation_about_y(turn), np.array([x_m, 0.0, z_m])) for _, turn, x_m, z_m in _distinct(found)]


def _maps(view: LevelView, turn: float) -> np.ndarray:
    """Return maps of the ground seen from above, (moments + 1, cells, cells) float32 of unit norm: a map of the people
    per moment, then a map of the room. All points are rotated about the vertical by ``turn`` radians first.
    """
    T, every = view.T_level_camera, -(-len(view.seen) // MAPPED_MOMENTS)
    moments = [_deeper(transform_points(T, seen.points_m[seen.person])) for seen in view.seen[::every]]
    still = np.concatenate([transform_points(T, seen.points_m[~seen.person]) for seen in view.seen[:1]])
    return np.stack([_map(points, turn) for points in (*moments, still)])


def _deeper(points_level_m: np.ndarray) -> np.ndarray:
    """Return points on people's skin, moved away from the camera by ``BODY_M``, to about the middle of the body."""
    ground = points_level_m * [1.0, 0.0, 1.0]
    away = ground / np.maximum(np.linalg.norm(ground, axis=1, keepdims=True), 1e-6)
    return np.asarray(points_level_m + BODY_M * away)


def _map(points_level_m: np.ndarray, turn: float) -> np.ndarray:
    cells = int(2 * REACH_M / CELL_M)
    points = points_level_m[(points_level_m[:, 1] > LOW_M) & (points_level_m[:, 1] < HIGH_M)]
    ground = points[:, [0, 2]] @ rotation_about_y(turn)[np.ix_([0, 2], [0, 2])].T
    cell = np.floor((ground + REACH_M) / CELL_M).astype(np.int64)
    cell = cell[((cell >= 0) & (cell < cells)).all(axis=1)]
    mass = np.bincount(cell[:, 0] * cells + cell[:, 1], minlength=cells * cells).reshape(cells, cells)
    blurred = cv2.GaussianBlur(np.sqrt(mass.astype(np.float32)), (0, 0), BLUR_M / CELL_M)
    norm = float(np.linalg.norm(blurred))
    return blurred / norm if norm > 0 else blurred


def _erase(score: np.ndarray, row: int, column: int) -> None:
    """Set the scores around a peak to -inf, in place, so that the next maximum is another peak."""
    reach = int(2 * APART_M / CELL_M)
    rows, columns = (np.arange(centre - reach, centre + reach + 1) % len(score) for centre in (row, column))
    score[np.ix_(rows, columns)] = -np.inf


def _distinct(found: list[tuple[float, float, float, float]]) -> list[tuple[float, float, float, float]]:
    kept: list[tuple[float, float, float, float]] = []
    for place in sorted(found, reverse=True):
        near = (
            abs((place[1] - other[1] + np.pi) % (2 * np.pi) - np.pi) < APART_RAD
            and np.hypot(place[2] - other[2], place[3] - other[3]) < APART_M
            for other in kept
        )
        if not any(near):
            kept.append(place)
        if len(kept) == PLACES:
            break
    return kept
