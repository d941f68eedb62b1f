"""Propose other poses for a pose that may be wrong (a pose in doubt). In a proposed pose, a limb lies along seen skin
that the body does not cover, or along the path over the surface from an anchor (hand or foot) to the body's centre; or
a limb is hidden, in a usual posture; or left and right limbs are exchanged.

Except for a hidden limb, the images determine the place of the proposed limb; the trunk stays as in the pose in doubt
(but ``exchanged`` also turns the body round). An anchor shows where a limb ends even if the body covers all seen skin.
For example, an arm that is wrongly fitted to the rail on the other side of a walker covers this rail, so that no skin
is left uncovered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import anchor_points
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import Explanation, node_area_m2
from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.joint_ranges import expected_turns
from anchorpose.body.pose import MOVING_BONES, Pose
from anchorpose.body.skin_points import Body, SkinPoints, pose_points
from anchorpose.geodesics.anchors import Anchors, SeenAnchors
from anchorpose.geodesics.center import center_field, limb_path
from anchorpose.joints import ANCHOR_NAMES, JOINT_INDEX
from anchorpose.rotations import rotation_matrices

SIDES: Final = ("Left", "Right")
MIRROR: Final = np.diag([1.0, 1.0, -1.0])
"""Reflection in the plane between the left and the right half of the body."""
# m, maximum distance between neighbouring nodes (points of the seen surface) of one piece of skin, twice the usual
# spacing of nodes
NEIGHBOUR_M: Final = 0.05
# m2, minimum area of an uncovered piece of skin, the size of a few fingers; smaller pieces are due to clothes
SMALLEST_M2: Final = 0.002
# maximum number of uncovered pieces of skin that are examined at a time, enough for two arms and a leg; smaller pieces
# are examined once the body covers the larger pieces
MOST_PIECES: Final = 3
# maximum number of rounds, each of three solver steps; a limb that must turn by half a circle needs several rounds
TURNS: Final = 4
# m; the solver stops if a round moves no joint farther than this along any axis; registration refines the pose later
SETTLED_M: Final = 0.01
# m, maximum distance by which the tip of a path may be beyond a limb's reach; a limb is laid along such a path, too,
# since the trunk may lean, and the shoulder may move
REACH_SLACK_M: Final = 0.15


@dataclass(frozen=True, slots=True)
class Chain:
    """An arm or a leg, as a chain of bones and joints."""

    bones: tuple[str, ...]  # from the trunk to the hand or foot
    joints: tuple[str, ...]  # from the hand or foot to the elbow or knee
    depth_m: tuple[float, ...]  # depth of each of ``joints`` below the skin
    root: str  # name of the joint at the trunk


CHAINS: Final = tuple(
    Chain(
        tuple(f"{side}{bone}" for bone in bones), tuple(f"{joint}{side}" for joint in joints), depth_m, f"{root}{side}"
    )
    for bones, joints, depth_m, root in (
        (("Arm", "ForeArm", "Hand"), ("Hand", "Wrist", "Elbow"), (0.012, 0.02, 0.04), "Shoulder"),
        (("UpLeg", "Leg", "Foot"), ("Foot", "Ankle", "Knee"), (0.03, 0.04, 0.055), "Hip"),
    )
    for side in SIDES
)
"""Arms and legs. The depth of a joint below the skin is half of the limb's thickness at the joint."""

_SIDED: Final = tuple(JOINT_INDEX[f"{joint}{side}"] for joint in ("Shoulder", "Hip") for side in SIDES)


@dataclass(frozen=True, slots=True, eq=False)
class LimbPath:
    """A path over the seen surface along which a limb may lie. The path leads from the limb's tip to the place where
    the limb meets the body.
    """

    places_m: np.ndarray  # (k, 3) places on the skin
    inward: np.ndarray  # (k, 3) unit vectors into the limb
    along_m: np.ndarray  # (k,) distance from the tip along the path
    area_m2: float = 0.0  # area of the uncovered piece of surface on which the path lies; 0 if not measured


