"""Represent a body for registration by a sparse, even sample of its skin; compute the positions of the sampled points
in a pose, and the derivatives of these positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import (
    BodyMesh,
    joint_derivative,
    joint_frames,
    missing_points,
    shape_body,
    skin,
    without_parts,
)
from anchorpose.body.pose import MOVING_BONES, POSE_SIZE, Pose, descendants, moving_bones
from anchorpose.body.segments import load_body_asset

# number of skin points; with this number, the points on an adult are about 28 mm apart, which is half of the narrowest
# limb's width
POINT_COUNT: Final = 2400
CLOTHES: Final = {
    "trunk": ("Hips", "LHipJoint", "RHipJoint", "LowerBack", "Spine", "Spine1", "LeftShoulder", "RightShoulder"),
    "sleeves": ("LeftArm", "LeftForeArm", "RightArm", "RightForeArm"),
    "trousers": ("LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"),
    "shoes": ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"),
}
"""Pieces of clothing, each with a thickness of its own, and the bones whose skin each piece covers."""

# number of patches of skin; patches are about 14 cm apart and as large as a muscle, a fold or the rim of a brace
PATCHES: Final = 96
PATCH_M: Final = 0.07  # m, standard deviation of a patch's bell-shaped profile
OFFSETS: Final = len(CLOTHES) + PATCHES
"""Number of offsets (parameters) by which the seen surface lies off the bare skin: pieces of clothing, then patches."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinPoints:
    """The sampled skin points of an asset, with all values that do not depend on a person's shape."""

    asset: BodyAsset
    vertex: np.ndarray  # (p,) index of the point's vertex in the asset
    weights: np.ndarray  # (p, b) skinning weight of every bone
    bones: np.ndarray  # (p, w) bones that move the point, the largest weight first
    influence: np.ndarray  # (p, w) weights of these bones, padded with 0
    part: np.ndarray  # (p,) bone that moves the point most
    covered: np.ndarray  # (p, c) 0 to 1; the point moves outwards by this share of each of the ``OFFSETS`` offsets
    below: np.ndarray  # (m, b) 1 at each moving bone and its descendants, else 0 (``descendants``)
    moving: np.ndarray  # (m,) index of each moving bone
    faces_of: np.ndarray  # (p, f) mesh faces around each point, padded by repeating the last face


@dataclass(frozen=True, slots=True, eq=False)
class FittedShape:
    """A person's shape, clothes included."""

    coefficients: np.ndarray  # (k,) shape coefficients, as in ``BodyAsset``
    offset_m: np.ndarray  # (OFFSETS,) thickness of each piece of clothing, then offset of each patch of skin
    missing: tuple[str, ...] = ()  # names of the parts that the body lacks

    def mesh(self, asset: BodyAsset) -> BodyMesh:
        """Return the skin and skeleton without clothes."""
        whole = shape_body(asset, self.coefficients)
        return without_parts(whole, self.missing) if self.missing else whole


