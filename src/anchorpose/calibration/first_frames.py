"""Read from the first frames of one camera how noisy they are, what stays in place and where the patient stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.recording.recording import FrameSet

MAD_OF_NORMAL: Final = 0.6745  # median of |x| of a standard normal
STAYS_SHARE: Final = 0.3  # of the frames: a surface read so often is the room, even where people stand in front of it
SAME_M, SAME_SIGMAS = 0.02, 3.0  # readings of one surface differ by less


def noise_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Factor a of the sensor's noise law sigma(z) = a z^2 (unit 1/m), from second differences along rows.

    depths_m: depth frames (height, width) float32, 0 = no reading. A plane has no second difference, so what is left
    is noise; medians ignore edges. The step of the grey values enters as the deviation of a uniform error.
    Source of the law: Khoshelham and Elberink 2012 (doi:10.3390/s120201437).
    Raises ValueError where no three neighbouring pixels have a reading.
    """
    ratios = []
    for depth in depths_m:
        depth = depth.astype(np.float64)
        left, middle, right = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
        seen = (left > 0) & (middle > 0) & (right > 0)
        ratios.append(np.abs(left - 2 * middle + right)[seen] / middle[seen] ** 2)
    every = np.concatenate(ratios) if ratios else np.empty(0)
    if not every.size:
        raise ValueError("no three neighbouring pixels have a reading: the noise cannot be measured")
    white = float(np.median(every)) / (MAD_OF_NORMAL * np.sqrt(6.0))
    return float(np.hypot(white, step_per_m(depths_m) / np.sqrt(12.0)))


def step_per_m(depths_m: Sequence[np.ndarray]) -> float:
    """Factor of the step between neighbouring grey values, ``step_per_m z^2`` (unit 1/m); 0 where there is one value.

    depths_m: as for ``noise_per_m``. Cameras that measure disparity have steps that grow with the square of distance.
    """
    steps = []
    for depth in depths_m:
        values = np.unique(depth[depth > 0].astype(np.float64))
        if len(values) > 1:
            steps.append(np.median(np.diff(values) / values[1:] ** 2))
    return float(np.median(steps)) if steps else 0.0