def uncovered_paths(evidence: Evidence, explanation: Explanation) -> list[LimbPath]:
    """Return a path over each large piece of seen skin that the body does not cover, the largest piece first.

    A path over a piece of uncovered skin begins at the piece's tip and ends at one of the piece's roots. Roots are the
    piece's nodes within ``NEIGHBOUR_M`` of a covered node, where the piece meets the covered skin. If a bar, for
    example, separates the piece from the covered skin, the root is the piece's node nearest to a covered node. The tip
    is the node farthest from the roots along the piece.
    """
    surface, bare = evidence.surface, explanation.node
    if len(bare) < 2:
        return []
    points, normals = (values[bare].astype(np.float64) for values in (surface.points_m, surface.normals))
    graph, piece = _pieces(points)
    size = np.bincount(piece, (node_area_m2(evidence) * explanation.thinned)[surface.camera[bare]])
    largest = np.argsort(-size, kind="stable")[:MOST_PIECES]
    away = _from_covered(points, surface.points_m[explanation.covered])
    return [
        replace(_path(graph, np.flatnonzero(piece == number), points, normals, away), area_m2=float(size[number]))
        for number in largest
        if size[number] >= SMALLEST_M2
    ]


def _pieces(points_m: np.ndarray) -> tuple[csr_array, np.ndarray]:
    """Return the graph that joins neighbouring nodes (points of the uncovered surface), with edge lengths in metres,
    and the number (u,) int of the connected piece to which each node belongs.
    """
    pairs = cKDTree(points_m).query_pairs(NEIGHBOUR_M, output_type="ndarray")
    length = np.linalg.norm(points_m[pairs[:, 0]] - points_m[pairs[:, 1]], axis=1)
    graph = csr_array((length, (pairs[:, 0], pairs[:, 1])), shape=(len(points_m), len(points_m)))
    _, piece = connected_components(graph, directed=False)
    return graph, piece


def _from_covered(points_m: np.ndarray, covered_m: np.ndarray) -> np.ndarray:
    """Return (u,) the distance in metres from each uncovered node to the nearest covered node; 0 everywhere if no node
    is covered.
    """
    if not len(covered_m):
        return np.zeros(len(points_m))
    distance, _ = cKDTree(covered_m).query(points_m)
    return np.asarray(distance)


def _path(
    graph: csr_array, nodes: np.ndarray, points_m: np.ndarray, normals: np.ndarray, away_m: np.ndarray
) -> LimbPath:
    """Return the path through one connected piece of nodes, from its tip to the nearest of its roots, as in
    ``uncovered_paths``.
    """
    roots = nodes[away_m[nodes] <= max(NEIGHBOUR_M, float(away_m[nodes].min()))]
    field, before, _ = dijkstra(graph, directed=False, indices=roots, min_only=True, return_predecessors=True)
    chain = [int(nodes[np.argmax(field[nodes])])]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    order = np.array(chain)
    return LimbPath(points_m[order], -normals[order], field[order[0]] - field[order])


def limb_poses(body: Body, pose: Pose, path: LimbPath, chains: Sequence[Chain] = CHAINS) -> Iterator[Pose]:
    """Yield two poses for each limb of ``chains`` that can reach the path's tip; in both poses, this limb lies along
    the path.

    The limb's joints within the path's length are placed under the path, inside the limb. The limb's other joints are
    placed by the joint ranges in the first pose, and stay where they are in the second pose.
    """
    joints = body.joints(pose)
    lengths = limb_lengths(body)
    for chain, (along_m, whole_m) in zip(CHAINS, lengths, strict=True):
        root = joints[JOINT_INDEX[chain.root]]
        if chain not in chains or np.linalg.norm(path.places_m[0] - root) > whole_m + REACH_SLACK_M:
            continue
        wanted = _held_but(joints, (chain,))
        for joint, at_m, depth_m in zip(chain.joints, along_m, chain.depth_m, strict=True):
            if at_m <= path.along_m[-1] + NEIGHBOUR_M:
                wanted[JOINT_INDEX[joint]] = _place(path, at_m, depth_m)
        bones = [body.points.asset.bone(bone) for bone in chain.bones]
        resting = pose.rotations.copy()
        resting[bones] = np.eye(3)
        yield _solved(body, Pose(resting, pose.root_m), wanted)
        yield _solved(body, pose, np.where(np.isnan(wanted), joints, wanted))


