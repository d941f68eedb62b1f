"""Joints as pose vectors that do not depend on where the patient stands and where he faces, and back.

A pose vector theta holds 21 x 3 joint positions relative to SpineBase in the trunk's heading frame (X where the trunk
faces, Y up, Z to its right), then a path of 4: SpineBase along X, Y, Z of the *momentary* heading frame, summed from
step to step like an odometer, and the heading, radians, unwrapped. Only differences of the path mean anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.tracking.motion import (
    MotionConfig,
    PredictionSource,
    predict,
    reference_motions,
)
from anchorpose.tracking.motion_database import MotionDatabase

COMPARED: Final = 3 * JOINT_COUNT
"""Columns of a pose vector that say how similar two poses are."""

_ROOT: Final = JOINT_INDEX["SpineBase"]
_LEFT: Final = [JOINT_INDEX["HipLeft"], JOINT_INDEX["ShoulderLeft"]]
_RIGHT: Final = [JOINT_INDEX["HipRight"], JOINT_INDEX["ShoulderRight"]]


@dataclass(frozen=True, slots=True, eq=False)
class JointPrediction:
    """joints_m (steps, 21, 3) float64 world, NaN where the history lacks a joint; source, trust: see ``Prediction``."""

    joints_m: np.ndarray
    source: PredictionSource
    trust: float


def heading_rad(joints_m: np.ndarray) -> np.ndarray:
    """(t,) turn about Y from world X to where the trunk faces: across hips and shoulders, whichever are known."""
    across = joints_m[:, _RIGHT] - joints_m[:, _LEFT]
    across = np.where(np.isfinite(across).all(axis=(2,), keepdims=True), across, 0.0).sum(axis=1)
    unknown = np.linalg.norm(across[:, [0, 2]], axis=1) == 0.0
    return np.where(unknown, np.nan, np.arctan2(across[:, 0], across[:, 2]))


def pose_vectors(joints_m: np.ndarray) -> np.ndarray:
    """(t, 67) float64 pose vectors of consecutive frames of joints (t, 21, 3) world metres; NaN is kept."""
    heading = heading_rad(joints_m)
    root = joints_m[:, _ROOT]
    relative = _turned(joints_m - root[:, None], -heading)
    steps = _turned(np.diff(root, axis=0)[:, None], -heading[:-1])[:, 0]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    turned = heading.copy()
    known = np.isfinite(heading)
    turned[known] = np.unwrap(heading[known])
    return np.concatenate([relative.reshape(len(joints_m), -1), path, turned[:, None]], axis=1)


def joints_after(last_m: np.ndarray, last_theta: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(steps, 21, 3) world joints of pose vectors (steps, 67) that follow the frame ``last_m`` (21, 3)."""
    headings = theta[:, -1]
    before = np.concatenate([last_theta[-1:], headings[:-1]])
    steps = np.diff(np.concatenate([last_theta[None, -4:-1], theta[:, -4:-1]]), axis=0)
    root = last_m[_ROOT] + np.cumsum(_turned(steps[:, None], before)[:, 0], axis=0)
    relative = theta[:, :COMPARED].reshape(-1, JOINT_COUNT, 3)
    return _turned(relative, headings) + root[:, None]


def joint_database(
    clips_m: Sequence[np.ndarray], rate_hz: Sequence[float], at_hz: float, config: MotionConfig
) -> MotionDatabase:
    """Motion database of clips of joints, (n_i, 21, 3) world metres each, Y up; any place, any heading, any rate."""
    return reference_motions([pose_vectors(clip) for clip in clips_m], rate_hz, at_hz, COMPARED, config)


def predict_joints(
    history_m: np.ndarray, steps: int, database: MotionDatabase | None, config: MotionConfig
) -> JointPrediction:
    """The joints of the next ``steps`` frames from the last ones (k, 21, 3) world metres, newest last."""
    recent = np.asarray(history_m, dtype=np.float64)
    vectors = pose_vectors(recent)
    prediction = predict(vectors, steps, COMPARED, database, config)
    return JointPrediction(joints_after(recent[-1], vectors[-1], prediction.theta), prediction.source, prediction.trust)


def _turned(vectors: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """(t, n, 3) vectors turned about Y by one angle (t,) a frame."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack([cos * x + sin * z, y, cos * z - sin * x], axis=-1)