def what_stays(frames_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """(height, width) float32: per pixel, the farthest surface that is read in ``STAYS_SHARE`` of the frames.

    frames_m (n, height, width), 0 = no reading. People stand in front of the room, never behind it; an edge pixel of a
    bar, which reads sometimes the bar and sometimes what is behind it, counts as bar if it reads the bar most of the
    time. 0 where less than that share of the frames has a reading.
    """
    if len(frames_m) == 1:
        return frames_m[0]
    rising = np.sort(frames_m, axis=0)
    count = (rising > 0).sum(axis=0)
    needed = np.maximum(np.ceil(STAYS_SHARE * np.maximum(count, 1)).astype(np.int64), 1)
    level = np.take_along_axis(rising, (len(rising) - needed)[None], axis=0)[0]
    near = np.abs(rising - level) < SAME_M + SAME_SIGMAS * noise_per_m * level**2
    near &= rising > 0
    total = np.where(near, rising, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return np.where(count >= STAYS_SHARE * len(frames_m), total, 0.0).astype(np.float32)


NEARER_M, NEARER_SIGMAS = 0.15, 3.0  # a body is thicker than this; smoothing cameras differ from the room by more
LEGS_M, HEADS_M = 0.3, 2.0  # between these heights people differ from floor and ceiling
SEEN_AREA_M2, SEEN_HEIGHT_M = 0.1, 0.6  # a fifth of an adult's frontal area, half the height of one who crouches
ALONE_SHARE, ALONE_DEPTH_M = 0.5, 1.5  # readings on less than half the depth image, within a person's reach in depth
FRAMES_NEEDED: Final = 8  # below that a percentile over time means nothing
CELL_M: Final = 0.25  # half a shoulder breadth
USUAL_DISTANCE_M: Final = 2.5  # of a patient from the camera, where nobody is found


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """point_camera_m (3,): below the patient's start, on the floor or, without one, at the patient's lowest visible
    point; reason: how it was found, one sentence."""

    point_camera_m: np.ndarray
    reason: str


def start_of_patient(
    camera: Camera,
    sample_frames: Sequence[FrameSet],
    background_m: np.ndarray | None,
    up: np.ndarray,
    height_m: float | None,
) -> Start:
    """The densest place over the ground, in the first sampled frame that shows enough of a person.

    up (3,) camera frame; height_m: of the camera above the floor, None where unknown. Where nothing stands out from
    the room, the place is straight ahead of the camera.
    """
    frames = [(frame.frame, depth) for frame in sample_frames if (depth := frame.depths_m[0]) is not None]
    for room, how in _rooms([depth for _, depth in frames], background_m):
        for number, depth in frames:
            mask = depth > 0
            if room is not None:
                mask &= (room <= 0) | (depth < room - _margin_m(room, depth))
            points = camera.back_project(np.where(mask, depth, 0)).reshape(-1, 3)[mask.ravel()].astype(np.float64)
            if height_m is not None:
                above = points @ up + height_m
                points = points[(above > LEGS_M) & (above < HEADS_M)]
            place = _densest(points, points[:, 2] ** 2 / (camera.intrinsics.fx * camera.intrinsics.fy), up)
            if place is not None:
                ground = _dropped(place, points, up, height_m)
                return Start(ground, f"the origin is below {how}, in frame {number}")
    ahead = np.array([0.0, 0.0, USUAL_DISTANCE_M])
    return Start(
        _dropped(ahead, ahead[None], up, height_m), "nobody was found: the origin is 2.5 m ahead of the camera"
    )


def people_only(depth_m: np.ndarray) -> bool:
    """Whether the recorder has removed the room already: few readings, all within a person's reach in depth."""
    readings = depth_m[depth_m > 0]
    if readings.size == 0:
        return True
    low, high = np.percentile(readings, [1, 99])
    return bool(readings.size < ALONE_SHARE * depth_m.size and high - low < ALONE_DEPTH_M)


def _rooms(depths_m: Sequence[np.ndarray], background_m: np.ndarray | None) -> Iterator[tuple[np.ndarray | None, str]]:
    """What people may stand out from, the most reliable first, in words too; None = the room is unknown."""
    if background_m is not None:
        yield background_m, "the first person in front of the empty room"
    elif len(depths_m) >= FRAMES_NEEDED and not all(people_only(depth) for depth in depths_m):
        yield (
            np.quantile(np.stack(depths_m), 0.9, axis=0).astype(np.float32),
            "the first person or moved furniture in front of what stays in place",
        )
    yield None, "the largest upright mass, a person or furniture"


def _margin_m(room_m: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    """(height, width) how much nearer than the room people are; noise grows with the square of depth."""
    both = (room_m > 0) & (depth_m > 0)
    square = np.maximum(room_m, 1e-3) ** 2
    typical = float(np.median(np.abs(room_m - depth_m)[both] / square[both])) if both.any() else 0.0
    margin: np.ndarray = np.maximum(NEARER_M, NEARER_SIGMAS * typical / MAD_OF_NORMAL * square)
    return margin


def _densest(points_m: np.ndarray, area_m2: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """(3,) mean of the points of the fullest ground cell and its eight neighbours; None where it is not a person.

    Pixels are counted, not square metres: the patient is nearer than walls and shelves.
    """
    if not len(points_m):
        return None
    side = np.cross(up, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    level = points_m @ np.stack([side, np.cross(side, up)], axis=1)
    cell = np.floor((level - level.min(axis=0)) / CELL_M).astype(np.int64) + 1
    shape = cell.max(axis=0) + 2
    mass = np.bincount(cell[:, 0] * shape[1] + cell[:, 1], minlength=int(shape.prod())).reshape(shape)
    around = sum(np.roll(mass, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1))
    peak = np.array(np.unravel_index(np.argmax(around), mass.shape))
    near = (np.abs(cell - peak) <= 1).all(axis=1)
    low, high = np.percentile(points_m[near] @ up, [2, 98])
    if area_m2[near].sum() < SEEN_AREA_M2 or high - low < SEEN_HEIGHT_M:
        return None
    centre: np.ndarray = np.average(points_m[near], axis=0, weights=area_m2[near])
    return centre


def _dropped(point_m: np.ndarray, points_m: np.ndarray, up: np.ndarray, height_m: float | None) -> np.ndarray:
    """``point_m`` moved along ``up`` to the floor or, without one, to the lowest of the points."""
    lowest = -height_m if height_m is not None else float(np.percentile(points_m @ up, 1))
    moved: np.ndarray = point_m + (lowest - point_m @ up) * up
    return moved
