"""The parts of the body that clinicians name."""

from __future__ import annotations

from typing import Final

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
