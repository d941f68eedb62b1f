"""Where the joints of a recording really are, or where its reference skeleton puts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anchorpose.camera import transform_points
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX

SURE = 1.0  # confidence of a reference joint that counts


def simulated_joints(truth: Path) -> np.ndarray:
    """(t, 21, 3) metres, world, of a truth.npz."""
    with np.load(truth) as file:
        joints: np.ndarray = file["joints"]
    return joints


def reference_joints(skeleton: Path, T_world_camera: np.ndarray) -> np.ndarray:
    """(t, 21, 3) metres, world, of a skeleton.npz (``names`` of our joints, ``xyz`` (t, m, 4)); NaN where unsure.

    ``xyz``: camera x right, y up, z away, metres, and confidence; a joint at the origin is none.
    Raises InputError where the file is no such skeleton.
    """
    try:
        with np.load(skeleton, allow_pickle=False) as file:
            names, stored = [str(name) for name in file["names"]], np.asarray(file["xyz"], dtype=np.float64)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(skeleton, f"is no reference skeleton ({error})", "give names and xyz (t, joints, 4)") from None
    if stored.ndim != 3 or stored.shape[1:] != (len(names), 4) or not set(names) <= set(JOINT_INDEX):
        raise InputError(skeleton, "its names and xyz do not fit our joints", "give names and xyz (t, joints, 4)")
    unknown = (stored[..., :3] == 0.0).all(axis=-1) | (stored[..., 3] < SURE)
    camera_m = np.where(unknown[..., None], np.nan, stored[..., :3] * [1.0, -1.0, 1.0])
    joints = np.full((len(stored), JOINT_COUNT, 3), np.nan)
    joints[:, [JOINT_INDEX[name] for name in names]] = transform_points(T_world_camera, camera_m)
    return joints
