"""Give simulated bodies properties outside of the tracker's shape space (the body shapes that its model can represent):
independent lengths and girths of the segments, shoes, braces, stumps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, get_args

import numpy as np

from anchorpose.body.kinematics import BodyMesh, below, stump_of
from anchorpose.recording.recording import MissingPart
from anchorpose.settings import settings
from anchorpose.simulate.choices import BraceName, Build

BUILDS: Final[tuple[Build, ...]] = get_args(Build)

# relative standard deviations, between bodies, of the length (first line) and of the girth (second line) of each limb
# segment
LENGTH_SPREAD: Final = {"UpLeg": 0.05, "Leg": 0.04, "Arm": 0.04, "ForeArm": 0.045, "Hand": 0.04, "Foot": 0.05}
GIRTH_SPREAD: Final = {"UpLeg": 0.06, "Leg": 0.06, "Arm": 0.07, "ForeArm": 0.06, "Hand": 0.04, "Foot": 0.04}
TRUNK: Final = ("LowerBack", "Spine", "Spine1")
TRUNK_SPREAD: Final = (0.06, 0.035, 0.04)  # relative standard deviations of the trunk's depth, height and breadth
MOST_ASYMMETRIC: Final = 0.04  # maximum relative difference in length, and in girth, between a left and a right segment
WASTED: Final = (0.75, 0.90)  # range of the factor on the girth of wasted thighs and shanks
STRONGER: Final = (1.02, 1.10)  # range of the factor on the girth of strong arms
BELLY_M: Final = (0.03, 0.08)  # m, range of a belly's bulge
FATTER: Final = (1.05, 1.20)  # range of the factor on the girth of the segments of a heavy person
SHOE_M: Final = (0.003, 0.008)  # m, range of the thickness of a shoe's upper
SOLE_M: Final = (0.010, 0.030)  # m, range of the thickness of a sole
SHOD_SHARE: Final = 0.75  # probability that a person wears shoes
BRACE_M: Final = (0.008, 0.018)  # m, range of the gap between a brace and the skin; ``with_brace`` defines this gap
BRACED: Final[dict[BraceName, tuple[str, ...]]] = {
    "left shank": ("LeftLeg",),
    "right shank": ("RightLeg",),
    "left thigh": ("LeftUpLeg",),
    "right thigh": ("RightUpLeg",),
    "trunk": ("LowerBack", "Spine"),
}


@settings
class OtherBody:
    """The ways in which the patient's body differs from the bodies in the shape space of the body asset."""

    build: Build = "ordinary"
    braces: tuple[BraceName, ...] = ()  # segments that are covered by stiff orthoses
    file: Path | None = None  # file of a body for ``rigged_body``; None = the body is drawn from the body asset
    missing: tuple[MissingPart, ...] = ()  # limbs or parts of limbs that the patient lacks; stated in recording.json


@dataclass(frozen=True, slots=True)
class Scales:
    """Factors on the size of each bone's body segment, relative to the body before scaling."""

    length: np.ndarray  # (b,) factors on the length of the segments
    girth: np.ndarray  # (b, 2) factors on depth and breadth; for limbs, both are equal


def draw_scales(rng: np.random.Generator, names: tuple[str, ...], build: Build) -> Scales:
    """Draw the scales of all body segments. Scales of different segments are independent, but left and right segments
    have nearly equal scales.
    """
    length, girth = np.ones(len(names)), np.ones((len(names), 2))
    if build == "ordinary":
        return Scales(length, girth)
    for part, spread in LENGTH_SPREAD.items():
        both = np.exp(rng.normal(0.0, spread)), np.exp(rng.normal(0.0, GIRTH_SPREAD[part]))
        if part in ("UpLeg", "Leg") and build == "wasted-legs":
            both = both[0], rng.uniform(*WASTED)
        if part in ("Arm", "ForeArm") and build == "wasted-legs":
            both = both[0], rng.uniform(*STRONGER)
        if build == "heavy":
            both = both[0], both[1] * rng.uniform(*FATTER)
        apart = rng.uniform(-0.5, 0.5) * MOST_ASYMMETRIC, rng.uniform(-0.5, 0.5) * MOST_ASYMMETRIC
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            bone = names.index(f"{side}{part}")
            length[bone] = both[0] * (1.0 + sign * apart[0])
            girth[bone] = both[1] * (1.0 + sign * apart[1])
    depth, height, breadth = np.exp(rng.normal(0.0, TRUNK_SPREAD))
    trunk = np.isin(names, TRUNK)
    length[trunk], girth[trunk] = height, (depth, breadth)
    return Scales(length, girth)


def rescale(body: BodyMesh, scales: Scales) -> BodyMesh:
    """Scale each bone's segment of the body along and across its axis. Where bones meet, their scales are blended."""
    asset, heads = body.asset, body.bone_heads
    stretch = np.tile(np.eye(3), (len(heads), 1, 1))
    for bone, name in enumerate(asset.bone_names):
        if name in TRUNK:
            stretch[bone] = np.diag([scales.girth[bone, 0], scales.length[bone], scales.girth[bone, 1]])
        else:
            along = body.bone_tails[bone] - heads[bone]
            along /= np.linalg.norm(along)
            across = np.eye(3) - np.outer(along, along)
            stretch[bone] = scales.length[bone] * np.outer(along, along) + scales.girth[bone, 0] * across
    _carry_to_ends(asset.bone_names, asset.bone_parents, stretch)
    moved = heads.copy()
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        if parent >= 0:
            moved[bone] = moved[parent] + stretch[parent] @ (heads[bone] - heads[parent])
    tails = moved + np.einsum("bij,bj->bi", stretch, body.bone_tails - heads)
    skin = np.zeros_like(body.vertices)
    for influence in range(asset.skin_bones.shape[1]):
        bones = asset.skin_bones[:, influence]
        place = moved[bones] + np.einsum("vij,vj->vi", stretch[bones], body.vertices - heads[bones])
        skin += asset.skin_weights[:, influence, None] * place
    return BodyMesh(asset, skin, moved, tails)