def usual_poses(body: Body, pose: Pose) -> Iterator[Pose]:
    """Yield two poses for each limb. In the first, the limb is where it is expected from the turns of all other bones;
    in the second, it is the mirror image of the limb on the other side. If the limb is hidden, its pixels in ``pose``
    show something else, for example the other leg.
    """
    asset = body.points.asset
    for chain in CHAINS:
        bones = [asset.bone(bone) for bone in chain.bones]
        expected, alike = pose.rotations.copy(), pose.rotations.copy()
        turns = expected_turns(asset, pose, [MOVING_BONES.index(bone) for bone in chain.bones])
        expected[bones] = rotation_matrices(turns)
        other = [asset.bone(_other_side(bone)) for bone in chain.bones]
        alike[bones] = MIRROR @ pose.rotations[other] @ MIRROR
        yield Pose(expected, pose.root_m)
        yield Pose(alike, pose.root_m)


def _other_side(name: str) -> str:
    """Return the name of the corresponding bone or joint of the other side; of the trunk, ``name`` itself."""
    return name.replace("Left", "*").replace("Right", "Left").replace("*", "Right")


def exchanged(body: Body, pose: Pose) -> Iterator[Pose]:
    """Yield the pose with the arms exchanged, with the legs exchanged, and with the body turned round where it stands.

    Exchanged limbs keep their places, but the left limb becomes the right limb and vice versa. The skin fits the images
    as well as before, so the bending of joints and the direction of feet decide whether an exchanged pose is better.
    """
    joints = body.joints(pose)
    asset = body.points.asset
    for limbs in (("Arm",), ("Leg",), ("Arm", "Leg")):
        moved = tuple(chain for chain in CHAINS if chain.bones[0].endswith(limbs))
        wanted, rotations = _held_but(joints, moved), pose.rotations.copy()
        if len(limbs) == 2:
            hips, sides = asset.bone("Hips"), list(_SIDED)
            rotations[hips] = Rotation.from_rotvec([0.0, np.pi, 0.0]).as_matrix() @ rotations[hips]
            wanted[sides] = joints[_mirrored()[sides]]
        for chain in moved:
            own = [JOINT_INDEX[name] for name in chain.joints]
            wanted[own] = joints[_mirrored()[own]]
            rotations[[asset.bone(bone) for bone in chain.bones]] = np.eye(3)
        yield _solved(body, Pose(rotations, pose.root_m), wanted)


@cache
def _mirrored() -> np.ndarray:
    """Return (21,), for each joint, the corresponding joint of the other side; for a joint of the trunk, the joint
    itself.
    """
    return np.array([JOINT_INDEX[_other_side(name)] for name in JOINT_INDEX])


def limb_lengths(body: Body) -> list[tuple[np.ndarray, float]]:
    """Return, for each limb of ``CHAINS``, the lengths (m) from the limb's tip to each of its joints and to its root
    (shoulder or hip).
    """
    asset, rest = body.points.asset, body.mesh.rest_joints()
    found = []
    for chain in CHAINS:
        end = np.isin(body.points.part, _bones_from(asset, chain.bones[-1]))
        joints = rest[[JOINT_INDEX[name] for name in (*chain.joints, chain.root)]]
        steps = np.linalg.norm(np.diff(joints, axis=0), axis=1)
        beyond = np.linalg.norm(body.rest_m[end] - joints[1], axis=1).max() - steps[0]
        along = beyond + np.concatenate([[0.0], np.cumsum(steps)])
        found.append((along[:-1], float(along[-1])))
    return found


@cache
def end_points(points: SkinPoints, chain: Chain) -> np.ndarray:
    """Return the indices of the skin points beyond the limb's elbow or knee."""
    return np.flatnonzero(np.isin(points.part, _bones_from(points.asset, chain.bones[1])))


def _bones_from(asset: BodyAsset, name: str) -> np.ndarray:
    """Return the indices of the bone with this name and of all its descendants in the skeleton."""
    first = asset.bone(name)
    below = {first}
    for bone, parent in enumerate(asset.bone_parents):
        if int(parent) in below:
            below.add(bone)
    return np.array(sorted(below))


