"""Learn the empty room of one camera from its background frame (a depth image without people) or, without such a frame,
from surfaces that stay still in the recording.

Still surfaces are the room or people who never leave their place. The learnt descriptor (a network that finds people in
depth images) recognises these people. The room behind these people is never seen; it is filled in from the planes of
floor, walls and ceiling, and from the model of the equipment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from scipy.spatial import ConvexHull

from anchorpose.calibration.first_frames import (
    FRAMES_NEEDED,
    MAD_OF_NORMAL,
    NEARER_M,
    SAME_M,
    noise_per_m,
    people_only,
    step_per_m,
)
from anchorpose.camera import Camera, transform_points
from anchorpose.descriptor.people import people_mask
from anchorpose.isolation.background import (
    BACKGROUND_GATE,
    EQUIPMENT_GATE,
    EQUIPMENT_TOLERANCE_M,
    BackgroundModel,
    BackgroundSource,
    equipment_depth,
)
from anchorpose.isolation.components import JUMP_GATE
from anchorpose.isolation.depth_noise import (
    SHARP_EDGE_PX,
    DepthDetail,
    DepthNoise,
    Sensor,
    measure_detail,
    measure_noise,
    neighbour_noise,
)
from anchorpose.isolation.room_planes import depth_of_room
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.threads import each

# pixels, side of the image blocks in which noise is measured; within a block, the noise is nearly the same
BLOCK_PX: Final = 16
# minimum number of readings in a block; the block's sigma, computed from a median, then has an error of a sixth of its
# value
READINGS_NEEDED: Final = 32
LEAST_READ: Final = 0.15  # the room is known at a pixel if at least this share of the frames agrees on its depth
# if at least this share of the frames has a reading at a pixel, the room is known there even if the readings differ. At
# a pixel that has readings of passers-by only, fewer than half of the frames have a reading
OFTEN_READ: Final = 0.5
# sigmas of the noise, maximum difference between readings of one surface, to which ``SAME_M`` (metres) is added
SAME_SIGMAS: Final = 6.0
# two percentiles of a pixel's readings over time. Both show the room if at least a fifth of these readings show it;
# their difference then gives sigma
FAR_PERCENTILE, NEAR_PERCENTILE = 95, 80
FAR_SIGMAS, NEAR_SIGMAS = 1.6449, 0.8416  # positions of these percentiles in a normal distribution, in sigmas

# m; a surface at most this far outside the equipment's outline on the ground may be the patient, whose arms or back may
# extend over the rails
LEAN_M: Final = 0.25
HEAD_M: Final = 2.3  # m above the floor, maximum height of a person in the equipment, with a raised arm
# m above the floor; lower surfaces count as floor. The floor's plane may be wrong by this height (``SOLE_M``); a foot
# is three times as high.
SOLE_M: Final = 0.015
# maximum share of the image's blocks in which readings of the room differ from the image of the empty room by more than
# ``BACKGROUND_GATE`` sigmas; if the share is larger, the image counts as outdated. In recordings of simulated and real
# cameras that did not move, the share of such blocks is up to 0.03. After a camera has tilted up or down by 0.25
# degrees, the readings of the floor differ from the image, and the share of such blocks is 0.35
OUTDATED_SHARE: Final = 0.1


def learn_background(
    empty_m: np.ndarray | None,
    frames_m: Sequence[np.ndarray],
    camera: Camera,
    floor_height_m: float | None,
    equipment: EquipmentModel | None = None,
) -> BackgroundModel:
    """Learn the background of one camera from a frame of the empty room or, without such a frame, from frames of the
    recording.

    empty_m (height, width) float32 or None; frames_m: frames of the same shape, spread over the recording; the camera
    needs a pose. Without an empty frame, the background of a pixel is the farthest surface that the pixel shows in
    enough frames. Readings of people, whom the learnt descriptor finds, are left out. floor_height_m: None if no floor
    is seen. The equipment is used only without an empty frame. Raises ValueError without frames.
    """
    if not frames_m:
        raise ValueError("a background needs at least one frame of the recording to measure the noise on")
    noise, detail = noise_per_m(frames_m), measure_detail(frames_m, camera)
    if empty_m is not None:
        depth = _fill_specks(empty_m.astype(np.float32))
        sigma = _at_least_a_step(_noise_behind(depth, frames_m, noise), depth, detail.step_per_m)
        law = measure_noise(depth, sigma, frames_m, camera, noise)
        return BackgroundModel(depth, sigma, _sensor(detail, noise, law), BackgroundSource.PICTURE)
    if people_only(frames_m, camera):
        nothing = np.zeros_like(frames_m[0], dtype=np.float32)
        sensor = _sensor(replace(detail, edge_px=SHARP_EDGE_PX), noise, neighbour_noise(noise))
        return BackgroundModel(nothing, nothing, sensor, BackgroundSource.REMOVED)
    depth, sigma = _from_recording(frames_m, camera, floor_height_m, equipment, noise)
    if len(frames_m) > 1:  # a single frame is itself the learnt room, so reading and room are rounded alike
        sigma = _at_least_a_step(sigma, depth, detail.step_per_m)
    law = measure_noise(depth, sigma, frames_m, camera, noise)
    return BackgroundModel(depth, sigma, _sensor(detail, noise, law), BackgroundSource.RECORDING)


def is_outdated(empty_m: np.ndarray, frames_m: Sequence[np.ndarray], camera: Camera) -> bool:
    """Return whether the camera, or much of the room, has moved since the image of the empty room was taken.

    empty_m, frames_m: as for ``learn_background``. After such a move, readings of the room differ from the image by
    more than noise in many image blocks. The difference of a block is the median of the signed differences of its
    pixels, in which noise averages out. Readings farther than ``NEARER_M`` from the image show people or furniture and
    are left out. Return False if the noise cannot be measured, for example from a single frame.
    """
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return False
    depth = _fill_specks(empty_m.astype(np.float32))
    law = measure_noise(depth, _noise_behind(depth, frames_m, noise), frames_m, camera, noise)
    if not law.measured:
        return False
    off = _off_room(depth, frames_m, law, step_per_m(frames_m))
    return bool(np.mean(np.abs(off) > BACKGROUND_GATE) > OUTDATED_SHARE)


def has_moved(model: BackgroundModel, frames_m: Sequence[np.ndarray]) -> bool:
    """Return whether the camera, or much of the room, moved while the frames (height, width) float32 were recorded, or
    whether the camera's depth drifted.

    frames_m: spread over the recording, in order. The test is that of ``is_outdated``, but compares the first third of
    the frames with the last third, and also uses readings far behind the room, where no person can be. Return False if
    the noise was not measured. Three moves are not found: a move that is undone, a move near the beginning or end, and
    a move by which the room's surfaces only come nearer by more than ``NEARER_M``, since such readings are taken for
    people.
    """
    third = len(frames_m) // 3
    if third == 0 or not model.sensor.noise.measured:
        return False
    parts = (frames_m[:third], frames_m[-third:])
    first, last = (
        _off_room(model.depth_m, part, model.sensor.noise, model.sensor.step_per_m, behind_m=np.inf) for part in parts
    )
    return bool(np.mean(np.abs(last - first) > BACKGROUND_GATE) > OUTDATED_SHARE)


def _off_room(
    depth_m: np.ndarray, frames_m: Sequence[np.ndarray], law: DepthNoise, step_per_m: float, behind_m: float = NEARER_M
) -> np.ndarray:
    """Return (rows, columns): how many sigmas the readings of each image block lie behind the room (median); NaN with
    too few readings. Readings more than ``NEARER_M`` in front of the room or ``behind_m`` behind it are left out.
    """
    known = np.where(depth_m > 0, depth_m, np.float32(1.0))
    # because of rounding, two grey values that differ by one step may stand for the same depth, so sigma is at least a
    # step
    sigma = np.maximum(law.sigma_m(known), step_per_m * known**2)
    beyond = [np.where((depth_m > 0) & (frame > 0), frame - depth_m, np.nan) for frame in frames_m]
    off = [np.where((one > -NEARER_M) & (one < behind_m), one / sigma, np.nan) for one in beyond]
    return _block_median(np.stack(off))


def _sensor(detail: DepthDetail, noise: float, law: DepthNoise) -> Sensor:
    return Sensor(detail.edge_px, detail.focal_px, detail.step_per_m, noise_per_m=noise, noise=law)


def _from_recording(
    frames_m: Sequence[np.ndarray],
    camera: Camera,
    floor_height_m: float | None,
    equipment: EquipmentModel | None,
    noise: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (depth_m, sigma_m) of the still surfaces; people who never move are replaced by the plane of the room, or
    the equipment, behind them.
    """
    people = np.stack(each(lambda frame: people_mask(frame, camera), frames_m))
    depth, sigma = _what_stays(np.where(people, np.float32(0.0), np.stack(frames_m)), noise)
    behind, hidden = depth_of_room(depth, camera, noise), people.any(axis=0) & (depth <= 0)
    if equipment is not None:
        drawn = equipment_depth(camera, equipment)
        behind = np.where(drawn > 0, drawn, behind)
        standing = in_equipment(depth, camera, equipment, floor_height_m, noise)
        margin = EQUIPMENT_TOLERANCE_M + EQUIPMENT_GATE * np.maximum(sigma, noise * drawn**2)
        hidden |= standing & ~((drawn > 0) & (depth > drawn - margin))
    depth = np.where(hidden, behind, depth)
    # sigma is at least the sensor's noise, also at pixels where floor or walls were filled in
    return depth, np.maximum(sigma, np.float32(noise) * depth**2)


