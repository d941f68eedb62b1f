"""Find depth images that do not show the camera's room, because the camera was covered or knocked over for a moment.

Such an image has readings and surfaces, but it differs from usual images: either hardly any reading shows the room, or
few readings show it and many lie behind the room's surfaces.
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
# maximum difference between the room and a reading of the room: SAME_M (metres) or SAME_SIGMAS standard deviations,
# whichever is larger. SAME_M allows for an error of the learnt room by one step between depth values
SAME_M, SAME_SIGMAS = 0.05, 6.0
FRAMES_NEEDED: Final = 3  # minimum number of frames from which ``usual_share`` is computed
# minimum share of the image in which the room's depth is known; with less, the images are not tested. For example,
# recording software may have removed the room, except some objects, from the images
LEAST_KNOWN: Final = 0.2
LEAST_USUAL: Final = 0.2  # minimum ``usual_share`` of a camera; the images of cameras with less are not tested
# the camera counts as covered if the share of pixels that show the room is less than this factor times ``usual_share``.
# If a passer-by is near the camera, half of the usual share still shows the room
COVERED: Final = 0.05
# an image counts as an image of another place if the share of pixels that show the room is less than this factor times
# ``usual_share``, and many readings lie behind the room
MOVED: Final = 0.6
# maximum share of the room's pixels with readings behind the room; walking people cause 0.002, moved furniture 0.04
MOST_BEHIND: Final = 0.05


def usual_share(room_m: np.ndarray, sigma_m: np.ndarray, frames_m: Sequence[np.ndarray]) -> float:
    """Return the share of pixels that show the room, among the pixels whose room depth is known: the median over
    frames. Return 0 if there are too few frames or known pixels.

    frames_m: depth images (height, width) float32. room_m, sigma_m (height, width) float32: as in ``BackgroundModel``.
    """
    if len(frames_m) < FRAMES_NEEDED or np.count_nonzero(room_m) < LEAST_KNOWN * room_m.size:
        return 0.0
    return float(np.median([_shares(frame, room_m, sigma_m)[0] for frame in frames_m]))


def is_of_other_place(depth_m: np.ndarray, model: BackgroundModel) -> bool:
    """Return whether a depth image (height, width) float32 shows another place than the camera's room.

    Return False if the camera's ``usual_share`` is too small for this test, for example because a recorder has removed
    the room.
    """
    if model.usual_share < LEAST_USUAL:
        return False
    same, behind = _shares(depth_m, model.depth_m, model.sigma_m)
    if same < COVERED * model.usual_share:
        return True
    return same < MOVED * model.usual_share and behind > MOST_BEHIND


def without_other_places(frame_set: FrameSet, scenes: Sequence[Scene]) -> FrameSet:
    """Return the frame set without images of another place; each image that is left out is noted as a problem. scenes:
    one per camera.
    """
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
    """Return two shares of the pixels at which the room's depth is known: the share with a reading that shows the room,
    and the share with a reading behind the room.
    """
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
