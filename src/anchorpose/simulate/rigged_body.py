"""Read a body of any source from a file: skin, bones named as in this project, skinning weights, in any rest pose."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset, stored_asset
from anchorpose.body.kinematics import BodyMesh
from anchorpose.body.skin_points import body_points
from anchorpose.errors import InputError
from anchorpose.recording.regular_file import read_arrays
from anchorpose.rotations import rotation_matrices

KEYS: Final = ("vertices", "faces", "bone_names", "bone_heads", "bone_tails", "skin_bones", "skin_weights")
ENDS: Final = {
    "Arm": "ForeArm",
    "ForeArm": "Hand",
    "Hand": "FingerBase",
    "UpLeg": "Leg",
    "Leg": "Foot",
    "Foot": "ToeBase",
}
"""Bones that are turned to their direction in the asset's rest pose, each with the next bone, which begins at its
end.
"""


def read_rigged_body(path: Path) -> BodyMesh:
    """Read a body and turn its limbs to the rest pose of the body asset (the tracker's body model), so that every
    movement fits the body. The joints are the bones' heads: their ends towards the pelvis.

    The file's axes are X forward, Y up and Z to the body's right, in metres. Raises InputError if the file cannot be
    read, lacks an array, or has other bones than the body asset.
    """
    remedy = "give a body as docs/simulate.md describes it"
    arrays = read_arrays(path, KEYS, remedy)
    missing = [key for key in KEYS if key not in arrays]
    asset = stored_asset()
    if missing or sorted(arrays["bone_names"].tolist()) != sorted(asset.bone_names):
        what = f"lacks {', '.join(missing)}" if missing else "has other bones than the body asset"
        raise InputError(path, what, remedy)
    order = np.array([arrays["bone_names"].tolist().index(name) for name in asset.bone_names])
    rig = replace(
        asset,
        vertices=arrays["vertices"].astype(np.float64),
        faces=arrays["faces"].astype(np.int32),
        skin_bones=np.argsort(order)[arrays["skin_bones"]],
        skin_weights=arrays["skin_weights"] / arrays["skin_weights"].sum(axis=1, keepdims=True),
    )
    return _in_rest_pose(rig, asset, arrays["bone_heads"][order], arrays["bone_tails"][order])


@cache
def sampled_vertices(asset: BodyAsset) -> np.ndarray:
    """Return (p,): the vertex nearest to each of the tracker's skin points, after these points were scaled to the
    body's height.
    """
    points = body_points()
    if len(asset.vertices) == len(points.asset.vertices):
        return points.vertex
    scale = np.ptp(asset.vertices[:, 1]) / np.ptp(points.asset.vertices[:, 1])
    return np.asarray(cKDTree(asset.vertices).query(scale * points.asset.vertices[points.vertex])[1])


def _in_rest_pose(rig: BodyAsset, asset: BodyAsset, heads: np.ndarray, tails: np.ndarray) -> BodyMesh:
    """Turn each limb about its joint to the limb's direction in the rest pose of the body asset, and put the feet on
    the floor.
    """
    turns = np.tile(np.eye(3), (len(heads), 1, 1))
    for side in ("Left", "Right"):
        for name, end in ENDS.items():
            bone, next_bone = rig.bone(f"{side}{name}"), rig.bone(f"{side}{end}")
            own = heads[next_bone] - heads[bone]
            turns[bone] = _least_turn(own, asset.bone_heads[next_bone] - asset.bone_heads[bone])
    moved = heads.copy()
    for bone, parent in enumerate(rig.bone_parents.tolist()):
        if parent >= 0:
            moved[bone] = moved[parent] + turns[parent] @ (heads[bone] - heads[parent])
            if not rig.bone_names[bone].endswith(tuple(ENDS)):
                turns[bone] = turns[parent]
    skin = np.zeros_like(rig.vertices)
    for influence in range(rig.skin_bones.shape[1]):
        bones = rig.skin_bones[:, influence]
        place = moved[bones] + np.einsum("vij,vj->vi", turns[bones], rig.vertices - heads[bones])
        skin += rig.skin_weights[:, influence, None] * place
    drop = np.array([0.0, skin[:, 1].min(), 0.0])
    ends = moved + np.einsum("bij,bj->bi", turns, tails - heads)
    return BodyMesh(replace(rig, vertices=skin - drop), skin - drop, moved - drop, ends - drop)


def _least_turn(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return (3, 3) the smallest rotation that turns one direction to another."""
    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3)
    return np.asarray(rotation_matrices((axis / sine * np.arctan2(sine, a @ b))[None])[0])