def in_equipment(
    room_m: np.ndarray, camera: Camera, equipment: EquipmentModel, floor_height_m: float | None, noise_per_m: float
) -> np.ndarray:
    """Return (height, width) bool: pixels that may show a person in the equipment: they lie above the floor, at most
    ``HEAD_M`` high, and at most ``LEAN_M`` outside the equipment's outline on the ground.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m))
    lowest = float(equipment.triangles()[0][:, 1].min()) if floor_height_m is None else floor_height_m
    above = points[..., 1] - lowest
    inside = _outside_m(points, equipment) < LEAN_M
    standing: np.ndarray = inside & (above > SOLE_M + JUMP_GATE * noise_per_m * room_m) & (above < HEAD_M)
    return standing


def _outside_m(points_m: np.ndarray, equipment: EquipmentModel) -> np.ndarray:
    """Return how far points (height, width, 3) lie outside the equipment's outline on the ground; negative inside."""
    hull = ConvexHull(equipment.triangles()[0][:, [0, 2]])
    sides = points_m[..., [0, 2]] @ hull.equations[:, :2].T + hull.equations[:, 2]
    distance: np.ndarray = np.where(np.isfinite(points_m[..., 0]), sides.max(axis=-1), np.inf)
    return distance


def _fill_specks(depth_m: np.ndarray) -> np.ndarray:
    """Fill single pixels without a reading with the median of the 5x5 pixels around, if most of these have readings."""
    seen = (depth_m > 0).astype(np.float32)
    trusted = cv2.blur(seen, (5, 5)) > 0.6
    return np.where((depth_m <= 0) & trusted, cv2.medianBlur(depth_m, 5), depth_m)