def _held_but(joints: np.ndarray, limbs: Sequence[Chain]) -> np.ndarray:
    """Return wanted places of the joints (21, 3): the present places, except for the joints of ``limbs``, which are NaN
    and are set by the caller.
    """
    wanted = joints.copy()
    wanted[[JOINT_INDEX[name] for chain in limbs for name in chain.joints]] = np.nan
    return wanted


def _place(path: LimbPath, at_m: float, depth_m: float) -> np.ndarray:
    """Return the point (3,) inside the limb that is at_m from the path's tip and depth_m below the skin."""
    skin = np.array([np.interp(at_m, path.along_m, path.places_m[:, axis]) for axis in range(3)])
    inward = np.array([np.interp(at_m, path.along_m, path.inward[:, axis]) for axis in range(3)])
    return np.asarray(skin + depth_m * inward / max(float(np.linalg.norm(inward)), 1e-9))


def _solved(body: Body, start: Pose, wanted: np.ndarray) -> Pose:
    """Return the pose whose joints are as near to the wanted places (21, 3) as possible; a joint that is NaN may be
    anywhere. The pose ``start`` may be far from the result, so several rounds of the solver are run.
    """
    found, joints = start, body.joints(start)
    for _ in range(TURNS):
        found = pose_from_joints(body, found, wanted)
        before, joints = joints, body.joints(found)
        if np.abs(joints - before).max() < SETTLED_M:
            break
    return found


CONTRADICTED_M: Final = 0.15  # m; an anchor farther than this from the tip of its limb contradicts the pose
# m, distance by which an anchor lies nearer to the body's centre than the skin at the tip of the anchor's limb
INSIDE_TIP_M: Final = 0.03


def anchor_paths(body: Body, pose: Pose, seen: SeenAnchors) -> Iterator[tuple[LimbPath, tuple[Chain, ...]]]:
    """Yield geodesic paths to the body's centre, each with the limbs that may lie along the path. The paths begin at
    hand and foot anchors that contradict the pose, and at free ends. Free ends are limb ends that were not identified
    as a particular hand or foot.

    A hand may belong to either arm and a foot to either leg, since left and right are exchanged in a pose that faces
    the wrong way. A free end may belong to any limb.
    """
    anchors, elsewhere = seen.anchors, contradicted_by(body, pose, seen.anchors, CONTRADICTED_M)
    ends = [
        (int(anchors.node[number]), INSIDE_TIP_M, tuple(chain for chain in CHAINS if _ends_in(chain, name)))
        for number, name in enumerate(ANCHOR_NAMES)
        if elsewhere[number]
    ]
    ends += [(cap.tip, 0.0, CHAINS) for cap in anchors.free]
    ends = [end for end in ends if end[2]]  # no limb ends in the head
    if not ends:
        return
    field = center_field(seen.whole)
    for node, beyond_m, chains in ends:
        nodes = limb_path(seen.whole, field, node)
        points, normals = (values[nodes].astype(np.float64) for values in (seen.whole.points_m, seen.whole.normals))
        yield LimbPath(points, -normals, beyond_m + field.distance_m[node] - field.distance_m[nodes]), chains


def contradicted_by(body: Body, pose: Pose, anchors: Anchors, beyond_m: float) -> np.ndarray:
    """Return (5,) bool: whether each anchor is farther than ``beyond_m`` from its place on the posed body; False for an
    anchor that was not found.
    """
    tips = pose_points(body, pose).points_m[anchor_points(body.points)]
    away_m = np.linalg.norm(anchors.position_m - tips, axis=1)  # NaN for an anchor that was not found
    return np.asarray(away_m > beyond_m)


def anchor_poses(body: Body, pose: Pose, seen: SeenAnchors) -> Iterator[Pose]:
    """Yield poses in which a limb lies along a path of ``anchor_paths``."""
    for path, chains in anchor_paths(body, pose, seen):
        yield from limb_poses(body, pose, path, chains)


def _ends_in(chain: Chain, anchor: str) -> bool:
    """Return whether the limb ends in the kind of anchor (hand or foot) that ``anchor`` names, on either side."""
    return anchor.startswith(("Hand", "Foot")) and chain.joints[0][:4] == anchor[:4]
