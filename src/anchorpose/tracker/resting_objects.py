"""Find objects that are at rest part of the time, furniture that is moved or people who keep still, and give them back.

A door that opens, a chair that is pushed: not in one place for long enough to be learnt as the room, and no person.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import cv2
import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.body.skin_points import body_points
from anchorpose.calibration.first_frames import SAME_M
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.background import BackgroundModel, BackgroundSource, RestingLayer, foreground
from anchorpose.isolation.components import JUMP_GATE, label_components
from anchorpose.isolation.empty_room import PERSON_M, in_equipment
from anchorpose.isolation.people import FAINT, PERSON_RADIUS_M
from anchorpose.isolation.scene import FLATTEST, LEAST_M2, Scene, find_pieces
from anchorpose.isolation.still_people import MOST_OF_ROOM, SWAYS_TIMES, WIDEST_M, sway
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.bystanders import ordinary_body, person_evidence, rough_body
from anchorpose.tracker.sighting import ONE_PERSON

LEAST_S: Final = 1.0  # that an object rests: a person who turns back stands still for half a second
LEAST_SAMPLES: Final = 6  # that show it at rest: its sway is measured on them
SETTLING: Final = 2  # samples in which what was pushed or swung still moves by less than the noise
WHOLE: Final = 0.8  # of the connected foreground: at rest; of the object: not there all the time
SHOWN: Final = 33  # percent of the object's pixels: people may hide the others
OFTEN: Final = 67  # percentile of the samples: in a third of them nobody touches the object
PLANE_FITS: Final = 3  # each to the pixels that the one before fits best
PLANE_SHARE: Final = 95  # percent of the pixels: the others are on the edges and on handles
LOW_M: Final = 1.0  # above the floor: stools and wheelchairs; heads of people on a chair are higher
FOOT_M: Final = 0.15  # above the floor: what a removed floor takes of wheels; people who lie on a bed are higher
HEAD_M2: Final = 0.02  # half a head: of a person in dark clothes it is all that is read above the legs
LEGS_M2: Final = 0.3  # both legs of an adult from before; below it the trunk is up to two radii behind the piece
MOST_COVERED: Final = 0.3  # of the columns: a person's legs continue above, or something hides the person there
ABOVE_PX: Final = range(3, 7)  # rows above the object: beyond the edge's ramp
RIM_PX: Final = 2  # around an object: its edge flickers by so much


class Recorded(NamedTuple):
    """Sampled frames of one camera (n, height, width) float32 in order, their times (n,) and foreground (bool)."""

    frames_m: np.ndarray
    time_s: np.ndarray
    nearer: np.ndarray

    def reversed(self) -> Recorded:
        """From the last sample to the first, in a time that increases."""
        return Recorded(self.frames_m[::-1], -self.time_s[::-1], self.nearer[::-1])


@dataclass(frozen=True, slots=True, eq=False)
class RestingObject:
    """A piece (height, width) bool that keeps its place in some samples (k,) int; flat: as no person is."""

    piece: np.ndarray
    layer: RestingLayer
    samples: np.ndarray
    flat: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """What rests until the last of n samples, per pixel (height, width).

    depth_m float32, 0 = nothing; since int: the first sample that read it and after which nothing was read behind it;
    agrees (n, height, width) bool: the samples from then on that read it.
    """

    depth_m: np.ndarray
    since: np.ndarray
    agrees: np.ndarray


def resting_objects(
    frames_m: Sequence[np.ndarray],
    time_s: Sequence[float],
    model: BackgroundModel,
    camera: Camera,
    floor_height_m: float | None,
) -> list[RestingObject]:
    """Whole foreground pieces that do not sway and rest from the first sample or until the last one.

    frames_m: sampled frames (height, width) float32 with their times (n,), in order. Objects are flat, or low with
    nothing above: those may still be people on the floor, which a body shows. Where no floor is seen (floor_height_m
    None) only flat ones are found.
    """
    times = np.asarray(time_s, dtype=np.float64)
    if len(times) < 2 * LEAST_SAMPLES or times[-1] - times[0] < 2.0 * LEAST_S:
        return []
    frames = np.stack([model.sensor.without_ramps(frame) for frame in frames_m])
    forward = Recorded(frames, times, np.stack([foreground(frame, model) for frame in frames]))
    late = list(_until_the_end(forward, model, camera, floor_height_m))
    early = _until_the_end(forward.reversed(), model, camera, floor_height_m)
    return late + [_turned(one, len(times)) for one in early]


def _turned(one: RestingObject, count: int) -> RestingObject:
    """What was found from the last sample to the first, in the recording's time."""
    layer = RestingLayer(one.layer.depth_m, one.layer.sigma_m, -one.layer.until_s, -one.layer.from_s)
    return RestingObject(one.piece, layer, np.sort(count - 1 - one.samples), one.flat)


