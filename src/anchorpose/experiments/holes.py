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

HOLES_KEY = 7  # a stream of its own beside those that recordings are drawn from


def draw_hole_frames(frames: int, share: float, seed: int, starts: Sequence[int]) -> np.ndarray:
    """(frames,) bool: which frames lose data. Never those that tracking starts in, whose pose is given."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(HOLES_KEY,)))
    chosen: np.ndarray = rng.random(frames) < share
    chosen[list(starts)] = False
    return chosen


def cut_holes(recording: Recording, out: Path, centre_m: np.ndarray, chosen: np.ndarray, radius_m: float) -> None:
    """A copy of the recording folder at ``out`` without the readings nearer than ``radius_m`` to the body's centre.

    centre_m (t, 3): in the world that the recording's cameras have poses in; NaN where the body was not seen: such a
    frame stays as it is. chosen (t,) bool. Pictures that lose nothing are linked, not copied.
    """
    shutil.copytree(recording.folder, out, ignore=shutil.ignore_patterns("depth"))
    for camera, stream in zip(recording.cameras, recording.streams, strict=True):
        folder = out / camera.name / "depth"
        folder.mkdir()
        for position, file in enumerate(stream.files):
            if not chosen[position] or np.isnan(centre_m[position]).any():
                (folder / file.name).symlink_to(file.resolve())
                continue
            stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            if stored is None:
                raise InputError(file, "cannot be decoded", "record or export it again")
            hole = within_hole(file, camera, centre_m[position], radius_m)
            cv2.imwrite(str(folder / file.name), np.where(hole, 0, stored).astype(stored.dtype))


def within_hole(file: Path, camera: Camera, centre_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(height, width) bool: pixels of a depth picture whose point lies within the radius of a world point."""
    depth = read_depth_picture(file, camera).depth_m
    if depth is None:
        return np.zeros((camera.height, camera.width), bool)
    points = transform_points(camera.require_pose(), camera.back_project(depth))
    inside: np.ndarray = np.linalg.norm(points - centre_m, axis=2) < radius_m
    return inside & (depth > 0)
