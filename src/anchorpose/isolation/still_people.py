"""Find people who never leave their place: unlike the room they have a person's size, move, and have moving parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.components import JUMP_GATE, JumpLimit, jump_limit, label_components
from anchorpose.isolation.people import PERSON

SOLE_M: Final = 0.05  # above the floor; what is lower is the floor's noise
TOP_M: Final = (0.9, 2.3)  # heads of people who sit and of people who raise an arm
WIDEST_M: Final = 1.3  # from hand to hand with bent arms; walls and tables are wider
LARGEST_M2: Final = 1.0  # of a person, seen from one side
LEAST_MOVED_SHARE: Final = 0.1  # of the pixels around a body, covered in some frame: bodies sway, cupboards do not
LEAST_ATTACHED_SHARE: Final = 0.3  # of a piece's border with a moving surface connected: trunks have limbs
LEAST_FRAMES: Final = 0.15  # in which that is so: people who pass a cupboard touch it for a moment
SWAYED_SHARE: Final = 0.01  # of the pixels around a body, covered in one frame
SWAY_M: Final = 0.25  # from a body's own depth: how far it sways and its arms reach
LIMB_PX: Final = 5  # a wrist four metres away; edges flicker by one or two
RING_PX: Final = 11  # around a body, 3 cm at 2 m
PATCH_PX: Final = 17  # of a chest or a thigh four metres away; its mean has a seventeenth of a reading's noise
SWAY_GATE_M: Final = 0.06  # from a person's usual place: quiet standing sways by up to 5 cm
MOST_OF_ROOM: Final = 90  # percentile of the room's patches; the others are at edges, which flicker
SWAYS_TIMES: Final = 2.0  # what most of the room shows; still people have 3 to 9 (time of flight), mannequins below 1
BESIDE_PX: Final = 2  # from the border of a piece to what may be connected


def resting_people(
    room_m: np.ndarray, nearer: Sequence[np.ndarray], camera: Camera, floor_height_m: float | None, noise_per_m: float
) -> np.ndarray:
    """(height, width) bool: pieces of ``room_m`` that are people: connected, above the floor, with something moving.

    room_m (height, width) float32: what was farthest over time, 0 = unknown; nearer: frames (height, width) float32
    with only what was in front of it, 0 elsewhere; none where there are too few frames to see movement. People are as
    large as a person and sway, or are a still part with a moving surface connected to it. Where no floor is seen
    (floor_height_m None) nobody is connected to it either, and the height above it is not tested.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m))
    limit = jump_limit(noise_per_m, camera.intrinsics.fx)
    nearer = [_without_flicker(frame) for frame in nearer]
    pieces, area = _upright_pieces(room_m, points, camera, floor_height_m, noise_per_m)
    attached = _attached_share(room_m, pieces, len(area) - 1, nearer, limit)
    mask = (attached > LEAST_ATTACHED_SHARE)[pieces] & (area < LARGEST_M2)[pieces] & (pieces > 0)
    for body in _of_body_size(pieces, area, points, floor_height_m):
        if _moves(body, room_m, nearer):
            mask |= body
    return mask


def swaying_people(
    room_m: np.ndarray, frames_m: Sequence[np.ndarray], camera: Camera, floor_height_m: float | None, noise_per_m: float
) -> np.ndarray:
    """(height, width) bool: pieces of ``room_m`` as large as a person that stay in place, but sway unlike furniture.

    room_m, floor_height_m: as in ``resting_people``; frames_m: sampled frames (height, width) float32. A person who
    stands sways by some millimetres, a person who sits breathes. A camera whose readings of furniture drift by as much
    shows nobody.
    """
    points = transform_points(camera.require_pose(), camera.back_project(room_m))
    pieces, area = _upright_pieces(room_m, points, camera, floor_height_m, noise_per_m)
    bodies = _of_body_size(pieces, area, points, floor_height_m)
    swaying = sway(frames_m, room_m, noise_per_m)
    rest = np.isfinite(swaying) & ~np.any([np.zeros(room_m.shape, bool), *bodies], axis=0)
    mask = np.zeros(room_m.shape, bool)
    if not rest.any():
        return mask
    least = SWAYS_TIMES * float(np.percentile(swaying[rest], MOST_OF_ROOM))
    for body in bodies:
        own = swaying[body & np.isfinite(swaying)]
        if own.size and np.median(own) > least:
            mask |= body
    return mask


