"""Write BVH files for Blender and other animation programs. They describe the skeleton as a hierarchy of rotating
bones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.segments import load_body_asset
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.exports.formats import Product, Samples, Source, rounded_text, write_rows
from anchorpose.exports.opensim_coordinates import in_axes, joint, known_median, pelvis_axes, rotations_deg, torso_axes
from anchorpose.exports.regular_time import Interpolation, RegularSamples, regular_samples, stretch_name, stretches_of
from anchorpose.options import ExportConfig
from anchorpose.results.tables import POSES_FILE, read_poses
from anchorpose.rotations import unit

ROOT: Final = "SpineBase"

# For each node, by name: its parent node, the joint at its origin, and the joint that it points to. If several bones
# begin at a joint, each bone has its own node there, so that every bone keeps its direction.
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
}


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node of the hierarchy (a bone) over all frames.

    parent: index of the parent in the list of nodes, -1 for the root. offset_m (3,): position relative to the parent
    node, in the parent's axes; end_m (3,): the far end of the bone, in the node's axes, used if the file has no node
    below this node. axes (n, 3, 3): rotation from the rest pose of the body model to the world in each frame, NaN where
    unknown.
    """

    name: str
    parent: int
    offset_m: np.ndarray
    end_m: np.ndarray
    axes: np.ndarray


def skeleton_of_joints(position_m: np.ndarray) -> list[Node]:
    """Build the nodes from joint centres (n, 21, 3). Bone lengths are medians over the frames.

    A bone's rotation relative to its parent is the shortest rotation that gives the bone its direction, since its
    rotation about its long axis is unknown. The lines between the hips and between the shoulders determine the rotation
    of pelvis and chest.
    """
    rest = shape_body(load_body_asset(), np.zeros(0)).rest_joints()[None]
    nodes, index = [Node(ROOT, -1, np.zeros(3), np.zeros(3), pelvis_axes(position_m))], {ROOT: 0}
    for name, (above, at, to) in _TREE.items():
        parent, points = nodes[index[above]], _along(rest, at, to)[0]
        start = torso_axes(position_m) if name == "SpineMid" else parent.axes
        # the parent's axes, turned by the shortest rotation that brings the bone from its rest direction to its present
        # direction
        axes = _swing(start @ points, _along(position_m, at, to)) @ start
        length_m = known_median(np.linalg.norm(joint(position_m, to) - joint(position_m, at), axis=1, keepdims=True))
        nodes.append(Node(name, index[above], parent.end_m, points * length_m, axes))
        index[name] = len(index)
    return nodes


def _along(position_m: np.ndarray, start: str, end: str) -> np.ndarray:
    return unit(joint(position_m, end) - joint(position_m, start))


