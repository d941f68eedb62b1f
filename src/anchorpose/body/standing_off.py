"""Find body segments that do not look human: the seen surface stands off (lies away from) the learnt body, or the limb
is too thick.

The body model does not fit a segment under an orthosis, a cast, a bandage or a skirt, however well the body's shape was
learnt. So the bone lengths and joints of a segment that does not look human get a larger sigma.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.segments import SIDES, TRUNK
from anchorpose.body.skin_points import CLOTHES, FittedShape, SkinPoints
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.recording import CoveredPart

# m; a segment stands off if the offsets of its patches of skin move its skin points by more than this (95th percentile
# over the points). For a segment with a brace, the 95th percentile of the skin points' movement was 0.030 to 0.036 m;
# without a brace, it was below 0.020 m, except for loose trousers, which reach 0.035 m
LEAST_M: Final = 0.020
# standard deviations of girth; a segment whose girth exceeds its expected girth (``_thicker``) by more than this is too
# thick. Without braces, the girths of both sides' segments differed by at most 0.9 standard deviations; with a brace,
# by 2.9 to 6.7
TOO_THICK: Final = 2.0
# standard deviations of girth above the mean; the expected girth of a segment is the girth of the other side's segment,
# but at most this, and at least the mean
ORDINARY: Final = 0.5
JOINT_SHARE: Final = 0.5  # sigma (m) of a segment's joints along each axis, per metre by which its skin stands off
BONE_SHARE: Final = 0.5  # sigma (m) of the length of a segment's bone, per metre by which its skin stands off

_LIMBS: Final = {
    "upper_arm": ("Arm", ("Shoulder", "Elbow")),
    "forearm": ("ForeArm", ("Elbow", "Wrist", "Hand")),
    "thigh": ("UpLeg", ("Hip", "Knee")),
    "shank": ("Leg", ("Knee", "Ankle", "Foot")),
}
"""The bone of each segment, and the joints that move with it: the joints at its ends, and a hand or foot beyond."""


def standing_off(points: SkinPoints, shape: FittedShape) -> dict[CoveredPart, float]:
    """Return, for each segment that does not look human, by how many metres the seen surface stands off from the learnt
    body. The keys are the segments' names, as in ``Subject.covered``.
    """
    found = dict[CoveredPart, float]()
    for name, mine in points_of_segments(points).items():
        # patches of neighbouring segments extend over the joint onto this segment; these patches are not used
        own = len(CLOTHES) + patches_of(points, name)
        off_m = np.abs(points.covered[np.ix_(mine, own)] @ shape.offset_m[own])
        away_m, thicker = float(np.percentile(off_m, 95)), _thicker(points.asset, shape, name)
        if thicker > TOO_THICK:
            found[name] = max(away_m, thicker * _unit_of_girth_m(points, name))
        elif away_m > LEAST_M:
            found[name] = away_m
    return found


def _thicker(asset: BodyAsset, shape: FittedShape, name: CoveredPart) -> float:
    """Return by how many standard deviations of girth a segment is thicker than expected. The expected girth is the
    girth of the other side's limb, but at least the mean girth, and at most ``ORDINARY`` standard deviations above the
    mean.
    """
    if name == "trunk":
        return 0.0
    segment, side = name.rsplit("_", 1)
    left, right = (float(shape.coefficients[asset.own_row(f"{segment}_girth_{each}")]) for each in SIDES)
    own, other = (left, right) if side == SIDES[0] else (right, left)
    return own - min(max(other, 0.0), ORDINARY)


@cache
def _unit_of_girth_m(points: SkinPoints, name: CoveredPart) -> float:
    """Return by how many metres one standard deviation of a segment's girth moves its skin."""
    segment, side = name.rsplit("_", 1)
    moved = points.asset.vertex_basis[points.asset.own_row(f"{segment}_girth_{side}"), points.vertex]
    return float(np.linalg.norm(moved[points_of_segments(points)[name]], axis=1).mean())


@lru_cache(maxsize=4)  # cached, since all frames have the same shape
def standing_off_sigma_m(points: SkinPoints, shape: FittedShape) -> np.ndarray:
    """Return (21,) metres per axis: the additional sigma of each joint of a segment that does not look human
    (``standing_off``); 0 for other joints.
    """
    sigma = np.zeros(len(JOINT_INDEX))
    for name, away_m in standing_off(points, shape).items():
        for joint in _joints_of(name):
            sigma[joint] = max(sigma[joint], JOINT_SHARE * away_m)
    return sigma


def _joints_of(name: CoveredPart) -> tuple[int, ...]:
    if name == "trunk":
        return tuple(JOINT_INDEX[joint] for joint in ("SpineBase", "SpineMid", "SpineShoulder"))
    segment, side = name.rsplit("_", 1)
    return tuple(JOINT_INDEX[f"{joint}{side.capitalize()}"] for joint in _LIMBS[segment][1])


@cache
def points_of_segments(points: SkinPoints) -> dict[CoveredPart, np.ndarray]:
    """Return, for each segment, (p,) bool: whether each skin point moves with the segment."""
    bones: dict[CoveredPart, tuple[str, ...]] = {"trunk": TRUNK}
    for segment, (bone, _) in _LIMBS.items():
        bones |= {f"{segment}_{side}": (f"{side.capitalize()}{bone}",) for side in SIDES}  # type: ignore[misc]
    return {name: np.isin(points.part, [points.asset.bone(bone) for bone in chosen]) for name, chosen in bones.items()}


@cache
def patches_of(points: SkinPoints, part: str) -> np.ndarray:
    """Return the indices (k,) of the patches of skin that lie mostly on a segment; an empty array for hands, feet and
    head.
    """
    mine = points_of_segments(points).get(part)  # type: ignore[call-overload]
    patches = points.covered[:, len(CLOTHES) :]
    if mine is None:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(patches[mine].sum(axis=0) > 0.5 * patches.sum(axis=0))