def sway(frames_m: Sequence[np.ndarray], room_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """(height, width) deviation over time of the mean reading around each pixel, divided by the squared depth.

    The mean over ``PATCH_PX`` leaves little of the sensor's noise, and all of a body's sway. NaN where the room is not
    seen around a pixel in most of the frames.
    """
    square = np.where(room_m > 0, room_m, 1.0).astype(np.float32) ** 2
    gate = SWAY_GATE_M + JUMP_GATE * noise_per_m * square
    means = []
    for frame in frames_m:
        change = frame - room_m
        same = ((frame > 0) & (room_m > 0) & (np.abs(change) < gate)).astype(np.float32)
        share = cv2.blur(same, (PATCH_PX, PATCH_PX))
        mean = cv2.blur(np.where(same > 0, change / square, np.float32(0.0)), (PATCH_PX, PATCH_PX))
        means.append(np.where(share > 0.5, mean / np.maximum(share, 1e-6), np.nan))
    seen = np.isfinite(means).mean(axis=0) > 0.5
    deviation = np.full(room_m.shape, np.nan)
    deviation[seen] = np.nanstd(np.array(means)[:, seen], axis=0)
    return deviation


def _upright_pieces(
    room_m: np.ndarray, points_m: np.ndarray, camera: Camera, floor_height_m: float | None, noise_per_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """(height, width) int32 connected pieces above the floor, from 1, and the area of each, (count + 1,) m2."""
    upright = room_m > 0
    if floor_height_m is not None:  # noise across the floor is a z h, the camera about a metre above it
        upright &= points_m[..., 1] - floor_height_m > SOLE_M + JUMP_GATE * noise_per_m * room_m
    pieces, count = label_components(room_m, upright, jump_limit(noise_per_m, camera.intrinsics.fx))
    pixel_m2 = room_m.astype(np.float64) ** 2 / (camera.intrinsics.fx * camera.intrinsics.fy)
    area = np.bincount(pieces.ravel(), pixel_m2.ravel(), count + 1)
    area[0] = 0.0
    return pieces, area


def _of_body_size(
    pieces: np.ndarray, area_m2: np.ndarray, points_m: np.ndarray, floor_height_m: float | None
) -> list[np.ndarray]:
    """(height, width) bool each: the pieces as large as a person."""
    bodies = [pieces == piece for piece in np.flatnonzero(area_m2 > PERSON.area_m2)]
    return [body for body in bodies if _has_a_body_size(points_m[body], floor_height_m)]


def _without_flicker(nearer_m: np.ndarray) -> np.ndarray:
    """What is in front of the room, without the thin rims that edges flicker by."""
    limb = np.ones((LIMB_PX, LIMB_PX), np.uint8)
    return np.where(cv2.morphologyEx((nearer_m > 0).astype(np.uint8), cv2.MORPH_OPEN, limb) > 0, nearer_m, 0.0)


def _attached_share(
    room_m: np.ndarray, pieces: np.ndarray, count: int, nearer: Sequence[np.ndarray], limit: JumpLimit
) -> np.ndarray:
    """(count + 1,) of each piece's border pixels the share beside which a nearer surface continued without a jump.

    In several of the frames, that is: a person who passes is beside a piece for a moment.
    """
    same = cv2.erode(pieces.astype(np.float32), np.ones((3, 3))) == pieces
    same &= cv2.dilate(pieces.astype(np.float32), np.ones((3, 3))) == pieces
    row, column = np.nonzero(~same & (pieces > 0))
    inside = (row >= BESIDE_PX) & (column >= BESIDE_PX)
    inside &= (row < room_m.shape[0] - BESIDE_PX) & (column < room_m.shape[1] - BESIDE_PX)
    row, column = row[inside], column[inside]
    own = room_m[row, column]
    reach = BESIDE_PX * limit.at(own)
    times = np.zeros(len(row))
    for frame in nearer:
        continued = np.zeros(len(row), dtype=bool)
        for d_row, d_column in ((0, BESIDE_PX), (0, -BESIDE_PX), (BESIDE_PX, 0), (-BESIDE_PX, 0)):
            beside = frame[row + d_row, column + d_column]
            continued |= (beside > 0) & (np.abs(beside - own) < reach)
        times += continued
    often = times >= max(1.0, LEAST_FRAMES * len(nearer))
    border = np.bincount(pieces[row, column], minlength=count + 1)
    return np.bincount(pieces[row, column], often, count + 1) / np.maximum(border, 1)


def _has_a_body_size(points_m: np.ndarray, floor_height_m: float | None) -> bool:
    low, high = np.percentile(points_m, [1, 99], axis=0)
    top_fits = floor_height_m is None or TOP_M[0] < high[1] - floor_height_m < TOP_M[1]
    return bool(
        top_fits
        and PERSON.height_m < high[1] - low[1] < TOP_M[1]
        and np.hypot(high[0] - low[0], high[2] - low[2]) < WIDEST_M
    )


def _moves(body: np.ndarray, room_m: np.ndarray, nearer: Sequence[np.ndarray]) -> bool:
    """Whether something at the body's own depth covers the pixels around it, now these, now those, again and again."""
    if not len(nearer):
        return True
    ring = cv2.dilate(body.astype(np.uint8), np.ones((RING_PX, RING_PX), np.uint8)).astype(bool)
    low, high = np.percentile(room_m[body], [2, 98])
    covered = [(frame[ring] > low - SWAY_M) & (frame[ring] < high + SWAY_M) for frame in nearer]
    frames = np.mean([frame.mean() > SWAYED_SHARE for frame in covered])
    return bool(np.any(covered, axis=0).mean() > LEAST_MOVED_SHARE and frames >= LEAST_FRAMES)