def _carry_to_ends(names: tuple[str, ...], parents: np.ndarray, stretch: np.ndarray) -> None:
    """Set the scaling matrix (``stretch``, (b, 3, 3)) of fingers and toes to the same factor in all directions: the
    geometric mean of the three factors of their hand or foot.
    """
    for bone, name in enumerate(names):
        if name.endswith(("FingerBase", "HandFinger1", "Thumb", "ToeBase")):
            stretch[bone] = np.eye(3) * np.cbrt(np.linalg.det(stretch[parents[bone]]))


def to_height(body: BodyMesh, height_m: float) -> BodyMesh:
    """Scale the whole body to a height, with its feet on the floor."""
    factor = height_m / float(np.ptp(body.vertices[:, 1]))
    drop = np.array([0.0, body.vertices[:, 1].min(), 0.0])
    return BodyMesh(body.asset, *(factor * (part - drop) for part in (body.vertices, body.bone_heads, body.bone_tails)))


def with_belly(body: BodyMesh, normals: np.ndarray, out_m: float) -> BodyMesh:
    """Add a bulge of fat, at most ``out_m`` thick, in front of the lower trunk."""
    asset = body.asset
    trunk = np.isin(asset.main_bone(), [asset.bone(name) for name in ("Hips", "LowerBack", "Spine")])
    waist_m = float(body.bone_heads[asset.bone("LowerBack"), 1] + 0.05)
    front = body.vertices[trunk & (np.abs(body.vertices[:, 1] - waist_m) < 0.05), 0].max()
    away = (body.vertices - [front - 0.03, waist_m, 0.0]) / [0.16, 0.13, 0.15]
    bulge = np.exp(-0.5 * (away**2).sum(axis=1)) * trunk * np.clip(normals[:, 0], 0.0, 1.0)
    return replace(body, vertices=body.vertices + out_m * bulge[:, None] * normals)


def with_shoes(body: BodyMesh, normals: np.ndarray, upper_m: float, sole_m: float) -> BodyMesh:
    """Move the skin of the feet outward by a shoe's upper, and downward by its sole."""
    asset = body.asset
    foot = np.isin(asset.bone_names, [f"{side}{end}" for side in ("Left", "Right") for end in ("Foot", "ToeBase")])
    share = (asset.skin_weights * foot[asset.skin_bones]).sum(axis=1)
    low = np.clip(1.0 - (body.vertices[:, 1] - body.vertices[:, 1].min()) / 0.03, 0.0, 1.0)
    moved = body.vertices + (share * upper_m)[:, None] * normals
    moved[:, 1] -= share * low * sole_m
    return replace(body, vertices=moved)


def with_brace(body: BodyMesh, bones: tuple[str, ...], off_m: float) -> tuple[BodyMesh, np.ndarray]:
    """Add a stiff shell around some bones' segments. Also return the cover (v,): from 0 (bare vertex) to 1 (covered).

    On the trunk, the shell is ``off_m`` from the skin. On legs, it is at least ``off_m`` from the skin, and its radius
    is at least ``off_m`` more than the 90th percentile of the radii of the segment's skin.
    """
    asset, vertices, covered = body.asset, body.vertices.copy(), np.zeros(len(body.vertices))
    for name in bones:
        bone = asset.bone(name)
        along = body.bone_tails[bone] - body.bone_heads[bone]
        along /= np.linalg.norm(along)
        share = (asset.skin_weights * (asset.skin_bones == bone)).sum(axis=1)
        out = body.vertices - body.bone_heads[bone]
        out -= np.outer(out @ along, along)
        radius = np.linalg.norm(out, axis=1)
        shell = np.maximum(np.percentile(radius[share > 0.9], 90), radius) if name.endswith("Leg") else radius
        vertices += (share * (shell + off_m - radius) / np.maximum(radius, 1e-6))[:, None] * out
        covered = np.minimum(covered + share, 1.0)
    return replace(body, vertices=vertices), covered


def amputated(body: BodyMesh, parts: tuple[MissingPart, ...]) -> BodyMesh:
    """Return the body with the skin of each missing part shrunk to a point at the stump. The bones do not change."""
    asset, vertices = body.asset, body.vertices.copy()
    bones, weights = asset.skin_bones.copy(), asset.skin_weights.copy()
    for part in parts:
        stump = stump_of(asset, part)
        gone = np.isin(asset.main_bone(), np.flatnonzero(below(asset, stump)))
        vertices[gone] = body.bone_heads[stump]
        bones[gone], weights[gone] = asset.bone_parents[stump], 0.0
        weights[gone, 0] = 1.0
    return replace(body, asset=replace(asset, skin_bones=bones, skin_weights=weights), vertices=vertices)