def even_clothes(thickness_m: float) -> np.ndarray:
    """Return the offsets (OFFSETS,) of the seen surface from bare skin if all pieces of clothing have the same
    thickness; the patches of skin have offsets of 0.
    """
    return np.where(np.arange(OFFSETS) < len(CLOTHES), thickness_m, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The body of one person: its sampled skin at rest, and the whole mesh with its skeleton."""

    points: SkinPoints
    shape: FittedShape
    mesh: BodyMesh
    rest_m: np.ndarray  # (p, 3) the skin points in the rest pose, moved outwards by clothes and patches
    rest_normals: np.ndarray  # (p, 3) outward unit normals

    def transforms(self, pose: Pose) -> np.ndarray:
        """Return the rigid motions T_world_rest (b, 4, 4) of the bones from the rest pose to a pose."""
        return self.mesh.bone_transforms(pose.rotations, pose.root_m)

    def joints(self, pose: Pose) -> np.ndarray:
        """Return the joints (21, 3) in a pose, in the order of ``JOINT_NAMES``, metres, world."""
        return self.mesh.joints(self.transforms(pose))


@dataclass(frozen=True, slots=True, eq=False)
class PosedPoints:
    """The skin points in a pose."""

    points_m: np.ndarray  # (p, 3) m, places in the world
    normals: np.ndarray  # (p, 3) normals in the world
    transforms: np.ndarray  # (b, 4, 4) T_world_rest of the bones


@cache
def skin_points(asset: BodyAsset) -> SkinPoints:
    """Sample ``POINT_COUNT`` vertices of the outer skin by farthest-point sampling."""
    vertex = _spread_out(asset, POINT_COUNT)
    weights = np.zeros((len(vertex), len(asset.bone_names)))
    rows = np.arange(len(vertex))[:, None]
    np.add.at(weights, (rows, asset.skin_bones[vertex]), asset.skin_weights[vertex])
    part = weights.argmax(axis=1)
    bones = np.argsort(-weights, axis=1, kind="stable")[:, : (weights > 0.0).sum(axis=1).max()]
    names = [asset.bone_names[bone] for bone in part]
    clothed = np.array([[name in bones for bones in CLOTHES.values()] for name in names], dtype=np.float64)
    return SkinPoints(
        asset=asset,
        vertex=vertex,
        weights=weights,
        bones=np.ascontiguousarray(bones),
        influence=np.take_along_axis(weights, bones, axis=1),
        part=part,
        covered=np.hstack([clothed, _patches(asset, vertex)]),
        below=descendants(asset),
        moving=moving_bones(asset),
        faces_of=_faces_around(asset, vertex),
    )


def body_points() -> SkinPoints:
    """Return the skin points of the asset that is fitted to patients."""
    return skin_points(load_body_asset())


def _outer_vertices(asset: BodyAsset) -> np.ndarray:
    """Return the vertices of the mesh's largest connected component: the skin without eyes, teeth and tongue."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    f = asset.faces
    count = len(asset.vertices)
    edges = coo_matrix((np.ones(3 * len(f)), (f.ravel(), np.roll(f, 1, axis=1).ravel())), shape=(count, count))
    _, piece = connected_components(edges, directed=False)
    return np.flatnonzero(piece == np.bincount(piece).argmax())


def _spread_out(asset: BodyAsset, count: int) -> np.ndarray:
    candidates = _outer_vertices(asset)
    points = asset.vertices[candidates]
    x, y, z = np.ascontiguousarray(points.T)  # with a separate array per axis, the loop takes a tenth of the time
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(points), np.inf)
    chosen[0] = y.argmax()
    for i in range(1, count):
        last = points[chosen[i - 1]]
        np.minimum(distance, (x - last[0]) ** 2 + (y - last[1]) ** 2 + (z - last[2]) ** 2, out=distance)
        chosen[i] = distance.argmax()
    return candidates[np.sort(chosen)]


def _patches(asset: BodyAsset, vertex: np.ndarray) -> np.ndarray:
    """Return (p, PATCHES) the share of each patch's offset by which each point moves: a bell-shaped profile around the
    patch's middle, limited to skin that faces the same way as the patch's middle.
    """
    place = asset.vertices[vertex]
    normals = _normals(asset.vertices, asset.faces[_faces_around(asset, vertex)])
    middles = np.zeros(PATCHES, dtype=np.int64)
    away = np.linalg.norm(place - place.mean(axis=0), axis=1)
    nearest = np.full(len(place), np.inf)
    for patch in range(PATCHES):
        middles[patch] = away.argmax() if patch == 0 else nearest.argmax()
        nearest = np.minimum(nearest, ((place - place[middles[patch]]) ** 2).sum(axis=1))
    distance2 = ((place[:, None] - place[middles]) ** 2).sum(axis=2)
    same_way = np.clip(normals @ normals[middles].T, 0.0, 1.0)
    return np.asarray(np.exp(-0.5 * distance2 / PATCH_M**2) * same_way * (distance2 < (3.0 * PATCH_M) ** 2))


def _faces_around(asset: BodyAsset, vertex: np.ndarray) -> np.ndarray:
    corner = asset.faces.ravel()
    order = np.argsort(corner, kind="stable")
    start = np.searchsorted(corner[order], vertex)
    end = np.searchsorted(corner[order], vertex, side="right")
    width = int((end - start).max())
    column = np.minimum(np.arange(width), (end - start - 1)[:, None])
    return order[start[:, None] + column] // 3


