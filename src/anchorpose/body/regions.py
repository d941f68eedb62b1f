"""The parts of the body that clinicians name, as sets of skin points."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.skin_points import SkinPoints

KNEE_RADIUS_M: Final = 0.10  # from the joint's centre: the kneecap and a hand's breadth around the leg

_MIDDLE: Final = {
    "head": ("Head",),
    "neck_and_shoulders": ("Neck", "Neck1", "LeftShoulder", "RightShoulder"),
    "chest": ("Spine", "Spine1"),
    "belly": ("LowerBack",),
    "pelvis": ("Hips", "LHipJoint", "RHipJoint"),
}
_SIDED: Final = {
    "upper_arm": ("{side}Arm",),
    "forearm": ("{side}ForeArm",),
    "hand": ("{side}Hand", "{initial}Thumb", "{side}FingerBase", "{side}HandFinger1"),
    "thigh": ("{side}UpLeg",),
    "knee": ("{side}UpLeg", "{side}Leg"),
    "shank": ("{side}Leg",),
    "foot": ("{side}Foot", "{side}ToeBase"),
}


def _all_regions() -> dict[str, tuple[str, ...]]:
    sided = {
        f"{name}_{side.lower()}": tuple(bone.format(side=side, initial=side[0]) for bone in bones)
        for side in ("Left", "Right")
        for name, bones in _SIDED.items()
    }
    return _MIDDLE | sided


REGION_BONES: Final = _all_regions()
"""The bones that each region's skin moves with; chest, belly and pelvis go all around the trunk."""

REGIONS: Final = tuple(REGION_BONES)


@cache
def region_of_points(points: SkinPoints) -> np.ndarray:
    """(p,) index into ``REGIONS`` of every skin point; the knee is what of thigh and shank lies about its joint."""
    asset = points.asset
    whole = {bone: k for k, (name, bones) in enumerate(REGION_BONES.items()) if not _is_knee(name) for bone in bones}
    of_bone = np.array([whole[name] for name in asset.bone_names])
    region = of_bone[points.part]
    place = asset.vertices[points.vertex]
    for side in ("Left", "Right"):
        leg = np.isin(points.part, [asset.bone(f"{side}UpLeg"), asset.bone(f"{side}Leg")])
        near = np.linalg.norm(place - asset.bone_heads[asset.bone(f"{side}Leg")], axis=1) < KNEE_RADIUS_M
        region[leg & near] = REGIONS.index(f"knee_{side.lower()}")
    return region


def _is_knee(region: str) -> bool:
    return region.startswith("knee")


@cache
def area_of_point(points: SkinPoints) -> float:
    """Square metres of skin that each of the evenly spread points stands for, on the mean adult."""
    asset = points.asset
    a, b, c = (asset.vertices[asset.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 / len(points.vertex))