def _until_the_end(
    seen: Recorded, model: BackgroundModel, camera: Camera, floor_height_m: float | None
) -> Iterator[RestingObject]:
    """Those that rest until the last sample."""
    still = _what_is_still(seen, model.sensor.noise_per_m)
    pieces, count = label_components(still.depth_m, still.depth_m > 0, model.sensor.jump_limit)
    area = np.bincount(
        pieces.ravel(), (still.depth_m.astype(np.float64) / model.sensor.focal_px).ravel() ** 2, count + 1
    )
    for number in np.flatnonzero(area[1:] > FAINT.area_m2) + 1:
        piece = pieces == number
        samples = _samples_of(piece, still, seen.time_s)
        came = (still.since[piece] >= LEAST_SAMPLES / 2).mean() if len(samples) else 0.0
        if came < WHOLE:
            continue
        flat = bool(area[number] > LEAST_M2 and _is_flat(piece, still.depth_m, camera))
        if not flat and not _is_low_and_complete(piece, still.depth_m, seen, samples, camera, floor_height_m):
            continue
        if _sway_ratio(piece, still, seen, samples, model) > (SWAYS_TIMES if flat else 1.0):
            continue
        if _whole_share(piece, still, seen, samples, model) > WHOLE:
            yield RestingObject(piece, _layer(piece, still, seen, samples, model), samples, flat)


def _what_is_still(seen: Recorded, noise_per_m: float) -> _Still:
    """The farthest surface of the last second, where nothing farther is read after it was first read."""
    frames, times = seen.frames_m, seen.time_s
    last = frames[min(int(np.searchsorted(times, times[-1] - LEAST_S)), len(frames) - LEAST_SAMPLES) :]
    far = last.max(axis=0)
    same = SAME_M + JUMP_GATE * noise_per_m * far**2
    close = (last > 0) & (last > far - 2.0 * same)
    depth = np.where(close, last, 0.0).sum(axis=0) / np.maximum(close.sum(axis=0), 1)
    behind = frames > depth + same
    broken = np.where(behind.any(axis=0), len(frames) - np.argmax(behind[::-1], axis=0), 0)
    agrees = (frames > 0) & (np.abs(frames - depth) < same)
    agrees &= np.arange(len(frames))[:, None, None] >= broken
    count = agrees.sum(axis=0)
    kept = (count >= LEAST_SAMPLES) & (2 * (agrees & seen.nearer).sum(axis=0) > count)
    return _Still(np.where(kept, depth, 0.0).astype(np.float32), np.argmax(agrees, axis=0), agrees)


def _samples_of(piece: np.ndarray, still: _Still, time_s: np.ndarray) -> np.ndarray:
    """(k,) the samples that show most of a piece at rest, without those in which it settles; none if too few."""
    since = np.percentile(still.since[piece], SHOWN)
    samples = np.flatnonzero(still.agrees[:, piece].mean(axis=1) > SHOWN / 100.0)
    samples = samples[samples >= since]
    enough = len(samples) >= LEAST_SAMPLES and time_s[samples[-1]] - time_s[samples[0]] >= LEAST_S
    return samples[SETTLING:] if enough else samples[:0]


def _sway_ratio(piece: np.ndarray, still: _Still, seen: Recorded, samples: np.ndarray, model: BackgroundModel) -> float:
    """How many times as much as those of most of the room the readings of a piece change over time; inf if unknown."""
    there = np.where(still.depth_m > 0, still.depth_m, model.depth_m)
    swaying = sway(seen.frames_m[samples], there, model.sensor.noise_per_m)
    room, own = swaying[still.depth_m <= 0], swaying[piece]
    room, own = room[np.isfinite(room)], own[np.isfinite(own)]
    if not room.size or not own.size:
        return float("inf")
    return float(np.median(own) / max(float(np.percentile(room, MOST_OF_ROOM)), 1e-9))


