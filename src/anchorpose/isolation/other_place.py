"""Find depth images that do not show the camera's room, because the camera was covered or knocked over for a moment.

Such an image has readings and surfaces, but it lacks two properties of usual images: no reading lies behind the room's
surfaces, and people never hide all of the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.scene import Scene
from anchorpose.recording.recording import FrameSet

SENTENCE: Final = "shows another place than usual: it was covered, or moved, for a moment"
STEP_PX: Final = 4  # pixels; every fourth pixel of every fourth row is tested
# maximum difference between the room and a reading of it: SAME_M, since the learnt room may be one step wrong, plus
# sigmas
SAME_M, SAME_SIGMAS = 0.05, 6.0
FRAMES_NEEDED: Final = 3  # minimum number of frames from which the room's usual share is computed
# minimum share of the image where the room is known; recorders that remove the room leave at most some objects
LEAST_KNOWN: Final = 0.2
LEAST_USUAL: Final = 0.2  # minimum share of the room's pixels that a camera usually sees; otherwise it is not tested
# factor on the usual share, below which the camera is covered; a passer-by near the camera leaves half of the share
COVERED: Final = 0.05
# factor on the usual share; with less, an image with many readings behind the room shows another place
MOVED: Final = 0.6
# minimum share of the room's pixels with readings behind the room; 0.002 if people walk, 0.04 if furniture is moved
MOST_BEHIND: Final = 0.05


def usual_share(room_m: np.ndarray, sigma_m: np.ndarray, frames_m: Sequence[np.ndarray]) -> float:
    """Return which share of the room's pixels read the room, the median over frames (height, width) float32; 0 if
    unknown.

    room_m, sigma_m (height, width) float32: as in ``BackgroundModel``.
    """
    if len(frames_m) < FRAMES_NEEDED or np.count_nonzero(room_m) < LEAST_KNOWN * room_m.size:
        return 0.0
    return float(np.median([_shares(frame, room_m, sigma_m)[0] for frame in frames_m]))


def is_of_other_place(depth_m: np.ndarray, model: BackgroundModel) -> bool:
    """Return whether a depth image (height, width) float32 shows another place than the camera's room.

    It is False if too little of the room is known, for example if a recorder has removed it.
    """
    if model.usual_share < LEAST_USUAL:
        return False
    same, behind = _shares(depth_m, model.depth_m, model.sigma_m)
    if same < COVERED * model.usual_share:
        return True
    return same < MOVED * model.usual_share and behind > MOST_BEHIND


def without_other_places(frame_set: FrameSet, scenes: Sequence[Scene]) -> FrameSet:
    """Remove images of another place from the frame set, and report each as a problem; scenes: one per camera."""
    other = [
        depth is not None and is_of_other_place(depth, scene.background)
        for depth, scene in zip(frame_set.depths_m, scenes, strict=True)
    ]
    if not any(other):
        return frame_set
    sentences = (f"camera {scene.camera.name} {SENTENCE}" for scene, out in zip(scenes, other, strict=True) if out)
    return replace(
        frame_set,
        depths_m=tuple(None if out else depth for depth, out in zip(frame_set.depths_m, other, strict=True)),
        taken_s=tuple(None if out else time_s for time_s, out in zip(frame_set.taken_s, other, strict=False)),
        problems=(*frame_set.problems, *sentences),
    )


def _shares(depth_m: np.ndarray, room_m: np.ndarray, sigma_m: np.ndarray) -> tuple[float, float]:
    """Return the shares of the room's known pixels that read the room, and that read a depth behind it."""
    depth, room, sigma = (image[::STEP_PX, ::STEP_PX] for image in (depth_m, room_m, sigma_m))
    known = room > 0
    count = int(np.count_nonzero(known))
    if not count:
        return 0.0, 0.0
    beyond = (depth - room)[known]
    gate = np.maximum(SAME_M, SAME_SIGMAS * sigma)[known]
    read = depth[known] > 0
    same, behind = read & (np.abs(beyond) <= gate), read & (beyond > gate)
    return float(np.count_nonzero(same)) / count, float(np.count_nonzero(behind)) / count