def _noise_behind(depth_m: np.ndarray, frames_m: Sequence[np.ndarray], noise: float) -> np.ndarray:
    """Return the standard deviation (height, width), metres, of readings on the background, measured block by block.

    Only readings *behind* the background are used: no person can be there, so their distance from the background is
    noise. This distance has a half-normal distribution, and its median gives the standard deviation. For a block that
    people always cover, sigma / z^2 (z: depth) is the median over the other blocks.
    """
    known = depth_m > 0
    behind = np.stack([np.where((frame > depth_m) & known, frame - depth_m, np.nan) for frame in frames_m])
    per_square = behind / np.where(known, depth_m, 1.0) ** 2
    factor = _block_median(per_square) / MAD_OF_NORMAL
    return _as_sigma(factor, depth_m, floor=noise)


def _what_stays(frames_m: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (depth_m, sigma_m) of the farthest surface that each pixel shows in enough of the frames, ``frames_m`` (n,
    height, width).
    """
    count = (frames_m > 0).sum(axis=0)
    rising = np.sort(frames_m, axis=0)  # missing readings are 0, so they are sorted first
    if len(frames_m) < FRAMES_NEEDED:  # a single reading may be a person; the farthest of several readings is the room
        depth = np.where(count >= min(2, len(frames_m)), rising[-1], np.float32(0.0))
        return depth, (np.sqrt(2.0) * noise * depth**2).astype(np.float32)
    near, far = (_percentile_of_last(rising, count, percent) for percent in (NEAR_PERCENTILE, FAR_PERCENTILE))
    square = np.where(count > 0, far, 1.0) ** 2
    same = SAME_M + SAME_SIGMAS * noise * square
    free = (far - near < same) & (count > 0)  # both percentiles show the room
    spread = (far - near) / ((FAR_SIGMAS - NEAR_SIGMAS) * square)
    sigma = _as_sigma(_block_median(np.where(free, spread, np.nan)[None]), far, floor=noise)
    # if the room gives no reading at a pixel, the pixel's readings are of passers-by only: they are few and differ
    agreeing = (np.abs(rising - far) < same).sum(axis=0)
    known = (agreeing >= LEAST_READ * len(frames_m)) | (count >= OFTEN_READ * len(frames_m))
    return np.where(known, np.maximum(far - FAR_SIGMAS * sigma, 0.0), 0.0).astype(np.float32), sigma


def _percentile_of_last(rising: np.ndarray, count: np.ndarray, percent: float) -> np.ndarray:
    """Return, per pixel, a percentile of the pixel's readings over time. rising (n, height, width): the values of each
    pixel in ascending order, of which the last ``count`` (height, width) are readings, and the values before them are 0
    (no reading). The result is 0 at pixels where ``count`` is 0.
    """
    place = len(rising) - count + np.rint((np.maximum(count, 1) - 1) * percent / 100.0).astype(np.int64)
    return np.take_along_axis(rising, np.minimum(place, len(rising) - 1)[None], axis=0)[0]


def _at_least_a_step(sigma_m: np.ndarray, depth_m: np.ndarray, step_per_m: float) -> np.ndarray:
    """Increase sigma so that a reading counts as in front of the room only if it is nearer by more than one step, the
    depth difference between successive grey values. Room and reading are each rounded by half a step, so two
    neighbouring grey values may stand for the same depth.
    """
    return np.maximum(sigma_m, np.float32(0.5 * step_per_m) * depth_m**2)


def _block_median(values: np.ndarray) -> np.ndarray:
    """Return (rows, columns): the median of values (n, height, width) per image block; NaN if too few are finite."""
    rows, columns = (-(-size // BLOCK_PX) for size in values.shape[1:])
    medians = np.full((rows, columns), np.nan)
    for row in range(rows):
        for column in range(columns):
            block = values[:, row * BLOCK_PX : (row + 1) * BLOCK_PX, column * BLOCK_PX : (column + 1) * BLOCK_PX]
            block = block[np.isfinite(block)]
            if block.size >= READINGS_NEEDED:
                medians[row, column] = np.median(block)
    return medians


def _as_sigma(factor: np.ndarray, depth_m: np.ndarray, floor: float) -> np.ndarray:
    """Convert the noise factor of each image block (sigma / z^2 at depth z; NaN = unknown) to the sigma of each pixel
    (height, width) in metres; factors below ``floor``, the factor of the sensor's own noise, are raised to ``floor``.
    """
    typical = float(np.nanmedian(factor)) if np.isfinite(factor).any() else floor
    whole = np.maximum(np.where(np.isfinite(factor), factor, typical), floor).astype(np.float32)
    smooth = cv2.resize(whole, depth_m.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return (smooth * np.where(depth_m > 0, depth_m, 1.0) ** 2).astype(np.float32)
