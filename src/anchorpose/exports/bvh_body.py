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
from anchorpose.exports.segment_frames import joint, unit
from anchorpose.exports.source import Samples
from anchorpose.results.poses import read_poses

# What the last bones of each limb point to; these are joints of ours.
_ENDS: Final = {
    "Head": "Head", "LeftHand": "HandLeft", "RightHand": "HandRight", "LeftFoot": "FootLeft", "RightFoot": "FootRight",
}  # fmt: skip


def skeleton_of_poses(
    path: Path, recorded: Samples, frame: np.ndarray, between: Between
) -> tuple[list[Node], np.ndarray]:
    """Nodes named like the body's bones, those of a BVH in the CMU collection, and the root's path (g, 3), metres.

    Offsets come from recorded frames; where the grid lies between these, a turn is the normalised mean of its
    neighbours. Raises InputError where poses.parquet has other frames than the joints, ``frame`` (n,).
    """
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    head_m, quaternion = poses.head_m.astype(np.float64), poses.quaternion.astype(np.float64)
    then, now = _matrices(quaternion), _matrices(_mixed(quaternion, between))
    nodes = list[Node]()
    for row, name in enumerate(MOVING_BONES):
        parent, end = _parent(name), np.zeros(3)
        offset = np.zeros(3) if parent < 0 else _middle(then[:, parent], head_m[:, row] - head_m[:, parent])
        if name in _ENDS:
            end = _middle(then[:, row], joint(recorded.position_m, _ENDS[name]) - head_m[:, row])
        nodes.append(Node(name, parent, offset, end, now[:, row]))
    return nodes, between.values(head_m[:, 0])


def _parent(name: str) -> int:
    """Place in ``MOVING_BONES`` of the next moving bone above; -1 for the root."""
    asset = load_body_asset()
    above = int(asset.bone_parents[asset.bone(name)])
    while above >= 0 and asset.bone_names[above] not in MOVING_BONES:
        above = int(asset.bone_parents[above])
    return -1 if above < 0 else MOVING_BONES.index(asset.bone_names[above])


def _mixed(quaternion: np.ndarray, between: Between) -> np.ndarray:
    """(g, bones, 4) of quaternions (n, bones, 4); NaN where lost or in a gap."""
    left, right = quaternion[between.before], quaternion[between.before + 1]
    same_side = np.where(np.sum(left * right, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    share = between.share[:, None, None]
    mixed = np.where(
        share == 0.0, left, np.where(share == 1.0, right, (1.0 - share) * left + share * same_side * right)
    )
    return unit(np.where(between.bridged[:, None, None], mixed, np.nan))


def _matrices(quaternion: np.ndarray) -> np.ndarray:
    """(n, bones, 3, 3) of quaternions (n, bones, 4) with the real part first; NaN stays NaN."""
    axes = np.full((*quaternion.shape[:2], 3, 3), np.nan)
    known = np.isfinite(quaternion).all(axis=-1)
    axes[known] = Rotation.from_quat(quaternion[known], scalar_first=True).as_matrix()
    return axes


def _middle(axes: np.ndarray, vector_m: np.ndarray) -> np.ndarray:
    """(3,) median over the frames of a world vector in the axes; NaN where there is no frame."""
    inside = np.einsum("nji,nj->ni", axes, vector_m)
    known = inside[np.isfinite(inside).all(axis=1)]
    return np.median(known, axis=0) if len(known) else np.full(3, np.nan)