def _swing(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the shortest rotations (n, 3, 3) that turn unit vectors ``start`` into unit vectors ``end`` (n, 3 each);
    NaN if they are opposite or NaN.
    """
    cross = np.cross(start, end)
    angle = np.arctan2(np.linalg.norm(cross, axis=1), np.sum(start * end, axis=1))
    axis = np.where((angle == 0.0)[:, None], 0.0, unit(cross))
    known = np.isfinite(axis).all(axis=1)
    turn = np.full((len(start), 3, 3), np.nan)
    turn[known] = Rotation.from_rotvec(axis[known] * angle[known, None]).as_matrix()
    return turn


# For bones without a child (head, hands and feet), by name: the joint to which the bone points.
_ENDS: Final = {
    "Head": "Head",
    "LeftHand": "HandLeft",
    "RightHand": "HandRight",
    "LeftFoot": "FootLeft",
    "RightFoot": "FootRight",
}


def skeleton_of_poses(
    path: Path, recorded: Samples, frame: np.ndarray, interpolation: Interpolation
) -> tuple[list[Node], np.ndarray]:
    """Build one node per moving bone of the body model from poses.parquet; return the nodes, and the positions (g, 3)
    of the root in metres at the g times of the regular grid.

    Nodes have the names that their bones have in the motion capture collection of Carnegie Mellon University (CMU). The
    offset of a node from its parent is the median over the recorded frames. At a grid time between two recorded frames,
    a rotation is the normalised, weighted mean of the quaternions in these frames. Raises InputError if the frames in
    poses.parquet differ from ``frame`` (n,), the frames of the joints.
    """
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    nodes = list[Node]()
    for row, name in enumerate(MOVING_BONES):
        parent, head_m = _parent(name), poses.head_m[:, row].astype(np.float64)
        offset, end = np.zeros(3), np.zeros(3)
        if parent >= 0:
            offset = _middle(poses.quaternion[:, parent], head_m - poses.head_m[:, parent].astype(np.float64))
        if name in _ENDS:
            end = _middle(poses.quaternion[:, row], joint(recorded.position_m, _ENDS[name]) - head_m)
        axes = _matrices(_mixed(poses.quaternion[:, row], interpolation))
        nodes.append(Node(name, parent, offset, end, axes))
    return nodes, interpolation.values(poses.head_m[:, 0].astype(np.float64))


def _parent(name: str) -> int:
    """Return the index in ``MOVING_BONES`` of a bone's nearest moving ancestor in the hierarchy; -1 for the root."""
    asset = load_body_asset()
    above = int(asset.bone_parents[asset.bone(name)])
    while above >= 0 and asset.bone_names[above] not in MOVING_BONES:
        above = int(asset.bone_parents[above])
    return -1 if above < 0 else MOVING_BONES.index(asset.bone_names[above])


def _mixed(quaternion: np.ndarray, interpolation: Interpolation) -> np.ndarray:
    """Interpolate recorded quaternions (n, 4) to grid times (g, 4); NaN in a gap or if the patient is lost."""
    left, right = (quaternion[interpolation.before + step].astype(np.float64) for step in (0, 1))
    same_side = np.where(np.sum(left * right, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    share = interpolation.share[:, None]
    mixed = np.where(
        share == 0.0, left, np.where(share == 1.0, right, (1.0 - share) * left + share * same_side * right)
    )
    return unit(np.where(interpolation.bridged[:, None], mixed, np.nan))


def _matrices(quaternion: np.ndarray) -> np.ndarray:
    """Convert quaternions (n, 4), real part first, to rotation matrices (n, 3, 3); NaN stays NaN."""
    axes = np.full((len(quaternion), 3, 3), np.nan)
    known = np.isfinite(quaternion).all(axis=-1)
    axes[known] = Rotation.from_quat(quaternion[known], scalar_first=True).as_matrix()
    return axes


def _middle(quaternion: np.ndarray, vector_m: np.ndarray) -> np.ndarray:
    """Convert a world vector (n, 3) to a bone's axes, and return its median (3,) over the n frames; NaN if it is NaN in
    all frames.
    """
    return known_median(in_axes(_matrices(quaternion.astype(np.float64)), vector_m))


STEM: Final = "motion"
DIGITS: Final = 5
_PLACE, _TURN = "Xposition Yposition Zposition", "Zrotation Xrotation Yrotation"


def write_bvh(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write motion.bvh, or one file for each stretch of frames in which all written bones are known; raises
    AnchorposeError without such a stretch.
    """
    regular = regular_samples(source.samples)
    from_poses = (source.folder / POSES_FILE).exists()
    nodes, root_m = _skeleton(source, regular, from_poses)
    known = np.stack([np.isfinite(node.axes).all(axis=(1, 2)) for node in nodes], axis=1)
    stretches = stretches_of(known & np.isfinite(root_m).all(axis=1)[:, None])
    if not stretches.runs or not stretches.kept[0]:
        raise AnchorposeError("No two frames in a row have the joints that a BVH needs; export with --to csv instead.")
    kept = [place for place, keep in enumerate(stretches.kept) if keep]
    for number, (first, last) in enumerate(stretches.runs):
        path = folder / stretch_name(STEM, ".bvh", number, len(stretches.runs))
        write_bvh_file(path, nodes, kept, root_m, slice(first, last), regular.rate_hz)
    left_out = [node.name for place, node in enumerate(nodes) if place not in kept]
    return Product(
        axes="Y up, the patient faces X, the patient's right is Z; the world of the recording",
        units="centimetres, degrees, turns about Z, then X, then Y",
        time=str(regular.base),
        missing="a BVH cannot hold a gap: bones known in less than half of the patient's frames are left out, and each "
        "stretch of frames in which all the others are known is a separate file",
        counts=(
            ("files", len(stretches.runs)),
            ("frames", stretches.frames),
            ("frames_left_out", int(regular.interpolation.bridged.sum()) - stretches.frames),
            ("rate_hz", regular.rate_hz),
        ),
        notes=(
            "Turns are those of the learnt body (poses.parquet)."
            if from_poses
            else "Turns are made from joint centres; turns about the long axis of a bone are not included.",
            *(
                f"{stretch_name(STEM, '.bvh', number, len(stretches.runs))} begins at "
                f"{float(regular.samples.time_s[first])!r} s."
                for number, (first, _) in enumerate(stretches.runs)
            ),
            f"Left out, since joints are missing: {', '.join(left_out) or 'nothing'}.",
            *stretches.notes,
        ),
    )


def write_bvh_file(
    path: Path, nodes: list[Node], kept: list[int], root_m: np.ndarray, rows: slice, rate_hz: float
) -> None:
    """Write a BVH file of the frames ``rows``. kept: indices of the nodes to write, the root first; root_m (n, 3):
    positions of the root.
    """
    order, lines = _hierarchy(nodes, kept)
    values = np.empty((rows.stop - rows.start, 3 + 3 * len(order)))
    values[:, :3] = 100.0 * root_m[rows]
    for number, place in enumerate(order, 1):
        values[:, 3 * number : 3 * number + 3] = _turns_deg(nodes, place, rows)
    head = ["HIERARCHY", *lines, "MOTION", f"Frames: {len(values)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    body = ([rounded_text(value, DIGITS, "") for value in row.tolist()] for row in values)
    write_rows(path, " ", ([line] for line in head), body)


def _turns_deg(nodes: list[Node], place: int, rows: slice) -> np.ndarray:
    """Return a node's rotations (r, 3) about its parent's axes Z, X and Y, degrees, without jumps by 360 degrees."""
    node, axes = nodes[place], nodes[place].axes[rows]
    if node.parent >= 0:
        axes = np.einsum("nji,njk->nik", nodes[node.parent].axes[rows], axes)
    return np.unwrap(np.stack(rotations_deg(axes), axis=1), period=360.0, axis=0)


def _skeleton(source: Source, regular: RegularSamples, from_poses: bool) -> tuple[list[Node], np.ndarray]:
    if not from_poses:
        position_m = regular.samples.position_m
        return skeleton_of_joints(position_m), joint(position_m, "SpineBase")
    return skeleton_of_poses(source.folder / POSES_FILE, source.samples, source.frame, regular.interpolation)


def _hierarchy(nodes: list[Node], kept: list[int]) -> tuple[list[int], list[str]]:
    """Return the indices of the kept nodes in file order, parents before children, and the file's HIERARCHY lines."""
    order, lines = list[int](), list[str]()

    def visit(place: int, depth: int) -> None:
        node, children = nodes[place], [child for child in kept if nodes[child].parent == place]
        order.append(place)
        add(depth, f"{'JOINT' if depth else 'ROOT'} {node.name}", "{")
        channels = f"3 {_TURN}" if depth else f"6 {_PLACE} {_TURN}"
        add(depth + 1, f"OFFSET {_centimetres(node.offset_m)}", f"CHANNELS {channels}")
        for child in children:
            visit(child, depth + 1)
        if not children:
            add(depth + 1, "End Site", "{", f"\tOFFSET {_centimetres(node.end_m)}", "}")
        add(depth, "}")

    def add(depth: int, *texts: str) -> None:
        lines.extend("\t" * depth + text for text in texts)

    visit(kept[0], 0)
    return order, lines


def _centimetres(vector_m: np.ndarray) -> str:
    return " ".join(rounded_text(float(value), DIGITS, "0") for value in 100.0 * vector_m)