def _is_flat(piece: np.ndarray, depth_m: np.ndarray, camera: Camera) -> bool:
    """Whether most of a piece is a plane within ``FLATTEST`` of its width; people were 0.05 to 0.15 of theirs off."""
    points = camera.back_project(depth_m)[piece].astype(np.float64)
    kept = points
    for _ in range(PLANE_FITS):
        middle = kept.mean(axis=0)
        spread, axes = np.linalg.eigh((kept - middle).T @ (kept - middle) / len(kept))
        off = np.abs((points - middle) @ axes[:, 0])
        limit = np.percentile(off, PLANE_SHARE)
        kept = points[off <= limit]
    width = np.sqrt(12.0 * spread[1])  # a width w has variance w^2 / 12
    return bool(np.sqrt((off[off <= limit] ** 2).mean()) < FLATTEST * width)


def _is_low_and_complete(
    piece: np.ndarray,
    depth_m: np.ndarray,
    seen: Recorded,
    samples: np.ndarray,
    camera: Camera,
    floor_height_m: float | None,
) -> bool:
    """Whether a piece stands on the floor, is low and short, and no part of a person who is higher or out of view.

    A person who lies is long, or on a bed; above a person's legs is a trunk, or what hides it.
    """
    if floor_height_m is None or np.concatenate([piece[[0, -1]].ravel(), piece[:, [0, -1]].ravel()]).any():
        return False
    points = transform_points(camera.require_pose(), camera.back_project(np.where(piece, depth_m, np.float32(0.0))))
    own = points[piece]
    low, high = np.percentile(own, [1, 99], axis=0)
    on_floor = low[1] - floor_height_m < FOOT_M and high[1] - floor_height_m < LOW_M
    if not on_floor or np.hypot(high[0] - low[0], high[2] - low[2]) > WIDEST_M:
        return False
    covered = [_covered_share(piece, depth_m, seen.frames_m[k]) for k in samples]
    above = [_area_above(piece, own, seen.frames_m[k], seen.nearer[k], camera) for k in samples]
    return bool(np.median(covered) < MOST_COVERED and np.median(above) < HEAD_M2)


def _covered_share(piece: np.ndarray, depth_m: np.ndarray, frame_m: np.ndarray) -> float:
    """Share of the columns of a piece above which the image ends or something as near is read."""
    column = np.flatnonzero(piece.any(axis=0))
    top = piece.argmax(axis=0)[column]
    above = np.stack([frame_m[np.maximum(top - up, 0), column] for up in ABOVE_PX])
    limit = depth_m[top, column] + SAME_M
    covered = (above > 0).any(axis=0) & (above.max(axis=0) < limit)
    return float((covered | (top < max(ABOVE_PX))).mean())


def _area_above(piece: np.ndarray, own_m: np.ndarray, frame_m: np.ndarray, nearer: np.ndarray, camera: Camera) -> float:
    """Square metres of other foreground, higher than a piece with points own_m (n, 3), where a person's trunk is."""
    rim = cv2.dilate(piece.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) > 0
    others = nearer & ~rim
    points = transform_points(camera.require_pose(), camera.back_project(np.where(others, frame_m, np.float32(0.0))))
    pixel_m2 = frame_m.astype(np.float64) ** 2 / (camera.intrinsics.fx * camera.intrinsics.fy)
    legs_alone = pixel_m2[piece].sum() < LEGS_M2
    reach_m = PERSON_RADIUS_M * (2.0 if legs_alone else 1.0)
    (low_x, _, low_z), (high_x, top, high_z) = np.percentile(own_m, [1, 99], axis=0)
    x, y, z = np.moveaxis(points, -1, 0)
    near = (x > low_x - reach_m) & (x < high_x + reach_m) & (z > low_z - reach_m) & (z < high_z + reach_m)
    return float(pixel_m2[others & near & (y > top)].sum())


def _whole_share(
    piece: np.ndarray, still: _Still, seen: Recorded, samples: np.ndarray, model: BackgroundModel
) -> float:
    """Of the connected foreground that a piece belongs to, the share at rest, in the third of the samples with most."""
    shares = []
    for k in samples:
        pieces, _ = label_components(seen.frames_m[k], seen.nearer[k], model.sensor.jump_limit)
        inside = pieces[piece & (pieces > 0)]
        if inside.size:
            shares.append(still.agrees[k][pieces == np.bincount(inside).argmax()].mean())
    return float(np.percentile(shares, OFTEN)) if shares else 0.0


