"""Give a rigged body of another source our bone names: python tools/import_rigged_body.py RIG.npz OUT.npz --names mhr.

RIG.npz: vertices (v, 3), faces (f, 3), bone_names, bone_parents, bone_heads (b, 3), skin_bones, skin_weights (v, w),
axes X forward, Y up, Z to the body's right, metres. Bones that have no counterpart are counted to the nearest ancestor
that has one; bones of the spine to ours at the same share of the way from hips to neck.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from anchorpose.body.asset import stored_asset

NAMES = {
    "mhr": {
        "Hips": "root",
        "Neck": "c_neck",
        "Head": "c_head",
        "Shoulder": "{l}_clavicle",
        "Arm": "{l}_uparm",
        "ForeArm": "{l}_lowarm",
        "Hand": "{l}_wrist",
        "FingerBase": "{l}_middle1",
        "HandFinger1": "{l}_middle2",
        "Thumb": "{l}_thumb0",
        "UpLeg": "{l}_upleg",
        "Leg": "{l}_lowleg",
        "Foot": "{l}_foot",
        "ToeBase": "{l}_ball",
    },
    "rocketbox": {
        "Hips": "Bip01 Pelvis",
        "Neck": "Bip01 Neck",
        "Head": "Bip01 Head",
        "Shoulder": "Bip01 {L} Clavicle",
        "Arm": "Bip01 {L} UpperArm",
        "ForeArm": "Bip01 {L} Forearm",
        "Hand": "Bip01 {L} Hand",
        "FingerBase": "Bip01 {L} Finger2",
        "HandFinger1": "Bip01 {L} Finger21",
        "Thumb": "Bip01 {L} Finger0",
        "UpLeg": "Bip01 {L} Thigh",
        "Leg": "Bip01 {L} Calf",
        "Foot": "Bip01 {L} Foot",
        "ToeBase": "Bip01 {L} Toe0",
    },
}
SPINE = ("Hips", "LowerBack", "Spine", "Spine1", "Neck")


def counterparts(names: dict[str, str]) -> dict[str, str]:
    """Our bone names to theirs, without those of the spine and the stubs of the pelvis."""
    found = {name: names[name] for name in ("Hips", "Neck", "Head")}
    for side, letter in (("Left", "l"), ("Right", "r")):
        for name, theirs in names.items():
            if name not in found:
                ours = f"{letter.upper()}Thumb" if name == "Thumb" else f"{side}{name}"
                found[ours] = theirs.format(l=letter, L=letter.upper())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--names", choices=list(NAMES), required=True)
    chosen = parser.parse_args()
    asset, rig = stored_asset(), np.load(chosen.rig)
    theirs = [str(name).replace("Bip02", "Bip01") for name in rig["bone_names"]]
    index = {ours: theirs.index(name) for ours, name in counterparts(NAMES[chosen.names]).items()}
    heads = np.zeros_like(asset.bone_heads)
    for ours, bone in index.items():
        heads[asset.bone(ours)] = rig["bone_heads"][bone]
    hips, neck, head = (heads[asset.bone(name)] for name in ("Hips", "Neck", "Head"))
    own = np.array([asset.bone_heads[asset.bone(name), 1] for name in SPINE])
    share = (own - own[0]) / (own[-1] - own[0])
    for name, part in zip(SPINE[1:-1], share[1:-1], strict=True):
        heads[asset.bone(name)] = hips + part * (neck - hips)
    heads[asset.bone("LHipJoint")] = heads[asset.bone("RHipJoint")] = hips
    heads[asset.bone("Neck1")] = (neck + head) / 2.0
    carried = np.zeros(len(theirs), dtype=np.int64)
    for bone, parent in enumerate(rig["bone_parents"].tolist()):
        known = [ours for ours, other in index.items() if other == bone and ours != "Hips"]
        along = (rig["bone_heads"][bone] - hips) @ (neck - hips) / ((neck - hips) @ (neck - hips))
        central = abs(rig["bone_heads"][bone, 2]) < 0.01 and along < 0.98
        if known:
            carried[bone] = asset.bone(known[0])
        elif central or parent < 0:
            carried[bone] = asset.bone(SPINE[int(np.searchsorted(share[1:-1], along, side="right"))])
        else:
            carried[bone] = carried[parent]
    tails = heads.copy()
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        if parent >= 0:
            tails[parent] = heads[bone]
    tails[asset.bone("Head")] = [head[0], rig["vertices"][:, 1].max(), 0.0]
    bones = {"bone_names": np.array(asset.bone_names), "bone_heads": heads, "bone_tails": tails}
    skin = {"skin_bones": carried[rig["skin_bones"]], "skin_weights": rig["skin_weights"]}
    np.savez_compressed(chosen.out, vertices=rig["vertices"], faces=rig["faces"], **bones, **skin)


if __name__ == "__main__":
    main()
