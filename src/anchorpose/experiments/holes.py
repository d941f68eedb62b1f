"""The paper's transient occlusions: data removed about the body's centre in randomly selected frames (Section V)."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.picture import read_depth_picture
from anchorpose.recording.recording import Recording

ON_BODY_M = 0.3  # from the middle of a body to its skin; farther off there is no body
HOLES_KEY = 7  # a stream of its own beside those that recordings are drawn from


def draw_hole_frames(frames: int, share: float, seed: int, starts: Sequence[int]) -> np.ndarray:
    """(frames,) bool: which frames lose data. Never those that tracking starts in, whose pose is given."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(HOLES_KEY,)))
    chosen: np.ndarray = rng.random(frames) < share
    chosen[list(starts)] = False
    return chosen


def cut_holes(recording: Recording, out: Path, centre_m: np.ndarray, chosen: np.ndarray, radius_m: float) -> np.ndarray:
    """A copy of the recording folder at ``out`` without the readings nearer than ``radius_m`` to the body's centre.

    centre_m (t, 3): the mean of what is seen of the body, in the world that the recording's camera has a pose in, NaN
    where it was not seen: such a frame stays as it is. That mean lies inside the body; the hole is about the reading
    nearest to it, so that its radius is what is cut from the skin. chosen (t,) bool. Pictures that lose nothing are
    linked, not copied. Returns (t,) bool: the frames that lost readings.
    Raises InputError for a recording of several cameras: their frames would have to be paired first.
    """
    if len(recording.cameras) != 1:
        raise InputError(recording.folder, "has several cameras", "holes are cut in recordings of one camera only")
    camera, stream = recording.cameras[0], recording.streams[0]
    shutil.copytree(recording.folder, out, ignore=shutil.ignore_patterns("depth"))
    folder, cut = out / camera.name / "depth", np.zeros(len(stream.files), bool)
    folder.mkdir()
    for position, file in enumerate(stream.files):
        stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if chosen[position] else None
        hole = None if stored is None else within_hole(file, camera, centre_m[position], radius_m)
        if stored is None or hole is None or not hole.any():
            (folder / file.name).symlink_to(file.resolve())
            continue
        cv2.imwrite(str(folder / file.name), np.where(hole, 0, stored).astype(stored.dtype))
        cut[position] = True
    return cut


def within_hole(file: Path, camera: Camera, centre_m: np.ndarray, radius_m: float) -> np.ndarray | None:
    """(height, width) bool: pixels of a depth picture within the radius of the reading nearest to a world point.

    None where there is no such reading within reach of a body.
    """
    depth = read_depth_picture(file, camera).depth_m
    if depth is None or np.isnan(centre_m).any():
        return None
    points = transform_points(camera.require_pose(), camera.back_project(depth))
    away = np.where(depth > 0, np.linalg.norm(points - centre_m, axis=2), np.inf)
    if away.min() > ON_BODY_M:
        return None
    middle = points.reshape(-1, 3)[np.argmin(away)]
    inside: np.ndarray = np.linalg.norm(points - middle, axis=2) < radius_m
    return inside & (depth > 0)
