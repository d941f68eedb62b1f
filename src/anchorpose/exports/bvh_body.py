"""The hierarchy of a BVH from poses.parquet: the bones of the learnt body with their own turns, long axes too."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import load_body_asset
from anchorpose.body.pose import MOVING_BONES
from anchorpose.errors import InputError
from anchorpose.exports.bvh_skeleton import Node
from anchorpose.exports.regular_time import Between
from anchorpose.exports.segment_frames import unit
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.poses import read_poses

# What the last bones of each limb point to; these are joints of ours.
_ENDS: Final = {
    "Head": "Head", "LeftHand": "HandLeft", "RightHand": "HandRight", "LeftFoot": "FootLeft", "RightFoot": "FootRight",
}  # fmt: skip


def skeleton_of_poses(path: Path, frame: np.ndarray, between: Between, position_m: np.ndarray) -> list[Node]:
    """Nodes named like the body's bones, those of a BVH in the CMU collection; position_m (g, 21, 3) on the grid.

    Where the grid lies between samples, a turn is the normalised mean of its neighbours. Raises InputError where
    poses.parquet has other frames than the joints, ``frame`` (n,).
    """
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    asset = load_body_asset()
    head_m = between.values(poses.head_m.astype(np.float64))
    axes = _axes(poses.quaternion.astype(np.float64), between)
    nodes = list[Node]()
    for row, name in enumerate(MOVING_BONES):
        above = int(asset.bone_parents[asset.bone(name)])
        while above >= 0 and asset.bone_names[above] not in MOVING_BONES:
            above = int(asset.bone_parents[above])
        parent = -1 if above < 0 else MOVING_BONES.index(asset.bone_names[above])
        offset = np.zeros(3) if parent < 0 else _middle(axes[:, parent], head_m[:, row] - head_m[:, parent])
        end = np.zeros(3)
        if name in _ENDS:
            end = _middle(axes[:, row], position_m[:, JOINT_INDEX[_ENDS[name]]] - head_m[:, row])
        nodes.append(Node(name, parent, offset, end, axes[:, row]))
    return nodes


def root_path(path: Path, between: Between) -> np.ndarray:
    """(g, 3) where the root bone's head is."""
    return between.values(read_poses(path).head_m[:, 0].astype(np.float64))


def _axes(quaternion: np.ndarray, between: Between) -> np.ndarray:
    """(g, bones, 3, 3) of quaternions (n, bones, 4) with the real part first; NaN where lost or in a gap."""
    left, right = quaternion[between.before], quaternion[between.before + 1]
    same_side = np.where(np.sum(left * right, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    share = between.share[:, None, None]
    mixed = np.where(share == 0.0, left, np.where(share == 1.0, right, (1.0 - share) * left + share * same_side * right))
    mixed = unit(np.where(between.bridged[:, None, None], mixed, np.nan))
    axes = np.full((*mixed.shape[:2], 3, 3), np.nan)
    known = np.isfinite(mixed).all(axis=-1)
    axes[known] = Rotation.from_quat(mixed[known], scalar_first=True).as_matrix()
    return axes


def _middle(axes: np.ndarray, vector_m: np.ndarray) -> np.ndarray:
    """(3,) median over the frames of a world vector in the axes; NaN where there is no frame."""
    inside = np.einsum("nji,nj->ni", axes, vector_m)
    known = inside[np.isfinite(inside).all(axis=1)]
    return np.median(known, axis=0) if len(known) else np.full(3, np.nan)