def _layer(
    piece: np.ndarray, still: _Still, seen: Recorded, samples: np.ndarray, model: BackgroundModel
) -> RestingLayer:
    """A piece with its rim from its first sample on; the deviation is that of its own readings, with the z^2 law."""
    readings = np.where(still.agrees[samples][:, piece], seen.frames_m[samples][:, piece], np.nan)
    read = np.isfinite(readings).any(axis=0)
    factor = np.nanstd(readings[:, read], axis=0) / still.depth_m[piece][read] ** 2
    sigma_per_m = max(float(np.median(factor)), model.sensor.noise_per_m)
    own = np.where(piece, still.depth_m, np.float32(0.0))
    depth = np.where(piece, own, cv2.dilate(own, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)))
    return RestingLayer(depth, np.float32(sigma_per_m) * depth**2, float(seen.time_s[samples[0]]), np.inf)


CHECKED: Final = 3  # samples with a body each
BELOW_FLOOR_M: Final = 0.3  # of a rough body's lowest joint; a body that explains a stool has it at a metre
MOST_SHARED: Final = 0.1  # of an object, within the equipment or about the place that the user named


def with_resting_objects(
    scene: Scene,
    number: int,
    samples: Sequence[FrameSet],
    floor_height_m: float | None,
    equipment: EquipmentModel | None,
    named_xz_m: tuple[float, float] | None,
) -> Scene:
    """The scene of the camera with a number, with the objects in its room that are moved, each while it rests.

    Only in a room that was learnt from the recording: from a picture of the empty room everything stands out.
    named_xz_m: where the user named the patient, who may keep still.
    """
    model, camera = scene.background, scene.camera
    if model.source is not BackgroundSource.RECORDING:
        return scene
    seen = [(depth, sample.time_s) for sample in samples if (depth := sample.depths_m[number]) is not None]
    frames, times = [depth for depth, _ in seen], [time_s for _, time_s in seen]
    found = [
        one
        for one in resting_objects(frames, times, model, camera, floor_height_m)
        if not _is_named(one, scene, named_xz_m)
        and not _is_in_equipment(one, scene, equipment, floor_height_m)
        and (one.flat or not _is_person(one, frames, scene, floor_height_m))
    ]
    return replace(scene, background=replace(model, layers=tuple(one.layer for one in found)))


def _is_named(one: RestingObject, scene: Scene, named_xz_m: tuple[float, float] | None) -> bool:
    if named_xz_m is None:
        return False
    camera = scene.camera
    points = transform_points(camera.require_pose(), camera.back_project(one.layer.depth_m))[one.piece]
    return bool((np.linalg.norm(points[:, [0, 2]] - named_xz_m, axis=1) < PERSON_M).mean() > MOST_SHARED)


def _is_in_equipment(
    one: RestingObject, scene: Scene, equipment: EquipmentModel | None, floor_height_m: float | None
) -> bool:
    if equipment is None:
        return False
    inside = in_equipment(
        one.layer.depth_m, scene.camera, equipment, floor_height_m, scene.background.sensor.noise_per_m
    )
    return bool(inside[one.piece].mean() > MOST_SHARED)


def _is_person(one: RestingObject, frames_m: Sequence[np.ndarray], scene: Scene, floor_height_m: float | None) -> bool:
    """Whether a body on the floor explains an object in most of some samples, or too little is seen to find one."""
    chosen = [int(one.samples[k]) for k in thin(len(one.samples), CHECKED)]
    return 2 * sum(_body_explains(one, frames_m[k], scene, floor_height_m) for k in chosen) > len(chosen)


def _body_explains(one: RestingObject, frame_m: np.ndarray, scene: Scene, floor_height_m: float | None) -> bool:
    """A body that explains a stool has its legs below the floor."""
    pieces = find_pieces(frame_m, scene)
    labels = np.where(one.piece & (pieces.depth_m > 0), np.uint8(PixelLabel.PATIENT), pieces.labels)
    evidence = person_evidence((View(pieces.depth_m, labels),), (scene.camera,), PixelLabel.PATIENT)
    body = ordinary_body(body_points())
    found = rough_body(body, evidence)
    if found is None:
        return True
    lowest_m = float(body.joints(found.belief.pose)[:, 1].min())
    on_floor = floor_height_m is None or lowest_m > floor_height_m - BELOW_FLOOR_M
    return found.explained >= ONE_PERSON and on_floor
