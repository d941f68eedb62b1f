"""Find objects that rest for a part of the recording (moved furniture, people who keep still), and add the furniture to
the room.

An opened door or a pushed chair does not stay in one place long enough to be learnt as a part of the room. But such an
object must not be taken for a person either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import cv2
import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.calibration.first_frames import SAME_M
from anchorpose.camera import Camera
from anchorpose.descriptor.learnt import described, nearest_rays
from anchorpose.descriptor.people import LEAST_AREA_M2
from anchorpose.isolation.background import BackgroundModel, BackgroundSource, RestingLayer, foreground
from anchorpose.isolation.components import JUMP_GATE, label_components
from anchorpose.isolation.scene import Scene
from anchorpose.recording.recording import FrameSet

# s, minimum time at rest of an object; it excludes people who turn round to walk back, since they stand still for half
# a second
LEAST_S: Final = 1.0
LEAST_SAMPLES: Final = 6  # minimum number of samples that show an object at rest, to measure the spread of its readings
# number of sampled frames that are left out after an object came to rest, since the object may still move a little
SETTLING: Final = 2
# 0 to 1, minimum of two shares for an object to count as resting: the share of the connected foreground around the
# object that is at rest, and the share of the object's pixels that came to rest only after the first samples
WHOLE: Final = 0.8
SHOWN: Final = 33  # minimum percentage of an object's pixels that a used sample shows; people may hide the rest
# percentile, over the sampled frames that show the object at rest, of the share of the object's connected foreground
# that is at rest (``_whole_share``); with this percentile, an object counts as resting even if people touch it in up to
# two thirds of the frames
OFTEN: Final = 67
RIM_PX: Final = 2  # pixels, width of the rim around an object; within it, the object's edge flickers


class Recorded(NamedTuple):
    """Sampled frames of one camera, in order."""

    frames_m: np.ndarray  # (n, height, width) float32 m, depth images
    time_s: np.ndarray  # (n,) s, time of each sampled frame
    nearer: np.ndarray  # (n, height, width) bool, the pixels of the foreground

    def reversed(self) -> Recorded:
        """Return the samples in reverse order, with negated times, so that time increases again."""
        return Recorded(self.frames_m[::-1], -self.time_s[::-1], self.nearer[::-1])


@dataclass(frozen=True, slots=True, eq=False)
class RestingObject:
    """An object that keeps its place in some of the sampled frames."""

    piece: np.ndarray  # (height, width) bool, the object's pixels
    layer: RestingLayer
    samples: np.ndarray  # (k,) int, numbers of the sampled frames that show the object at rest


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """For each pixel, the surface that stays at rest until the last of n sampled frames."""

    depth_m: np.ndarray  # (height, width) float32 m, depth of the surface at rest; 0 at pixels without such a surface
    # (height, width) int, first sample that reads this surface; no later sample reads anything behind it
    since: np.ndarray
    agrees: np.ndarray  # (n, height, width) bool, whether a sample from ``since`` on reads the surface


def resting_objects(
    frames_m: Sequence[np.ndarray], time_s: Sequence[float], model: BackgroundModel
) -> list[RestingObject]:
    """Return the objects, people included, that rest from the first sample on or until the last sample.

    frames_m: n sampled frames (height, width) float32, in order; time_s: their n times.
    """
    times = np.asarray(time_s, dtype=np.float64)
    if len(times) < 2 * LEAST_SAMPLES or times[-1] - times[0] < 2.0 * LEAST_S:
        return []
    frames = np.stack([model.sensor.without_ramps(frame) for frame in frames_m])
    forward = Recorded(frames, times, np.stack([foreground(frame, model) for frame in frames]))
    late = list(_until_the_end(forward, model))
    early = _until_the_end(forward.reversed(), model)
    return late + [_turned(one, len(times)) for one in early]


def _turned(one: RestingObject, count: int) -> RestingObject:
    """Convert an object that was found in the samples in reverse order: return it with the true times, and with the
    numbers of its samples in the recording's order.
    """
    layer = RestingLayer(one.layer.depth_m, one.layer.sigma_m, -one.layer.until_s, -one.layer.from_s)
    return RestingObject(one.piece, layer, np.sort(count - 1 - one.samples))


def _until_the_end(seen: Recorded, model: BackgroundModel) -> Iterator[RestingObject]:
    """Yield the objects that rest until the last sample."""
    still = _what_is_still(seen, model.sensor.noise_per_m)
    pieces, count = label_components(still.depth_m, still.depth_m > 0, model.sensor.jump_limit)
    area = np.bincount(
        pieces.ravel(), (still.depth_m.astype(np.float64) / model.sensor.focal_px).ravel() ** 2, count + 1
    )
    for number in np.flatnonzero(area[1:] > LEAST_AREA_M2) + 1:
        piece = pieces == number
        samples = _samples_of(piece, still, seen.time_s)
        came = (still.since[piece] >= LEAST_SAMPLES / 2).mean() if len(samples) else 0.0
        if came < WHOLE:
            continue
        if _whole_share(piece, still, seen, samples, model) > WHOLE:
            yield RestingObject(piece, _layer(piece, still, seen, samples, model), samples)


def _what_is_still(seen: Recorded, noise_per_m: float) -> _Still:
    """Return, for each pixel, the surface that is at rest until the last sample. The depth of this surface is the mean
    of the farthest readings in the last ``LEAST_S`` seconds (in at least ``LEAST_SAMPLES`` samples).
    """
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
    """Return the numbers (k,) of the samples that show enough of an object (its pixels: ``piece``) at rest, without the
    first ``SETTLING`` of these samples; an empty array if too few samples show it, or for too short a time.
    """
    since = np.percentile(still.since[piece], SHOWN)
    samples = np.flatnonzero(still.agrees[:, piece].mean(axis=1) > SHOWN / 100.0)
    samples = samples[samples >= since]
    enough = len(samples) >= LEAST_SAMPLES and time_s[samples[-1]] - time_s[samples[0]] >= LEAST_S
    return samples[SETTLING:] if enough else samples[:0]


def _whole_share(
    piece: np.ndarray, still: _Still, seen: Recorded, samples: np.ndarray, model: BackgroundModel
) -> float:
    """Return how much of the connected foreground that contains an object (its pixels: ``piece``) is at rest, 0 to 1.
    This share is measured in each frame of ``samples``, which show the object at rest; the percentile ``OFTEN`` of the
    shares is returned.
    """
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
    """Make the ``RestingLayer`` (depth and its standard deviation per pixel) of an object (``piece``) and its rim, the
    pixels just around the object. The layer begins at the time of the first of ``samples``. The standard deviation of
    the object's readings is measured, and is assumed to grow with the square of the depth.
    """
    readings = np.where(still.agrees[samples][:, piece], seen.frames_m[samples][:, piece], np.nan)
    read = np.isfinite(readings).any(axis=0)
    factor = np.nanstd(readings[:, read], axis=0) / still.depth_m[piece][read] ** 2
    sigma_per_m = max(float(np.median(factor)), model.sensor.noise_per_m)
    own = np.where(piece, still.depth_m, np.float32(0.0))
    depth = np.where(piece, own, cv2.dilate(own, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)))
    return RestingLayer(depth, np.float32(sigma_per_m) * depth**2, float(seen.time_s[samples[0]]), np.inf)


CHECKED: Final = 3  # number of an object's samples that the descriptor examines
MOST_PERSON: Final = 0.2  # maximum share of an object's pixels that may look like a person; chairs have up to 0.1


def with_resting_objects(scene: Scene, number: int, samples: Sequence[FrameSet]) -> Scene:
    """Add moved objects to the room of one camera's scene, each for the time that it rests.

    Objects are added only if the room was learnt from the recording. If the recording has an image of the empty room,
    every object that is not in this image stays foreground.
    """
    model, camera = scene.background, scene.camera
    if model.source is not BackgroundSource.RECORDING:
        return scene
    seen = [(depth, sample.time_s) for sample in samples if (depth := sample.depths_m[number]) is not None]
    frames, times = [depth for depth, _ in seen], [time_s for _, time_s in seen]
    found = [one for one in resting_objects(frames, times, model) if _person_share(one, frames, camera) < MOST_PERSON]
    return replace(scene, background=replace(model, layers=tuple(one.layer for one in found)))


def _person_share(one: RestingObject, frames_m: Sequence[np.ndarray], camera: Camera) -> float:
    """Return the share of an object's pixels that the learnt descriptor takes for a person: the median over ``CHECKED``
    frames.
    """
    chosen = [int(one.samples[k]) for k in thin(len(one.samples), CHECKED)]
    row, column, _ = nearest_rays(camera)
    return float(
        np.median([(described(frames_m[k], camera).person[row, column] >= 0.5)[one.piece].mean() for k in chosen])
    )
