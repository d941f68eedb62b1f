"""Provide the recordings of an experiment, and cut holes into their depth images.

Recordings are simulated, or the user's own recordings with another tracker's skeleton as reference. Holes are the
paper's transient occlusions: depth readings around the body's centre are removed in random frames (Section VI).
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.depth_image import read_depth_image
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import read_arrays, read_image
from anchorpose.research.experiment.config import ExperimentConfig, Scene
from anchorpose.simulate import config as presets
from anchorpose.simulate.config import SimulationConfig

# m, height of folds in loose clothes, near the simulator's maximum (0.015); folds of other clothes are 0.009 m high
LOOSE_M = 0.014


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """One recording of an experiment."""

    name: str
    scene: Scene
    simulation: SimulationConfig | None  # settings of a simulated recording; None for a user's own recording
    folder: Path | None = None  # folder of a user's own recording; None for a simulated recording

    @property
    def holes_are_cut(self) -> bool:
        """Return whether holes are cut into the recording's depth images. No holes are cut if equipment or people hide
        the patient.
        """
        return self.scene in (Scene.PAPER, Scene.LOOSE, Scene.REAL)


def plan_clips(config: ExperimentConfig, real: Path | None) -> list[Clip]:
    """Return all test recordings, scene by scene. real: folder of the user's recordings, which come last."""
    clips = [
        Clip(f"{scene}-{seed}", scene, simulation_of(scene, seed, config))
        for scene in config.scenes
        if scene is not Scene.REAL
        for seed in config.seeds(scene)
    ]
    return clips + ([] if real is None else real_clips(real))


def real_clips(folder: Path) -> list[Clip]:
    """Return a clip for each recording folder in ``folder`` that has a reference skeleton (skeleton.npz)."""
    found = sorted(path.parent for path in folder.glob("*/skeleton.npz") if (path.parent / "recording.json").is_file())
    return [Clip(f"real-{path.name}", Scene.REAL, None, path) for path in found]


def simulation_of(scene: Scene, seed: int, config: ExperimentConfig) -> SimulationConfig:
    """Return the settings of a simulated recording."""
    if scene is Scene.PAPER:
        return presets.single(seed, config.seconds, config.fps)
    alone = presets.single(seed, config.scene_seconds, config.fps)
    crowded = presets.clinic(seed, config.scene_seconds, config.fps)
    match scene:
        case Scene.LOOSE:
            return replace(alone, clothing_m=LOOSE_M)
        case Scene.FRAME:
            return replace(alone, equipment="standing-frame")
        case Scene.CLINIC_FRONT:
            return replace(crowded, cameras=1)
        case Scene.CLINIC:
            return crowded
    raise ValueError(f"{scene} is not simulated")


SURE = 1.0  # minimum confidence of a reference joint that is used


def simulated_joints(truth: Path) -> np.ndarray:
    """Return the true joints (t, 21, 3) of a truth.npz, metres, world."""
    joints: np.ndarray = read_arrays(truth, ("joints",), "simulate the recording again")["joints"]
    return joints


def reference_joints(skeleton: Path, T_world_camera: np.ndarray) -> np.ndarray:
    """Return the joints (t, 21, 3) of a skeleton.npz, metres, world; uncertain joints are NaN.

    The file has the ``names`` of m of the 21 joints and ``xyz`` (t, m, 4): metres in the camera's frame (x right, y up,
    z away) and confidence. A joint exactly at the camera's origin counts as missing. Raises InputError if the file is
    not such a skeleton.
    """
    remedy = "give names and xyz (t, joints, 4)"
    arrays = read_arrays(skeleton, ("names", "xyz"), remedy)
    try:
        names, stored = [str(name) for name in arrays["names"]], np.asarray(arrays["xyz"], dtype=np.float64)
    except (ValueError, KeyError) as error:
        raise InputError(skeleton, f"is not a reference skeleton ({error})", remedy) from None
    if stored.ndim != 3 or stored.shape[1:] != (len(names), 4) or not set(names) <= set(JOINT_INDEX):
        raise InputError(skeleton, "its names and xyz do not fit the 21 joints", remedy)
    unknown = (stored[..., :3] == 0.0).all(axis=-1) | (stored[..., 3] < SURE)
    camera_m = np.where(unknown[..., None], np.nan, stored[..., :3] * [1.0, -1.0, 1.0])
    joints = np.full((len(stored), JOINT_COUNT, 3), np.nan)
    joints[:, [JOINT_INDEX[name] for name in names]] = transform_points(T_world_camera, camera_m)
    return joints


# m, maximum distance from the body's centre to the nearest reading; a farther reading is not on the body
ON_BODY_M = 0.3
HOLES_KEY = 7  # key of the random numbers that choose the frames with holes; the simulator uses other random numbers


def draw_hole_frames(frames: int, share: float, seed: int, starts: Sequence[int]) -> np.ndarray:
    """Draw at random the frames into whose depth images a hole is cut, (frames,) bool.

    starts: frames at which tracking starts; these frames never get a hole, since their pose is given.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(HOLES_KEY,)))
    chosen: np.ndarray = rng.random(frames) < share
    chosen[list(starts)] = False
    return chosen


def cut_holes(recording: Recording, out: Path, centre_m: np.ndarray, chosen: np.ndarray, radius_m: float) -> np.ndarray:
    """Copy the recording folder to ``out``, without the depth readings inside a hole of radius ``radius_m``.

    centre_m (t, 3): mean position of the patient's visible surface, world. This position lies inside the body, so the
    hole's centre is the reading nearest to this position. In frames in which ``centre_m`` is NaN, the body was not
    seen, and no hole is cut. chosen (t,) bool: the frames to change. For an image from which no reading is removed, the
    copy has a link to the image. Returns (t,) bool: the frames that lost readings. Raises InputError for a recording
    with several cameras, since this function cannot tell which of their images belong together.
    """
    if len(recording.cameras) != 1:
        raise InputError(recording.folder, "has several cameras", "holes are cut in recordings of one camera only")
    camera, stream = recording.cameras[0], recording.streams[0]
    shutil.copytree(recording.folder, out, ignore=shutil.ignore_patterns("depth"))
    folder, cut = out / camera.name / "depth", np.zeros(len(stream.files), bool)
    folder.mkdir()
    for position, file in enumerate(stream.files):
        stored = read_image(file) if chosen[position] else None
        hole = None if stored is None else within_hole(file, camera, centre_m[position], radius_m)
        if stored is None or hole is None or not hole.any():
            (folder / file.name).symlink_to(file.resolve())
            continue
        cv2.imwrite(str(folder / file.name), np.where(hole, 0, stored).astype(stored.dtype))
        cut[position] = True
    return cut


def within_hole(file: Path, camera: Camera, centre_m: np.ndarray, radius_m: float) -> np.ndarray | None:
    """Return (height, width) bool: the pixels of a depth image that lie within a hole around a point in the world.

    The hole's centre is the reading nearest to the point. Return None if no reading is within ``ON_BODY_M`` of the
    point, if the image cannot be read, or if the point is NaN.
    """
    depth = read_depth_image(file, camera).depth_m
    if depth is None or np.isnan(centre_m).any():
        return None
    points = transform_points(camera.require_pose(), camera.back_project(depth))
    away = np.where(depth > 0, np.linalg.norm(points - centre_m, axis=2), np.inf)
    if away.min() > ON_BODY_M:
        return None
    middle = points.reshape(-1, 3)[np.argmin(away)]
    inside: np.ndarray = np.linalg.norm(points - middle, axis=2) < radius_m
    return inside & (depth > 0)
