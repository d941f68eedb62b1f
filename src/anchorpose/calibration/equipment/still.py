"""What stays in place in one camera's pictures: the evidence the equipment's pose is found from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.calibration.floor import FloorPlane
from anchorpose.camera import Camera

STAYS_SHARE: Final = 0.3  # of the frames: what is farthest so often is the room, though people stand before it
SAME_M, SAME_SIGMAS = 0.02, 3.0  # readings of one surface differ by less


@dataclass(frozen=True, slots=True, eq=False)
class StillView:
    """One camera's evidence.

    still_m (height, width) float32: what stays, 0 = unknown; frames_m (n, height, width) float32, 0 = no reading: the
    pictures it was made from (the empty room's alone, where there is one).
    """

    camera: Camera
    still_m: np.ndarray
    frames_m: np.ndarray
    noise_per_m: float
    floor: FloorPlane


def see_still(
    camera: Camera, frames_m: Sequence[np.ndarray], background_m: np.ndarray | None, noise: float, floor: FloorPlane
) -> StillView:
    """The empty room's picture where there is one, else what stays in pictures spread over the recording."""
    stack = np.stack(frames_m if background_m is None else [background_m]).astype(np.float32)
    return StillView(camera, what_stays(stack, noise), stack, noise, floor)


def what_stays(frames_m: np.ndarray, noise_per_m: float) -> np.ndarray:
    """(height, width) float32: per pixel, the farthest surface that is read in ``STAYS_SHARE`` of the frames.

    frames_m (n, height, width), 0 = no reading. People stand before the room, never behind it; a bar's edge pixel,
    which reads now the bar, now what is behind, counts as bar while it does so most of the time. 0 where less than that
    share of the frames has a reading.
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
