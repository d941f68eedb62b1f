"""The hierarchy of a BVH and the turns of its nodes, from joint centres alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import load_body_asset
from anchorpose.body.shaped import shape_body
from anchorpose.exports.segment_frames import joint, pelvis_axes, torso_axes, unit
from anchorpose.joints import JOINT_INDEX

ROOT: Final = "SpineBase"

# Node: the node above it, the joint that it stands at, the joint that it points to. Where several bones leave a joint,
# each has a node of its own there, so that every bone keeps its direction.
_TREE: Final = {
    "LowerSpine": ("SpineBase", "SpineBase", "SpineMid"),
    "SpineMid": ("LowerSpine", "SpineMid", "SpineShoulder"),
    "SpineShoulder": ("SpineMid", "SpineShoulder", "Neck"),
    "Neck": ("SpineShoulder", "Neck", "Head"),
    **{
        node.format(side): (above.format(side), at.format(side), to.format(side))
        for side in ("Left", "Right")
        for node, above, at, to in (
            ("Clavicle{}", "SpineMid", "SpineShoulder", "Shoulder{}"),
            ("Shoulder{}", "Clavicle{}", "Shoulder{}", "Elbow{}"),
            ("Elbow{}", "Shoulder{}", "Elbow{}", "Wrist{}"),
            ("Wrist{}", "Elbow{}", "Wrist{}", "Hand{}"),
            ("Pelvis{}", "SpineBase", "SpineBase", "Hip{}"),
            ("Hip{}", "Pelvis{}", "Hip{}", "Knee{}"),
            ("Knee{}", "Hip{}", "Knee{}", "Ankle{}"),
            ("Ankle{}", "Knee{}", "Ankle{}", "Foot{}"),
        )
    },
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node of the hierarchy over all frames; NaN where it cannot be told.

    parent: its place in the list of nodes, -1 for the root. offset_m (3,) from the parent's node in the parent's axes;
    end_m (3,): what the node points to, in its own axes. axes (n, 3, 3): its turn in the world; the rest pose, arms and
    legs as in the body asset, is the identity.
    """

    name: str
    parent: int
    offset_m: np.ndarray
    end_m: np.ndarray
    axes: np.ndarray


def skeleton_of_joints(position_m: np.ndarray) -> list[Node]:
    """Nodes from joint centres (n, 21, 3): a bone turns on its parent by the shortest way, so no turn about its own
    long axis is made up; pelvis and chest are turned by hips and shoulders. Offsets have median bone lengths."""
    rest = shape_body(load_body_asset(), np.zeros(0)).rest_joints()[None]
    nodes, index = list[Node](), dict[str, int]()
    nodes.append(Node(ROOT, -1, np.zeros(3), np.zeros(3), pelvis_axes(position_m)))
    index[ROOT] = 0
    for name, (above, at, to) in _TREE.items():
        parent = nodes[index[above]]
        start = torso_axes(position_m) if name == "SpineMid" else parent.axes
        points = _along(rest, at, to)[0]
        axes = _swing(start @ points, _along(position_m, at, to)) @ start
        nodes.append(Node(name, index[above], parent.end_m, points * _length(position_m, at, to), axes))
        index[name] = len(index)
    return nodes


def _along(position_m: np.ndarray, start: str, end: str) -> np.ndarray:
    return unit(joint(position_m, end) - joint(position_m, start))


def _length(position_m: np.ndarray, start: str, end: str) -> float:
    along = np.linalg.norm(position_m[:, JOINT_INDEX[end]] - position_m[:, JOINT_INDEX[start]], axis=1)
    known = along[np.isfinite(along)]
    return float(np.median(known)) if len(known) else float("nan")


def _swing(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n, 3, 3) the shortest turn that takes unit vectors ``start`` to ``end``; NaN where there is none."""
    cross = np.cross(start, end)
    angle = np.arctan2(np.linalg.norm(cross, axis=1), np.sum(start * end, axis=1))
    axis = np.where((angle == 0.0)[:, None], 0.0, unit(cross))
    known = np.isfinite(axis).all(axis=1)
    turn = np.full((len(start), 3, 3), np.nan)
    turn[known] = Rotation.from_rotvec(axis[known] * angle[known, None]).as_matrix()
    return turn