def build_body(points: SkinPoints, shape: FittedShape) -> Body:
    """Return the body of a shape, with its skin points and their normals in the rest pose."""
    mesh = shape.mesh(points.asset)
    # normals are computed on the whole body, since the shrunken skin of missing parts has no normals
    whole = shape_body(points.asset, shape.coefficients) if shape.missing else mesh
    normals = _normals(whole.vertices, points.asset.faces[points.faces_of])
    offset_m = points.covered @ shape.offset_m
    if shape.missing:
        offset_m[missing_points(points.asset, points.part, shape.missing)] = 0.0
    rest_m = mesh.vertices[points.vertex] + offset_m[:, None] * normals
    return Body(points, shape, mesh, rest_m, normals)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (p, 3) outward unit normals from the faces (p, f, 3) around each point."""
    corners = vertices[faces]  # (p, f, 3, 3)
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]).sum(axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


@lru_cache(maxsize=8)  # cached, since several steps of one frame's processing need the posed points
def pose_points(body: Body, pose: Pose) -> PosedPoints:
    """Pose the sampled points by linear blend skinning; the result is shared and must not be changed."""
    transforms = body.transforms(pose)
    posed, normals = skin(body.points.bones, body.points.influence, transforms, body.rest_m, body.rest_normals)
    return PosedPoints(posed, normals, transforms)


def pose_jacobian(body: Body, posed: PosedPoints, index: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return (n, POSE_SIZE) the derivative of each chosen point's movement along its direction, by each pose parameter.

    index (n,): the chosen points; direction (n, 3): unit vectors. The parameters are the turn of each moving bone in
    its parent's frame, then the translation of the root.
    """
    transforms = posed.transforms
    used, back = np.unique(index, return_inverse=True)
    weights = body.points.weights[used]
    placed = np.einsum("bij,nj->nbi", transforms[:, :3, :3], body.rest_m[used]) + transforms[:, :3, 3]
    # (n, m, 3): for each used point and moving bone, the sum of weight x place over this bone and its descendants
    carried = body.points.below @ (weights[..., None] * placed)
    share = weights @ body.points.below.T
    pivot, frame = joint_frames(transforms, body.mesh.bone_heads, body.points.asset.bone_parents, body.points.moving)
    lever = carried - share[..., None] * pivot
    torque = np.cross(lever[back], direction[:, None, :])  # d(point . direction) = turn . (lever x direction)
    jacobian = np.empty((len(index), POSE_SIZE))
    jacobian[:, :-3] = np.einsum("nmi,mij->nmj", torque, frame).reshape(len(index), 3 * len(MOVING_BONES))
    jacobian[:, -3:] = direction
    return jacobian


def shape_offsets(asset: BodyAsset, posed: PosedPoints, count: int) -> np.ndarray:
    """Return (b, count, 3) m: by how much one unit of each coefficient changes the translation of each bone's motion
    from the rest pose to the posed body. The bone's posed points move by this much in addition to the effect of their
    change at rest.
    """
    transforms, head_basis = posed.transforms, asset.bone_head_basis[:count]
    shift = np.zeros((len(transforms), count, 3))  # shift of each bone's head in the world, by each coefficient
    for bone, parent in enumerate(asset.bone_parents):
        if parent >= 0:
            step = head_basis[:, bone] - head_basis[:, parent]
            shift[bone] = shift[parent] + step @ transforms[parent, :3, :3].T
    return shift - np.einsum("bij,kbj->bki", transforms[:, :3, :3], head_basis)


def joints_by_shape(body: Body, posed: PosedPoints, count: int) -> np.ndarray:
    """Return the derivative (21, 3, count) of the joints in the world by the first ``count`` shape coefficients at a
    fixed pose.
    """
    asset, bones = body.points.asset, joint_bones(body.points.asset)
    at_rest = np.einsum("nij,knj->nik", posed.transforms[bones, :3, :3], asset.bone_head_basis[:count, bones])
    return np.asarray(at_rest + shape_offsets(asset, posed, count)[bones].transpose(0, 2, 1))


def joint_jacobian(body: Body, transforms: np.ndarray, bones: np.ndarray, joints_m: np.ndarray) -> np.ndarray:
    """Return the derivative (n, 3, POSE_SIZE), by the pose, of points joints_m (n, 3) in the world; each point is fixed
    to one of the bones (n,).
    """
    pivot, frame = joint_frames(transforms, body.mesh.bone_heads, body.points.asset.bone_parents, body.points.moving)
    return joint_derivative(pivot, frame, body.points.below, bones, joints_m)


def place_variance(jacobian: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the variance (n,), m2, of n places that depend on the pose, as the mean over the three axes. jacobian (n,
    3, POSE_SIZE): derivative of the places by the pose; covariance: the covariance of the pose.
    """
    return np.asarray(((jacobian @ covariance) * jacobian).sum(axis=(1, 2)) / 3.0)
